"""How many probes measuring may take where nobody said how many."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator

from ..core.graph import Graph, Node, PlannedLayer
from ..core.outline import Outline
from ..core.slices import timed

DEFAULT_PROBES = 2048
SHARE = 0.15
"""Of a bake's seconds, with the measuring."""

SHORT_SECONDS = 2.0
"""Shorter bakes are allowed what one of so many seconds is."""

PILOTS = (8, 32, 128)
"""Probes of the runs that tell what more would take. What is made once (a tree, a sorted hull) falls to the
first, so that only the others tell."""


def allowed_seconds(baked_seconds: float) -> float:
    """For measuring all that was baked in so many seconds."""
    return SHARE / (1.0 - SHARE) * max(baked_seconds, (1.0 - SHARE) * SHORT_SECONDS)


PILOT_SECONDS = 0.1
"""What the first two take of a layer whatever it is, on an ordinary machine."""

USED_SHARE = 0.75
"""Of the seconds that are allowed, what layers take that need them all: probes are powers of two."""


def _counted[Result](
    work: Generator[None, None, Result], count: Callable[[float], None]
) -> Generator[None, None, Result]:
    """The same; `count` is told the seconds of each of its slices."""
    while True:
        started = time.perf_counter()
        try:
            next(work)
        except StopIteration as end:
            return end.value
        finally:
            count(time.perf_counter() - started)
        yield


class MeasuringOutlook:
    """How long measuring will take. `tree`: what rays need, which an effect may need too; `has_tree`: it
    has been built."""

    def __init__(self, graph: Graph, outline: Outline, tree: Node, probes: int | None):
        self._layers = [layer for layer in graph.layers if layer.kind.score is not None]
        self._probes = probes
        self.tree_seconds = (  # on an ordinary machine
            0.0 if tree in graph.nodes() else tree.step.ordinary_seconds * tree.step.work_of(tree, outline)
        )
        self._done, self._taken, self._current = 0, 0.0, 0.0
        self._expected: float | None = None  # of the layer at hand
        self.has_tree = False

    def expect(self, seconds: float) -> None:
        """The layer at hand takes so many seconds more."""
        self._expected = self._current + seconds

    def watched[Result](
        self, work: Generator[None, None, tuple[Result, float]]
    ) -> Generator[None, None, tuple[Result, float]]:
        """The measuring of one layer (core/slices.py, timed), counted."""
        found, seconds = yield from _counted(work, self._count)
        self._done, self._taken = self._done + 1, self._taken + seconds
        self._current, self._expected = 0.0, None
        return found, seconds

    def _count(self, seconds: float) -> None:
        self._current += seconds

    def seconds_left(self, baking_seconds: float, slower: float = 1.0) -> float:
        """Where the bake without measuring takes so many seconds on a machine that is so many times as slow
        as an ordinary one."""
        tree = 0.0 if self.has_tree else slower * self.tree_seconds
        allowed = allowed_seconds(baking_seconds) - tree - self._taken
        left, layers = tree, self._layers[self._done :]
        for number, layer in enumerate(layers):
            expected = self._usual_seconds(layer, allowed / (len(layers) - number), slower)
            allowed -= expected
            if number == 0 and self._expected is not None:
                expected = max(self._expected - self._current, 0.25 * self._current)
            elif number == 0:  # one that takes longer than expected is taken to be two thirds through
                expected = max(expected - self._current, 0.5 * self._current)
            left += expected
        return left

    def _usual_seconds(self, layer: PlannedLayer, allowed: float, slower: float) -> float:
        """Of a layer that has not been measured yet."""
        each = slower * layer.kind.score.probe_seconds
        if self._probes is not None:  # as much slower or faster as those so far
            done = slower * sum(layer.kind.score.probe_seconds for layer in self._layers[: self._done])
            return each * (self._taken / done if done else self._probes)
        least = each * sum(PILOTS[:2]) + slower * PILOT_SECONDS
        return max(min(each * DEFAULT_PROBES, USED_SHARE * allowed), least)


class ImagesOutlook:
    """How long error images will take, of so many pixels for each of the graph's measured layers."""

    def __init__(self, graph: Graph, pixels: int):
        scores = (layer.kind.score for layer in graph.layers)
        self._ordinary = sum(pixels * score.pixel_seconds for score in scores if score is not None)
        self._done, self.seconds = 0.0, 0.0  # seconds on an ordinary machine of what is done, and those spent

    def show(self, layer: PlannedLayer, pixels: int) -> None:
        """So many more pixels of a layer's image are done, or will not be made."""
        self._done += pixels * layer.kind.score.pixel_seconds

    def watched[Result](self, work: Generator[None, None, Result]) -> Generator[None, None, Result]:
        """The making of one, counted."""
        return (yield from _counted(work, self._count))

    def _count(self, seconds: float) -> None:
        self.seconds += seconds

    def seconds_left(self, slower: float) -> float:
        """On a machine that is so many times as slow as an ordinary one, once some are made as it was with
        those."""
        slower = self.seconds / self._done if self._done else slower
        return max(self._ordinary - self._done, 0.0) * slower


def _still_to_run(number: int, affordable: float, most: int) -> tuple[int, int]:
    """Probes of all runs after a pilot, where there is time for so many, and of the last of them."""
    more, last = 0, PILOTS[number]
    for pilot in PILOTS[number + 1 :]:
        if affordable - more < pilot:
            return more, last
        more, last = more + pilot, pilot
    while 2 * last <= min(affordable - more, most):
        last *= 2
    return (more + last if last > PILOTS[-1] else more), last


def within[Result](
    work: Callable[[int], Generator[None, None, Result]],
    seconds: float,
    most: int = DEFAULT_PROBES,
    expect: Callable[[float], None] = lambda seconds: None,
) -> Generator[None, None, tuple[Result, int]]:
    """What `work(probes)` returns, for the largest power of two of probes that fits into `seconds`, and that
    number: at least the second pilot's, at most `most`. `expect` is told how long it still
    takes, as soon as that is known.

    The clock decides, not what was found, so that the estimates stay unbiased; powers of two, so that a bake
    that is made again seldom gets another number.
    """
    found, spent, before = None, 0.0, 0.0
    for number, probes in enumerate(PILOTS):
        if number == 0 and seconds <= 0.0:
            continue  # there is nothing to find out
        result, took = yield from timed(work(probes))
        found, spent = (result, probes), spent + took
        if number == 0:
            before = took
            continue
        affordable = probes * (seconds - spent) / max(took, 1e-6)
        more, last = _still_to_run(number, affordable, most)
        if not more:
            break
        # What all numbers of probes need besides shows between the pilots, as soon as neither made a tree.
        each = max(took - before, 0.0) / (probes - PILOTS[number - 1])
        low, high = sorted((took + each * (more - probes), took * more / probes))
        expected = low if number > 1 else (low * high) ** 0.5
        if 2.0 * low < high:  # more of them will be affordable than it seems by what all need besides
            expected = max(expected, min(USED_SHARE * seconds - spent, took * most / probes))
        expect(expected)
        before = took
        if number + 1 == len(PILOTS):
            found = (yield from work(last)), last
    return found


def at_pace[Result](
    work: Callable[[int], Generator[None, None, Result]],
    seconds: float,
    besides: float,
    each: float,
    most: int = DEFAULT_PROBES,
    expect: Callable[[float], None] = lambda seconds: None,
) -> Generator[None, None, tuple[Result, int]]:
    """The same as `within`, without pilots, where it is known what `each` probe takes and what all numbers of
    them need `besides`."""
    probes = PILOTS[1]
    while 2 * probes <= most and besides + 2 * probes * each <= seconds:
        probes *= 2
    expect(besides + probes * each)
    return (yield from work(probes)), probes
