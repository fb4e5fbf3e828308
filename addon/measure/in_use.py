"""How wrong a layer is that multiplies, used as it is meant to be: on the light that it multiplies, at the
delivered pixel, against the mean of many rays over the pixel's footprint. docs/accuracy.md has the method."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from ..core.metrics import maximum, quantile
from ..core.params import Params
from ..core.random import hash_bits
from ..core.working_space import luminance_of
from .deviation import LIT_VIEWS, Deviations, Scale, deviations, joined_deviations
from .drawn import Draw, draw, drawn_part, everything, likely_sizes, spread_of
from .error_image import ErrorImage, error_image
from .footprint import Probed, Truth, seen
from .interval import joined, limits
from .kept_samples import method_error
from .light import by_cause
from .report import LayerError
from .scale import scale_of
from .strata import NOTHING, Difficulty, Stratum, finite, largest_nearby, mean_weight, scaling_codes
from .survey import BinarySurvey, EmptySurvey, Estimate, GroupedSurvey, Screened, Survey, allot, looks_again
from .watch import Watch
from .whole import Whole

VIEWS, SAMPLES = 16, 2
"""Of a probe: view rays of each half, and of each view ray rays of each estimate."""
BETWEEN_VIEWS = 8
"""Of a pixel that is partly lit or may be partly there, for the screening."""
SCREENING_RAYS = 2
"""Of a pixel that is wholly lit or dark; more where there are few."""

LOOKS = {
    Difficulty.EMPTY: 2,
    Difficulty.FRINGE: 2,
    Difficulty.BETWEEN: 4,
    Difficulty.EDGE: 48,
    Difficulty.REST: 48,
}
"""Pixels screened for each probe, of strata of each kind together."""
EXACT_LOOKS = 16
"""The same of a layer whose samples are anything between 0 and 1."""
LIKELY = {Difficulty.EDGE: 4.0}
"""Strata with more errors than others are looked at more."""
MOST_REPEATS, MOST_BETWEEN = 32, 4
"""Times the rays of one pixel, where there are few pixels; the latter of those that are partly lit."""
DRAWN = Difficulty.BETWEEN, Difficulty.FRINGE
"""Strata whose pixels are drawn by how wrong they may be, where others were watched."""
DRAWS, ENOUGH_WATCHED = 2, 32
"""For each probe that was asked for; and pixels of those strata that must have been watched."""
BRIGHT_PIXELS = 16
"""Of each stratum, that may be as bright as the mean."""
ROUNDING = 9
"""Decimals beyond which white light has colours too."""
IMAGE_VIEWS = 8, 24
"""Of a pixel of an error image: view rays of each half, and how many more where the halves disagree."""
WHOLE_VIEWS, WHOLE_AT_ONCE = 8, 1 << 12
"""Of every pixel, view rays of each half; and pixels at once."""


@dataclass(frozen=True)
class InUseScore:
    """Of a layer that multiplies: root mean square over the pixels where it multiplies anything, of layer x
    light - truth, as a share of light + mean light.

    `truth(rays, outline, layer, layers, casters, view_rays, samples, seed)` is what Truth in footprint.py
    says; `casters` (instances,) uint8. `is_binary`: an estimate by one sample is 0 or 1.
    """

    truth: Callable
    is_binary: bool = False
    reference_name: str = "ray traced"
    probe_seconds: float = 5e-4
    pixel_seconds: float = 2e-4
    metric: ClassVar[str] = "in use"

    def measure(self, probed: Probed, probes: int, seed: int) -> Generator[None, None, LayerError]:
        return self._measuring(probed, probes, seed).run(self.reference_name)

    def watch(self, probed: Probed, probes: int, samples: int, seed: int) -> Generator[None, None, Watch]:
        return self._measuring(probed, probes, seed).watch(samples)

    def error_image(
        self, probed: Probed, seed: int, show: Callable[[int], None]
    ) -> Generator[None, None, ErrorImage]:
        return self._measuring(probed, 0, seed).image(show)

    def whole(
        self, probed: Probed, pixels: np.ndarray, seed: int, show: Callable[[int], None]
    ) -> Generator[None, None, Whole]:
        """The truth at `pixels` (P,), whatever the layer holds; `show` is told of pixels as they are done."""
        return self._measuring(probed, 0, seed).whole(pixels, show)

    def _measuring(self, probed: Probed, probes: int, seed: int) -> _Measuring:
        told = probed.layer, probed.layers, probed.casters
        truth = partial(self.truth, probed.rays, probed.outline, *told)
        return _Measuring(probed, truth, self.is_binary, probes, seed)

    def rms(self, value: float) -> float:
        return value

    def lowered_by(self, params: Params | None, error: LayerError) -> tuple[str, ...]:
        return by_cause(params, error)


class _Measuring:
    def __init__(self, probed: Probed, truth: Truth, is_binary: bool, probes: int, seed: int):
        self.probed, self.truth, self.is_binary = probed, truth, is_binary
        self.probes, self.seed, self.count_variance = probes, seed, 0.0
        image = probed.image.reshape(probed.image.shape[0] * probed.image.shape[1], -1)
        self.values, self.pixels = image, len(image)
        self.scale = Scale(1.0, np.array(luminance_of(probed.outline.working_space)), probed.outline.exposure)

    def run(self, reference_name: str) -> Generator[None, None, LayerError]:
        strata = self.probed.strata(self._codes, self.seed)
        yield
        self.scale = yield from self._found_scale()
        to_draw = self._to_draw(strata)
        surveys = yield from self._screened([each for each in strata if each not in to_draw])
        found = yield from self._probed(surveys)
        estimates = [survey.estimate(each) for survey, each in zip(surveys, found, strict=True)]
        if to_draw:
            estimates.append((yield from self._drawn(to_draw)))
            found.append([estimates[-1].found])
        part = joined(each.part for each in estimates)
        count = math.fsum(each.count for each in estimates)
        all_of = joined_deviations([each.found for each in estimates])
        sampling = np.concatenate([each.sampling for each in estimates])
        traced = [measured for each in found for measured in each]

        def mean(values: np.ndarray) -> float:
            return float((sampling * values).sum()) / count if count > 0.0 else 0.0

        def root(total: float) -> float:
            return math.sqrt(max(total, 0.0) / count) if count > 0.0 else 0.0

        own = self._scale_variance(part.total, count, all_of, sampling)
        part = replace(part, noise_variance=part.noise_variance + own)
        value = min(root(part.total), 1.0)
        low, high = (min(root(limit), 1.0) for limit in limits(part))
        method = yield from method_error(self.probed, self.truth, self.scale, self.probes, self.seed)
        told = {"method": None, "sampling": None}
        if method is not None:
            told = {"method": method, "sampling": math.sqrt(max(value**2 - method**2, 0.0))}
        ones = np.ones(len(all_of))
        chroma = (all_of.chroma[:, 0] * all_of.chroma[:, 1]).sum(axis=1)
        return LayerError(
            metric=InUseScore.metric,
            value=value,
            ci95=(low, high),
            bias=mean(all_of.signed),
            p99=quantile(all_of.sizes, ones, 0.99, sampling),
            max=maximum(all_of.sizes, ones),
            probes=sum(map(len, traced)),
            reference=f"{reference_name}, {2 * VIEWS} view rays a pixel",
            reference_noise=_noise(traced),
            seconds=0.0,
            model=round(math.sqrt(max(mean(chroma), 0.0)), ROUNDING) or None,
            display=math.sqrt(max(mean(all_of.display[:, 0] * all_of.display[:, 1]), 0.0)),
            **told,
        )

    def _scale_variance(self, total: float, count: float, found: Deviations, sampling: np.ndarray) -> float:
        """Of the sum of squares, by what it is of: an error is a share of light + mean light, and the sum is
        divided by how many pixels have any."""
        squares = sampling * np.maximum(found.squares, 0.0)
        whole = float(squares.sum())
        # As the mean light grows an error shrinks, in the dark as much, elsewhere less.
        shrinks = float((squares * (1.0 - found.share)).sum()) / whole if whole > 0.0 else 0.0
        by_mean = (2.0 * shrinks * self.scale.uncertainty) ** 2
        by_count = self.count_variance / count**2 if count > 0.0 else 0.0
        return total**2 * (by_mean + by_count)

    def image(self, show: Callable[[int], None]) -> Generator[None, None, ErrorImage]:
        self.scale = yield from self._found_scale()

        def halves(pixels: np.ndarray, views: int, seed: int) -> Generator[None, None, np.ndarray]:
            return (yield from self._told(pixels, views, SAMPLES, seed, 2)).errors

        size = self.probed.image.shape[:2]
        return (yield from error_image(halves, size, IMAGE_VIEWS, self.seed, show))

    def whole(self, pixels: np.ndarray, show: Callable[[int], None]) -> Generator[None, None, Whole]:
        self.scale = yield from self._found_scale()
        parts = []
        for number, start in enumerate(range(0, len(pixels), WHOLE_AT_ONCE)):
            part = pixels[start : start + WHOLE_AT_ONCE]
            own = int(hash_bits(self.seed, 5, number))
            looked = yield from seen(self.probed, self.truth, part, WHOLE_VIEWS, SAMPLES, own, 2)
            found = deviations(np.zeros((len(part), self.values.shape[1])), looked, self.scale)
            parts.append([each.astype(np.float32) for each in (found.errors, found.slopes, found.has_light)])
            show(len(part))
        return Whole(pixels, self.pixels, *map(np.concatenate, zip(*parts, strict=True)))

    def watch(self, samples: int) -> Generator[None, None, Watch]:
        self.scale = yield from self._found_scale()
        count, weights = None, self.probed.weights
        if weights is not None:
            light = weights.reshape(*weights.shape[:2], -1).mean(axis=2)
            count = float(np.count_nonzero(light > NOTHING * light.max()))
        drawn = draw(self._likely_sizes(samples), self.probes, self.seed)
        pixels, stands_for = drawn.pixels, drawn.stands_for
        own = int(hash_bits(self.seed, 4))
        found = yield from self._told(pixels, VIEWS, SAMPLES, own, 2)
        if count is None:
            count = float((stands_for * found.has_light).sum())
        return Watch(pixels, stands_for, self._values(pixels), found.errors, found.slopes, count, samples)

    def _likely_sizes(self, samples: int) -> np.ndarray:
        """(pixels,) as likely_sizes says."""
        share, weights = 1.0, self.probed.weights
        if weights is not None:
            light = weights.reshape(*weights.shape[:2], -1).mean(axis=2)
            near = largest_nearby(light)  # samples may have missed what there is
            share = near / (near + (mean_weight(light) or 1.0))
        return likely_sizes(self.probed.image, share, samples)

    def _to_draw(self, strata: Sequence[Stratum]) -> list[Stratum]:
        """Those whose pixels are drawn one by one: what a pixel that was missed may be off by is not told by
        the layer alone, but by what others are, of which enough must have been watched."""
        if self.probed.watched is None or self.probed.weights is None:
            return []
        those = [each for each in strata if each.difficulty in DRAWN]
        members = np.concatenate([np.zeros(0, np.uint32), *(each.members for each in those)])
        return those if np.isin(self.probed.watched.pixels, members).sum() >= ENOUGH_WATCHED else []

    def _drawn(self, strata: Sequence[Stratum]) -> Generator[None, None, Estimate]:
        members = np.sort(np.concatenate([each.members for each in strata]))
        watch = self.probed.watched
        count, likely = DRAWS * self.probes, self._likely_sizes(watch.samples)
        drawn, views = draw(likely[members], count, int(hash_bits(self.seed, 6))), VIEWS
        if len(members) <= count:
            drawn, views = everything(len(members)), VIEWS * min(count // len(members), MOST_REPEATS)
        pixels = members[drawn.pixels]
        found = yield from self._told(pixels, views, SAMPLES, int(hash_bits(self.seed, 7)), 2)
        is_one = np.isin(watch.pixels, members)
        squares = (watch.errors_of(self._values(watch.pixels)).mean(axis=1) ** 2).sum(axis=1)[is_one]
        sizes = drawn.sizes[np.searchsorted(members, watch.pixels[is_one])]
        own = found.sizes**2 / drawn.sizes[drawn.pixels]
        worst = max(own.max(initial=0.0), (squares / sizes).max(initial=0.0))
        part = drawn_part(drawn, found.squares, found.square_variances, float(worst))
        return Estimate(part, self._count_of(strata, pixels, drawn, found), found, drawn.stands_for)

    def _count_of(
        self, strata: Sequence[Stratum], pixels: np.ndarray, drawn: Draw, found: Deviations
    ) -> float:
        """How many pixels of all strata multiply anything."""
        empty = [each.members for each in strata if each.is_empty]
        is_empty = np.isin(pixels, np.concatenate([np.zeros(0, np.uint32), *empty]))
        has_light = np.where(is_empty, found.has_light, 0.0)
        self.count_variance += spread_of(drawn, has_light)
        certain = sum(each.population for each in strata if not each.is_empty)
        return certain + float((drawn.stands_for * has_light).sum())

    def _codes(self) -> np.ndarray:
        return scaling_codes(self.probed.image, self.probed.weights, self.is_binary)

    def _found_scale(self) -> Generator[None, None, Scale]:
        """The mean light: what rays find at some pixels, as a factor of what the layer's samples weighed if
        they did, whose mean is known."""
        if self.seed not in self.probed.found:
            self.probed.found[self.seed] = yield from scale_of(self.probed, self.truth, self.scale, self.seed)
        return self.probed.found[self.seed]

    def _screened(self, strata: list[Stratum]) -> Generator[None, None, list[Survey]]:
        """Shares the screening out so that a bad pixel that is missed costs the same in every stratum, or
        less where errors are likely."""
        looks = np.zeros(len(strata), np.int64)
        by_views = Difficulty.EMPTY, Difficulty.FRINGE, Difficulty.BETWEEN
        groups = *((kind,) for kind in by_views), (Difficulty.EDGE, Difficulty.REST)
        for kinds in groups:
            index = [number for number, each in enumerate(strata) if each.difficulty in kinds]
            sizes = np.array([strata[i].population for i in index], np.int64)
            wishes = [LIKELY.get(strata[i].difficulty, 1.0) * self._counts_for(strata[i]) for i in index]
            total = (LOOKS[kinds[0]] if self.is_binary else EXACT_LOOKS) * self.probes
            # A pixel that nobody looks at may be wholly wrong; only what is left looks at one again.
            once = np.array(allot(total, sizes, wishes), np.int64)
            again = allot(total - int(once.sum()), (MOST_REPEATS - 1) * sizes, wishes)
            looks[index] = once + np.where(once == sizes, again, 0)
        asked, kinds = [], []
        for stratum, count in zip(strata, looks.tolist(), strict=True):
            pixels = stratum.chosen(count)
            repeats = max(min(count // max(len(pixels), 1), MOST_REPEATS), 1)
            if stratum.difficulty == Difficulty.EMPTY:
                kinds.append((EmptySurvey, BETWEEN_VIEWS))
                asked.append(_Asked(pixels, BETWEEN_VIEWS, 0, 1))
            elif stratum.difficulty in by_views:
                rays = BETWEEN_VIEWS * min(repeats, MOST_BETWEEN)
                kinds.append((GroupedSurvey, rays))
                asked.append(_Asked(pixels, rays // 2, SAMPLES, 2))
            else:  # single rays that know nothing of each other
                rays = SCREENING_RAYS * repeats
                kinds.append((BinarySurvey, rays))
                asked.append(_Asked(pixels, 1, 1, rays))
        found = yield from self._told_of(asked, int(hash_bits(self.seed, 2)))
        surveys: list[Survey] = []
        for stratum, each, (kind, rays), told in zip(strata, asked, kinds, found, strict=True):
            population = stratum.population
            is_certain = self.probed.weights is not None and not stratum.is_empty
            lit = population
            if not is_certain:
                lit = population * float(told.has_light.mean())
                self.count_variance += _count_variance(told.has_light, rays // LIT_VIEWS, population)
            screened = Screened(stratum, each.pixels, self._values(each.pixels), rays, told, lit)
            surveys.append(kind(screened))
        return surveys

    def _counts_for(self, stratum: Stratum) -> float:
        """What a wholly wrong pixel of it adds, times how many it has. Some pixels of each count as if they
        were as bright as the mean: samples may have missed most of what there is."""
        if self.probed.weights is None or stratum.is_empty:
            return float(stratum.population)
        weights, found = self.probed.weights.reshape(self.pixels, -1), self.probed.found
        if "mean weight" not in found:
            found["mean weight"] = mean_weight(weights.mean(axis=1)) + 1e-30
        mean, weights = found["mean weight"], weights[stratum.members].mean(axis=1)
        bright = 0.25 * min(stratum.population, BRIGHT_PIXELS)
        return max(float(((weights / (weights + mean)) ** 2).sum()), bright)

    def _values(self, pixels: np.ndarray) -> np.ndarray:
        return finite(self.values[pixels])

    def _told_of(self, asked: Sequence[_Asked], seed: int) -> Generator[None, None, list[Deviations]]:
        """Of each; those by as many rays in one go: a look at few pixels takes as long as one at many."""
        alike: dict[tuple[int, int, int], list[int]] = {}
        for number, each in enumerate(asked):
            alike.setdefault((each.views, each.samples, each.sets), []).append(number)
        found: dict[int, Deviations] = {}
        for (views, samples, sets), numbers in alike.items():
            pixels = np.concatenate([asked[number].pixels for number in numbers])
            own = int(hash_bits(seed, views, samples, sets))
            told, start = (yield from self._told(pixels, views, samples, own, sets)), 0
            for number in numbers:
                end = start + len(asked[number].pixels)
                found[number], start = told[start:end], end
        return [found[number] for number in range(len(asked))]

    def _told(self, pixels, views, samples, seed, sets) -> Generator[None, None, Deviations]:
        looked = yield from seen(self.probed, self.truth, pixels, views, samples, seed, sets)
        return deviations(self._values(pixels), looked, self.scale)

    def _probed(self, surveys: Sequence[Survey]) -> Generator[None, None, list[list[Deviations]]]:
        """For every survey and group, what the slow reference says of its first pixels: about half the probes
        for binary strata and half for the others, as far as each has use for them."""
        sizes = [len(group) for survey in surveys for group in survey.groups]
        totals: dict[type, float] = {}
        for survey in surveys:
            totals[type(survey)] = totals.get(type(survey), 0.0) + sum(survey.wishes)
        wishes = [wish / (totals[type(survey)] or 1.0) for survey in surveys for wish in survey.wishes]
        counts = allot(self.probes, sizes, wishes)
        # Where all that asks for probes has them, more rays take their noise off.
        looks = looks_again(self.probes - sum(counts), counts, wishes)
        each, asked = iter(zip(counts, looks, strict=True)), []
        for survey in surveys:
            for group in survey.groups:
                count, again = next(each)
                views = VIEWS * min(again, MOST_REPEATS)
                asked.append(_Asked(survey.screened.pixels[group[:count]], views, SAMPLES, 2))
        found = iter((yield from self._told_of(asked, int(hash_bits(self.seed, 3)))))
        return [[next(found) for _ in survey.groups] for survey in surveys]


@dataclass(frozen=True)
class _Asked:
    """Pixels (P,) to look at by `sets` times `views` view rays, with `samples` rays of each estimate."""

    pixels: np.ndarray
    views: int
    samples: int
    sets: int


def _count_variance(has_light: np.ndarray, groups: int, population: int) -> float:
    """Of how many of a stratum's pixels have light, each by so many groups of LIT_VIEWS view rays."""
    looked = len(has_light)
    chance = float((has_light * (1.0 - has_light)).mean()) / (groups - 1) if groups > 1 else 0.0
    chosen = (1.0 - looked / population) * float(has_light.var())
    return population**2 / looked * (chance + chosen)


def _noise(traced: list[Deviations]) -> float:
    """RMS noise of the mean of both halves at the probes."""
    variances = [each.noise_variances.sum(axis=1) for each in traced if len(each)]
    return math.sqrt(0.5 * float(np.concatenate(variances).mean())) if variances else 0.0
