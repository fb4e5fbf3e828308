"""How wrong a layer is that multiplies, used as it is meant to be: on the light that it multiplies, at the
delivered pixel, against the mean of many rays over the pixel's footprint. docs/accuracy.md has the method."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from ..core.metrics import maximum, mean_brightness, quantile
from ..core.params import Params
from ..core.random import hash_bits
from ..core.working_space import luminance_of
from .deviation import Deviations, Scale, deviations, joined_deviations
from .error_image import ErrorImage, error_image
from .footprint import Probed, Truth, seen
from .interval import joined, limits
from .kept_samples import method_error
from .light import by_cause
from .report import LayerError
from .strata import NOTHING, Difficulty, Stratum, finite, nearby, scaling_codes
from .survey import BinarySurvey, EmptySurvey, GroupedSurvey, Screened, Survey, allot

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
MOST_REPEATS = 32
"""Times the rays of one pixel, where there are few pixels."""
ROUNDING = 9
"""Decimals beyond which white light has colours too."""
SCALE_PIXELS, SCALE_VIEWS = 1024, 8
"""Looked at for the mean brightness."""
IMAGE_VIEWS = 8, 24
"""Of a pixel of an error image: view rays of each half, and how many more where the halves disagree."""


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

    def error_image(
        self, probed: Probed, seed: int, show: Callable[[int], None]
    ) -> Generator[None, None, ErrorImage]:
        return self._measuring(probed, 0, seed).image(show)

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
        self.probes, self.seed = probes, seed
        image = probed.image.reshape(probed.image.shape[0] * probed.image.shape[1], -1)
        self.values, self.pixels = image, len(image)
        self.scale = Scale(1.0, np.array(luminance_of(probed.outline.working_space)), probed.outline.exposure)

    def run(self, reference_name: str) -> Generator[None, None, LayerError]:
        strata = self.probed.strata(self._codes, self.seed)
        yield
        self.scale = yield from self._found_scale()
        surveys = yield from self._screened(strata)
        found = yield from self._probed(surveys)
        estimates = [survey.estimate(each) for survey, each in zip(surveys, found, strict=True)]
        part = joined(each.part for each in estimates)
        count = math.fsum(each.count for each in estimates)
        all_of = joined_deviations([each.found for each in estimates])
        sampling = np.concatenate([each.sampling for each in estimates])
        traced = [measured for each in found for measured in each]

        def mean(values: np.ndarray) -> float:
            return float((sampling * values).sum()) / count if count > 0.0 else 0.0

        def root(total: float) -> float:
            return math.sqrt(max(total, 0.0) / count) if count > 0.0 else 0.0

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

    def image(self, show: Callable[[int], None]) -> Generator[None, None, ErrorImage]:
        self.scale = yield from self._found_scale()

        def halves(pixels: np.ndarray, views: int, seed: int) -> Generator[None, None, np.ndarray]:
            return (yield from self._told(pixels, views, SAMPLES, seed, 2)).errors

        size = self.probed.image.shape[:2]
        return (yield from error_image(halves, size, IMAGE_VIEWS, self.seed, show))

    def _codes(self) -> np.ndarray:
        return scaling_codes(self.probed.image, self.probed.weights, self.is_binary)

    def _found_scale(self) -> Generator[None, None, Scale]:
        """The mean light: what rays find at some pixels, as a factor of what the layer's samples weighed if
        they did, whose mean is known."""
        if self.seed not in self.probed.found:
            self.probed.found[self.seed] = yield from self._looked_for_scale()
        return self.probed.found[self.seed]

    def _looked_for_scale(self) -> Generator[None, None, Scale]:
        near, seed = np.ones(self.pixels, bool), int(hash_bits(self.seed, 1))
        if self.probed.weights is not None:
            weights = self.probed.weights.reshape(self.pixels, -1).mean(axis=1, dtype=np.float64)
            known = weights > NOTHING * weights.max(initial=0.0)
            weights[~known] = 0.0
            near = nearby(known.reshape(self.probed.image.shape[:2])).reshape(-1)
        generator = np.random.Generator(np.random.PCG64(self.seed))
        order = generator.permutation(np.flatnonzero(near))[:SCALE_PIXELS]
        looked = yield from seen(self.probed, self.truth, order, SCALE_VIEWS, 0, seed)
        light = np.nan_to_num(looked.multiplied).mean(axis=1)
        brightness, shown = self.scale.of(light), self.scale.shown(light)
        is_lit = brightness > 0.0
        mean, shown_mean = (mean_brightness(each[is_lit]) for each in (brightness, shown))
        if self.probed.weights is not None and is_lit.any():
            weighed = mean_brightness(weights[order])
            if weighed > 0.0:
                # Samples may have missed what rays find in some pixels, but not on the whole.
                found = mean_brightness(brightness) / float(is_lit.mean())
                mean = mean_brightness(weights[near]) * found / weighed
        return self.scale.with_means(mean, shown_mean)

    def _screened(self, strata: list[Stratum]) -> Generator[None, None, list[Survey]]:
        """Shares the screening out so that a bad pixel that is missed costs the same in every stratum, or
        less where errors are likely."""
        looks = np.zeros(len(strata), np.int64)
        by_views = Difficulty.EMPTY, Difficulty.FRINGE, Difficulty.BETWEEN
        groups = *((kind,) for kind in by_views), (Difficulty.EDGE, Difficulty.REST)
        for kinds in groups:
            index = [number for number, each in enumerate(strata) if each.difficulty in kinds]
            sizes = [MOST_REPEATS * strata[i].population for i in index]
            wishes = [LIKELY.get(strata[i].difficulty, 1.0) * self._counts_for(strata[i]) for i in index]
            each = LOOKS[kinds[0]] if self.is_binary else EXACT_LOOKS
            looks[index] = allot(each * self.probes, sizes, wishes)
        surveys: list[Survey] = []
        for number, (stratum, count) in enumerate(zip(strata, looks.tolist(), strict=True)):
            pixels, seed = stratum.chosen(count), int(hash_bits(self.seed, 2, number))
            if stratum.difficulty in by_views:
                kind, rays = GroupedSurvey, BETWEEN_VIEWS
                if stratum.difficulty == Difficulty.EMPTY:
                    kind = EmptySurvey
                told = yield from self._told(pixels, rays, SAMPLES * (kind is GroupedSurvey), seed, 1)
            else:  # single rays that know nothing of each other
                kind = BinarySurvey
                rays = SCREENING_RAYS * max(min(count // max(len(pixels), 1), MOST_REPEATS), 1)
                told = yield from self._told(pixels, 1, 1, seed, rays)
            population = stratum.population
            is_certain = self.probed.weights is not None and not stratum.is_empty
            lit = population if is_certain else population * float(told.has_light.mean())
            surveys.append(kind(Screened(stratum, pixels, self._values(pixels), rays, told, lit)))
        return surveys

    def _counts_for(self, stratum: Stratum) -> float:
        """What a wholly wrong pixel of it adds, times how many it has."""
        if self.probed.weights is None or stratum.is_empty:
            return float(stratum.population)
        weights = self.probed.weights.reshape(self.pixels, -1)[stratum.members].mean(axis=1)
        mean = self.probed.weights.mean(dtype=np.float64)
        return float(((weights / (weights + mean)) ** 2).sum()) + 1e-30

    def _values(self, pixels: np.ndarray) -> np.ndarray:
        return finite(self.values[pixels])

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
        counts = iter(allot(self.probes, sizes, wishes))
        result = []
        for number, survey in enumerate(surveys):
            chosen = [group[: next(counts)] for group in survey.groups]
            pixels = survey.screened.pixels[np.concatenate(chosen)]
            seed = int(hash_bits(self.seed, 3, number))
            found = yield from self._told(pixels, VIEWS, SAMPLES, seed, 2)
            ends = np.cumsum([len(each) for each in chosen])
            result.append([found[end - len(each) : end] for end, each in zip(ends, chosen, strict=True)])
        return result


def _noise(traced: list[Deviations]) -> float:
    """RMS noise of the mean of both halves at the probes."""
    variances = [each.noise_variances.sum(axis=1) for each in traced if len(each)]
    return math.sqrt(0.5 * float(np.concatenate(variances).mean())) if variances else 0.0
