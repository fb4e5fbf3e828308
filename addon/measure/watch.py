"""Pixels that are watched while a layer gets more samples, drawn by how wrong they may be (drawn.py): what
they should hold is found once, by rays, so that after every pass it costs next to nothing to tell how far the
layer still is from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .strata import finite

WATCHING_SECONDS = 0.5
USUAL_PIXELS, MOST_TIMES = 480 * 270, 4.0
"""What as many probes as are watched would take on an ordinary machine, in an image of so many pixels: about
a thousand of a shadow. Of larger ones a pass takes longer: up to so many times as many."""


@dataclass(frozen=True)
class Watch:
    """`pixels` (P,) of a layer, numbered row by row; each stands for so many (`stands_for`). `errors` (P, 2
    halves, K) were those of `values` (P, channels), and grow by `slopes` for each 1 that these do. `count`:
    pixels that the mean is over; `samples`: of the layer when they were drawn, which took
    `seconds`, 0 where nobody looked."""

    pixels: np.ndarray
    stands_for: np.ndarray
    values: np.ndarray
    errors: np.ndarray
    slopes: np.ndarray
    count: float
    samples: int
    seconds: float = 0.0

    def rms(self, values: np.ndarray) -> float:
        """The error where the pixels hold `values`, without the noise of the rays, which is another in each
        half."""
        if self.count <= 0.0:
            return 0.0
        errors = self.errors_of(values)
        squares = (errors[:, 0] * errors[:, 1]).sum(axis=1)
        return math.sqrt(max(float((self.stands_for * squares).sum()), 0.0) / self.count)

    def errors_of(self, values: np.ndarray) -> np.ndarray:
        """(P, 2, K) where the pixels hold `values`."""
        return self.errors + (finite(values) - self.values)[:, None] * self.slopes


def probes_of(pixels: int, probe_seconds: float) -> int:
    """How many are watched in an image of so many pixels, where one takes so long on an ordinary machine."""
    return round(watching_seconds(pixels) / probe_seconds)


def watching_seconds(pixels: int) -> float:
    """What drawing them takes, in an image of so many pixels, on an ordinary machine."""
    larger = math.sqrt(pixels / USUAL_PIXELS)
    return WATCHING_SECONDS * min(max(larger, 1.0), MOST_TIMES)
