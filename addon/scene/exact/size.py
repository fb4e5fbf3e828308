"""How fine a picture of a mesh is to be baked."""

from __future__ import annotations

import math

import bpy
import numpy as np

from ...core.shot import Raster
from .layout import least_size

LEAST = 128
TEXELS_PER_PIXEL = 2.0  # of the picture, where the mesh is nearest; its shadows may lie nearer than it itself


def size_for(
    raster: Raster, shown: bpy.types.Object, matrices: np.ndarray, area: float, faces: int, most: int
) -> int:
    """Texels a side, a power of two, for an object of `area` m² in its own space, (N, 4, 4) its matrices from
    it to the world, of which one needs the most; `most` unless the faces need more."""
    corners = np.array([corner[:] for corner in shown.bound_box], np.float64)
    corners = corners @ matrices[:, :3, :3].transpose(0, 2, 1) + matrices[:, None, :3, 3]
    view, (width, _) = raster.view, raster.computed_size
    left, right, _, _ = view.window
    pixels = (right - left) / width
    if not view.orthographic:
        eye = np.array(view.eye)
        nearest = np.clip(eye, corners.min(axis=1), corners.max(axis=1))
        pixels = pixels * np.maximum(np.linalg.norm(nearest - eye, axis=1), view.near)
    with np.errstate(divide="ignore", invalid="ignore"):
        wanted = float(np.max(TEXELS_PER_PIXEL * np.sqrt(area * _stretchings(matrices)) / pixels))
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


def _stretchings(matrices: np.ndarray) -> np.ndarray:
    """(N,) what areas grow by, at most."""
    found = np.ones(len(matrices))
    finite = np.isfinite(matrices).all(axis=(1, 2))
    lengths = np.linalg.svd(matrices[finite, :3, :3], compute_uv=False)
    found[finite] = lengths[:, 0] * lengths[:, 1]
    return found


def area_of(mesh: bpy.types.Mesh) -> float:
    """m² of a mesh's faces in its own space."""
    areas = np.empty(len(mesh.polygons), np.float32)
    mesh.polygons.foreach_get("area", areas)
    return float(np.nan_to_num(areas.astype(np.float64), posinf=0.0, neginf=0.0).sum())
