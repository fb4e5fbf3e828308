"""How long a bake still takes, from what its nodes have taken so far.

A node at the surface runs once for every chunk, so its first runs tell of the others; a node that has not
run yet takes what others of its step took for as much work, in this bake or an earlier one of this process;
what nothing is known of takes what that step takes on an ordinary machine, times how much slower this one has
been so far.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from .execution import Execution
from .graph import Graph, Node, Rate
from .outline import Outline

MOST_SECONDS = 0.01, 50e-9  # of steps that do not say (Step.ordinary_seconds)

KNOWN_SECONDS = 0.5
"""What these are worth beside what the bake has shown so far: its first steps tell little of the others."""

_learnt: dict[str, dict[tuple[str, bool], float]] = {}
"""Of bakes on each device, seconds per run of the least work, or per pixel of a step at the surface, in this
process: a sequence's second frame knows what the first one took."""


def learnt(device: str) -> dict[tuple[str, bool], float]:
    """Seconds by step's name, and whether it runs at the surface, of bakes on `device` (a GPU's have steps
    that ran on the CPU too)."""
    return dict(_learnt.get(device, {}))


def recall(device: str, seconds: Mapping[tuple[str, bool], float]) -> None:
    """What `learnt` said in an earlier process; what this one knows better stays."""
    _learnt[device] = {**seconds, **_learnt.get(device, {})}


@dataclass
class _Runs:
    """Of one node: how often at the end, in what seconds are kept for each, and what such a one takes on an
    ordinary machine. `is_plain`: all nodes of its kind have about as much to do."""

    kind: tuple[str, bool]
    runs: int
    unit: float
    ordinary: float
    is_plain: bool


class Forecast:
    """Of `parts` that one after the other go into `execution` on `device`: graphs, and in how many chunks of
    `pixels` pixels each runs. It is asked many times a second, about hundreds of nodes: what does not change
    is found once, and nodes go by their keys, since their own hash is Python's work."""

    def __init__(
        self,
        parts: Iterable[tuple[Graph, int]],
        pixels: float,
        execution: Execution,
        outline: Outline,
        device: str = "cpu",
    ):
        self._learnt = _learnt.setdefault(device, {})
        self._pixels, self._execution, self._outline = pixels, execution, outline
        self._nodes: dict[str, _Runs] = {}
        for graph, chunks in parts:
            for node in graph.nodes():
                is_known = node.key in self._nodes
                more = chunks if node.rate == Rate.SAMPLE else int(not is_known)
                if is_known:
                    self._nodes[node.key].runs += more
                else:
                    self._nodes[node.key] = self._runs_of(node, more)

    def seconds_left(self) -> float:
        """What the nodes that are still to run will take."""
        taken = self._taken()
        slower, learnt = self._slower(taken), dict(self._learnt)
        sums: dict[tuple[str, bool], list[float]] = {}
        for node, seconds, runs in taken.values():
            total = sums.setdefault(node.kind, [0.0, 0.0])
            total[0] += seconds
            total[1] += runs * node.unit
        left = 0.0
        for key, node in self._nodes.items():
            _, seconds, done = taken.get(key, (node, 0.0, 0))
            if done >= node.runs:
                continue
            if done:
                each = seconds / done
            else:
                # Lamps differ: where a step does not say by how much, the next may be a more usual one.
                usual = learnt.get(node.kind, slower * node.ordinary)
                known, units = sums.get(node.kind, (0.0, 0.0))
                more = node.runs * node.unit if node.is_plain or not units else 0.0
                each = node.unit * (known + usual * more) / (units + more)
            left += (node.runs - done) * each
        return left

    def slower(self) -> float:
        """How many times as long as on an ordinary machine what ran has taken."""
        return self._slower(self._taken())

    def usually_slower(self) -> float:
        """The same by what earlier bakes tell, before anything has run."""
        usual, real = KNOWN_SECONDS, KNOWN_SECONDS
        for node in self._nodes.values():
            if (seconds := self._learnt.get(node.kind)) is not None:
                usual += node.runs * node.unit * node.ordinary
                real += node.runs * node.unit * seconds
        return real / usual

    def _slower(self, taken: dict[str, tuple[_Runs, float, int]]) -> float:
        usual, real = KNOWN_SECONDS, KNOWN_SECONDS
        for node, seconds, runs in taken.values():
            if node.kind not in self._learnt:
                usual += runs * node.unit * node.ordinary
                real += seconds
        return real / usual

    def learn(self) -> None:
        """At the end: what the steps took is known to the next bake."""
        sums: dict[tuple[str, bool], list[float]] = {}
        for node, seconds, runs in self._taken().values():
            total = sums.setdefault(node.kind, [0.0, 0.0])
            total[0] += seconds
            total[1] += runs * node.unit
        self._learnt.update({kind: seconds / units for kind, (seconds, units) in sums.items() if units})

    def _taken(self) -> dict[str, tuple[_Runs, float, int]]:
        """Seconds and runs of each node so far, by its key; copies between devices take time and are no
        runs."""
        found: dict[str, tuple[_Runs, float, int]] = {}
        for (key, device), timing in list(self._execution.timings.items()):
            if key not in self._nodes:  # what only measuring asked for
                self._nodes[key] = self._runs_of(timing.node, 0)
            node, seconds, runs = found.get(key, (self._nodes[key], 0.0, 0))
            found[key] = node, seconds + timing.seconds, runs if " to " in device else max(runs, timing.runs)
        return found

    def _runs_of(self, node: Node, runs: int) -> _Runs:
        step, is_at_surface = node.step, node.rate == Rate.SAMPLE
        unit = step.work_of(node, self._outline) if step.work_of else 1.0
        ordinary = MOST_SECONDS[is_at_surface] if step.ordinary_seconds is None else step.ordinary_seconds
        unit *= self._pixels if is_at_surface else 1.0
        return _Runs((step.name, is_at_surface), runs, unit, ordinary, step.work_of is None)
