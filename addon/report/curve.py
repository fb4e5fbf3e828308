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
    slope, scale = _line(n, 0.5 * np.log(error**2 - floor**2))
    if slope >= 0.0 or not math.isfinite(least):
        return None
    return Order(math.exp(scale), -slope, float(floor), _power_95(n, error, scale, -slope, floor))


STUDENT = {2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 6: 2.447, 7: 2.365, 8: 2.306}
"""Its 97.5% quantile by degrees of freedom; 1.96 + 2.8 / of more, within a hundredth."""


def _power_95(n: np.ndarray, error: np.ndarray, scale: float, power: float, floor: float) -> float | None:
    """Half of the power's interval, by what log errors are off by (Gauss-Newton): the floor is fitted too."""
    falling = np.exp(2.0 * (scale - power * n))
    square = falling + floor**2
    by_floor = [0.5 / square] if floor > 0.0 else []
    slopes = np.stack([falling / square, -n * falling / square, *by_floor], axis=1)
    free = len(n) - slopes.shape[1]
    if free < 2 or np.linalg.matrix_rank(slopes) < slopes.shape[1]:
        return None
    off = np.log(error) - 0.5 * np.log(square)
    variance = float(off @ off) / free * float(np.linalg.inv(slopes.T @ slopes)[1, 1])
    return STUDENT.get(free, 1.96 + 2.8 / free) * math.sqrt(variance)


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope, and value at 0."""
    middle = x.mean()
    spread = float(((x - middle) ** 2).sum())
    slope = float(((x - middle) * y).sum()) / spread if spread > 0.0 else 0.0
    return slope, float(y.mean()) - slope * middle


def _sum_of_squares(n: np.ndarray, error: np.ndarray, floor: float) -> float:
    slope, scale = _line(n, 0.5 * np.log(error**2 - floor**2))
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
