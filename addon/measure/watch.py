"""Pixels that are watched while a layer gets more samples: what they should hold is found once, by rays, so
that after every pass it costs next to nothing to tell how far the layer still is from it.

They are drawn by how wrong they may be: sums over all pixels are then known by the fewest of them (sampling
with probability proportional to size: Cochran, Sampling Techniques, 9A.3; systematic, 8.11).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.random import hash_bits
from .strata import finite, largest_nearby

EDGE, ANYWHERE = 0.12, 0.03
"""By how much a pixel is off, measured: with few samples for each 1 that the layer changes around it, and
with any by what a method gets wrong wherever it is."""
EDGE_SAMPLES, POWER = 4, 0.75
"""So many are few; of more, edges are off by less, about like this power of their number."""

WATCHING_SECONDS = 0.5
USUAL_PIXELS, MOST_TIMES = 480 * 270, 4.0
"""What as many probes as are watched would take on an ordinary machine, in an image of so many pixels: about
a thousand of a shadow. Of larger ones a pass takes longer: up to so many times as many."""
UNLIKELY = 0.1
"""Of all pixels that are watched, about so many are anywhere, also where nothing seems to be wrong."""


@dataclass(frozen=True)
class Watch:
    """`pixels` (P,) of a layer, numbered row by row; each stands for so many (`stands_for`). `errors` (P, 2
    halves, K) were those of `values` (P, channels), and grow by `slopes` for each 1 that these do. `count`:
    pixels that the mean is over."""

    pixels: np.ndarray
    stands_for: np.ndarray
    values: np.ndarray
    errors: np.ndarray
    slopes: np.ndarray
    count: float

    def rms(self, values: np.ndarray) -> float:
        """The error where the pixels hold `values`, without the noise of the rays, which is another in each
        half."""
        if self.count <= 0.0:
            return 0.0
        errors = self.errors + (finite(values) - self.values)[:, None] * self.slopes
        squares = (errors[:, 0] * errors[:, 1]).sum(axis=1)
        return math.sqrt(max(float((self.stands_for * squares).sum()), 0.0) / self.count)


def probes_of(pixels: int, probe_seconds: float) -> int:
    """How many are watched in an image of so many pixels, where one takes so long on an ordinary machine."""
    return round(watching_seconds(pixels) / probe_seconds)


def watching_seconds(pixels: int) -> float:
    """What drawing them takes, in an image of so many pixels, on an ordinary machine."""
    larger = math.sqrt(pixels / USUAL_PIXELS)
    return WATCHING_SECONDS * min(max(larger, 1.0), MOST_TIMES)


def likely_pixels(
    image: np.ndarray, share: np.ndarray | float, count: int, samples: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """About `count` pixels (P,) of an image (height, width[, channels]) of so many samples, ascending, and
    how many pixels each stands for (P,). `share` (height, width): what an error of 1 counts for."""
    planes = finite(image.reshape(*image.shape[:2], -1))
    change = np.zeros(image.shape[:2])
    for plane in np.moveaxis(planes, 2, 0):
        np.maximum(change, largest_nearby(plane, 1) + largest_nearby(-plane, 1), out=change)
    edge = EDGE * (EDGE_SAMPLES / max(samples, EDGE_SAMPLES)) ** POWER
    sizes = np.square((edge * change + ANYWHERE) * share).reshape(-1)
    sizes += UNLIKELY * sizes.mean()
    sums = np.cumsum(sizes)
    if not count or sums[-1] <= 0.0:
        return np.zeros(0, np.int64), np.zeros(0)
    step = sums[-1] / count
    places = (np.arange(count) + (int(hash_bits(seed, 0)) + 0.5) / 2.0**32) * step
    pixels, times = np.unique(np.searchsorted(sums, places, side="right"), return_counts=True)
    return pixels, times * step / sizes[pixels]
