"""The one line that every face calls: read a scene, plan it, run the plan, measure what came out."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .baked import Baked, put_together
from .core.arrays import Arrays
from .core.errors import Cancelled
from .core.execution import Execution
from .core.executor import Executor
from .core.free_memory import give_back, held_bytes
from .core.graph import Graph, PlannedLayer
from .core.memory import MemoryEstimate
from .core.observer import NOBODY, Observer
from .core.outline import Outline
from .core.progress import Forecast
from .core.read import Read
from .core.sequence import SequenceLayer, with_neutral
from .core.slices import timed
from .core.surface import Chunk
from .devices.start import Devices, start_devices
from .effects.shared.coarse_picture import take_coarse_picture
from .effects.shared.steps import ray_accelerator
from .measure.budget import SHARE, MeasuringOutlook
from .measure.footprint import Probed
from .measure.kept_samples import pixels_to_keep
from .measure.measure import Measurement
from .measure.report import LayerError, NotMeasured
from .measure.target import Chosen, Target
from .measuring import Measuring, unless_cancelled
from .passes import Passes
from .planning import Options, groups_of, plan_scene, sampling_of
from .speeds import keep_speeds, recall_speeds

if TYPE_CHECKING:
    from .scene.exact.reading import Exact

SHOWING_SECONDS = 0.05  # between two looks at how long it still takes
BAKING_SHARE = 1.0 - SHARE  # of a time budget; measuring has the rest
FIRST_TOLD_SHARE = 0.02  # done of a bake before anything is said of what is left


class BakeJob:
    """A bake of a scene under way: of one shot's graph, or of several shots' one after the other, which share
    what they have in common. `advance` works for about a budget of seconds, so that it can run in time slices
    on the main thread (a GPU) or to its end on a worker thread (the CPU). What a graph lacks of `sequence` is
    neutral in the result; `warnings` go to its report. Where `tiles` is a queue, it gets tiles of the
    composite so far, each as its first row and its pixels (rows, width, 4). `look(probed)`, where it is set,
    sees each layer that is measured, and may work in slices. `observer` is told of stages and nodes."""

    def __init__(
        self,
        outline: Outline,
        graphs: Graph | Sequence[Graph],
        arrays: Arrays,
        options: Options,
        devices: Devices | None = None,
        read_seconds: float = 0.0,
        sequence: tuple[SequenceLayer, ...] = (),
        warnings: Sequence[str] = (),
        observer: Observer = NOBODY,
    ):
        self.outline, self.arrays, self.observer = outline, arrays, observer
        self.stage = "Starting"
        self.graphs = [graphs] if isinstance(graphs, Graph) else list(graphs)
        self.options = options
        self.sequence = sequence
        self.devices = devices or start_devices(options.backend)
        recall_speeds(self.devices.primary.name)
        for device in {self.devices.primary, self.devices.fallback}:
            device.set_scene(outline, arrays)
        self.progress = 0.0
        self._started = self._shown = time.perf_counter()
        self._seconds_left: float | None = None  # when last shown
        self._forecasts: list[Forecast] = []  # of this shot and those to come
        self._measuring: Measuring | None = None
        self.tiles: deque[tuple[int, np.ndarray]] | None = None
        self.look: Callable[[Probed], Generator[None]] | None = None
        self._warnings = [*warnings, *outline.warnings, *arrays.warnings]
        made = [layer.name for layer in self.graph.layers if layer.effect]
        if options.samples_of and (unknown := [name for name in made if name not in options.samples_of]):
            which = f"{', '.join(unknown)}: as many as any other has"
            self._warnings.append(f"samples: nothing was chosen for {which}")
        if options.error_images and options.probes == 0:
            self._warnings.append("error images: there are none, as nothing is measured (probes: 0)")
        self.read_seconds = read_seconds
        self._coarse_picture_seconds: list[float] = []  # by shot
        self._held = held_bytes()
        self._layers_bytes = 0  # of finished shots
        self.memory: MemoryEstimate | None = None  # told once the coarse picture has been taken
        self._results: list[Baked] = []
        self._failure: BaseException | None = None
        self._work = self._run()

    @property
    def graph(self) -> Graph:
        """Of the first shot."""
        return self.graphs[0]

    @property
    def stage(self) -> str:
        """What it is at, in a word."""
        return self._stage

    @stage.setter
    def stage(self, name: str) -> None:
        self._stage = name
        self.observer.stage(name)

    @property
    def _is_done(self) -> bool:
        return len(self._results) == len(self.graphs)

    @property
    def seconds_left(self) -> float | None:
        """What the bake is expected to take from now on; None while too little is done to tell. It may rise,
        which `progress` must not: where steps take longer than expected that is told at once."""
        if self._seconds_left is None:
            return None
        # A step that has not come back yet may take longer than expected: then it is taken to be halfway.
        since = time.perf_counter() - self._shown
        return max(self._seconds_left - since, 0.5 * self._seconds_left)

    @property
    def needs_main_thread(self) -> bool:
        return self.devices.primary.name == "gpu"

    @property
    def is_cancelled(self) -> bool:
        return self.devices.fallback.cancel_flag.is_set()

    def cancel(self) -> None:
        """From any thread; `advance` then raises Cancelled."""
        self.devices.fallback.cancel_flag.set()

    def advance(self, budget_seconds: float = float("inf")) -> bool:
        """Works on, at least by a step; True when the result is there. Raises Cancelled, or what failed."""
        end = time.perf_counter() + budget_seconds
        while not self._is_done:
            if self._failure is not None:
                raise self._failure
            try:
                next(self._work, None)
            except (*self.devices.primary.cancelled, *self.devices.fallback.cancelled):
                self._failure = Cancelled()
                raise self._failure from None
            except BaseException as failure:
                self._failure = failure
                raise
            if time.perf_counter() >= end:
                break
        return self._is_done

    def result(self) -> Baked:
        """Of the first shot."""
        return self.results()[0]

    def results(self) -> list[Baked]:
        """One for each shot."""
        self.advance()
        return self._results

    def _run(self) -> Iterator[None]:
        executor = Executor(self.devices.primary, self.devices.fallback, keeps_inputs=False)
        executor.observer = self.observer
        began, execution = time.perf_counter() - self.read_seconds, executor.execution
        self._forecasts = [self._forecast(graph, [graph], execution) for graph in self.graphs]
        yield from self._take_coarse_pictures(executor)
        executor.outline = self.outline
        for number in range(len(self.graphs)):
            yield from self._bake(executor, number, execution, began)
            execution, began = Execution(), time.perf_counter()
        executor.release()
        self.progress, self.stage, self._seconds_left = 1.0, "Done", None

    def _forecast(
        self, graph: Graph, groups: Sequence[Graph], execution: Execution, passes: Passes | None = None
    ) -> Forecast:
        sampling = sampling_of(graph, self.options)
        tiles = sampling.chunk_count // sampling.samples
        parts = [(group, sampling.samples) for group in groups]
        if sampling.passes:
            parts = (passes or Passes(None, None, self.options)).parts(groups, sampling)
        parts = [(part, samples * tiles) for part, samples in parts]
        return Forecast(
            parts,
            sampling.width * sampling.height / tiles,
            execution,
            self.outline,
            self.devices.primary.name,
        )

    def _bake(self, executor: Executor, number: int, execution: Execution, began: float) -> Iterator[None]:
        """One shot; what those to come read of the same stays with the executor."""
        before = self._coarse_picture_seconds[number] + (0.0 if number else self.read_seconds)
        outline, options, graph = self.outline, self.options, self.graphs[number]
        later, sampling = self.graphs[number + 1 :], sampling_of(graph, options)
        groups, self.memory = groups_of(outline, graph, options, self._held, self._layers_bytes)
        shortage = [self.memory.shortage] if self.memory.shortage else []
        cancelled = (*self.devices.primary.cancelled, *self.devices.fallback.cancelled)
        self._measuring = None
        is_aiming = any(map(options.target_of, graph.layers))
        if (options.probes != 0 or is_aiming) and graph.shot.has_eye:  # probes lie along view rays
            measurement = Measurement(options.probes, options.seed, cancelled)
            tree = ray_accelerator(outline, graph.shot)
            outlook = MeasuringOutlook(graph, outline, tree, options.probes)
            self._measuring = Measuring(
                measurement, outlook, executor, outline, graph, sampling, before, options.error_images
            )
            self._measuring.look = self.look
            if options.probes != 0:
                pixels = sampling.width * sampling.height
                execution.kept_pixels = pixels_to_keep(pixels, sampling.samples, options.seed)
        self._forecasts[: len(self._forecasts) - len(later)] = [self._forecast(graph, groups, execution)]

        def learnt() -> None:
            self._forecasts[0] = self._forecast(graph, groups, execution, passes)

        ends_at = began + (BAKING_SHARE if options.probes != 0 else 1.0) * options.time_budget_s
        passes = Passes(
            executor,
            self._measuring,
            options,
            learnt,
            ends_at if options.time_budget_s else 0.0,
            len(groups),
        )
        errors: dict[str, LayerError | NotMeasured] = {}
        for count, group in enumerate(groups, start=1):
            self.stage = "Baking"
            sampled = partial(self._show_tile, graph, execution)
            work = passes if sampling.passes else executor
            for _ in work.run(group, sampling, execution, sampled):
                self._show_progress()
                yield
            if self._measuring:
                self.observer.tell(watching_s=sum(self._measuring.watching_seconds.values()))
            if self._measuring and options.probes != 0:
                self.stage = "Measuring"
                errors |= yield from self._showing(self._measuring.errors(group))
            execution.weights.clear()
            executor.keep_only(*groups[count:], *later)
            if len(groups) > 1:
                give_back()
        seconds = time.perf_counter() - began
        self._forecasts[0].learn()
        keep_speeds(options.backend, self.devices.primary.name, seconds)
        self.graphs[number], missing = with_neutral(graph, self.sequence, outline)
        baked = put_together(
            outline=outline,
            graph=self.graphs[number],
            devices=self.devices,
            execution=execution,
            chosen={effect.id: params for effect, params in options.chosen().items()},
            seed=options.seed,
            chunks=sampling.chunk_count,
            errors=errors,
            seconds=seconds,
            coarse_picture_seconds=self._coarse_picture_seconds[number],
            memory=self.memory,
            warnings=[*self._warnings, *shortage, *execution.warnings],
            samples=options.set_samples,
            chosen_samples={**passes.chosen, **self._chosen_before(graph, passes.chosen, errors)},
            watching_seconds=self._measuring.watching_seconds if self._measuring else {},
            target_error=options.aim,
            time_budget_s=options.time_budget_s,
            placement=sampling.placement.value,
            error_images=self._measuring.images if self._measuring else {},
            sequence=self.sequence,
            missing=missing,
            has_picture=options.composite,
        )
        self._results.append(baked)
        self._layers_bytes += self.memory.layers

    def _chosen_before(
        self, graph: Graph, chosen: dict[str, Chosen], errors: dict[str, LayerError | NotMeasured]
    ) -> dict[str, Chosen]:
        """Where nobody looked, since samples were chosen before, the measured error tells of the target."""
        found = {}
        for layer in graph.layers if self.options.samples_of else ():
            target, error = self.options.asked_of(layer), errors.get(layer.name)
            if target and isinstance(error, LayerError):
                seen, least = (layer.kind.score.rms(each) for each in (error.value, error.ci95[0]))
                found[layer.name] = replace(chosen[layer.name], target=Target(target, seen, least=least))
        return found

    def _show_progress(self) -> None:
        """`progress` is the share of the expected time that has passed, and never falls. Faces count from
        when there is a job, so that reading is no part of it."""
        now = time.perf_counter()
        if now - self._shown < SHOWING_SECONDS:
            return
        self._shown, passed = now, now - self._started
        left = sum(forecast.seconds_left() for forecast in self._forecasts)
        if self._measuring:
            left += self._measuring.seconds_left(passed + left, self._forecasts[0].slower())
        self.progress = max(self.progress, passed / (passed + left))
        if self._seconds_left is not None or passed > FIRST_TOLD_SHARE * (passed + left):
            self._seconds_left = left

    def _show_tile(self, graph: Graph, execution: Execution, chunk: Chunk) -> None:
        """After a tile's 1st, 2nd, 4th ... and last sample. Of other groups all or nothing is there."""
        taken = chunk.sample + 1
        if self.tiles is None or (taken & chunk.sample and taken < chunk.samples):
            return
        name = next((layer.name for layer in graph.layers if _is_composite(layer)), None)
        if name in execution.films:
            tile = execution.films[name].image(slice(chunk.y0, chunk.y1))
            self.tiles.append((chunk.y0, tile))

    def _take_coarse_pictures(self, executor: Executor) -> Generator[None]:
        """Takes a coarse picture of each shot and plans again with it and with the arrays: boxes alone cannot
        tell that a wall hides the plain behind it, and maps would be spread over both, nor whether the house
        around a lamp is close to it."""
        device = self.devices.fallback
        for number, graph in enumerate(self.graphs):
            self._coarse_picture_seconds.append(0.0)
            if graph.surface is None or not graph.shot.has_eye:
                continue
            node, shot = graph.surface, graph.shot
            geometry = executor.value(node.inputs[0], device)
            yield
            who = node.params["visible"], node.params.get("holdouts", frozenset())
            taking = take_coarse_picture(device, geometry, self.outline, shot, *who)
            seen, seconds = yield from timed(self._showing(unless_cancelled(taking, device.cancel_flag)))
            if len(seen):
                started = time.perf_counter()
                self.outline = replace(self.outline, distance_m=device.distance_m)
                self.graphs[number] = plan_scene(self.outline, replace(shot, seen=seen), self.options)
                seconds += time.perf_counter() - started
            self._coarse_picture_seconds[number] = seconds

    def _showing[Result](self, work: Generator[None, None, Result]) -> Generator[None, None, Result]:
        """The same, telling `progress` at its yields."""
        while True:
            try:
                next(work)
            except StopIteration as end:
                return end.value
            self._show_progress()
            yield


def _is_composite(layer: PlannedLayer) -> bool:
    return not layer.effect and not layer.of.is_lamp


def read_depsgraph(
    depsgraph,
    options: Options,
    camera=None,
    size=None,
    exact: Exact | None = None,
    observer: Observer = NOBODY,
) -> tuple[Outline, Graph, Arrays, float] | None:
    """Scans, plans and extracts what the plan reads from an evaluated depsgraph of Blender's (in render mode:
    as F12 sees the scene); `camera` is Blender's, None for the scene's. Returns the seconds too. With `exact`
    the options say whether it counts; None where it now waits for what is to be baked first."""
    from .scene.extract import extract, with_known_clips
    from .scene.scan import ScanOptions, scan

    started = time.perf_counter()
    name, exact = camera.name if camera else None, exact if options.read == Read.EXACT.value else None
    if exact is not None:
        exact.texels = options.read_texels
    observer.stage("Scanning")
    found = scan(depsgraph, ScanOptions(size=size, camera=name, seed=options.seed, exact=exact))
    observer.stage("Planning")
    graph = plan_scene(found.outline, found.shot, options)
    if exact is not None:
        parts = found.exactly.needed(graph, found.outline)
        exact.wait_for(parts)
        if exact.is_waiting:
            return None
        found = replace(found, outline=replace(found.outline, baked=tuple(exact.told(parts))))
    observer.stage("Extracting")
    arrays = extract(found, graph.wants, graph.instances)
    outline = with_known_clips(found.outline, arrays)
    return outline, graph, arrays, time.perf_counter() - started


def read_scene(
    scene, view_layer, options: Options, frame: int | None = None, camera=None, size=None
) -> tuple[Outline, Graph, Arrays, float]:
    """`read_depsgraph` of the scene as F12 would see it; `scene`, `view_layer` and `camera` are Blender's.
    Only on the main thread."""
    from .scene.exact.rounds import with_exact

    def read(depsgraph, exact):
        return read_depsgraph(depsgraph, options, camera, size, exact)

    return with_exact(scene, view_layer, read, frame, camera)


def read_job(
    scene,
    view_layer,
    options_of: Callable[[Any], Options],
    frame: int | None = None,
    camera=None,
    size=None,
    show: Callable[[float], None] | None = None,
    observer: Observer = NOBODY,
    **job_arguments,
) -> BakeJob:
    """A bake of the scene as F12 would see it. `options_of(scene)` is asked with the scene as evaluated at
    the frame, where animated and driven settings have their values; `show` is told the share that is done of
    what Blender bakes of materials before, and may raise; `job_arguments` go to the BakeJob. Only on the main
    thread."""
    from .scene.exact.rounds import with_exact

    def read(depsgraph, exact):
        options = options_of(depsgraph.scene_eval)
        return options, read_depsgraph(depsgraph, options, camera, size, exact, observer)

    observer.stage("Evaluating")
    options, (*found, seconds) = with_exact(scene, view_layer, read, frame, camera, show)
    return BakeJob(*found, options, read_seconds=seconds, observer=observer, **job_arguments)


def bake(scene, view_layer, options: Options, **where) -> Baked:
    """Reads and bakes, to the end; `where` as `read_scene` takes it."""
    outline, graph, arrays, seconds = read_scene(scene, view_layer, options, **where)
    return BakeJob(outline, graph, arrays, options, read_seconds=seconds).result()
