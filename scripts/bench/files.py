"""Writing layers to EXR files: seconds and sizes by the way they are written."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from strata.addon.core.layers import Layer, LayerSet
from strata.addon.layers.exr import write_layers
from strata.addon.layers.exr_params import ExrParams

from .document import significant, table

SAMPLES = 8  # a pixel, whose mean a shadow is
WAYS = {
    "float, ZIP (default)": {},
    "float, ZIP, one part": {"parts": "single"},
    "half, ZIP": {"depth": "half"},
    "half, DWAA": {"depth": "half", "codec": "dwaa"},
    "half, DWAA, one part": {"depth": "half", "codec": "dwaa", "parts": "single"},
}


def layers_of(width: int, height: int) -> LayerSet:
    """24 channels: 12 shadows, each half of it flat and half a noisy penumbra, and 4 times light in fog."""
    random = np.random.default_rng(0)
    rows, columns = np.mgrid[:height, :width].astype(np.float32) * np.float32(2160 / height)
    layers = []
    for number in range(12):
        edge = 0.5 + np.sin(rows / (90 + 7 * number)) * np.cos(columns / (130 - 5 * number))
        shadow = random.binomial(SAMPLES * 16, edge.clip(0.0, 1.0)).astype(np.float32) / (SAMPLES * 16)
        layers.append(Layer(f"Soft Shadow {number}", "V", shadow, "soft_shadow"))
    for number in range(4):
        fog = 0.1 + 0.05 * np.sin(rows / (300 + 20 * number)) * np.cos(columns / 400)
        fog = fog[:, :, None] * random.normal(1.0, 0.01, (height, width, 3)) * (1.0, 0.8, 0.5)
        layers.append(Layer(f"Volumetric {number}", "RGB", fog.astype(np.float32), "volumetric_light"))
    return LayerSet(tuple(layers), width, height, "ViewLayer")


def _neutral(layer_set: LayerSet) -> LayerSet:
    """As many channels, each of one value."""
    layers = [
        Layer(layer.name, layer.channels, np.broadcast_to(np.float32(1.0), layer.pixels.shape), layer.effect)
        for layer in layer_set.layers
    ]
    return LayerSet(tuple(layers), layer_set.width, layer_set.height, "ViewLayer")


def run(folder: Path, size: tuple[int, int], repeats: int) -> str:
    """The table. All ways take turns, and the medians are shown."""
    full = layers_of(*size)
    path = folder / "layers.exr"

    def ours(layer_set: LayerSet, **values) -> Callable[[], object]:
        return lambda: write_layers(path, layer_set, ExrParams.checked("exr", values))

    runs = {name: ours(full, **values) for name, values in WAYS.items()}
    runs["float, ZIP, neutral layers"] = ours(_neutral(full))
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in runs}
    sizes = {}
    for _ in range(repeats):
        for name, write in runs.items():
            started = time.perf_counter(), time.process_time()
            write()
            taken[name].append((time.perf_counter() - started[0], time.process_time() - started[1]))
            sizes[name] = os.path.getsize(path)
    rows = [
        [name, *map(significant, np.median(times, axis=0)), significant(sizes[name] / 2**20)]
        for name, times in taken.items()
    ]
    raw = 24 * 4 * size[0] * size[1] / 2**20
    return f"24 channels, {size[0]}x{size[1]}, {significant(raw)} MiB of float32.\n\n" + table(
        ["", "s", "s of cores", "MiB"], rows
    )
