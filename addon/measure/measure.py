"""Collects probes while a graph runs, and measures each of its layers afterwards."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from dataclasses import replace

import numpy as np

from ..core.device import RayCaster
from ..core.errors import Cancelled, one_line
from ..core.graph import Graph, PlannedLayer
from ..core.outline import Outline
from ..core.random import hash_bits, text_bits
from ..core.slices import timed
from ..core.surface import Chunk
from .budget import DEFAULT_PROBES, within
from .probes import ProbeCollector, Probed
from .report import LayerError, NotMeasured


class Measurement:
    """Collects probes while a graph runs (core/executor.py, Collector), then measures layer by layer those
    that have a score.

    `probes`: how many pixels of a layer get the slow reference, None for as many as there is time for;
    `cancelled`: what devices raise when they are
    cancelled. Whatever else goes wrong is told in place of the error: measuring never costs a layer.
    """

    def __init__(
        self,
        graph: Graph,
        outline: Outline,
        probes: int | None,
        seed: int,
        cancelled: tuple[type[Exception], ...] = (),
    ):
        self.has_budget = probes is None
        self.probes, self.seed = DEFAULT_PROBES if probes is None else probes, seed
        self._outline, self._shot = outline, graph.shot
        # GeneratorExit: whoever ran it has gone. A panic of the kernels is a BaseException too.
        self._passes_through = (Cancelled, KeyboardInterrupt, SystemExit, GeneratorExit, *cancelled)
        self._lost: dict[str, NotMeasured] = {}  # by layer, why there are no probes
        self.surface = graph.surface
        attributes = tuple(sorted(graph.surfaces.get(graph.surface, ())))
        self._watched = {
            layer.name: layer.kind.score.watch(layer, outline, graph.shot, attributes)
            for layer in graph.layers
            if layer.kind.score
        }
        self._collectors: dict[str, ProbeCollector] = {}  # by layer; layers made together share one
        self._jitter = (0.0, 0.0)  # of the first sample
        self._collecting_seconds = dict.fromkeys(self._watched, 0.0)

    def add(
        self, chunk: Chunk, surface: dict[str, np.ndarray], layers: dict[str, np.ndarray]
    ) -> Generator[None]:
        """See ProbeCollector.add; `layers` are those that are made together, in all their tiles."""
        if chunk.sample == 0:
            self._jitter = chunk.jitter
        watched = [self._watched[name] for name in layers if name in self._watched]
        if not watched or watched[0].name in self._lost:
            return
        if watched[0].name not in self._collectors:
            collector = ProbeCollector(watched, self.probes, self.seed, self._outline.frame)
            self._collectors |= {each.name: collector for each in watched}
        collector = self._collectors[watched[0].name]
        lost, seconds = yield from timed(self.guarded(collector.add(chunk, surface, layers)))
        for each in watched:
            self._collecting_seconds[each.name] += seconds / len(watched)
            if lost:
                self._lost[each.name] = lost

    @property
    def collecting_seconds(self) -> float:
        """Of all layers so far."""
        return math.fsum(self._collecting_seconds.values())

    def guarded[Result](
        self, work: Generator[None, None, Result]
    ) -> Generator[None, None, Result | NotMeasured]:
        """The same, which returns why where it fails."""
        try:
            return (yield from work)
        except self._passes_through:
            raise
        except BaseException as error:
            return NotMeasured(one_line(error))

    def measure(
        self,
        layer: PlannedLayer,
        rays: RayCaster,
        casters: np.ndarray,
        image: np.ndarray,
        allowed_seconds: float = math.inf,
        expect: Callable[[float], None] = lambda seconds: None,
    ) -> Generator[None, None, LayerError | NotMeasured]:
        """One layer's error, after the last tile; yields between slices of work. `casters` (instances,)
        uint8: what can block the light; `image` (height, width[, channels]): the finished layer;
        `allowed_seconds`: what there is time for, where the number of probes was left open, and `expect`
        is told how long it still takes."""
        if layer.name in self._lost:
            return self._lost[layer.name]
        if layer.name not in self._collectors:
            return NotMeasured("it is made of finished images, and probes are drawn from samples")

        started = time.perf_counter()
        collector = self._collectors[layer.name]
        strata, total = tuple(collector.strata(layer.name)), collector.totals[layer.name]
        probed = Probed(layer, self._outline, self._shot, strata, total, image, self._jitter, rays, casters)
        seed = int(hash_bits(self.seed, text_bits(layer.name)))
        choosing_seconds = self._collecting_seconds[layer.name] + time.perf_counter() - started

        def measuring(probes: int):
            return layer.kind.score.measure(probed, probes, seed)

        if not self.has_budget:
            error, seconds = yield from timed(measuring(self.probes))
        else:
            (error, probes), seconds = yield from timed(within(measuring, allowed_seconds, expect=expect))
            error = replace(error, probes_in_time=probes)
        return replace(error, seconds=choosing_seconds + seconds)

    def forget(self, layer: PlannedLayer) -> None:
        """Frees the probes of a layer that has been measured."""
        if collector := self._collectors.pop(layer.name, None):
            collector.forget(layer.name)
