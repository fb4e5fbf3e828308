"""An eye that geometry is rasterised from: the camera, or a light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PACKED_LENGTH = 19

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class View:
    """Lengths in metres, axes orthonormal, all in world space.

    `window` is left, right, bottom, top: slopes (tangents) for a perspective view, metres for an
    orthographic one. Depth is measured along `forward`, so it is the distance to the eye's plane.
    Twin of kernels/src/view.rs.
    """

    eye: Vector
    right: Vector
    up: Vector
    forward: Vector
    window: tuple[float, float, float, float]
    near: float
    far: float
    orthographic: bool = False

    def packed(self) -> np.ndarray:
        """(19,) float64: eye, right, up, forward, window, near, far, orthographic."""
        numbers = (*self.eye, *self.right, *self.up, *self.forward, *self.window)
        return np.array([*numbers, self.near, self.far, float(self.orthographic)], np.float64)

    def to_view(self, points: np.ndarray) -> np.ndarray:
        """World points (..., 3) float64 to (right, up, forward) coordinates relative to the eye."""
        axes = np.array([self.right, self.up, self.forward], np.float64)
        return (np.asarray(points, np.float64) - np.array(self.eye, np.float64)) @ axes.T
