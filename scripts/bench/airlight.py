"""Baked volumetric light held against Cycles, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from strata.addon.bake import bake
from strata.addon.planning import Options

from . import cycles

SAMPLES, PROBES = 8, 4096


@dataclass(frozen=True)
class Comparison:
    """One light at pixel centres. `error` is the root mean square difference as a share of a pixel's
    brightness and the mean one, Cycles' own noise taken off; `cycles_noise` that of the mean of its two
    renders, `bias` the layer's mean over Cycles', less 1; `method` is what the bake says, by rays."""

    light: str
    error: float
    cycles_noise: float
    bias: float
    method: float


def by_rays(scene, size: tuple[int, int], samples: int, probes: int) -> list:
    """Layers of lights at default settings, measured."""
    options = Options(("volumetric_light",), "cpu", samples=samples, probes=probes)
    baked = bake(scene, scene.view_layers[0], options, size=size)
    return [layer for layer in baked.layers.layers if layer.light]


def compare_all(
    scene, samples: int, size: tuple[int, int], names=None, probes: int = PROBES
) -> list[Comparison]:
    """Every light that has a layer, or those of `names`, at default settings against two renders each."""
    layers = {layer.light: layer for layer in by_rays(scene, size, 1, probes)}
    found = []
    for lamp in cycles.lamps(scene):
        if lamp.name in layers and (not names or lamp.name in names):
            halves = [cycles.airlight(scene, lamp, samples, seed=seed, size=size).image for seed in (1, 2)]
            found.append(compare(layers[lamp.name], *np.asarray(halves, np.float64)))
    return found


def compare(layer, first: np.ndarray, second: np.ndarray) -> Comparison:
    """A layer against two images of the same light."""
    truth = 0.5 * (first + second)
    whole = brightness(truth)
    # The halves' noises are independent, so that the product's mean is the square without them.
    square = ((layer.pixels - first) * (layer.pixels - second) / whole**2).mean()
    noise = 0.5 * np.sqrt(np.mean(((first - second) / whole) ** 2))
    return Comparison(
        layer.light,
        float(np.sqrt(max(square, 0.0))),
        float(noise),
        float(layer.pixels.mean() / truth.mean() - 1.0),
        layer.error["method"],
    )


def brightness(image: np.ndarray) -> np.ndarray:
    """(height, width, 1) of each pixel and of the mean one, that errors are shares of."""
    return np.abs(image).mean(axis=2, keepdims=True) + np.abs(image).mean()
