"""How fine a picture of a mesh is to be baked."""

from __future__ import annotations

import math

import bpy
import numpy as np

from ...core.arrays import MeshArrays
from ...core.shot import Raster
from .layout import least_size

LEAST = 128
TEXELS_PER_PIXEL = 2.0  # of the picture, where the mesh is nearest; its shadows may lie nearer than it itself


def size_for(
    raster: Raster, shown: bpy.types.Object, matrix: np.ndarray, area: float, faces: int, most: int
) -> int:
    """Texels a side, a power of two, for an object of `area` m² in its own space, (4, 4) its matrix from it
    to the world; `most` unless the faces need more."""
    corners = np.array([corner[:] for corner in shown.bound_box], np.float64)
    corners = corners @ matrix[:3, :3].T + matrix[:3, 3]
    view, (width, _) = raster.view, raster.computed_size
    left, right, _, _ = view.window
    pixel = (right - left) / width
    if not view.orthographic:
        eye = np.array(view.eye)
        nearest = np.clip(eye, corners.min(axis=0), corners.max(axis=0))
        pixel *= max(float(np.linalg.norm(nearest - eye)), view.near)
    area *= _stretching(matrix)
    wanted = TEXELS_PER_PIXEL * math.sqrt(area) / pixel if pixel > 0.0 else math.inf
    wanted = min(max(wanted, LEAST), most) if wanted == wanted else most
    return max(_power_of_two(wanted), least_size(faces))


def sizes_for(faces: int, most: int) -> list[int]:
    """All that `size_for` may give, the finest first."""
    least, size = max(least_size(faces), _power_of_two(min(LEAST, most))), _power_of_two(most)
    sizes = []
    while size > least:
        sizes.append(size)
        size //= 2
    return [*sizes, least]


def _power_of_two(number: float) -> int:
    return 1 << (math.ceil(number) - 1).bit_length()


def _stretching(matrix: np.ndarray) -> float:
    """What areas grow by, at most."""
    if not np.isfinite(matrix).all():
        return 1.0
    first, second, _ = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return float(first * second)


def area_of(mesh: MeshArrays) -> float:
    """m² of a mesh's faces in its own space."""
    finite = np.nan_to_num(mesh.positions.astype(np.float64), posinf=0.0, neginf=0.0)
    corners = finite[mesh.corner_vertices]
    following = np.arange(1, len(corners) + 1)
    following[mesh.face_starts[1:] - 1] = mesh.face_starts[:-1]
    normals = np.add.reduceat(np.cross(corners, corners[following]), mesh.face_starts[:-1], axis=0)
    return float(0.5 * np.sqrt(np.sum(normals**2, axis=1)).sum())
