"""Collects probes while a graph runs, and measures each of its layers afterwards."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from ..core.device import RayCaster, ShadowLight
from ..core.effect import LayerKind, Metric
from ..core.graph import Graph, PlannedLayer
from ..core.outline import Outline
from ..core.random import hash_bits, text_bits
from ..core.surface import Chunk
from ..effects.registry import effect_named
from .probes import ProbeCollector, Watched
from .report import LayerError
from .visibility import measure_visibility


class Measurement:
    """Collects probes while a graph runs (core/executor.py, Collector), then measures layer by layer.

    `probes`: how many pixels of a layer get the slow reference.
    """

    def __init__(self, graph: Graph, outline: Outline, probes: int, seed: int):
        self.probes, self.seed = probes, seed
        self._outline = outline
        watched = [
            Watched(layer.name, layer.effect, light.emitter, light.receivers)
            for layer in graph.layers
            if _metric(layer) == Metric.WEIGHTED_RMSE
            for light in [outline.lights[layer.light_index]]
        ]
        self._collector = ProbeCollector(watched, outline.view.eye, probes, seed, outline.frame)
        self._collecting_seconds = 0.0  # of one layer
        self._layers = max(len(watched), 1)

    def add(self, chunk: Chunk, surface: dict[str, np.ndarray], layers: dict[str, np.ndarray]) -> None:
        """See ProbeCollector.add."""
        started = time.perf_counter()
        self._collector.add(chunk, surface, layers)
        self._collecting_seconds += (time.perf_counter() - started) / self._layers

    def measure(self, layer: PlannedLayer, rays: RayCaster, casters: np.ndarray) -> LayerError:
        """One layer's error, after the last tile; `casters` (instances,) uint8: what can block the light."""
        started = time.perf_counter()
        light = self._outline.lights[layer.light_index]
        evaluate = effect_named(layer.effect).reference

        def weigh(points):
            return rays.irradiance(light.emitter, points)

        def screen(points, seed):
            return rays.screen(casters, light.emitter, points, seed)

        def reference(points, samples, seed):
            return evaluate(rays, ShadowLight(light.emitter, casters), points, samples, seed)

        strata = self._collector.strata(layer.name)
        seed = int(hash_bits(self.seed, text_bits(layer.name)))
        error = measure_visibility(strata, self.probes, weigh, screen, reference, seed)
        seconds = self._collecting_seconds + time.perf_counter() - started
        return replace(error, seconds=seconds)


def _metric(layer: PlannedLayer) -> Metric | None:
    if not layer.effect:
        return None
    kinds: tuple[LayerKind, ...] = effect_named(layer.effect).layers
    return next(kind.metric for kind in kinds if layer.name.startswith(kind.title))
