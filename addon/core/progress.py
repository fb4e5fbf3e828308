"""How long a bake still takes, from what its nodes have taken so far.

A node at the surface runs once for every chunk, so its first runs tell of the others; a node that has not
run yet takes what others of its step took for as much work, in this bake or an earlier one of this process;
what nothing is known of takes what that step takes on an ordinary machine, times how much slower this one has
been so far.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from .execution import Execution
from .graph import Graph, Node, Rate
from .outline import Outline

MOST_SECONDS = 0.01, 50e-9  # of steps that do not say (Step.ordinary_seconds)

KNOWN_SECONDS = 0.5
"""What these are worth beside what the bake has shown so far: its first steps tell little of the others."""

_learnt: dict[tuple[str, bool], float] = {}
"""Seconds per run of the least work, or per pixel of a step at the surface, in the bakes of this process: a
sequence's second frame knows what the first one took."""


def learnt() -> dict[tuple[str, bool], float]:
    """Seconds by step's name, and whether it runs at the surface."""
    return dict(_learnt)


def recall(seconds: Mapping[tuple[str, bool], float]) -> None:
    """What `learnt` said in an earlier process; what this one knows better stays."""
    _learnt.update({kind: each for kind, each in seconds.items() if kind not in _learnt})


class Forecast:
    """Of `parts` that one after the other go into `execution`: graphs, and in how many chunks of `pixels`
    pixels each runs."""

    def __init__(
        self, parts: Iterable[tuple[Graph, int]], pixels: float, execution: Execution, outline: Outline
    ):
        self._pixels, self._execution, self._outline = pixels, execution, outline
        self._runs: dict[Node, int] = {}  # of each node, at the end
        self._units: dict[Node, float] = {}
        for graph, chunks in parts:
            for node in graph.nodes():
                more = chunks if node.rate == Rate.SAMPLE else int(node not in self._runs)
                self._runs[node] = self._runs.get(node, 0) + more

    def seconds_left(self) -> float:
        """What the nodes that are still to run will take."""
        taken = self._taken()
        slower, learnt = self._slower(taken), dict(_learnt)
        sums: dict[tuple[str, bool], list[float]] = {}
        for node, (seconds, runs) in taken.items():
            kind = _kind(node)
            total = sums.setdefault(kind, [0.0, 0.0])
            total[0] += seconds
            total[1] += runs * self._unit(node)
        left = 0.0
        for node, runs in self._runs.items():
            seconds, done = taken.get(node, (0.0, 0))
            if done:
                each = seconds / done
            else:
                # Lamps differ: where a step does not say by how much, the next may be a more usual one.
                usual = learnt.get(_kind(node), slower * _ordinary(node))
                known, units = sums.get(_kind(node), (0.0, 0.0))
                more = 0.0 if units and node.step.work_of else runs * self._unit(node)
                each = self._unit(node) * (known + usual * more) / (units + more)
            left += max(runs - done, 0) * each
        return left

    def slower(self) -> float:
        """How many times as long as on an ordinary machine what ran has taken."""
        return self._slower(self._taken())

    def usually_slower(self) -> float:
        """The same by what earlier bakes tell, before anything has run."""
        usual, real = KNOWN_SECONDS, KNOWN_SECONDS
        for node, runs in self._runs.items():
            if (seconds := _learnt.get(_kind(node))) is not None:
                usual += runs * self._unit(node) * _ordinary(node)
                real += runs * self._unit(node) * seconds
        return real / usual

    def _slower(self, taken: dict[Node, tuple[float, int]]) -> float:
        usual, real = KNOWN_SECONDS, KNOWN_SECONDS
        for node, (seconds, runs) in taken.items():
            if _kind(node) not in _learnt:
                usual += runs * self._unit(node) * _ordinary(node)
                real += seconds
        return real / usual

    def learn(self) -> None:
        """At the end: what the steps took is known to the next bake."""
        sums: dict[tuple[str, bool], list[float]] = {}
        for node, (seconds, runs) in self._taken().items():
            total = sums.setdefault(_kind(node), [0.0, 0.0])
            total[0] += seconds
            total[1] += runs * self._unit(node)
        _learnt.update({kind: seconds / units for kind, (seconds, units) in sums.items() if units})

    def _taken(self) -> dict[Node, tuple[float, int]]:
        """Seconds and runs of each node so far; copies between devices take time and are no runs."""
        found: dict[Node, tuple[float, int]] = {}
        for timing in list(self._execution.timings.values()):
            seconds, runs = found.get(timing.node, (0.0, 0))
            copies = " to " in timing.device
            found[timing.node] = seconds + timing.seconds, runs if copies else max(runs, timing.runs)
        return found

    def _unit(self, node: Node) -> float:
        """How much a run has to do, in what seconds are kept for."""
        if node not in self._units:
            work = node.step.work_of(node, self._outline) if node.step.work_of else 1.0
            self._units[node] = work * (self._pixels if node.rate == Rate.SAMPLE else 1.0)
        return self._units[node]


def _kind(node: Node) -> tuple[str, bool]:
    return node.step.name, node.rate == Rate.SAMPLE


def _ordinary(node: Node) -> float:
    seconds = node.step.ordinary_seconds
    return MOST_SECONDS[node.rate == Rate.SAMPLE] if seconds is None else seconds
