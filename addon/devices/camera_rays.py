"""What the camera sees between and beside pixel centres, by rays and in float64: the surface that
supersampled references are asked at, made without the rasteriser."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.arrays import Arrays
from ..core.outline import Outline
from ..core.shot import Shot
from ..core.view_rays import ViewRays, lines_of_sight, view_rays
from .mesh_points import MeshPoints, nothing


class CameraRays:
    """Traces view rays against the instances `visible` and fills the surface attributes `attributes`, with
    the conventions of core/surface.py. `triangulate(mesh)`: corners of each triangle (T, 3) and its face
    (T,); `visible` (instances,) uint8."""

    def __init__(
        self,
        triangulate: Callable,
        outline: Outline,
        shot: Shot,
        arrays: Arrays,
        visible: np.ndarray,
        attributes: frozenset[str],
    ):
        self._points = MeshPoints(triangulate, outline, arrays)
        self._outline = outline
        self._visible, self._attributes = visible, attributes
        self._shot, self._view = shot, shot.view

    def look(self, nearest: Callable, pixels: np.ndarray, jitter: np.ndarray) -> ViewRays:
        """Rays through `pixels` (N, 2), `jitter` (N, 2) pixels beside their centres. `nearest(casters,
        origins, directions, t_max)` finds hits relative to the eye, as `strata_kernels.Accel.nearest`."""
        view = self._view
        origins, directions = lines_of_sight(view, self._shot.computed_size, pixels, jitter)
        starts = origins + view.near * directions
        room = np.full(len(pixels), view.far - view.near, np.float32)
        _, instance, triangle = nearest(
            self._visible, starts.astype(np.float32), np.ascontiguousarray(directions, np.float32), room
        )
        surface = nothing(len(pixels), self._attributes)
        hit = np.flatnonzero(instance >= 0)
        for mesh in {self._outline.instances[i].mesh for i in np.unique(instance[hit])}:
            used = [i for i, each in enumerate(self._outline.instances) if each.mesh == mesh]
            rows = hit[np.isin(instance[hit], used)]
            self._fill(surface, rows, mesh, instance[rows], triangle[rows], origins[rows], directions[rows])
        return view_rays(self._shot, pixels, jitter, surface)

    def _fill(self, surface, rows, mesh_index: int, instance, triangle, origins, directions) -> None:
        """Writes the attributes at `rows`, which hit the triangles `triangle` of one mesh."""

        def turned(winding: np.ndarray) -> np.ndarray:
            return np.where(np.einsum("ni,ni->n", winding, directions) > 0.0, -1.0, 1.0)

        position = self._points.fill(
            surface,
            rows,
            mesh_index,
            instance,
            triangle,
            self._view.eye,
            lambda points, corner: _weights(points, origins, directions),
            turned,
        )
        if "depth" in surface:
            surface["depth"][rows] = position @ np.array(self._view.forward)


def _weights(points: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(N, 3) weights of the corners (N, 3, 3) where rays meet their triangles (Möller and Trumbore), kept
    inside: hits were found in float32."""
    first, second = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    across = np.cross(directions, second)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / np.einsum("ni,ni->n", first, across)
        start = origins - points[:, 0]
        u = np.einsum("ni,ni->n", start, across) * inverse
        v = np.einsum("ni,ni->n", directions, np.cross(start, first)) * inverse
    weights = np.nan_to_num(np.stack([1.0 - u - v, u, v], axis=1), posinf=0.0, neginf=0.0).clip(0.0)
    weights[~weights.any(axis=1)] = 1.0
    return weights / weights.sum(axis=1, keepdims=True)
