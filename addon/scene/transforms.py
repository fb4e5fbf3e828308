"""Blender's matrices as float64."""

from __future__ import annotations

import numpy as np

# A matrix whose columns span less than this share of the volume of a box of their lengths is singular:
# a thousand steps of the float32 that Blender keeps matrices in.
_SINGULAR = 1e-4


def matrix_of(matrix) -> np.ndarray:
    """A mathutils.Matrix as (4, 4) float64."""
    return np.array([row[:] for row in matrix], np.float64)


def is_usable(matrix: np.ndarray) -> bool:
    """Whether a (4, 4) matrix is finite, and flattens nothing."""
    if not np.isfinite(matrix).all():
        return False
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not lengths.all():
        return False
    return bool(abs(np.linalg.det(matrix[:3, :3] / lengths)) > _SINGULAR)


def as_vector(values) -> tuple[float, float, float]:
    return tuple(float(v) for v in values)
