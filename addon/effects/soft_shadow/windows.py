"""What windows of maps have in common, whatever light they are of."""

from __future__ import annotations

import numpy as np

from ...core.view import View

NamedView = tuple[str, View]
LeftOut = tuple[str, str]
Window = tuple[np.ndarray, np.ndarray]
"""Low and high corners (2,) across the light's axes."""


def padded(low: np.ndarray, high: np.ndarray) -> tuple[float, float, float, float]:
    """Left, right, bottom, top, a little wider so that no edge falls on the border, and never empty."""
    size = high - low
    margin = np.maximum(0.002 * size, 1e-6 * size.max() + 1e-12)
    low, high = low - margin, high + margin
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])
