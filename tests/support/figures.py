"""Error figures of whole images by their definitions, in float64: what reports estimate from probes.

`weights` say how much a pixel matters (of a lamp's visibility: the unshadowed irradiance).
"""

from __future__ import annotations

import numpy as np
from strata.addon.core.metrics import mean_brightness


def weighted_rmse(errors, weights) -> float:
    """sqrt(sum of weight * error^2 / sum of weight); 0 if nothing has weight."""
    errors, weights = (np.asarray(each, np.float64).ravel() for each in (errors, weights))
    total = weights.sum()
    return float(np.sqrt((weights * errors**2).sum() / total)) if total > 0.0 else 0.0


def weighted_bias(errors, weights) -> float:
    """sum of weight * error / sum of weight; 0 if nothing has weight."""
    errors, weights = (np.asarray(each, np.float64).ravel() for each in (errors, weights))
    total = weights.sum()
    return float((weights * errors).sum() / total) if total > 0.0 else 0.0


def in_use_of_light(values, truths) -> float:
    """Of a layer (height, width, channels) that adds: root mean square of (value - truth) / (|truth| at the
    pixel + mean truth); where all of that is 0, of the values."""
    values, truths = np.asarray(values, np.float64), np.asarray(truths, np.float64)
    sizes = np.abs(truths).mean(axis=-1, keepdims=True)
    whole = sizes + (mean_brightness(sizes) or 1.0)
    return float(np.sqrt((((values - truths) / whole) ** 2).mean()))


def wrong_share(values, truths, tolerance: float = 0.0) -> float:
    """Share of the pixels that are off by more than `tolerance`."""
    return float(np.mean(np.abs(np.asarray(values, np.float64) - truths) > tolerance))
