"""Whether a layer multiplies onto an unshadowed render as if that had been rendered with shadows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import strata_kernels
from strata.addon.bake import bake
from strata.addon.planning import Options

from . import cycles
from .scenes import read


@dataclass(frozen=True)
class Fringe:
    """RMS difference over the mean of the unshadowed image: at `silhouettes` (where neighbouring pixels show
    different objects), and `elsewhere`; `noise` is that of the two renders at silhouettes."""

    samples: int
    silhouettes: float
    elsewhere: float
    noise: float


def silhouettes(scene, size: tuple[int, int]) -> np.ndarray:
    """(height, width) bool: pixels with a neighbour that shows another object."""
    case = read(scene, size)
    everything = np.ones(len(case.outline.instances), np.uint8)
    found = strata_kernels.raster_surface(
        case.device.geometry(), everything, case.graph.shot.view.packed(), *size, attributes=["object_id"]
    )["object_id"]
    edge = np.zeros(found.shape, bool)
    for axis in (0, 1):
        differs = np.diff(found, axis=axis) != 0
        before, after = [slice(None)] * 2, [slice(None)] * 2
        before[axis], after[axis] = slice(None, -1), slice(1, None)
        edge[tuple(before)] |= differs
        edge[tuple(after)] |= differs
    return edge


def measure(scene, light: str, size: tuple[int, int], samples, cycles_samples: int) -> list[Fringe]:
    """Bakes of each of `samples` a pixel, with the scene's own pixel filter on both sides."""
    lamp = scene.objects[light]

    def rendered(shadow: bool, seed: int) -> np.ndarray:
        settings = {"shadow": shadow, "seed": seed, "size": size, "filter_width": None}
        return cycles.render(scene, lamp, cycles_samples, **settings).image.mean(axis=2, dtype=np.float64)

    bare = 0.5 * (rendered(False, 1) + rendered(False, 2))
    halves = rendered(True, 1), rendered(True, 2)
    shadowed, scale = 0.5 * (halves[0] + halves[1]), bare.mean()
    edge = silhouettes(scene, size)
    noise = float(np.sqrt(np.square(0.5 * (halves[0] - halves[1]))[edge].mean())) / scale
    found = []
    for count in samples:
        options = Options(backend="cpu", samples=count, probes=0)
        layers = bake(scene, scene.view_layers[0], options, size=size).layers.layers
        layer = next(layer for layer in layers if layer.light == light)
        square = np.square(layer.pixels * bare - shadowed)
        parts = [float(np.sqrt(square[where].mean())) / scale for where in (edge, ~edge)]
        found.append(Fringe(count, *parts, noise))
    return found
