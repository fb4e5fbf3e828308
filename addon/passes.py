"""A bake in passes: each layer gets more samples until its error is at its target.

After every pass some pixels tell how far each layer still is (measure/watch.py). They are other pixels, with
other rays, than those that its reported error comes from: one that was low by chance does not stay low.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

from .core.execution import Execution
from .core.executor import Executor
from .core.film import takes_of
from .core.graph import Graph, PlannedLayer, Rate
from .core.sampling import FIRST_PASSES, Sampling
from .core.surface import Chunk
from .measure.report import NotMeasured
from .measure.target import Chosen, Target
from .measure.watch import Watch
from .measuring import Measuring
from .planning import USUAL_SAMPLES, Options

AIM = 0.95  # of the target, since what is known of an error is off by about as much
POWER, USUAL_ERROR = 0.7, 0.066
"""Errors fall about like this power of the number of samples, from about this with one, by what sample scenes
took (docs/accuracy.md, Targets); only the expected time depends on it."""
STUCK = 0.9
"""Where twice as many samples leave more than this of an error, more of them hardly help."""
FEWEST_TO_BE_STUCK = 16


class Passes:
    """Of one shot's groups, one after the other. `measuring` has the rays that tell how far layers are from
    their targets, which `options` say, unless it is known how many samples each gets. `chosen`: what
    was chosen so far; `learnt` is called when more is known of that. Where there is a moment that all
    `groups` should have ended at (`ends_at`, of time.perf_counter, 0: none), no pass begins that would go
    beyond it."""

    def __init__(
        self,
        executor: Executor | None,
        measuring: Measuring | None,
        options: Options,
        learnt: Callable[[], None] = lambda: None,
        ends_at: float = 0.0,
        groups: int = 1,
    ):
        self._executor, self._measuring, self._learnt = executor, measuring, learnt
        self._options, self._samples_of = options, options.samples_of
        self._ends_at, self._groups_left = 0.0 if self._samples_of else ends_at, groups
        self._expected: dict[str, float] = {}
        self.chosen: dict[str, Chosen] = {}

    def run(
        self, group: Graph, sampling: Sampling, execution: Execution, sampled: Callable[[Chunk], None]
    ) -> Generator[None]:
        """Makes the group's layers; yields between slices of work."""
        executor, going_on = self._executor, list(group.layers)
        looked = {
            layer.name: _Looked(self._measuring, layer, target)
            for layer in going_on
            if (target := self._options.target_of(layer)) and layer.is_whole
        }
        tiles = sampling.chunk_count // sampling.samples
        now = time.perf_counter()
        ends_at = self._ends_at and now + (self._ends_at - now) / max(self._groups_left, 1)
        self._groups_left -= 1
        for first, samples in pairwise((0, *sampling.passes)):
            part = replace(group, layers=tuple(going_on))
            own = replace(sampling, first=first, samples=samples)
            more = (samples - first) * tiles * _seconds_of_sample(part, execution)
            if first and ends_at and time.perf_counter() + more > ends_at:
                self._put_late(going_on, looked)
                break
            for _ in executor.run(part, own, execution, sampled, finishes=False):
                yield
            for layer in going_on:
                self.chosen[layer.name] = Chosen(samples)
                if layer.name in looked:
                    self.chosen[layer.name] = yield from looked[layer.name].chosen(samples)
                    self._expected[layer.name] = looked[layer.name].expected(samples, sampling.samples)
            going_on = self._going_on(group, going_on, looked, samples)
            self._learnt()
            if not going_on:
                break
        for name, each in looked.items():
            if each.failure:
                count = self.chosen[name].samples
                execution.warnings.append(
                    f"layer '{name}': how wrong it is could not be measured ({each.failure}), so that it has "
                    f"{count} samples, as many as any other or as there may be"
                )
        for _ in executor.finish(group, execution):
            yield
        for take in takes_of(group):
            if not take.is_whole:
                execution.set_aside(take)

    def _going_on(
        self, group: Graph, layers: list[PlannedLayer], looked: dict[str, _Looked], samples: int
    ) -> list[PlannedLayer]:
        """Layers that are to get more samples, what is made of what is made anyway, and as long as there are
        any what nobody looks at."""
        if self._samples_of:
            return [layer for layer in layers if samples < self._samples_of_layer(layer.name, group)]
        open_ones = {
            layer.name for layer in layers if layer.name in looked and not looked[layer.name].is_done
        }
        wanted = [layer for layer in layers if self._wants(layer, layers, looked, open_ones, samples)]
        made = set(replace(group, layers=tuple(wanted)).nodes())
        return [
            layer for layer in layers if layer.node in made and (layer in wanted or not self._is_set(layer))
        ]

    def _wants(
        self,
        layer: PlannedLayer,
        layers: list[PlannedLayer],
        looked: dict[str, _Looked],
        open_ones: set[str],
        samples: int,
    ) -> bool:
        """Whether more samples are to be made for its sake."""
        options = self._options
        if layer.name in looked:
            if looked[layer.name].failure and not open_ones:
                return samples < self._most_of_measured()
            is_open = layer.name in open_ones or looked[layer.name].failure
            return bool(is_open) and samples < options.most_samples
        if self._is_set(layer):
            return samples < options.set_samples
        if options.time_budget_s and not options.aim:
            return True
        usual = USUAL_SAMPLES if options.aim else options.set_samples
        others = any(each.effect and each.name not in looked for each in layers)
        return bool(open_ones) or (samples < usual and (others or not looked))

    def _most_of_measured(self) -> int:
        """Samples of a layer of which nobody can tell how wrong it is: as many as any other got, or as there
        may be."""
        got = (self.chosen[name].samples for name, each in self.chosen.items() if each.target)
        return max(got, default=self._options.most_samples)

    def _is_set(self, layer: PlannedLayer) -> bool:
        """Whether it gets as many samples as are set, whatever others get."""
        options = self._options
        is_free = options.aim or options.time_budget_s or options.target_of(layer)
        return bool(layer.effect) and not is_free

    def _put_late(self, layers: Iterable[PlannedLayer], looked: dict[str, _Looked]) -> None:
        """There was no time for more samples of these."""
        for layer in layers:
            chosen = self.chosen[layer.name]
            if layer.name not in looked or not looked[layer.name].is_done:
                target = chosen.target and replace(chosen.target, is_late=True)
                self.chosen[layer.name] = replace(chosen, target=target)

    def _samples_of_layer(self, name: str, group: Graph) -> int:
        """What is made of others, of which reports say nothing, has as many as the most of those; a layer of
        which nobody knew, as the most of any, in all frames of a sequence."""
        if name in self._samples_of:
            return self._samples_of[name]
        if any(layer.effect for layer in group.layers if layer.name == name):
            return max(self._samples_of.values())
        known = (self._samples_of[layer.name] for layer in group.layers if layer.name in self._samples_of)
        return max(known, default=USUAL_SAMPLES)

    def parts(self, groups: Sequence[Graph], sampling: Sampling) -> list[tuple[Graph, int]]:
        """What has run and what is expected to: graphs, and how many samples of each."""
        found = []
        for group in groups:
            counts = self.counts(group, sampling)
            for first, samples in pairwise((0, *sorted(set(counts.values())))):
                layers = tuple(layer for layer in group.layers if counts[layer.name] >= samples)
                found.append((replace(group, layers=layers), samples - first))
        return found

    def expect(self, samples: Mapping[str, float]) -> None:
        """Says how many samples layers are likely to get, by their names."""
        self._expected |= samples

    def counts(self, group: Graph, sampling: Sampling) -> dict[str, int]:
        """How many samples each layer has, or is expected to get."""
        likely = {layer.name: self._likely_samples(layer, group) for layer in group.layers}
        most = max((each for each in likely.values() if each), default=USUAL_SAMPLES)
        return {name: min(each or most, sampling.samples) for name, each in likely.items()}

    def _likely_samples(self, layer: PlannedLayer, group: Graph) -> int:
        """0: as many as the most of others."""
        if self._samples_of:
            return self._samples_of_layer(layer.name, group)
        if self._is_set(layer):
            return self._options.set_samples
        expected, target = self._expected.get(layer.name, 0.0), self._options.target_of(layer)
        if not expected and target:
            expected = max(samples_for(target), FIRST_PASSES[0])
        done = self.chosen[layer.name].samples if layer.name in self.chosen else 0
        return max(done, round(expected))


def samples_for(target: float, samples: int = 1, error: float = USUAL_ERROR) -> float:
    """How many it seems to take to a target error, where so many left an `error`."""
    return samples * (error / (AIM * target)) ** (1.0 / POWER)


class _Looked:
    """A layer that is looked at after each pass, until it `is_done`."""

    def __init__(self, measuring: Measuring, layer: PlannedLayer, target: float):
        self._measuring, self._layer, self._target = measuring, layer, target
        self._watch: Watch | float | None = None
        self._since, self._first = 0, 0.0  # samples that the watch began with, and its error then
        self._error: float | None = None
        self.is_done = self._was_stuck = False
        self.failure = ""  # why nobody can tell how wrong it is

    def chosen(self, samples: int) -> Generator[None, None, Chosen]:
        """What is chosen where no more follow."""
        if self.is_done:  # it goes on with another
            if isinstance(self._watch, Watch):
                self._error = self._measuring.watched_error(self._layer, self._watch)
            return Chosen(samples, self._told(self._was_stuck))
        before, is_doubled = self._first, samples >= 2 * self._since
        if isinstance(self._watch, Watch):
            self._error = self._measuring.watched_error(self._layer, self._watch)
            is_stuck = is_doubled and self._is_stuck(before, samples)
        else:
            is_stuck = False
        # What was likely to be wrong with few samples is not with many.
        if not is_stuck and is_doubled:
            found = yield from self._measuring.watch(self._layer, samples)
            if isinstance(found, NotMeasured):
                self.is_done, self.failure = True, found.why
                return Chosen(samples)
            is_first = self._error is None
            self._error = found
            if isinstance(found, Watch):
                self._error = self._measuring.watched_error(self._layer, found)
            elif not is_first:
                is_stuck = self._is_stuck(before, samples)
            self._watch, self._since, self._first = found, samples, self._error
        self.is_done, self._was_stuck = is_stuck or self._error <= AIM * self._target, is_stuck
        return Chosen(samples, self._told(is_stuck))

    def _is_stuck(self, before: float, samples: int) -> bool:
        """Whether it is as wrong as with half the samples, or nearly."""
        return samples >= FEWEST_TO_BE_STUCK and self._error > max(STUCK * before, self._target)

    def expected(self, samples: int, most: int) -> float:
        """Samples at the end, as it seems after so many."""
        if self.is_done or self._error is None:
            return samples
        return min(samples_for(self._target, samples, self._error), most)

    def _told(self, is_stuck: bool) -> Target | None:
        return None if self._error is None else Target(self._target, self._error, is_stuck)


def _seconds_of_sample(graph: Graph, execution: Execution) -> float:
    """What a sample of a tile takes, as far as it has been seen."""
    nodes = {node.key for node in graph.nodes() if node.rate == Rate.SAMPLE}
    taken = (each for each in execution.timings.values() if each.node.key in nodes)
    return sum(timing.seconds / max(timing.runs, 1) for timing in taken)
