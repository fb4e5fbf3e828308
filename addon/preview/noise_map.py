"""Noise as colours: from dark violet, where a picture hardly changes any more, to yellow."""

from __future__ import annotations

import numpy as np

# Viridis of matplotlib (Smith, van der Walt, Firing 2015, CC0) at equal steps: equal steps of a value look
# equal, in print and to the colour-blind too.
VIRIDIS = ("440154", "472d7b", "3b528b", "2c728e", "21908c", "27ad81", "5dc863", "aadc32", "fde725")
_COLOURS = np.array([tuple(bytes.fromhex(colour)) for colour in VIRIDIS], np.float32) / 255.0

LOWEST, HIGHEST = 1e-3, 1.0
"""Shares of the brightness at both ends; steps between are factors."""
MARKS = (1e-3, 1e-2, 1e-1, 1.0)
"""Of the legend."""


def colours(shares: np.ndarray) -> np.ndarray:
    """(..., 4) float32 of noise as shares of the brightness, as a display is sent it, opaque. What is not
    finite is as noisy as can be."""
    shares = np.nan_to_num(shares, nan=HIGHEST, posinf=HIGHEST)
    place = np.log(np.clip(shares, LOWEST, HIGHEST) / LOWEST) / np.log(HIGHEST / LOWEST)
    found = np.ones((*place.shape, 4), np.float32)
    steps = np.linspace(0.0, 1.0, len(_COLOURS))
    for channel in range(3):
        found[..., channel] = np.interp(place, steps, _COLOURS[:, channel])
    return found
