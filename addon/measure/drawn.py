"""Pixels that are drawn by how wrong they may be: sums over all pixels are then known by the fewest of them
(sampling with probability proportional to size: Cochran, Sampling Techniques, 9A.3; systematic, 8.11).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.random import hash_bits
from .estimate import noise_of
from .interval import Part
from .strata import finite, largest_nearby

EDGE, ANYWHERE = 0.12, 0.03
"""By how much a pixel is off, measured: with few samples for each 1 that the layer changes around it, and
with any by what a method gets wrong wherever it is."""
EDGE_SAMPLES, POWER = 4, 0.75
"""So many are few; of more, edges are off by less, about like this power of their number."""
UNLIKELY = 0.1
"""Of all pixels that are drawn, about so many are anywhere, also where nothing seems to be wrong."""


@dataclass(frozen=True)
class Draw:
    """`pixels` (P,), ascending: places in the `sizes` (N,) that they were drawn by; each is there for `times`
    (P,) draws, and one draw for as many pixels as have a size of `step` together."""

    pixels: np.ndarray
    times: np.ndarray
    sizes: np.ndarray
    step: float

    @property
    def of_one(self) -> np.ndarray:
        """(P,) how many pixels one draw of each stands for."""
        return self.step / self.sizes[self.pixels] if len(self.pixels) else np.zeros(0)

    @property
    def stands_for(self) -> np.ndarray:
        """(P,) how many pixels each stands for."""
        return self.times * self.of_one

    @property
    def is_whole(self) -> bool:
        """Whether every pixel is there, as itself."""
        return len(self.pixels) == len(self.sizes)


def likely_sizes(image: np.ndarray, share: np.ndarray | float, samples: int) -> np.ndarray:
    """(pixels,) squares of what pixels of an image (height, width[, channels]) of so many samples are likely
    to be off by. `share` (height, width): what an error of 1 counts for."""
    planes = finite(image.reshape(*image.shape[:2], -1))
    change = np.zeros(image.shape[:2])
    for plane in np.moveaxis(planes, 2, 0):
        np.maximum(change, largest_nearby(plane, 1) + largest_nearby(-plane, 1), out=change)
    edge = EDGE * (EDGE_SAMPLES / max(samples, EDGE_SAMPLES)) ** POWER
    return np.square((edge * change + ANYWHERE) * share).reshape(-1)


def draw(sizes: np.ndarray, count: int, seed: int) -> Draw:
    """`count` times one of as many pixels as there are `sizes` (N,)."""
    sizes = sizes + UNLIKELY * (sizes.mean() if len(sizes) else 0.0)
    sums = np.cumsum(sizes)
    if not count or not len(sums) or sums[-1] <= 0.0:
        return Draw(np.zeros(0, np.int64), np.zeros(0, np.int64), sizes, 0.0)
    step = sums[-1] / count
    places = (np.arange(count) + (int(hash_bits(seed, 0)) + 0.5) / 2.0**32) * step
    pixels, times = np.unique(np.searchsorted(sums, places, side="right"), return_counts=True)
    return Draw(pixels, times, sizes, float(step))


def everything(count: int) -> Draw:
    """All of so many pixels."""
    return Draw(np.arange(count), np.ones(count, np.int64), np.ones(count), 1.0)


def drawn_part(drawn: Draw, squares: np.ndarray, variances: np.ndarray, worst: float) -> Part:
    """The sum of squared errors over all that were drawn from. `squares` (P,) of those that were drawn, of
    `variances` (P,) by the reference's noise; `worst`: the most that the square of a pixel may be for each 1
    of its size. The variance is that of draws that know nothing of each other (Hansen and Hurwitz 1943):
    systematic ones, in an order in which neighbours are alike, have no larger one."""
    if not len(squares):
        return Part(0.0, 0.0, 0.0, 0.0)
    total = float((drawn.stands_for * squares).sum())
    noise = drawn.stands_for**2 * variances
    if drawn.is_whole:
        return Part(total, 0.0, noise_of(noise), 0.0)
    variance = spread_of(drawn, squares) - float(noise.sum())
    return Part(total, max(variance, 0.0), noise_of(noise), worst * drawn.step)


def spread_of(drawn: Draw, values: np.ndarray) -> float:
    """Variance of the sum of `values` (P,) over all that were drawn from, by which were."""
    count = int(drawn.times.sum())
    if count < 2 or drawn.is_whole:
        return 0.0
    of_one = drawn.of_one * values
    mean = float((drawn.times * of_one).sum()) / count
    return count / (count - 1) * float((drawn.times * (of_one - mean) ** 2).sum())
