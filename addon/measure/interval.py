"""Confidence intervals for a sum over all pixels of which few were looked at.

Errors of an image live in few pixels, so the sum of their squares behaves less like a mean than like a count
of rare events of different sizes. Its interval is the one that epidemiology takes for such a sum (Fay and
Feuer 1997): the total follows a gamma distribution with the estimate's own mean and variance, and the upper
limit adds one more event, of the largest size that may have been missed. With many events that is the normal
interval; with events of one size it is Garwood's exact one for a Poisson count; with none it is the rule of
three (3.69 rather than 3, as the limits are two-sided). A bootstrap knows no event that it has not seen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from statistics import NormalDist

CONFIDENCE = 0.95
TAIL = 0.5 * (1.0 - CONFIDENCE)
LARGE_SHAPE = 1e5  # Wilson and Hilferty's cube is closer than 1e-9 from here on


@dataclass(frozen=True)
class Part:
    """A stratum's share of the sum. `total` is the estimate; `variance` comes from which pixels were looked
    at, `noise_variance` from the reference's own noise, which is as often too low as too high; `unseen` is
    what one more bad pixel among those not looked at would add to the estimate."""

    total: float
    variance: float
    noise_variance: float
    unseen: float


def joined(parts: Iterable[Part]) -> Part:
    """The sum of independent parts. Unseen events do not add up: where one bad pixel in a thousand could have
    been missed in either of two strata, both at once are ruled out (the rule of three bounds the sum of all
    expected counts), so the worst is the largest."""
    parts = list(parts)
    return Part(
        math.fsum(part.total for part in parts),
        math.fsum(part.variance for part in parts),
        math.fsum(part.noise_variance for part in parts),
        max((part.unseen for part in parts), default=0.0),
    )


def limits(part: Part, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Lower and upper limit of a sum that cannot be negative (its estimate can, by the reference's noise)."""
    tail = 0.5 * (1.0 - confidence)
    noise = NormalDist().inv_cdf(1.0 - tail) * math.sqrt(part.noise_variance)
    total = max(part.total, 0.0)
    low = _gamma_limit(total, part.variance, tail)
    high = _gamma_limit(total + part.unseen, part.variance + part.unseen**2, 1.0 - tail)
    # Distances to the limits of independent terms add like standard deviations (Zou and Donner 2008).
    return max(total - math.hypot(total - low, noise), 0.0), total + math.hypot(high - total, noise)


def _gamma_limit(mean: float, variance: float, probability: float) -> float:
    if mean <= 0.0 or variance <= 1e-24 * mean * mean:
        return mean
    shape = mean * mean / variance
    return gamma_quantile(probability, shape) * variance / mean


def gamma_quantile(probability: float, shape: float) -> float:
    """Quantile of the gamma distribution of scale 1, to a relative 1e-10."""
    normal = NormalDist().inv_cdf(probability)
    cube = 1.0 - 1.0 / (9.0 * shape) + normal / (3.0 * math.sqrt(shape))
    if shape > LARGE_SHAPE:
        return shape * cube**3
    low, high = 0.0, max(1.0, shape)
    while gamma_distribution(high, shape) < probability:
        low, high = high, 2.0 * high
    while high - low > 1e-10 * high and high > 1e-300:
        middle = 0.5 * (low + high)
        if gamma_distribution(middle, shape) < probability:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def gamma_distribution(x: float, shape: float) -> float:
    """The regularised lower incomplete gamma function P(shape, x) (Abramowitz and Stegun 6.5.29, 6.5.31)."""
    if x <= 0.0:
        return 0.0
    scale = math.exp(shape * math.log(x) - x - math.lgamma(shape))
    if x < shape + 1.0:
        term = total = 1.0 / shape
        n = shape
        while abs(term) > 1e-16 * total:
            n += 1.0
            term *= x / n
            total += term
        return scale * total
    # Continued fraction for the complement, evaluated forwards (Lentz).
    tiny = 1e-300
    b = x + 1.0 - shape
    c, d = 1.0 / tiny, 1.0 / b
    fraction = d
    for i in range(1, 100_000):
        a = i * (shape - i)
        b += 2.0
        d = 1.0 / (a * d + b or tiny)
        c = b + a / c or tiny
        fraction *= c * d
        if abs(c * d - 1.0) < 1e-16:
            break
    return 1.0 - scale * fraction
