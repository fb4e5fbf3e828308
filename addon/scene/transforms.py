"""Blender's matrices as float64, and its numbers as far as single precision goes."""

from __future__ import annotations

import math

import numpy as np

# A matrix whose columns span less than this share of the volume of a box of their lengths is singular:
# a thousand steps of the float32 that Blender keeps matrices in.
_SINGULAR = 1e-4
# Beyond this, squares overflow float32 (Blender turns infinite locations into 3e38).
LARGEST = 1e18


def matrix_of(matrix) -> np.ndarray:
    """A mathutils.Matrix as (4, 4) float64."""
    return np.array([row[:] for row in matrix], np.float64)


def are_finite(matrices: np.ndarray) -> np.ndarray:
    """Which of the (..., 4, 4) matrices are finite and not absurdly far; NaN compares false."""
    return (np.abs(matrices) < LARGEST).all(axis=(-2, -1))


def are_usable(matrices: np.ndarray) -> np.ndarray:
    """(N,) bool: which of the (N, 4, 4) matrices are finite and flatten nothing."""
    linear = matrices[:, :3, :3]
    with np.errstate(all="ignore"):
        directions = linear / np.linalg.norm(linear, axis=1, keepdims=True)
        volumes = np.abs(np.linalg.det(np.nan_to_num(directions, nan=0.0, posinf=0.0, neginf=0.0)))
    return are_finite(matrices) & (volumes > _SINGULAR)


def as_vector(values) -> tuple[float, float, float]:
    return tuple(float(v) for v in values)


def as_colour(values) -> tuple[float, float, float]:
    """Three numbers whose squares single precision holds; 0 for what is no number."""
    return tuple(0.0 if math.isnan(v) else max(-LARGEST, min(float(v), LARGEST)) for v in values)
