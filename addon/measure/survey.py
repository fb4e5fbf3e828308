"""A stratum under measurement: screened with few rays, then looked at with many where that pays.

Screening is a generator that yields between slices of work. `BinarySurvey` and `PenumbraSurvey` offer
`groups` of pixels (indices, in random order) with a `wish` for probes each; `estimate` takes what the probes
of each group found.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.random import hash_bits
from ..core.surface import SurfacePoints
from .estimate import Group, Measured, binary_part, grouped_part
from .interval import Part
from .shadow_probes import Stratum, take

RAYS_AT_ONCE = 1 << 15
"""Between two yields: some hundredths of a second."""

SCREENING_SAMPLES = 4
"""Rays of each half that sorts the penumbra's pixels into groups."""

EDGES = (0.2, 0.4, 1.0)
"""The groups' largest differences between layer and screening. Eight well-spread rays err by about 0.1, so
that few correct pixels leave the first group, and no error of 0.6 stays in it."""

Weigh = Callable[[SurfacePoints], np.ndarray]
"""weigh(points): the weights (N,), unshadowed irradiance at radiance 1."""

Screen = Callable[[SurfacePoints, int], np.ndarray]
"""screen(points, seed): (N, R) estimates of visibility by one ray each, 0 or 1."""

Reference = Callable[[SurfacePoints, int, int], tuple[np.ndarray, np.ndarray]]
"""reference(points, samples, seed): (N, 2) independent estimates by `samples` rays each, and weights (N,)."""


def in_slices(
    function: Callable[[SurfacePoints, int], np.ndarray], points: SurfacePoints, rays: int, seed: int
) -> Generator[None, None, list]:
    """What `function(points, seed)` returns, for a few points at a time; `rays` that each of them takes."""
    step = max(RAYS_AT_ONCE // rays, 1)
    results = []
    for number, start in enumerate(range(0, len(points.position), step)):
        results.append(function(take(points, slice(start, start + step)), int(hash_bits(seed, number))))
        yield
    return results


@dataclass(frozen=True)
class Estimate:
    """What a stratum adds to the image. `part`: the sum over its pixels of weight * error^2; `weight` and
    `bias`: those of weight and of weight * error; `errors`, `weights` and `sampling` (N,): pixels that
    stand for all of it."""

    part: Part
    weight: float
    bias: float
    errors: np.ndarray
    weights: np.ndarray
    sampling: np.ndarray


class BinarySurvey:
    """Pixels that the layer calls wholly lit or wholly dark: one group, those that some ray contradicts.

    `stratum`: the screened pixels, `weights` (N,) float64 theirs, `estimates` (N, R) what their rays say;
    `mean_weight` of all that were kept.
    """

    def __init__(self, stratum: Stratum, weights: np.ndarray, estimates: np.ndarray, mean_weight: float):
        self._weight = stratum.population * mean_weight
        self.stratum, self._weights, self._estimates = stratum, weights, estimates
        count = len(weights)
        contradicted = (np.abs(self._estimates - self.stratum.values[:, None]) > 0.5).any(axis=1)
        self.groups = [_shuffled(np.flatnonzero(contradicted), self.stratum)]
        self.wishes = [len(self.groups[0]) / count * self._weight]
        self._agreed = np.flatnonzero(~contradicted)

    def estimate(self, measured: Sequence[Measured]) -> Estimate:
        (found,) = measured
        population, screened = self.stratum.population, len(self.stratum.values)
        rays = self._estimates.shape[1]
        part, sampling = binary_part(population, self._weights, len(self.groups[0]), rays, found)
        # One ray is an unbiased estimate, so the bias needs no probes.
        differences = self.stratum.values - self._estimates.mean(axis=1)
        others = max(population - sampling.sum(), 0.0) / max(len(self._agreed), 1)
        return Estimate(
            part,
            self._weight,
            population / screened * float((self._weights * differences).sum()),
            np.concatenate([found.errors, np.zeros(len(self._agreed))]),
            np.concatenate([found.weights, self._weights[self._agreed]]),
            np.concatenate([sampling, np.full(len(self._agreed), others)]),
        )


class PenumbraSurvey:
    """Pixels that the layer says are partly lit, grouped by how far a few rays are from it; `estimates`
    (N, 2) by those rays, the rest as for BinarySurvey."""

    def __init__(self, stratum: Stratum, weights: np.ndarray, estimates: np.ndarray, mean_weight: float):
        self._weight = stratum.population * mean_weight
        self.stratum, self._weights = stratum, weights
        differences = np.abs(stratum.values - estimates.mean(axis=1))
        group = np.digitize(differences, EDGES[:-1])
        self.groups = [_shuffled(np.flatnonzero(group == each), self.stratum) for each in range(len(EDGES))]
        # So that a bad pixel that is missed costs the same in each.
        self.wishes = [
            len(members) / len(group) * self._weight * edge**2
            for members, edge in zip(self.groups, EDGES, strict=True)
        ]

    def estimate(self, measured: Sequence[Measured]) -> Estimate:
        population = self.stratum.population
        sizes = [len(members) for members in self.groups]
        groups = [Group(*each) for each in zip(sizes, EDGES, measured, strict=True)]
        part, sampling = grouped_part(population, self._weights, self.stratum.values, groups)
        errors = np.concatenate([found.errors for found in measured])
        weights = np.concatenate([found.weights for found in measured])
        sampling = np.concatenate(sampling)
        bias = float((sampling * weights * errors).sum())
        return Estimate(part, self._weight, bias, errors, weights, sampling)


def screened_binary(
    stratum: Stratum, weights: np.ndarray, looks: int, screen: Screen, seed: int
) -> Generator[None, None, BinarySurvey]:
    """Screens `looks` pixels of the stratum by single rays, each several times where there are fewer."""
    index = stratum.smallest(looks)
    chosen = stratum.at(index)
    repeated = take(chosen.points, np.repeat(np.arange(len(index)), max(looks // len(index), 1)))
    estimates = yield from in_slices(screen, repeated, 2, seed)
    estimates = np.concatenate(estimates).astype(np.float64).reshape(len(index), -1)
    return BinarySurvey(chosen, weights[index], estimates, float(weights.mean()))


def screened_penumbra(
    stratum: Stratum, weights: np.ndarray, looks: int, reference: Reference, seed: int
) -> Generator[None, None, PenumbraSurvey]:
    """Screens `looks` pixels of the stratum by a few rays."""
    index = stratum.smallest(looks)
    chosen = stratum.at(index)

    def few(points: SurfacePoints, seed: int) -> np.ndarray:
        return np.asarray(reference(points, SCREENING_SAMPLES, seed)[0], np.float64)

    estimates = yield from in_slices(few, chosen.points, 2 * SCREENING_SAMPLES, seed)
    return PenumbraSurvey(chosen, weights[index], np.concatenate(estimates), float(weights.mean()))


def _shuffled(members: np.ndarray, stratum: Stratum) -> np.ndarray:
    return members[np.argsort(stratum.priorities[members])]


def allot(total: int, sizes: Sequence[int], wishes: Sequence[float]) -> list[int]:
    """Shares `total` probes out in proportion to `wishes`, none above its size. Every group gets two if it
    has as many, even beyond the total: an empty one would bias the estimate."""
    sizes, wishes = np.asarray(sizes, np.int64), np.asarray(wishes, np.float64)
    given = np.minimum(sizes, 2)
    open_groups = given < sizes
    while open_groups.any() and given.sum() < total:
        wish = np.where(open_groups, wishes, 0.0)
        left = total - int(given[~open_groups].sum())
        if wish.sum() <= 0.0:
            break
        wanted = np.floor(left * wish / wish.sum()).astype(np.int64)
        full = open_groups & (wanted >= sizes)
        if not full.any():
            given = np.where(open_groups, np.maximum(wanted, given), given)
            break
        given[full] = sizes[full]
        open_groups &= ~full
    return given.tolist()


def shared_looks(
    total: int, sizes: Sequence[int], populations: Sequence[int], wishes: Sequence[float], again: bool
) -> list[tuple[int, int]]:
    """Shares `total` looks of a reference out to groups: for each how many of its `sizes` pixels get any, and
    how many each of them gets.

    Three in four looks are first ones, as `allot` has it, since what was never looked at widens the interval
    most. If they may look `again`, and there are groups of which every pixel is seen, the others take
    those pixels' noise off: in proportion to the power 2/3 of a pixel's wish, which is best where the noise
    of a square (Compared.square_variances) goes with the wish.
    """
    sizes, populations = np.asarray(sizes, np.int64), np.asarray(populations, np.int64)
    counts = np.array(allot(total - total // 4 if again else total, sizes, wishes), np.int64)
    more = np.ones(len(counts), np.int64)
    whole = (counts == populations) & (populations > 0)
    if again and whole.any():
        each = (np.asarray(wishes, np.float64)[whole] / populations[whole]) ** (2.0 / 3.0)
        left = max(total - int(counts.sum()), 0)
        more[whole] += (left * each / max((each * counts[whole]).sum(), 1e-300)).astype(np.int64)
    elif again:
        counts = np.array(allot(total, sizes, wishes), np.int64)
    return list(zip(counts.tolist(), more.tolist(), strict=True))
