"""How far a layer is from Cycles, used as it is meant to be: float64, the metrics of docs/accuracy.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.metrics import mean_brightness
from ..measure.report import rounded
from ..measure.verdict import interval_words, percent

TWO_SIDED_95 = 1.96
UNSEEN_95 = 3.0
"""Of pixels that are so rare that none of n was seen, there are no more than 3 / n, 95 times of 100."""


@dataclass(frozen=True)
class Audit:
    """Of a layer, over `pixels` of its image: `value` as the layer's own error is defined, Cycles' noise
    taken off, `ci95` for all pixels of the image (of those that nobody looked at, as many as may be are as
    bad as the worst that was seen), `noise` of Cycles at one pixel, which took `samples` there."""

    value: float
    ci95: tuple[float, float]
    noise: float
    pixels: int
    samples: int
    seconds: float

    def to_json(self) -> dict[str, Any]:
        numbers = {key: rounded(item) for key, item in vars(self).items() if isinstance(item, float)}
        return {**vars(self), **numbers, "ci95": [rounded(limit) for limit in self.ci95]}

    @property
    def words(self) -> str:
        return (
            f"held against Cycles off by {percent(self.value)} ({interval_words(*self.ci95)}), "
            f"{self.pixels} pixels, whose noise is {percent(self.noise)}"
        )


def of_multiplied(
    layer: np.ndarray, bare: np.ndarray, shadowed: np.ndarray, luminance: tuple[float, float, float]
) -> np.ndarray | None:
    """Errors of both halves (2, N) at the pixels that the lamp lights, from a layer (H, W) or (H, W, 3) and
    Cycles' image without and with shadow, (2, H, W, 3) each, each half with noise of its own; None where
    nothing is lit."""
    factor = layer.reshape(*layer.shape[:2], -1).astype(np.float64)
    difference = (factor * bare - shadowed) @ np.asarray(luminance)
    brightness = bare.mean(axis=0) @ np.asarray(luminance)
    lit = brightness > 0.0
    if not lit.any():
        return None
    return difference[:, lit] / (brightness[lit] + mean_brightness(brightness[lit]))


def of_added(layer: np.ndarray, light: np.ndarray) -> np.ndarray | None:
    """The same of light (H, W, 3) that is added, against Cycles' (2, H, W, 3): each channel by itself,
    (2, 3 N)."""
    truth = light.mean(axis=0)
    mean = [mean_brightness(np.abs(truth[..., channel])) for channel in range(3)]
    if not any(mean):
        return None
    below = np.abs(truth) + np.where(np.array(mean) > 0.0, mean, 1.0)
    return ((layer.astype(np.float64) - light) / below).reshape(2, -1)


def audit_of(errors: np.ndarray, samples: int, seconds: float) -> Audit:
    """Of both halves' errors (2, N). Their noises are independent, so that the mean of their product is the
    square without them."""
    first, second = errors
    squares = first * second
    square, spread = squares.mean(), squares.std() / np.sqrt(max(squares.size - 1, 1))
    low = max(square - TWO_SIDED_95 * spread, 0.0)
    high = max(square + TWO_SIDED_95 * spread + UNSEEN_95 * squares.max() / squares.size, 0.0)
    noise = 0.5 * float(np.sqrt(np.mean((first - second) ** 2)))
    value = float(np.sqrt(max(square, 0.0)))
    return Audit(value, (float(np.sqrt(low)), float(np.sqrt(high))), noise, squares.size, samples, seconds)
