"""Settings of soft shadows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from ...core.conditions import When
from ...core.params import Group, Params, param


class Method(Enum):
    """How backprojected texels add up to occlusion, or rays without any map. Automatic is rays wherever they
    are traced: they take the least time, and all that they are wrong by falls with the number of samples."""

    AUTOMATIC = "automatic"
    AREA = "area"
    BITMASK = "bitmask"
    HYBRID = "hybrid"
    RAYS = "rays"


OF_MAPS = When("method", (Method.AREA, Method.BITMASK, Method.HYBRID))
SAMPLING = Group("Sampling")
BIAS = Group("Bias")


@dataclass(frozen=True)
class SoftShadowParams(Params):
    layers: int = param(
        3,
        hard=(1, 8),
        trades_time=True,
        per_light=True,
        used_when=OF_MAPS,
        doc="Depths kept per texel; more stop light from leaking between overlapping casters",
    )
    resolution: int = param(
        1024,
        hard=(128, 4096),
        unit="texel",
        trades_time=True,
        per_light=True,
        label="Map Size",
        used_when=OF_MAPS,
        doc="Side of each light's depth map",
    )
    method: Method = param(
        Method.AUTOMATIC,
        trades_time=True,
        per_light=True,
        automatic=(Method.RAYS, Method.BITMASK),
        doc="How texels add up: area is the thesis's sum, bitmask counts light samples, hybrid adds rays; or "
        "rays alone, a few for each of a pixel's samples. Automatic is rays on the CPU, bitmask on a GPU",
    )
    max_samples: int = param(
        512,
        hard=(16, 65536),
        soft=(256, 16384),
        unit="texel",
        trades_time=True,
        label="Max Texels",
        group=SAMPLING,
        used_when=OF_MAPS,
        doc="Texels of the map that one point may read; beyond it a coarser map is read",
    )
    refinements: int = param(
        1,
        hard=(0, 4),
        trades_time=True,
        group=SAMPLING,
        used_when=OF_MAPS,
        doc="Times the search region is narrowed by the nearest caster in it",
    )
    gradient_scale: float = param(
        1.0,
        hard=(0.0, 16.0),
        soft=(0.0, 4.0),
        label="Scale",
        group=BIAS,
        used_when=OF_MAPS,
        doc="Shadow bias, a multiple of the depth's slope across a texel; too small: acne, too large: leaks",
    )
    gradient_cap_m: float = param(
        1e9,
        hard=(0.0, 1e9),
        soft=(0.0, 1.0),
        unit="m",
        label="Limit",
        group=BIAS,
        unlimited="Unlimited",
        used_when=OF_MAPS,
        doc="Largest bias that the slope may give",
    )
    spacing: int = param(
        1,
        hard=(1, 4),
        unit="pixel",
        group=SAMPLING,
        used_when=When("method", (Method.BITMASK, Method.HYBRID)),
        doc="Every so many-th pixel each way is evaluated, others where surface or shadow change; 1: all",
    )
    rays: int = param(
        64,
        hard=(0, 1024),
        soft=(16, 256),
        trades_time=True,
        per_light=True,
        used_when=When("method", (Method.BITMASK, Method.HYBRID)),
        doc="Rays for each point that maps are unsure of, with the hybrid method, with the bitmask a quarter "
        "as many at hard edges of a sun's shadows, with both at least 64 for what is closest to a spot or a "
        "point; 0: none",
    )

    sample_rays: int = param(
        4,
        hard=(1, 1024),
        soft=(1, 64),
        trades_time=True,
        lowers_noise=True,
        per_light=True,
        used_when=When("method", (Method.RAYS,)),
        doc="Rays for each of a pixel's samples, with the method rays; those of all are spread over the "
        "light",
    )

    def finer(self) -> tuple[str, ...]:
        """Rays first, which no map equals (the bitmask asks for few), then larger maps: in sample scenes 256
        rays of 32 take away up to half of hybrid's error, maps of 4096 of 1024 texels too, more layers a
        fifth or nothing."""
        if self.method == Method.RAYS:
            return super().finer()
        first = ("rays", "resolution", "max_samples")
        finer = sorted(super().finer(), key=lambda name: first.index(name) if name in first else len(first))
        finer = [name for name in finer if name != "rays" or self.method == Method.HYBRID]
        if self.method != Method.HYBRID:
            finer.insert(0, "method=hybrid")
        if self.spacing > 1:
            finer.insert(0, "spacing=1")
        return tuple(finer)

    def lighter(self, share: float) -> SoftShadowParams:
        """Smaller maps, fewer texels of them a point, fewer points, and no rays: a hierarchy for those takes
        longer than a frame to build."""
        return replace(
            self,
            spacing=max(2, self.spacing),
            resolution=max(128, round(self.resolution * share)),
            max_samples=max(16, round(self.max_samples * share)),
            method=Method.AREA if self.method == Method.AREA else Method.BITMASK,
            rays=0,
        )
