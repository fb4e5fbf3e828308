"""Baked layers held against Cycles, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
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


@dataclass(frozen=True)
class CyclesTruth:
    """A lamp's shadow by Cycles: two independent renders, (height, width) float64 each, and where the lamp
    reaches at all; `weight` (pixels,) what it brings there unshadowed."""

    lamp: str
    halves: tuple[np.ndarray, np.ndarray]
    lit: np.ndarray
    weight: np.ndarray

    @classmethod
    def rendered(cls, scene, lamp, samples: int, size: tuple[int, int]) -> CyclesTruth:
        """`samples` in each of the two renders."""
        first, second = (cycles.shadow(scene, lamp, samples, seed=seed, size=size) for seed in (1, 2))
        lit = (first.weight > 0.0) & (second.weight > 0.0)
        weight = (0.5 * (first.weight + second.weight))[lit]
        return cls(lamp.name, (first.visibility[lit], second.visibility[lit]), lit, weight)

    def compare(self, baked: Baked) -> Comparison:
        """The lamp's layer, baked at pixel centres."""
        layer = next(layer for layer in baked.layers.layers if layer.light == self.lamp)
        noise = 0.5 * weighted_rmse(self.halves[0] - self.halves[1], self.weight)
        errors = layer.pixels[self.lit] - 0.5 * (self.halves[0] + self.halves[1])
        square = weighted_rmse(errors, self.weight) ** 2 - noise**2
        found = layer.error
        return Comparison(
            self.lamp,
            max(square, 0.0) ** 0.5,
            noise,
            weighted_bias(errors, self.weight),
            quantile(errors, self.weight, 0.99),
            maximum(errors, self.weight),
            found.get("value"),
            tuple(found["ci95"]) if found else None,
            int(self.lit.sum()),
        )


def compare_all(
    scene, samples: int, size: tuple[int, int], settings: dict[str, dict]
) -> list[tuple[str, Comparison]]:
    """Every light that has a layer, with each of `settings` (Options.values by a name for them)."""
    view_layer = scene.view_layers[0]
    bakes = {
        name: bake(
            scene,
            view_layer,
            Options(effects=("soft_shadow",), backend="cpu", samples=1, values=values),
            size=size,
        )
        for name, values in settings.items()
    }
    layers = {layer.light for baked in bakes.values() for layer in baked.layers.layers}
    found = []
    for lamp in (lamp for lamp in cycles.lamps(scene) if lamp.name in layers):
        truth = CyclesTruth.rendered(scene, lamp, samples, size)
        found += [(name, truth.compare(baked)) for name, baked in bakes.items()]
    return found
