"""How wrong a shadow layer is, by rays at random pixels. docs/accuracy.md explains the method."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..core.graph import PlannedLayer
from ..core.metrics import maximum, quantile
from ..core.outline import Outline
from ..core.params import Params
from ..core.random import hash_bits
from ..core.shot import Shot
from .difficulty import Difficulty
from .estimate import Measured
from .interval import joined, limits
from .probes import Probed, finite
from .report import LayerError
from .shadow_probes import PIXELS_PER_PROBE, Stratum, WatchedShadow, shadow_strata, take, together
from .survey import (
    BinarySurvey,
    PenumbraSurvey,
    Reference,
    Screen,
    Weigh,
    allot,
    in_slices,
    screened_binary,
    screened_penumbra,
)

SAMPLES = 128  # rays of each of the reference's two halves
LOOKS = PIXELS_PER_PROBE[Difficulty.REST]  # pixels screened by single rays for each probe
PENUMBRA_LOOKS = PIXELS_PER_PROBE[Difficulty.PENUMBRA]
MOST_REPEATS = 16  # looks at one pixel, where few pixels get most of the light
LOOKS_PER_PIXEL = 4  # on average, for small images
LIKELY = {Difficulty.EDGE: 4.0, Difficulty.TERMINATOR: 4.0}
"""Strata with more errors than others are looked at more."""


@dataclass(frozen=True)
class VisibilityScore:
    """Of one light's visibility: RMSE weighted by the light that would arrive. Only pixels that show a
    surface count.

    Each is called with a RayCaster and the light's emitter first, for as many points (core/surface.py,
    SurfacePoints) as take some hundredths of a second; `casters` (instances,) uint8 can shadow it:

    - `reference(rays, emitter, casters, points, samples, seed)`: two independent estimates (N, 2) float64 by
      `samples` rays each, and weights (N,) float64.
    - `screen(rays, emitter, casters, points, seed)`: (N, R) estimates by one ray each, 0 or 1.
    - `weigh(rays, emitter, points)`: the weights (N,), unshadowed irradiance at radiance 1.
    """

    reference: Callable
    screen: Callable
    weigh: Callable
    metric: ClassVar[str] = "weighted rmse"
    probe_seconds: ClassVar[float] = 2e-4

    def watch(
        self, layer: PlannedLayer, outline: Outline, shot: Shot, attributes: tuple[str, ...]
    ) -> WatchedShadow:
        light, eye = outline.lights[layer.of.index], np.array(shot.origin)
        return WatchedShadow(layer.name, layer.effect, light.emitter, eye, light.receivers)

    def measure(self, probed: Probed, probes: int, seed: int) -> Generator[None, None, LayerError]:
        rays, casters = probed.rays, probed.casters
        emitter = probed.outline.lights[probed.layer.of.index].emitter

        def weigh(points):
            return self.weigh(rays, emitter, points)

        def screen(points, seed):
            return self.screen(rays, emitter, casters, points, seed)

        def reference(points, samples, seed):
            return self.reference(rays, emitter, casters, points, samples, seed)

        strata = shadow_strata(probed.strata, np.array(probed.shot.origin))
        return measure_visibility(strata, probes, weigh, screen, reference, seed)

    def rms(self, value: float) -> float:
        return value

    def lowered_by(self, params: Params | None) -> tuple[str, ...]:
        return params.finer() if params is not None else ()


def measure_visibility(
    strata: Sequence[Stratum], probes: int, weigh: Weigh, screen: Screen, reference: Reference, seed: int
) -> Generator[None, None, LayerError]:
    """RMSE of a shadow layer weighted by the unshadowed irradiance, from ProbeCollector.strata.

    Many pixels are screened with few rays; then about `probes` get 2 x 128, where the screening contradicts
    the layer and across the penumbra. Yields between slices of work.
    """
    strata = [stratum for stratum in strata if len(stratum.values)]
    surveys = yield from _screened(strata, probes, weigh, screen, reference, seed)
    probing_seed = int(hash_bits(seed, len(strata)))
    found = yield from _probed(surveys, probes, reference, probing_seed)
    estimates = [survey.estimate(each) for survey, each in zip(surveys, found, strict=True)]

    total = joined(each.part for each in estimates)
    weight = math.fsum(each.weight for each in estimates)
    # Weighed back, a few unequal pixels may stand for more than there is; no visibility is off by over 1.
    value, low, high = (
        min(math.sqrt(max(_ratio(each, weight), 0.0)), 1.0) for each in (total.total, *limits(total))
    )
    errors, weights, sampling = (
        np.concatenate([np.zeros(0), *(getattr(each, name) for each in estimates)])
        for name in ("errors", "weights", "sampling")
    )
    traced = [measured for each in found for measured in each]
    return LayerError(
        metric=VisibilityScore.metric,
        value=value,
        ci95=(low, high),
        bias=_ratio(math.fsum(each.bias for each in estimates), weight),
        p99=quantile(errors, weights, 0.99, sampling),
        max=maximum(errors, weights, sampling),
        probes=sum(len(each.values) for each in traced),
        reference=f"ray traced, 2 x {SAMPLES} rays",
        reference_noise=_noise(traced),
        seconds=0.0,
    )


def _screened(strata, probes, weigh, screen, reference, seed) -> Generator[None, None, list]:
    """Shares the screening out so that a bad pixel that is missed costs the same in every stratum, or less
    where errors are likely."""
    weights = []
    for stratum in strata:
        weights.append(finite(weigh(stratum.points)))  # infinite on a lamp without size
        yield
    pairs = list(zip(strata, weights, strict=True))
    wishes = [LIKELY.get(s.difficulty, 1.0) * s.population * float(w.mean()) for s, w in pairs]
    looks = np.zeros(len(strata), np.int64)
    in_penumbra = np.array([s.difficulty == Difficulty.PENUMBRA for s in strata], bool)
    for chosen, budget, repeats in ((in_penumbra, PENUMBRA_LOOKS, 1), (~in_penumbra, LOOKS, MOST_REPEATS)):
        index = np.flatnonzero(chosen)
        sizes = [repeats * len(strata[i].values) for i in index]
        total = min(budget * probes, LOOKS_PER_PIXEL * sum(len(strata[i].values) for i in index))
        looks[index] = allot(total, sizes, [wishes[i] for i in index])
    surveys: list[BinarySurvey | PenumbraSurvey] = []
    for number, (stratum, weight) in enumerate(pairs):
        one_seed, count = int(hash_bits(seed, number)), int(looks[number])
        if stratum.difficulty == Difficulty.PENUMBRA:
            survey = yield from screened_penumbra(stratum, weight, count, reference, one_seed)
        else:
            survey = yield from screened_binary(stratum, weight, count, screen, one_seed)
        surveys.append(survey)
    return surveys


def _probed(
    surveys: list[BinarySurvey | PenumbraSurvey], probes: int, reference: Reference, seed: int
) -> Generator[None, None, list[list[Measured]]]:
    """For every survey and group, what the slow reference says of its first pixels: about half the probes
    for binary strata and half for the penumbra, as far as each has use for them."""
    sizes = [len(group) for survey in surveys for group in survey.groups]
    totals = dict.fromkeys((BinarySurvey, PenumbraSurvey), 0.0)
    for survey in surveys:
        totals[type(survey)] += sum(survey.wishes)
    wishes = [wish / (totals[type(survey)] or 1.0) for survey in surveys for wish in survey.wishes]
    counts = iter(allot(probes, sizes, wishes))
    chosen = [[np.sort(group[: next(counts)]) for group in survey.groups] for survey in surveys]
    if not surveys:
        return []
    pairs = zip(surveys, chosen, strict=True)
    points = together([take(survey.stratum.points, np.concatenate(groups)) for survey, groups in pairs])

    def many(points, seed):
        return reference(points, SAMPLES, seed)

    traced = yield from in_slices(many, points, 2 * SAMPLES, seed)
    # Nothing is traced where the layer is right wherever it was screened.
    halves = np.concatenate([np.zeros((0, 2)), *(halves for halves, _ in traced)])
    weights = np.concatenate([np.zeros(0), *(finite(weights) for _, weights in traced)])
    if not np.isfinite(halves).all():
        raise ValueError("a reference returned values that are not finite")
    result, start = [], 0
    for survey, groups in zip(surveys, chosen, strict=True):
        result.append([])
        for group in groups:
            rows = slice(start, start + len(group))
            result[-1].append(Measured(survey.stratum.values[group], halves[rows], weights[rows]))
            start += len(group)
    return result


def _noise(traced: list[Measured]) -> float:
    """RMS noise of the mean of both halves at the probes, weighted like the error."""
    weight = math.fsum(float(each.weights.sum()) for each in traced)
    squares = math.fsum(float((each.weights * each.noise_variances).sum()) for each in traced)
    return math.sqrt(0.5 * _ratio(squares, weight))


def _ratio(total: float, weight: float) -> float:
    return total / weight if weight > 0.0 else 0.0
