"""What a layer should be at every pixel of an image, by rays, found once: how far any image is from it then
costs next to nothing, whoever made it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .deviation import product_variances
from .strata import finite

TWO_SIDED_95 = 1.96
NEARLY_ALL = 0.99


@dataclass(frozen=True)
class Judged:
    """An image's error in use, over `pixels`; `ci95` is what the rays' noise and pixels that nobody looked at
    leave open, `bias` is negative where it is too dark."""

    value: float
    ci95: tuple[float, float]
    bias: float
    p99: float
    pixels: int

    def to_json(self) -> dict[str, Any]:
        return {**vars(self), "ci95": list(self.ci95)}


@dataclass(frozen=True)
class Whole:
    """`pixels` (P,) of `population`, numbered row by row. Errors are linear in what a layer holds: `dark`
    (P, 2 halves, K) are those of a layer that is 0, and grow by `slopes` for each 1. `has_light` (P,): how
    much of a pixel has anything to multiply."""

    pixels: np.ndarray
    population: int
    dark: np.ndarray
    slopes: np.ndarray
    has_light: np.ndarray

    def errors(self, image: np.ndarray) -> np.ndarray:
        """(P, 2, K) of an image (height, width[, channels])."""
        values = finite(image.reshape(image.shape[0] * image.shape[1], -1)[self.pixels]).astype(np.float64)
        return self.dark + values[:, None] * self.slopes

    def judged(self, image: np.ndarray) -> Judged:
        """Each half's noise is its own, so that the product of both is the square without it."""
        errors = self.errors(image)
        squares = (errors[:, 0] * errors[:, 1]).sum(axis=1)
        count, pixels = float(self.has_light.sum()), len(self.pixels)
        if count <= 0.0:
            return Judged(0.0, (0.0, 0.0), 0.0, 0.0, pixels)
        unseen = 1.0 - pixels / self.population
        variance = product_variances(errors[:, 0], errors[:, 1]).sum() + unseen * pixels * squares.var()
        total, off = float(squares.sum()), TWO_SIDED_95 * math.sqrt(float(variance))
        low, value, high = (math.sqrt(max(each, 0.0) / count) for each in (total - off, total, total + off))
        mean = errors.mean(axis=1)
        sizes = np.sqrt((mean**2).sum(axis=1))[self.has_light > 0.0]
        bias = float(mean.sum()) / count
        return Judged(value, (low, high), bias, float(np.quantile(sizes, NEARLY_ALL)), pixels)

    def to_arrays(self) -> dict[str, np.ndarray]:
        """To be kept in a file."""
        return {**vars(self), "population": np.array(self.population)}

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray]) -> Whole:
        return cls(**{**arrays, "population": int(arrays["population"])})
