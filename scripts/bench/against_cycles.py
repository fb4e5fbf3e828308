"""Baked layers held against Cycles, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from strata.addon.bake import Baked, bake
from strata.addon.core.metrics import maximum, quantile
from strata.addon.planning import Options
from strata.tests.support.figures import weighted_bias, weighted_rmse

from . import cycles, methods, scenes

RAYS = 256


@dataclass(frozen=True)
class Comparison:
    """One light. `rmse` is weighted by the unshadowed light, Cycles' own noise taken off; `cycles_noise` is
    the noise of the mean of its two renders; `rays_rmse` how far Strata's own rays, from every pixel, are
    from Cycles."""

    light: str
    rmse: float
    cycles_noise: float
    rays_rmse: float
    bias: float
    p99: float
    largest: float
    pixels: int


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

    @property
    def noise(self) -> float:
        """Of the mean of the two."""
        return 0.5 * weighted_rmse(self.halves[0] - self.halves[1], self.weight)

    def errors(self, pixels: np.ndarray) -> np.ndarray:
        """Of an image (height, width) of the lamp's shadow, where the lamp reaches."""
        return pixels[self.lit] - 0.5 * (self.halves[0] + self.halves[1])

    def rmse(self, pixels: np.ndarray) -> float:
        """Weighted, the noise taken off."""
        return max(weighted_rmse(self.errors(pixels), self.weight) ** 2 - self.noise**2, 0.0) ** 0.5

    def compare(self, baked: Baked, rays_rmse: float) -> Comparison:
        """The lamp's layer, baked at pixel centres."""
        layer = next(layer for layer in baked.layers.layers if layer.light == self.lamp)
        errors = self.errors(layer.pixels)
        return Comparison(
            self.lamp,
            self.rmse(layer.pixels),
            self.noise,
            rays_rmse,
            weighted_bias(errors, self.weight),
            quantile(errors, self.weight, 0.99),
            maximum(errors, self.weight),
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
            Options(effects=("soft_shadow",), backend="cpu", samples=1, probes=0, values=values),
            size=size,
        )
        for name, values in settings.items()
    }
    layers = {layer.light for baked in bakes.values() for layer in baked.layers.layers}
    found = []
    for lamp in (lamp for lamp in cycles.lamps(scene) if lamp.name in layers):
        truth = CyclesTruth.rendered(scene, lamp, samples, size)
        rays_rmse = truth.rmse(_by_rays(scene, lamp, size))
        found += [(name, truth.compare(baked, rays_rmse)) for name, baked in bakes.items()]
    return found


def _by_rays(scene, lamp, size: tuple[int, int]) -> np.ndarray:
    """(height, width): the lamp's shadow by Strata's own rays from every pixel's centre."""
    others = [other for other in cycles.lamps(scene) if other != lamp]
    with cycles.kept(*((other, "hide_render", True) for other in others)):
        case = scenes.read(scene, size)
    surface, _ = methods.surface_of(case)
    visibility, _ = methods.traced(case, methods.accelerator_of(case), surface, RAYS, seed=1)
    return visibility.reshape(size[::-1])
