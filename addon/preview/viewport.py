"""One viewport's picture: made at once while something moves, refined step by step when all is still."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..bake import Options, plan_scene
from ..core.executor import Execution
from ..core.graph import Graph, PlannedLayer
from ..core.sampling import Sampling
from ..core.surface import Chunk
from ..effects.shared.look import seen_boxes
from ..scene.viewport import Placement
from .budget import Budget
from .session import Session, lighter, mean_of

STILL_SECONDS = 0.2
TILE_PIXELS = 1 << 16


@dataclass
class Statistics:
    """Of what a viewport shows. `steps`: milliseconds and runs by step and instance, of the last frame or of
    the refinement so far. `ran`: how many nodes the last frame ran."""

    frame_ms: float = 0.0
    scale: float = 1.0
    map_share: float = 1.0
    samples: int = 0
    of_samples: int = 0
    error: float | None = None
    is_converged: bool = False
    ran: int = 0
    steps: dict[tuple[str, str], tuple[float, int]] = field(default_factory=dict)
    message: str = ""


@dataclass(eq=False)
class Picture:
    """What to draw: host pixels (height, width[, 4]) float32 or a device's image, and where in the region."""

    pixels: Any
    place: tuple[float, float, float, float]
    is_colour: bool


def layer_of(graph: Graph, name: str) -> PlannedLayer | None:
    """The layer to show: the named one, or the composite, which has neither effect nor light."""
    for layer in graph.layers:
        if layer.name == name if name else not layer.effect and layer.light_index is None:
            return layer
    return None


class Viewport:
    """The picture of one region."""

    def __init__(self):
        self.budget = Budget()
        self.statistics = Statistics()
        self.picture: Picture | None = None
        self.signature: tuple | None = None
        self.changed_at = 0.0
        self._refinement: Iterator[None] | None = None
        self._costs: list[tuple[float, float]] = []

    def show(
        self, session: Session, placement: Placement, options: Options, layer: str, budget_ms: float
    ) -> bool:
        """Makes a frame if anything has changed since the last; whether it did."""
        signature = (session.version, placement, options, layer)
        if _same(signature, self.signature):
            return False
        self.signature = signature
        self.changed_at = time.monotonic()
        self._refinement = None
        self._frame(session, placement, options, layer, budget_ms)
        self._refinement = self._refine(session, placement, options, layer)
        return True

    @property
    def needs_work(self) -> bool:
        return self._refinement is not None

    def wait(self) -> float:
        """Seconds until it is still."""
        return max(0.0, self.changed_at + STILL_SECONDS - time.monotonic())

    def advance(self, seconds: float, budget_ms: float) -> bool:
        """Refines for about so long; whether there is a new picture. Raises what steps raise."""
        if self._costs:
            scene, surface = np.mean(self._costs[-8:], axis=0)
            self.budget.settle(budget_ms, scene, surface)
            self._costs.clear()
        before = self.picture
        end = time.perf_counter() + seconds
        while self._refinement is not None and time.perf_counter() < end and self.picture is before:
            if next(self._refinement, self) is self:
                self._refinement = None
        return self.picture is not before

    def release(self) -> None:
        self.picture = self._refinement = self.signature = None

    def _frame(self, session, placement: Placement, options: Options, name: str, budget_ms: float) -> None:
        started = time.perf_counter()
        scale = self.budget.scale
        light = lighter(options, self.budget.map_share)
        outline, graph = session.moving_plan(placement, scale, light)
        session.feed()
        layer = layer_of(graph, name)
        if layer is None:
            self.picture = None
            self.statistics = Statistics(message=f"no layer '{name}'" if name else "nothing is in view")
            return
        graph = replace(graph, layers=(layer,))
        width, height = outline.computed_size
        chunk = Chunk(width, height, 0, height, 0, (0.0, 0.0))
        for _share in session.executor.frame(graph, chunk):
            pass
        device, value = session.executor.layer_value(layer)
        if device.name == "cpu":
            value = device.to_host(value)
        self.picture = Picture(value, placement.place(*placement.sizes(scale)), len(layer.channels) > 1)
        self._count(session.executor.execution, started)
        scene_ms = sum(
            1e3 * timing.seconds
            for timing in session.executor.execution.timings.values()
            if not timing.node.per_surface
        )
        surface_ms = sum(
            1e3 * timing.seconds
            for timing in session.executor.execution.timings.values()
            if timing.node.per_surface
        )
        self._costs.append((scene_ms, surface_ms))
        self.statistics.scale, self.statistics.map_share = scale, self.budget.map_share
        self.statistics.samples, self.statistics.of_samples = 0, options.samples
        self.budget.coarser(budget_ms, scene_ms, surface_ms)

    def _refine(self, session: Session, placement: Placement, options: Options, name: str) -> Iterator[None]:
        """The bake, to the last bit, but for its measurement: coarse look, plan, samples."""
        started = time.perf_counter()
        outline, graph = session.still_plan(placement, options)
        yield
        executor, fallback = session.executor, session.devices.fallback
        if graph.surface is not None:
            session.feed()
            geometry = executor.value(graph.surface.inputs[0], fallback)
            boxes = seen_boxes(fallback, geometry, outline, graph.surface.params["visible"])
            if len(boxes):
                outline = replace(outline, seen=boxes)
                graph = plan_scene(outline, options)
            yield
        layer = layer_of(graph, name)
        if layer is None:
            return
        graph = replace(graph, layers=(layer,))
        place = placement.place(*placement.sizes(1.0))
        sampling = Sampling(
            *outline.computed_size,
            options.samples,
            outline.pixel_filter,
            tile_pixels=TILE_PIXELS,
            is_progressive=True,
        )
        session.feed()
        shown = 0
        execution = None
        for _share in executor.run(graph, sampling):
            execution = executor.execution
            if execution.samples > shown and execution.samples < options.samples:
                shown = execution.samples
                pixels = mean_of(execution.images[layer.name], shown)
                self._show(execution, pixels, place, layer, started, shown, options.samples)
            yield
            session.feed()
        pixels = execution.images[layer.name]
        self._show(execution, pixels, place, layer, started, options.samples, options.samples)
        self.statistics.is_converged = True

    def _show(
        self, execution: Execution, pixels, place, layer, started, samples: int, of_samples: int
    ) -> None:
        self.picture = Picture(pixels, place, len(layer.channels) > 1)
        self._count(execution, started)
        self.statistics.scale = self.statistics.map_share = 1.0
        self.statistics.samples, self.statistics.of_samples = samples, of_samples

    def _count(self, execution: Execution, started: float) -> None:
        self.statistics = Statistics(
            frame_ms=1e3 * (time.perf_counter() - started),
            ran=sum(timing.runs for timing in execution.timings.values()),
            steps={
                (timing.node.step.name, timing.node.instance): (1e3 * timing.seconds, timing.runs)
                for timing in execution.timings.values()
            },
        )


def _same(a: tuple, b: tuple | None) -> bool:
    return b is not None and a == b
