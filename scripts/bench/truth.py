"""The reference of the race, and the error against it: weighted RMSE at random lit pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from strata.addon.core.metrics import maximum, quantile
from strata.tests.support.figures import weighted_bias, weighted_rmse

from .methods import Surface, accelerator_of, traced
from .scenes import Case


@dataclass(frozen=True)
class Error:
    """Weighted RMSE, weighted bias, 99th percentile and maximum."""

    rmse: float
    bias: float
    p99: float
    largest: float


@dataclass(frozen=True, eq=False)
class Truth:
    """`pixels` (N,) indices into the frame; `visibility` and `weight` (N,) float64. `noise` is the weighted
    RMSE that the reference itself has, from its two independent halves."""

    pixels: np.ndarray
    visibility: np.ndarray
    weight: np.ndarray
    noise: float
    rays: int

    def error(self, visibility: np.ndarray) -> Error:
        """Of a whole frame's visibility."""
        errors = visibility.reshape(-1)[self.pixels].astype(np.float64) - self.visibility
        # The reference's noise adds to every square; it is known, so it is taken off.
        square = weighted_rmse(errors, self.weight) ** 2 - self.noise**2
        return Error(
            max(square, 0.0) ** 0.5,
            weighted_bias(errors, self.weight),
            quantile(errors, self.weight, 0.99),
            maximum(errors, self.weight),
        )


def truth_by_rays(case: Case, surface: Surface, count: int, rays: int, seed: int = 77) -> Truth:
    """At `count` pixels drawn from those that the light can reach, by two times `rays` stratified rays."""
    accelerator = accelerator_of(case)
    _, weight = traced(case, accelerator, surface, 16, seed)
    lit = np.flatnonzero(weight > 0.0)
    pixels = np.sort(np.random.default_rng(seed).choice(lit, min(count, len(lit)), replace=False))
    points = surface[pixels]
    halves = [traced(case, accelerator, points, rays, seed + 1 + half) for half in range(2)]
    visibility = np.mean([half[0] for half in halves], axis=0, dtype=np.float64)
    weight = np.mean([half[1] for half in halves], axis=0, dtype=np.float64)
    noise = 0.5 * weighted_rmse(np.subtract(halves[0][0], halves[1][0], dtype=np.float64), weight)
    return Truth(pixels, visibility, weight, noise, 2 * rays)
