"""Settings of volumetric light."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from ...core.conditions import When
from ...core.params import Colour, Group, Params, param


class Method(Enum):
    """How lit stretches of a ray become light."""

    WALK = "walk"
    LUT = "lut"


class Scale(Enum):
    """Of the image that is evaluated, to each side of the one that is baked."""

    FULL = "1"
    HALF = "1/2"
    QUARTER = "1/4"

    @property
    def stride(self) -> int:
        return {"1": 1, "1/2": 2, "1/4": 4}[self.value]


MEDIUM = Group("Medium", is_open=True)
OWN_MEDIUM = When("use_scene_medium", (False,))


@dataclass(frozen=True)
class VolumetricLightParams(Params):
    use_scene_medium: bool = param(
        True,
        label="From Scene",
        group=MEDIUM,
        doc="The medium is the world's volume or a mesh's; off: the coefficients below, everywhere",
    )
    scattering_per_m: Colour = param(
        Colour(0.02, 0.02, 0.02),
        hard=(0.0, 1e6),
        soft=(0.0, 1.0),
        unit="1/m",
        group=MEDIUM,
        used_when=OWN_MEDIUM,
        doc="Share of light turned aside in each metre, by channel",
    )
    absorption_per_m: Colour = param(
        Colour(0.0, 0.0, 0.0),
        hard=(0.0, 1e6),
        soft=(0.0, 1.0),
        unit="1/m",
        group=MEDIUM,
        used_when=OWN_MEDIUM,
        doc="Share of light taken in each metre, by channel",
    )
    anisotropy: float = param(
        0.0,
        hard=(-0.9999, 0.9999),
        soft=(-0.95, 0.95),
        group=MEDIUM,
        used_when=OWN_MEDIUM,
        doc="Mean cosine of scattering (Henyey-Greenstein): above 0 light mostly goes on, below it returns",
    )
    light_samples: int = param(
        8,
        hard=(1, 256),
        soft=(1, 32),
        trades_time=True,
        doc="Points of a light with a size that cast shadows, each with its maps; of a sun twice as many",
    )
    resolution: int = param(
        1024,
        hard=(64, 4096),
        unit="texel",
        trades_time=True,
        label="Map Size",
        doc="Side of each light's depth map",
    )
    method: Method = param(
        Method.WALK,
        trades_time=True,
        words={"lut": "Table"},
        doc="walk integrates each lit stretch; lut reads a table of the antiderivative",
    )
    scale: Scale = param(
        Scale.FULL,
        trades_time=True,
        label="Resolution",
        words={"1": "Full", "1/2": "Half", "1/4": "Quarter"},
        doc="Side of the evaluated image to that of the baked one; depths guide the way back",
    )
    order: int = param(
        5,  # 1.4e-5 of an open lamp's light; 4 err by 2.4e-4
        hard=(2, 16),
        unit="node",
        trades_time=True,
        doc="Quadrature nodes for every factor e² of distance or e⁶ of extinction",
    )

    def finer(self) -> tuple[str, ...]:
        """Where a coarser image is evaluated, edges err most."""
        coarse = () if self.scale == Scale.FULL else ("scale=1",)
        return (*coarse, *super().finer())

    def lighter(self, share: float) -> VolumetricLightParams:
        """Fewer points of each light, each of which has its maps, smaller maps, and one ray for four
        pixels."""
        return replace(
            self,
            light_samples=max(1, round(0.25 * self.light_samples * share)),
            resolution=max(128, round(self.resolution * share)),
            scale=Scale.HALF if self.scale == Scale.FULL else self.scale,
        )
