"""How wrong a shadow layer is, by rays at random pixels. docs/accuracy.md explains the method."""

from __future__ import annotations

import math
import time

import numpy as np

from ..core.effect import Metric
from ..core.metrics import maximum, quantile
from ..core.random import hash_bits
from .difficulty import Difficulty
from .estimate import Measured
from .interval import joined, limits
from .probes import KEPT, Stratum, take, together
from .report import LayerError
from .survey import BinarySurvey, PenumbraSurvey, Reference, Screen, allot

SAMPLES = 128  # rays of each of the reference's two halves


def measure_visibility(
    strata: dict[Difficulty, Stratum], probes: int, screen: Screen, reference: Reference, seed: int
) -> LayerError:
    """RMSE of a shadow layer weighted by the unshadowed irradiance, from ProbeCollector.strata.

    Many pixels are screened with few rays; then about `probes` get 2 x 128, where the screening contradicts
    the layer and across the penumbra.
    """
    started = time.perf_counter()
    *screening_seeds, probing_seed = hash_bits(seed, np.arange(len(Difficulty))).tolist()
    surveys: list[BinarySurvey | PenumbraSurvey] = []
    for stratum, one_seed in zip(_affordable(strata, probes), screening_seeds, strict=False):
        if stratum.difficulty == Difficulty.PENUMBRA:
            surveys.append(PenumbraSurvey(stratum, reference, one_seed))
        else:
            surveys.append(BinarySurvey(stratum, screen, one_seed))
    found = _probed(surveys, probes, reference, probing_seed)
    estimates = [survey.estimate(each) for survey, each in zip(surveys, found, strict=True)]

    total = joined(each.part for each in estimates)
    weight = math.fsum(each.weight for each in estimates)
    low, high = (_ratio(limit, weight) for limit in limits(total))
    errors, weights, sampling = (
        np.concatenate([np.zeros(0), *(getattr(each, name) for each in estimates)])
        for name in ("errors", "weights", "sampling")
    )
    traced = [measured for each in found for measured in each]
    return LayerError(
        metric=Metric.WEIGHTED_RMSE.value,
        value=math.sqrt(_ratio(max(total.total, 0.0), weight)),
        ci95=(math.sqrt(low), min(math.sqrt(high), 1.0)),
        bias=_ratio(math.fsum(each.bias for each in estimates), weight),
        p99=quantile(errors, weights, 0.99, sampling),
        max=maximum(errors, weights, sampling),
        probes=sum(len(each.values) for each in traced),
        reference=f"ray traced, 2 x {SAMPLES} rays",
        reference_noise=_noise(traced),
        seconds=time.perf_counter() - started,
    )


def _affordable(strata: dict[Difficulty, Stratum], probes: int) -> list[Stratum]:
    """What edges and terminators leave of the screening goes to the rest."""
    budget = KEPT[Difficulty.REST] * probes
    used = sum(
        len(strata[kind].values) for kind in (Difficulty.EDGE, Difficulty.TERMINATOR) if kind in strata
    )
    left = {Difficulty.REST: max(budget - used, 1)}
    return [stratum.first(left.get(kind, len(stratum.values))) for kind, stratum in strata.items()]


def _probed(
    surveys: list[BinarySurvey | PenumbraSurvey], probes: int, reference: Reference, seed: int
) -> list[list[Measured]]:
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
    halves, weights = (np.asarray(array, np.float64) for array in reference(points, SAMPLES, seed))
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
