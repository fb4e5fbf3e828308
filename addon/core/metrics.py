"""Figures of how wrong an image is, in float64.

`weights` say how much a pixel matters (of a lamp's visibility: the unshadowed irradiance). `sampling` says
how many pixels a sample stands for; None: every pixel is there, once.
"""

from __future__ import annotations

import numpy as np

NEGLIGIBLE_WEIGHT = 0.01
"""Quantiles look at pixels whose weight is above this share of the mean weight: what is nearly unlit may be
wrong, but nobody sees it."""

BRIGHTEST = 100.0
"""Times the median: brighter pixels count as this in a mean brightness, so that one beside a lamp does not
set what errors everywhere are shares of."""

WRONG = 1.0 / 8.0
"""A pixel of a mask is wrong if it is off by more than this: eight of the 64 rays that it is compared with,
twice the standard deviation of their mean even where they fall as they like."""


def _together(*arrays) -> list[np.ndarray]:
    return [np.asarray(array, np.float64).reshape(-1) for array in arrays]


def _sampling(sampling, like: np.ndarray) -> np.ndarray:
    return np.ones_like(like) if sampling is None else np.asarray(sampling, np.float64).reshape(-1)


def mean_brightness(sizes) -> float:
    """Mean of the sizes, none counted as more than BRIGHTEST times the median of those above 0; 0 if none
    is."""
    sizes = np.asarray(sizes, np.float64).reshape(-1)
    if not (sizes > 0.0).any():
        return 0.0
    return float(np.minimum(sizes, BRIGHTEST * np.median(sizes[sizes > 0.0])).mean())


def seen(weights, sampling=None) -> np.ndarray:
    """(N,) bool: weight above 1% of its mean."""
    (weights,) = _together(weights)
    sampling = _sampling(sampling, weights)
    count = sampling.sum()
    mean = (weights * sampling).sum() / count if count > 0.0 else 0.0
    return weights > NEGLIGIBLE_WEIGHT * mean


def quantile(errors, weights, share: float, sampling=None) -> float:
    """The smallest |error| that at least `share` of the seen pixels do not exceed; 0 if none is seen."""
    errors, weights = _together(errors, weights)
    sampling = _sampling(sampling, weights)
    keep = seen(weights, sampling)
    sizes, sampling = np.abs(errors[keep]), sampling[keep]
    if not sizes.size:
        return 0.0
    order = np.argsort(sizes)
    reached = np.cumsum(sampling[order])
    # Rounding in the sum must not push the last step out of reach.
    index = np.searchsorted(reached, share * reached[-1] * (1.0 - 1e-12))
    return float(sizes[order][min(index, sizes.size - 1)])


def maximum(errors, weights, sampling=None) -> float:
    """The largest |error| of the seen pixels; 0 if none is seen."""
    errors, weights = _together(errors, weights)
    keep = seen(weights, sampling)
    return float(np.abs(errors[keep]).max(initial=0.0))
