"""The part of a bake that measures what came out: what references trace with, how long a layer may take."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from dataclasses import replace
from typing import Any

import numpy as np

from .core.errors import Cancelled
from .core.executor import Executor
from .core.graph import Graph, Node, PlannedLayer
from .core.outline import Outline
from .core.sampling import Sampling
from .core.slices import timed
from .devices.cpu import CpuRays
from .effects.shared.steps import ray_accelerator
from .measure.budget import ImagesOutlook, MeasuringOutlook, allowed_seconds
from .measure.error_image import ErrorImage
from .measure.footprint import KeptSamples, Probed
from .measure.measure import Measurement
from .measure.report import LayerError, NotMeasured
from .measure.unread import between, concerns, unread_materials, without_end
from .measure.watch import Watch

REFERENCES_READ = ("position", "geometric_normal", "shading_normal", "depth", "material", "instance")


class Measuring:
    """Of one bake's layers, group by group. `executor` makes them, and what rays need; `graph` is the whole,
    in `sampling`; `seconds_before` were spent on the bake before `executor` began; `has_images`: it makes
    error images too, `images` by the names of their layers."""

    def __init__(
        self,
        measurement: Measurement,
        outlook: MeasuringOutlook,
        executor: Executor,
        outline: Outline,
        graph: Graph,
        sampling: Sampling,
        seconds_before: float,
        has_images: bool = False,
    ):
        self.measurement, self.outlook = measurement, outlook
        width, height = graph.shot.computed_size
        self._pixels = width * height * has_images
        self._images = ImagesOutlook(graph, self._pixels)
        self.images: dict[str, ErrorImage] = {}
        self._executor, self._outline, self._graph = executor, outline, graph
        self._sampling = sampling
        self._seconds_before = seconds_before
        self._rays: CpuRays | NotMeasured | None = None
        self._rays_seconds = 0.0  # of one layer
        self._unread = unread_materials(outline.materials)
        self._clear_rays: CpuRays | None = None  # past all that is unread
        self.watching_seconds: dict[str, float] = {}  # by layer
        self._watches: dict[str, Watch] = {}  # by layer
        self.look: Callable[[Probed], Generator[None]] | None = None  # at each measured layer
        self.seconds = 0.0  # of all so far, without the error images

    def errors(self, graph: Graph) -> Generator[None, None, dict[str, LayerError | NotMeasured]]:
        """The error of each of the graph's layers, by name: rays against the layer's own casters, on the CPU
        whatever made the layer."""
        layers = [layer for layer in graph.layers if layer.kind.score and layer.is_whole]
        if not layers:
            return {}
        if self._rays is None:
            self._rays = yield from self.measurement.guarded(self._started_rays())
        if isinstance(self._rays, NotMeasured):
            self._executor.execution.samples_of.clear()
            return {layer.name: self._rays for layer in layers}
        execution, errors = self._executor.execution, {}
        for number, layer in enumerate(layers, start=1):
            allowed = self._allowed_seconds() / (len(layers) - number + 1)
            probed = self._probed(layer)
            work = self._measured(probed, allowed)
            work = self.outlook.watched(timed(self.measurement.guarded(work)))
            error, seconds = yield from work
            self.seconds += seconds
            if isinstance(error, LayerError):
                error = replace(error, seconds=error.seconds + self._rays_seconds)
            errors[layer.name] = error
            if self._pixels:
                yield from self._make_image(probed, isinstance(error, LayerError))
            if self.look:
                yield from self.look(probed)
            execution.samples_of.pop(layer.name, None)
        return errors

    def watch(self, layer: PlannedLayer, samples: int) -> Generator[None, None, Watch | float | NotMeasured]:
        """Pixels that tell how far the layer is from the truth while it gets more samples; of one whose score
        watches none, how far it is now, root mean square."""
        if self._rays is None:
            self._rays = yield from self.measurement.guarded(self._started_rays())
        if isinstance(self._rays, NotMeasured):
            return self._rays
        work = self.measurement.guarded(self.measurement.watch(self._probed(layer), samples))
        watch, seconds = yield from timed(unless_cancelled(work, self._executor.fallback.cancel_flag))
        self.watching_seconds[layer.name] = self.watching_seconds.get(layer.name, 0.0) + seconds
        if isinstance(watch, Watch):
            self._watches[layer.name] = replace(watch, seconds=seconds)
        return watch

    def watched_error(self, layer: PlannedLayer, watch: Watch) -> float:
        """Root mean square of the layer so far, as a share of the brightness."""
        return watch.rms(self._executor.execution.films[layer.name].at(watch.pixels))

    def seconds_left(self, bake_seconds: float, slower: float) -> float:
        """Where the bake takes so many seconds, with what has been measured so far, on a machine that is so
        many times as slow as an ordinary one."""
        left = self._images.seconds_left(slower)
        without = bake_seconds - self.seconds - self._images.seconds - left
        return self.outlook.seconds_left(without, slower) + left

    def _allowed_seconds(self) -> float:
        """What measuring may still take of what has been baked so far."""
        baked = sum(timing.seconds for timing in self._executor.execution.timings.values())
        return allowed_seconds(self._seconds_before + baked) - self.seconds

    def _measured(self, probed: Probed, allowed: float) -> Generator[None, None, LayerError | NotMeasured]:
        flag, met = self._executor.fallback.cancel_flag, (probed.casters | self._rays.camera.visible) != 0
        is_unread = concerns(self._outline.instances, met, self._unread)
        if is_unread and self._clear_rays is None:
            self._clear_rays = yield from self._started_clear_rays()
        work = self.measurement.measure(probed, allowed / (1 + is_unread), self.outlook.expect)
        error = yield from unless_cancelled(work, flag)
        if is_unread and isinstance(error, LayerError):
            cleared = replace(probed, rays=self._clear_rays, watched=None, found={})
            clear = yield from unless_cancelled(self.measurement.again(cleared, error), flag)
            error = replace(between(error, clear), seconds=clear.seconds)
        if self._outline.unknown and isinstance(error, LayerError):
            error = without_end(error, self._outline.unknown)
        return error

    def _make_image(self, probed: Probed, is_measured: bool) -> Generator[None]:
        """Of a layer that could be measured; what fails is told."""
        layer, done, execution = probed.layer, 0, self._executor.execution

        def show(pixels: int) -> None:
            nonlocal done
            done += pixels
            self._images.show(layer, pixels)

        if is_measured:
            work = self.measurement.guarded(self.measurement.error_image(probed, show))
            work = unless_cancelled(work, self._executor.fallback.cancel_flag)
            image = yield from self._images.watched(work)
            if isinstance(image, ErrorImage):
                self.images[layer.name] = image
            else:
                execution.warnings.append(f"layer '{layer.name}' has no error image: {image.why}")
        self._images.show(layer, self._pixels - done)

    def _probed(self, layer: PlannedLayer) -> Probed:
        execution, shot = self._executor.execution, self._graph.shot
        return Probed(
            layer,
            self._graph.layers,
            self._outline,
            shot,
            execution.image(layer.name),
            execution.weights_of(layer.name),
            self._kept_samples(layer),
            self._rays,
            self._executor.fallback.instance_mask(layer.casters),
            self._watches.get(layer.name),
        )

    def _kept_samples(self, layer: PlannedLayer) -> KeptSamples | None:
        execution = self._executor.execution
        if layer.name not in execution.samples_of:
            return None
        values = execution.samples_of[layer.name]
        rows, columns = np.divmod(execution.kept_pixels.astype(np.int64), self._sampling.width)
        offsets = replace(self._sampling, samples=len(values)).offsets(np.stack([columns, rows], axis=1))
        return KeptSamples(execution.kept_pixels, values, offsets)

    def _started_rays(self) -> Generator[None, None, CpuRays]:
        """What references trace with."""
        executor, device, graph = self._executor, self._executor.fallback, self._graph
        accelerator, seconds = _value_apart(executor, ray_accelerator(self._outline, graph.shot), device)
        self.outlook.has_tree = True
        self.seconds += seconds
        self._rays_seconds = seconds / sum(layer.kind.score is not None for layer in graph.layers)
        yield
        return self._rays_in(accelerator)

    def _started_clear_rays(self) -> Generator[None, None, CpuRays]:
        """The same as though nothing were there whose opacity is not read."""
        device, node = self._executor.fallback, ray_accelerator(self._outline, self._graph.shot)
        geometry, casters = (
            device.geometry_without(self._unread),
            device.instance_mask(node.params["casters"]),
        )
        origin, build = np.array(node.params["eye"]), device.kernels.Accel
        accelerator = device.unless_cancelled(lambda: build(geometry, origin, casters))
        yield
        return self._rays_in(accelerator)

    def _rays_in(self, accelerator: Any) -> CpuRays:
        executor, device, graph = self._executor, self._executor.fallback, self._graph
        seen = graph.surface.params
        holdouts = seen.get("holdouts", frozenset())
        return CpuRays(
            accelerator,
            np.array(graph.shot.origin),
            device.cancel_flag,
            device.camera_rays(graph.shot, seen["visible"], self._attributes(), seen["seed"], holdouts),
            value=lambda node: executor.value(node, device),
            texture=device.texture,
        )

    def _attributes(self) -> frozenset[str]:
        """What references read of surfaces."""
        known = self._graph.surfaces[self._graph.surface]
        has_uv = "uv" in self._graph.wants
        return known.union(REFERENCES_READ, ("uv",) if has_uv else ())


def unless_cancelled[Result](
    work: Generator[None, None, Result], flag: threading.Event
) -> Generator[None, None, Result]:
    """The same; raises Cancelled at its next slice once the flag is set."""
    while True:
        if flag.is_set():
            raise Cancelled()
        try:
            next(work)
        except StopIteration as end:
            return end.value
        yield


def _value_apart(executor: Executor, node: Node, device) -> tuple[Any, float]:
    """A node's value, and the seconds that it took, if any: they are no layer's, and not in the timings."""
    timings = executor.execution.timings
    before = {key: replace(timing) for key, timing in timings.items()}
    try:
        value = executor.value(node, device)
        seconds = sum(timing.seconds for timing in timings.values())
    finally:
        timings.clear()
        timings.update(before)
    return value, seconds - sum(timing.seconds for timing in before.values())
