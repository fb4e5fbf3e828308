"""Baked layers held against Cycles, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass

from strata.addon.bake import Baked, Options, bake
from strata.addon.core.metrics import maximum, quantile, weighted_bias, weighted_rmse

from . import cycles


@dataclass(frozen=True)
class Comparison:
    """One light. `rmse` is weighted by the unshadowed light, Cycles' own noise taken off; `cycles_noise` is
    the noise of the mean of its two renders; `value` and `ci95` are the bake's own report, None without."""

    light: str
    rmse: float
    cycles_noise: float
    bias: float
    p99: float
    largest: float
    value: float | None
    ci95: tuple[float, float] | None
    pixels: int

    @property
    def agrees(self) -> bool:
        """Whether the report's interval holds what Cycles says, Cycles' noise allowed for."""
        low, high = self.ci95
        return low - self.cycles_noise <= self.rmse <= high + self.cycles_noise


def compare(scene, lamp, baked: Baked, samples: int, size: tuple[int, int]) -> Comparison:
    """A light's layer, baked at pixel centres, against two renders of `samples` each."""
    layer = next(layer for layer in baked.layers.layers if layer.light == lamp.name)
    first, second = (cycles.shadow(scene, lamp, samples, seed=seed, size=size) for seed in (1, 2))
    lit = (first.weight > 0.0) & (second.weight > 0.0)
    weight = (0.5 * (first.weight + second.weight))[lit]
    halves = first.visibility[lit], second.visibility[lit]
    noise = 0.5 * weighted_rmse(halves[0] - halves[1], weight)
    errors = layer.pixels[lit] - 0.5 * (halves[0] + halves[1])
    square = weighted_rmse(errors, weight) ** 2 - noise**2
    found = layer.error
    return Comparison(
        lamp.name,
        max(square, 0.0) ** 0.5,
        noise,
        weighted_bias(errors, weight),
        quantile(errors, weight, 0.99),
        maximum(errors, weight),
        found.get("value"),
        tuple(found["ci95"]) if found else None,
        int(lit.sum()),
    )


def compare_all(
    scene, samples: int, size: tuple[int, int], options: Options | None = None, names=None
) -> list[Comparison]:
    """Every light that the bake has a layer of, or those of `names`."""
    options = options or Options(backend="cpu", samples=1)
    baked = bake(scene, scene.view_layers[0], options, size=size)
    layers = {layer.light for layer in baked.layers.layers}
    lamps = [
        lamp for lamp in cycles.lamps(scene) if lamp.name in layers and (not names or lamp.name in names)
    ]
    return [compare(scene, lamp, baked, samples, size) for lamp in lamps]
