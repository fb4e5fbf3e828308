"""How many probes measuring may take where nobody said how many."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator

from ..core.graph import Graph
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


PROBE_SECONDS = 3e-4
TRIANGLE_SECONDS = 5e-7
"""What a probe of a layer and a triangle of the tree take on an ordinary machine."""

USED_SHARE = 0.8
"""Of the seconds that are allowed, what layers take that need them all: probes are powers of two."""


class MeasuringOutlook:
    """How long measuring will take. `has_tree`: what rays need has been built."""

    def __init__(self, graph: Graph, outline: Outline, probes: int | None):
        self._layers = sum(layer.kind.score is not None for layer in graph.layers)
        self._probes = probes
        self._tree = TRIANGLE_SECONDS * sum(mesh.triangles for mesh in outline.meshes)
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
        found, seconds = yield from self._counted(work)
        self._done, self._taken = self._done + 1, self._taken + seconds
        self._current, self._expected = 0.0, None
        return found, seconds

    def _counted[Result](self, work: Generator[None, None, Result]) -> Generator[None, None, Result]:
        while True:
            started = time.perf_counter()
            try:
                next(work)
            except StopIteration as end:
                return end.value
            self._current += time.perf_counter() - started
            yield

    def seconds_left(self, baking_seconds: float) -> float:
        """Where the bake without measuring takes so many seconds."""
        tree = 0.0 if self.has_tree else self._tree
        left = self._layers - self._done
        if self._probes is None:  # layers differ tenfold, and share what time there is
            allowed = max(allowed_seconds(baking_seconds) - tree - self._taken, 0.0)
            each = min(PROBE_SECONDS * DEFAULT_PROBES, USED_SHARE * allowed / max(left, 1))
        else:
            each = self._taken / self._done if self._done else PROBE_SECONDS * self._probes
        if left <= 0:
            return tree
        if self._expected is not None:
            here = max(self._expected - self._current, 0.1 * self._current)
        else:  # one that takes longer than expected is taken to be two thirds through
            here = max(each - self._current, 0.5 * self._current)
        return tree + (left - 1) * each + here


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
        if number + 1 == len(PILOTS):
            while 2 * probes <= min(affordable, most):
                probes *= 2
            if probes > found[1]:
                # What all numbers of probes need besides shows between the pilots.
                each = max(took - before, 0.0) / (found[1] - PILOTS[number - 1])
                expect(min(took + each * (probes - found[1]), took * probes / found[1]))
                found = (yield from work(probes)), probes
        elif affordable < PILOTS[number + 1]:
            break
        before = took
    return found
