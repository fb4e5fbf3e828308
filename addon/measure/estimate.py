"""Sums of squared errors over a stratum, estimated in two phases: many pixels are screened with a few rays,
few of them are measured with many.

Both estimates are unbiased. `docs/accuracy.md` derives them and says which simulations test them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .deviation import Deviations, product_variances
from .interval import TAIL, Part

STEP = 1e-3  # of finite differences

MOST_HIDDEN = 8
"""Pixels: of more, each is off by so little that they hide less, for any number of rays."""

SMALLEST_CHANCE = 2.0**-9
"""Floor of a flagged pixel's chance of being flagged, two rays out of 1/1024: what 2 x 128 rays resolve."""


@dataclass(frozen=True)
class Contradicted:
    """Pixels that the layer calls 0 or 1, seen by the slow reference. `halves` (M, 2): of the rays of two
    independent halves, the share that says the other; `weights` (M,): what the square of such a share counts
    for; float64."""

    halves: np.ndarray
    weights: np.ndarray

    @property
    def noise_variances(self) -> np.ndarray:
        """(M,) variances of one half."""
        return 0.5 * (self.halves[:, 0] - self.halves[:, 1]) ** 2


def noise_of(variances: np.ndarray) -> float:
    """Of a sum of squares with such variances by noise, each known by its own pixel's two looks alone: where
    few pixels have most of it, chance may have shown too little, so the largest counts twice."""
    return float(variances.sum() + variances.max(initial=0.0))


def unseen_weight(weights: np.ndarray) -> float:
    """Weight of a bad pixel that was missed: the mean weight where the light falls, sum w^2 / sum w."""
    total = float(weights.sum())
    return float((weights**2).sum()) / total if total > 0.0 else 0.0


def hidden(rays: int) -> float:
    """What rays may have missed where every pixel got so many, as a share of what one more event counts for
    (interval.py). m pixels of error e pass them all with the chance (1 - e)^(rays m). Where that is no less
    than the interval's tail they hide up to m e^2: the most, over whole numbers of pixels, against the
    -log(tail) events of the rule of three."""
    pixels = np.arange(1, MOST_HIDDEN + 1)
    errors = 1.0 - TAIL ** (1.0 / (rays * pixels))
    return float((pixels * errors**2).max()) / -math.log(TAIL)


def binary_part(
    population: int, screened_weights: np.ndarray, flagged: int, rays: int, measured: Contradicted
) -> tuple[Part, np.ndarray]:
    """A stratum whose values are 0 or 1, screened with `rays` single rays a pixel.

    A pixel is flagged where any ray contradicts its value; one of error e is flagged with the chance
    p = 1 - (1 - e)^rays. Flagged pixels count e^2 / p, the others nothing: e^2 on average (Horvitz and
    Thompson), so what the rays agree with needs no second look. `measured`: a random part of the `flagged`.
    Returns the Part, and how many pixels each measured one stands for (M,).
    """
    screened, looked_at = len(screened_weights), len(measured.weights)
    if not screened:
        return Part(0.0, 0.0, 0.0, 0.0), np.zeros(0)
    share = screened / population
    unseen = unseen_weight(screened_weights) / share * max(1.0 - share, hidden(rays))
    if not looked_at:
        return Part(0.0, 0.0, 0.0, unseen), np.zeros(0)
    errors = np.clip(measured.halves.mean(axis=1), 0.0, 1.0)
    repeats = flagged / looked_at  # flagged pixels that each measured one stands for
    chances = _chance(errors, rays)
    sampling = repeats / (share * chances)
    # e^2 / p is curved, so that noise in e shifts its mean, by half its curvature times the noise's variance.
    inner = np.clip(errors, STEP, 1.0 - STEP)
    before, here, after = (_counted(inner + step, rays) for step in (-STEP, 0.0, STEP))
    slope, curvature = (after - before) / (2.0 * STEP), (after - 2.0 * here + before) / STEP**2
    noise = 0.5 * measured.noise_variances  # of the halves' mean
    scale = repeats / share * measured.weights
    counts = scale * (_counted(errors, rays) - 0.5 * curvature * noise)
    # Sampling with independent chances share * p, then drawing `looked_at` of `flagged` without putting back.
    variance = ((1.0 - share * chances) * counts**2).sum() / repeats
    if looked_at > 1:
        variance += looked_at * (1.0 - 1.0 / repeats) * counts.var(ddof=1)
    noise_variance = noise_of((scale * slope) ** 2 * noise)
    return Part(float(counts.sum()), float(variance), noise_variance, unseen), sampling


def _chance(errors: np.ndarray, rays: int) -> np.ndarray:
    return np.maximum(1.0 - (1.0 - errors) ** rays, SMALLEST_CHANCE)


def _counted(errors: np.ndarray, rays: int) -> np.ndarray:
    """e^2 / p, without the floor."""
    return errors**2 / np.maximum(1.0 - (1.0 - errors) ** rays, 1e-12)


@dataclass(frozen=True)
class Group:
    """`size` screened pixels whose error is hardly above `edge`, and those of them that were measured."""

    size: int
    edge: float
    measured: Deviations


def grouped_part(
    population: int, worst: np.ndarray, rays: int, groups: list[Group]
) -> tuple[Part, list[np.ndarray]]:
    """A stratum of any values: double sampling for stratification (Cochran, Sampling Techniques, 12.2). The
    screening, by `rays` for each pixel, only sorts pixels into groups; each group is then sampled at its own
    rate. `worst` (S,): the largest errors that the screened pixels' values allow. Returns the Part and, for
    each group, how many pixels each measured one stands for (M,)."""
    screened = len(worst)
    if not screened:
        return Part(0.0, 0.0, 0.0, 0.0), [np.zeros(0) for _ in groups]
    share = screened / population
    measured = sum(len(group.measured) for group in groups) / screened
    unseen = [float((worst**2).mean()) / share * max(1.0 - share, (1.0 - measured) * hidden(rays))]
    means, sizes, samplings, total, variance, noise_variance = [], [], [], 0.0, 0.0, 0.0
    for group in groups:
        count = len(group.measured)
        stands_for = group.size / share
        samplings.append(np.full(count, stands_for / count if count else 0.0))
        if not count:
            continue
        counts = group.measured.squares
        spread = float(counts.var(ddof=1)) if count > 1 else float(counts[0] ** 2)
        variances = group.measured.square_variances
        noise = float(variances.mean())
        measured_share = count / stands_for
        mean = float(counts.mean())
        total += stands_for * mean
        variance += stands_for**2 / count * (1.0 - measured_share) * max(spread - noise, 0.0)
        noise_variance += noise_of((stands_for / count) ** 2 * variances)
        unseen.append(group.edge**2 * (1.0 - measured_share) * stands_for / count)
        means.append(mean)
        sizes.append(group.size / screened)
    if len(means) > 1:
        means, sizes = np.array(means), np.array(sizes)
        between = float((sizes * (means - (sizes * means).sum()) ** 2).sum())
        variance += (1.0 - share) * population**2 / screened * between
    return Part(total, variance, noise_variance, max(unseen)), samplings


@dataclass(frozen=True)
class Compared:
    """A simple random sample of a stratum's `population` pixels beside the reference. `values` (M, channels)
    float64 of the layer; `estimates` (1 or 2, M, channels): exact, or two independent ones."""

    population: int
    values: np.ndarray
    estimates: np.ndarray

    @property
    def errors(self) -> np.ndarray:
        """(M, channels) layer minus truth, with the reference's noise."""
        return self.values - self.estimates.mean(axis=0)

    def as_shares(self, mean: float) -> Compared:
        """The same in shares of the brightness at each pixel: of the truth there and `mean`."""
        whole = np.abs(self.estimates.mean(axis=0)).mean(axis=1, keepdims=True) + mean
        return Compared(self.population, self.values / whole, self.estimates / whole)

    @property
    def squares(self) -> np.ndarray:
        """(M,) squared errors, the mean over channels, without the noise's own square (Measured.squares)."""
        first, last = self.values - self.estimates[0], self.values - self.estimates[-1]
        return (first * last).mean(axis=1)

    @property
    def square_variances(self) -> np.ndarray:
        """(M,) variances of `squares` by the reference's noise."""
        first, last = self.values - self.estimates[0], self.values - self.estimates[-1]
        return product_variances(first, last) / self.values.shape[1] ** 2

    @property
    def noise(self) -> float:
        """Sum over the stratum's pixels of the variance of the estimates' mean, the mean over channels."""
        if len(self.estimates) < 2 or not len(self.values):
            return 0.0
        return self.population * float((0.25 * (self.estimates[0] - self.estimates[1]) ** 2).mean())

    @property
    def mean_error_variance(self) -> float:
        """Of the sum over the stratum's pixels of the error, the mean over channels."""
        count = len(self.values)
        if count < 2:
            return 0.0
        spread = float(self.errors.mean(axis=1).var(ddof=1))
        return self.population**2 / count * spread


def sampled_part(compared: Compared, worst: float) -> Part:
    """The sum over a stratum of squared errors; `worst`: the square of an error that one more pixel may have.
    The sampling is without replacement (Cochran, Sampling Techniques, 2.5)."""
    count = len(compared.values)
    if not count:
        return Part(0.0, 0.0, 0.0, 0.0)
    stands_for = compared.population / count
    left = 1.0 - 1.0 / stands_for  # of the pixels, what was not looked at
    squares, variances = compared.squares, compared.square_variances
    spread = float(squares.var(ddof=1)) if count > 1 else float(squares[0] ** 2)
    scale = compared.population**2 / count
    return Part(
        stands_for * float(squares.sum()),
        scale * left * max(spread - float(variances.mean()), 0.0),
        noise_of(stands_for**2 * variances),
        stands_for * left * worst,
    )
