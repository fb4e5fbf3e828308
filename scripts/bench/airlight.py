"""Baked volumetric light held against Cycles, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from strata.addon.bake import bake
from strata.addon.planning import Options

from . import cycles

LOOKS = 2
"""Of each pixel by rays, on average."""


@dataclass(frozen=True)
class Comparison:
    """One light. `error` is the relative L2, Cycles' own noise taken off; `cycles_noise` that of the mean of
    its two renders, `bias` the layer's mean over Cycles', less 1; `value` and `ci95` are the bake's own
    report."""

    light: str
    error: float
    cycles_noise: float
    bias: float
    value: float
    ci95: tuple[float, float]

    @property
    def agrees(self) -> bool:
        """Whether the report's interval holds what Cycles says, Cycles' noise allowed for."""
        low, high = self.ci95
        return low - self.cycles_noise <= self.error <= high + self.cycles_noise


def by_rays(scene, size: tuple[int, int]) -> list:
    """Layers of lights at default settings, their error measured in every pixel, in the brightest often."""
    options = Options(("volumetric_light",), "cpu", samples=1, probes=LOOKS * size[0] * size[1])
    baked = bake(scene, scene.view_layers[0], options, size=size)
    return [layer for layer in baked.layers.layers if layer.light]


def compare_all(scene, samples: int, size: tuple[int, int], names=None) -> list[Comparison]:
    """Every light that has a layer, or those of `names`, at default settings against two renders each."""
    layers = {layer.light: layer for layer in by_rays(scene, size)}
    found = []
    for lamp in cycles.lamps(scene):
        if lamp.name in layers and (not names or lamp.name in names):
            halves = [cycles.airlight(scene, lamp, samples, seed=seed, size=size).image for seed in (1, 2)]
            found.append(compare(layers[lamp.name], *np.asarray(halves, np.float64)))
    return found


def compare(layer, first: np.ndarray, second: np.ndarray) -> Comparison:
    """A layer against two images of the same light."""
    scale = 0.5 * (first + second).mean()
    # The halves' noises are independent, so that the product's mean is the square without them.
    square = ((layer.pixels - first) * (layer.pixels - second)).mean()
    noise = 0.5 * np.sqrt(np.mean((first - second) ** 2))
    return Comparison(
        layer.light,
        float(np.sqrt(max(square, 0.0)) / scale),
        float(noise / scale),
        float(layer.pixels.mean() / scale - 1.0),
        layer.error["value"],
        tuple(layer.error["ci95"]),
    )
