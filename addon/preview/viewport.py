"""One viewport's picture: made at once while something moves, refined step by step when all is still."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any

import numpy as np

from ..core.effect import Reduce
from ..core.execution import Execution
from ..core.film import Film, takes_of
from ..core.graph import Graph, PlannedLayer, Rate
from ..core.reach import fitted
from ..core.sampling import Sampling
from ..core.surface import Chunk
from ..planning import Options, passes_of, places_of
from ..scene.viewport import Placement
from . import noise_map
from .budget import Budget
from .estimate import noise_shares, resolution_noise, sampling_noise
from .session import Session

STILL_SECONDS = 0.2
# Where redraws come slowly, a movement has ended when the next is so many times overdue, at the latest then;
# a step of the refinement begun between two frames would slow the movement down further.
BREAK, LONGEST_BREAK_SECONDS = 1.5, 0.8
LONGEST_SECONDS_BETWEEN = 1.0  # pictures of a refinement
TILE_PIXELS = 1 << 16  # so that a node does not take much longer than a frame
_epochs = count(1)


@dataclass
class Statistics:
    """Of what a viewport shows. `frame_ms`: from the change to the picture. `steps`: milliseconds and runs
    by step and instance, of the last frame, or of the refinement so far. `ran`: how many nodes that were.
    `noise`: estimated distance to a picture of any number of samples, as a share of its brightness
    (`estimate.py`); `out_of`: the setting whose time is up, so that it is not refined any further;
    `message` stands for a picture where there is none, and `has_failed` says that it ought to be there;
    `layers` names what could be shown; `has_spread`: there are samples enough for a map of their noise."""

    frame_ms: float = 0.0
    scale: float = 1.0
    map_share: float = 1.0
    samples: int = 0
    of_samples: int = 0
    noise: float | None = None
    is_converged: bool = False
    out_of: str = ""
    ran: int = 0
    steps: dict[tuple[str, str], tuple[float, int]] = field(default_factory=dict)
    message: str = ""
    has_failed: bool = False
    layers: tuple[str, ...] = ()
    has_spread: bool = False


@dataclass(eq=False)
class Picture:
    """What to draw: host pixels (height, width[, 3 or 4]) float32 or a device's image, and where in the
    region. `is_colour`: seen through the view transform."""

    pixels: Any
    place: tuple[float, float, float, float]
    is_colour: bool


def layer_of(graph: Graph, name: str) -> PlannedLayer | None:
    """The layer to show: the named one, or the composite, which has neither effect nor light."""
    for layer in graph.layers:
        if layer.name == name if name else not layer.effect and not layer.of.is_lamp:
            return layer
    return None


def _is_colour(layer: PlannedLayer) -> bool:
    return len(layer.channels) > 1 and not layer.kind.is_spread


def _noise(film: Film | None, samples: int, of_samples: int) -> float | None:
    """Of the mean of the first samples; None of what is no mean."""
    if film is None or film.reduce != Reduce.MEAN:
        return None
    return sampling_noise(film.image(), film.squares(), samples, of_samples)


class Viewport:
    """The picture of one region."""

    def __init__(self):
        self.budget = Budget()
        self.statistics = Statistics()
        self.picture: Picture | None = None
        self._spread: tuple[Film, int, int] | None = None  # what it was made of, samples, and of how many
        self._noise_map: Picture | None = None
        self.failed_at: Any = None  # what was asked for when it failed, for whoever asks
        self._asked: tuple | None = None
        self._changed_at = 0.0
        self._pause = STILL_SECONDS
        self._work: Iterator[None] | None = None
        self._costs: list[tuple[float, float]] = []
        self._layers: tuple[str, ...] = ()
        self._refined_graph: Graph | None = None

    def show(
        self,
        session: Session,
        placement: Placement,
        options: Options,
        layer: str,
        budget_ms: float,
        longest_s: float = 0.0,
    ) -> bool:
        """Makes a frame if anything has changed since the last; whether it did. Its refinement ends with the
        first sample that is done after `longest_s`, or the options' time budget; 0: with the last one."""
        asked = (session.version, placement, options, layer, longest_s)
        if asked == self._asked:
            return False
        self._asked = asked
        before = self._changed_at
        self._frame(session, placement, options, layer, budget_ms)
        self._changed_at = time.monotonic()
        self._pause = min(max(STILL_SECONDS, BREAK * (self._changed_at - before)), LONGEST_BREAK_SECONDS)
        self._work = self._still(session, placement, options, layer, longest_s)
        return True

    @property
    def has_work(self) -> bool:
        """Whether `advance` has anything to do, now or once it is still."""
        return self._work is not None

    def wait(self) -> float:
        """Seconds until it is still."""
        return max(0.0, self._changed_at + self._pause - time.monotonic())

    def advance(self, seconds: float, session_version: int, budget_ms: float) -> bool:
        """Refines for about so long, by one step at least; whether there is a new picture. Raises what
        steps raise."""
        if self._asked is None or session_version != self._asked[0]:
            self._work = None  # overtaken by a change that is not drawn yet
            return False
        if self._costs:
            self.budget.settle(budget_ms, *np.median(self._costs[-8:], axis=0))
            self._costs.clear()
        before = self.picture
        end = time.perf_counter() + seconds
        while self._work is not None:
            if next(self._work, self) is self:
                self._work = None
            if self.picture is not before or time.perf_counter() >= end:
                break
        return self.picture is not before

    def fail(self, line: str, asked: Any) -> None:
        """Says so in place of a picture; `asked` is what not to try again."""
        self.release()
        self.statistics = Statistics(message=line, has_failed=True)
        self.failed_at = asked

    def shown(self, shows_noise: bool) -> Picture | None:
        """The picture, or the map of its noise where its samples tell."""
        if not shows_noise or self._spread is None:
            return self.picture
        if self._noise_map is None:
            film, samples, of_samples = self._spread
            shares = noise_shares(film.image(), film.squares(), samples, of_samples)
            place = self.picture.place
            self._noise_map = Picture(noise_map.colours(shares), place, is_colour=False)
        return self._noise_map

    def _put(self, picture: Picture | None, spread: tuple[Film, int, int] | None = None) -> None:
        self.picture, self._spread, self._noise_map = picture, spread, None

    def release(self) -> None:
        self._put(None)
        self._work = self._asked = self.failed_at = None

    def _frame(self, session, placement: Placement, options: Options, name: str, budget_ms: float) -> None:
        """The picture at once, at the budget's scale."""
        started = time.perf_counter()
        prepared = self._moving(session, placement, options, name)
        if prepared is None:
            self._put(None)
            self.statistics = Statistics(
                message=f"no layer '{name}'" if name else "nothing is in view", layers=self._layers
            )
            return
        graph, layer, chunk = prepared
        executor = session.executor
        for _share in executor.frame(graph, chunk, next(_epochs)):
            pass
        device, value = executor.layer_value(layer)
        execution = executor.execution
        session.want(id(self), graph, *([self._refined_graph] if self._refined_graph else []))
        scale, map_share = self.budget.scale, self.budget.map_share
        self._put(Picture(value, placement.place(*placement.sizes(scale)), _is_colour(layer)))
        self._count(execution, started)
        statistics = self.statistics
        statistics.scale, statistics.map_share = scale, map_share
        statistics.of_samples = (passes_of(graph, options) or (options.set_samples,))[-1]
        statistics.noise = resolution_noise(value) if device.name == "cpu" else None
        costs = [0.0, 0.0]
        for timing in execution.timings.values():
            costs[timing.node.rate != Rate.SCENE] += 1e3 * timing.seconds
        self._costs.append(tuple(costs))
        self.budget.coarser(budget_ms, *costs)

    def _moving(self, session: Session, placement: Placement, options: Options, name: str):
        """Graph, layer and chunk of a frame while something moves; None where there is no such layer."""
        budget = self.budget
        graph = session.moving_plan(placement, budget.scale, options, budget.map_share)
        layer = layer_of(graph, name)
        self._layers = tuple(planned.name for planned in graph.layers if planned.effect)
        if layer is None:
            return None
        width, height = graph.shot.computed_size
        return replace(graph, layers=(layer,)), layer, Chunk(width, height, 0, height, 0, (0.0, 0.0))

    def _still(
        self, session: Session, placement: Placement, options: Options, name: str, longest_s: float
    ) -> Iterator[None]:
        """First the bake's picture, to the last bit; then what the next movement will want to find."""
        refined = yield from self._refined(session, placement, options, name, longest_s)
        prepared = self._moving(session, placement, options, name)
        if refined is None or prepared is None:
            return
        graph, _layer, chunk = prepared
        self._refined_graph = refined
        session.want(id(self), refined, graph)
        for _share in session.executor.frame(graph, chunk, next(_epochs)):
            yield

    def _refined(
        self, session: Session, placement: Placement, options: Options, name: str, longest_s: float
    ) -> Generator[None, None, Graph | None]:
        """The bake, but for its measurement: coarse picture, plan, sample by sample, their mean shown.
        Returns what ran."""
        started = time.perf_counter()
        graph = session.still_plan(placement, options)
        yield
        layer = layer_of(graph, name)
        if layer is None:
            return None
        graph = replace(graph, layers=(layer,))
        place = placement.place(*placement.sizes(1.0))
        passes = passes_of(graph, options)
        most = passes[-1] if passes else options.set_samples
        target = options.target_of(layer) or options.aim
        sampling = Sampling(
            *graph.shot.computed_size,
            most,
            graph.shot.pixel_filter,
            tile_pixels=TILE_PIXELS,
            is_progressive=True,
            passes=passes,
            places=places_of(graph.shot, options),
        )
        sampling = fitted(sampling, graph.nodes())
        executor, epoch, execution = session.executor, next(_epochs), Execution()
        takes = [replace(take, has_squares=True) for take in takes_of(graph)]
        shown = started
        limits = {"time_limit": longest_s, "time_budget": options.time_budget_s}
        limit_s, limit = min(((each, name) for name, each in limits.items() if each), default=(0.0, ""))
        for chunk in sampling.chunks():
            for _share in executor.frame(graph, chunk, epoch, execution):
                yield
            for take in takes:
                executor.collect(take, chunk)
            samples = chunk.sample + 1
            # Blender's redraws cost as much as a sample: only for what can be seen to differ.
            of_samples = chunk.samples  # all, or those after this pass
            is_worth = samples == of_samples or samples & (samples - 1) == 0
            is_worth = is_worth or time.perf_counter() - shown > LONGEST_SECONDS_BETWEEN
            is_late = 0.0 < limit_s < time.perf_counter() - started
            if chunk.y1 == sampling.height and (is_worth or is_late):
                shown = time.perf_counter()
                for _ in executor.develop(graph, takes, execution):
                    yield
                film = execution.films.get(layer.name)
                has_spread = samples > 1 and film is not None and film.reduce == Reduce.MEAN
                picture = Picture(execution.image(layer.name), place, _is_colour(layer))
                self._put(picture, (film, samples, of_samples) if has_spread else None)
                self._count(execution, started)
                self.statistics.has_spread = has_spread
                self.statistics.samples, self.statistics.of_samples = samples, most
                self.statistics.noise = noise = _noise(film, samples, of_samples)
                is_enough = samples == of_samples and noise is not None and noise <= target
                self.statistics.is_converged = is_enough or samples == most
                if self.statistics.is_converged:
                    break
                if is_late:
                    self.statistics.out_of = limit
                    break
            yield
        return graph

    def _count(self, execution: Execution, started: float) -> None:
        timings = execution.timings.values()
        self.statistics = Statistics(
            frame_ms=1e3 * (time.perf_counter() - started),
            ran=sum(timing.runs for timing in timings),
            layers=self._layers,
            steps={
                (timing.node.step.name, timing.node.instance): (1e3 * timing.seconds, timing.runs)
                for timing in timings
            },
        )
