"""What the camera sees between and beside pixel centres, by rays and in float64: the surface that
supersampled references are asked at, made without the rasteriser."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.arrays import Arrays, MeshArrays
from ..core.outline import Outline
from ..core.shot import Shot
from ..core.surface import ATTRIBUTES
from ..core.view_rays import ViewRays, lines_of_sight, view_rays


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
        self._triangulate = triangulate
        self._outline, self._arrays = outline, arrays
        self._visible, self._attributes = visible, attributes
        self._shot, self._view = shot, shot.view
        self._triangles: dict[int, tuple[np.ndarray, np.ndarray]] = {}

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
        surface = _nothing(len(pixels), self._attributes)
        hit = np.flatnonzero(instance >= 0)
        for mesh in {self._outline.instances[i].mesh for i in np.unique(instance[hit])}:
            used = [i for i, each in enumerate(self._outline.instances) if each.mesh == mesh]
            rows = hit[np.isin(instance[hit], used)]
            self._fill(surface, rows, mesh, instance[rows], triangle[rows], origins[rows], directions[rows])
        return view_rays(self._shot, pixels, jitter, surface)

    def _fill(self, surface, rows, mesh_index: int, instance, triangle, origins, directions) -> None:
        """Writes the attributes at `rows`, which hit the triangles `triangle` of one mesh."""
        mesh = self._arrays.meshes[mesh_index]
        corners, faces = self._split(mesh_index, mesh)
        corner, face = corners[triangle], faces[triangle]
        matrices = self._arrays.matrices[instance]
        linear, offset = matrices[:, :3, :3], matrices[:, :3, 3] - np.array(self._view.eye)
        points = mesh.positions[mesh.corner_vertices[corner]].astype(np.float64)
        points = np.einsum("nij,nkj->nki", linear, points) + offset[:, None]
        weights = _weights(points, origins, directions)
        position = np.einsum("nk,nki->ni", weights, points)
        winding = _unit(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]))
        turn = np.where(np.einsum("ni,ni->n", winding, directions) > 0.0, -1.0, 1.0)[:, None]
        values = {
            "position": position,
            "depth": position @ np.array(self._view.forward),
            "instance": instance,
            "triangle": triangle,
            "geometric_normal": turn * winding,
            "shading_normal": turn * winding,
            "object_id": np.array([each.object_id for each in self._outline.instances])[instance],
        }
        if "shading_normal" in surface and mesh.corner_normals is not None:
            local = np.einsum("nk,nki->ni", weights, mesh.corner_normals[corner].astype(np.float64))
            # Rows of cofactors: what a linear map does to normals, and so to the winding above.
            first, second, third = linear[:, 0], linear[:, 1], linear[:, 2]
            cofactors = [np.cross(second, third), np.cross(third, first), np.cross(first, second)]
            shading = np.stack([np.einsum("ni,ni->n", row, local) for row in cofactors], axis=1)
            values["shading_normal"] = turn * _unit(shading)
        if "uv" in surface and mesh.corner_uvs is not None:
            values["uv"] = np.einsum("nk,nki->ni", weights, mesh.corner_uvs[corner].astype(np.float64))
        if "material" in surface:
            slots = np.zeros(len(rows), int) if mesh.face_slots is None else mesh.face_slots[face]
            values["material"] = self._materials(instance, slots)
        for name in surface.keys() & values.keys():
            surface[name][rows] = values[name]

    def _split(self, index: int, mesh: MeshArrays) -> tuple[np.ndarray, np.ndarray]:
        if index not in self._triangles:
            self._triangles[index] = self._triangulate(mesh)
        return self._triangles[index]

    def _materials(self, instance: np.ndarray, slots: np.ndarray) -> np.ndarray:
        """Of each hit; a slot beyond the last counts as the last, as in Blender."""
        result = np.empty(len(slots), np.int32)
        for each in np.unique(instance):
            materials = np.array(self._outline.instances[each].materials)
            there = instance == each
            result[there] = materials[np.clip(slots[there], 0, len(materials) - 1)]
        return result


def _nothing(count: int, attributes: frozenset[str]) -> dict[str, np.ndarray]:
    """A surface of misses."""
    surface = {}
    for name in attributes:
        each = ATTRIBUTES[name]
        surface[name] = np.full((count, each.channels) if each.channels > 1 else count, each.miss, each.dtype)
    return surface


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


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)
