"""Error against time of one method: what a given error takes, how fast it falls, and who is best."""

from __future__ import annotations

import math
from collections.abc import Sequence
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


@dataclass(frozen=True)
class Order:
    """error² = (scale · N^-power)² + floor²: what goes away with samples (or whatever N counts), and what
    stays. `power_95` is half of an interval for the power; None of so few points that none can be told."""

    scale: float
    power: float
    floor: float
    power_95: float | None

    def error_at(self, steps: float) -> float:
        return math.hypot(self.scale * steps**-self.power, self.floor)


FLOORS = 64
FEWEST_POINTS = 3


def order_of(steps: Sequence[float], errors: Sequence[float]) -> Order | None:
    """By least squares of log error. None where fewer than three errors are above 0, or they do not fall:
    there is no order then."""
    points = [(n, error) for n, error in zip(steps, errors, strict=True) if n > 0.0 < error]
    if len({n for n, _ in points}) < FEWEST_POINTS:
        return None
    n, error = np.log([n for n, _ in points]), np.array([error for _, error in points])
    floors = np.concatenate([[0.0], error.min() * np.linspace(0.02, 0.995, FLOORS)])
    found = [(_sum_of_squares(n, error, floor), floor) for floor in floors]
    least, floor = min(found)
    slope, scale, spread = _line(n, 0.5 * np.log(error**2 - floor**2))
    if slope >= 0.0 or not math.isfinite(least):
        return None
    free = len(points) - 2 - (floor > 0.0)
    half = 1.96 * math.sqrt(least / free / spread) if free > 0 and spread > 0.0 else None
    return Order(math.exp(scale), -slope, float(floor), half)


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Slope, value at 0, and the sum of squares of x about its mean."""
    middle = x.mean()
    spread = float(((x - middle) ** 2).sum())
    slope = float(((x - middle) * y).sum()) / spread if spread > 0.0 else 0.0
    return slope, float(y.mean()) - slope * middle, spread


def _sum_of_squares(n: np.ndarray, error: np.ndarray, floor: float) -> float:
    slope, scale, _ = _line(n, 0.5 * np.log(error**2 - floor**2))
    expected = 0.5 * np.log(np.exp(2.0 * (scale + slope * n)) + floor**2)
    return float(((np.log(error) - expected) ** 2).sum())


def front(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Places of those that none is both cheaper and nearer than, from cheap to near (Pareto's front)."""
    found, best = [], math.inf
    for index in sorted(range(len(costs)), key=lambda index: (costs[index], errors[index])):
        if errors[index] < best:
            found.append(index)
            best = errors[index]
    return found
