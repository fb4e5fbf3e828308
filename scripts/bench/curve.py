"""Error against time of one method, and what it takes for a given error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Curve:
    """Points of a method, from fast to exact."""

    seconds: tuple[float, ...]
    errors: tuple[float, ...]

    def seconds_at(self, error: float) -> tuple[float, bool]:
        """By straight lines between the points on logarithmic axes, and whether the error lies within them;
        beyond its ends the curve goes on as its last piece."""
        order = np.argsort(self.errors)
        x, y = np.log(np.array(self.errors)[order]), np.log(np.array(self.seconds)[order])
        at = np.log(error)
        within = bool(x[0] <= at <= x[-1])
        piece = int(np.clip(np.searchsorted(x, at) - 1, 0, len(x) - 2))
        slope = (y[piece + 1] - y[piece]) / (x[piece + 1] - x[piece])
        return float(np.exp(y[piece] + slope * (at - x[piece]))), within
