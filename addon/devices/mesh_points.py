"""Surface attributes at points of meshes, in float64: for view rays and for charts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.arrays import Arrays
from ..core.outline import Outline
from ..core.surface import ATTRIBUTES


class MeshPoints:
    """Fills attributes with the conventions of core/surface.py. `triangulate(mesh)`: corners of each triangle
    (T, 3) and its face (T,)."""

    def __init__(self, triangulate: Callable, outline: Outline, arrays: Arrays):
        self._triangulate = triangulate
        self._outline, self._arrays = outline, arrays
        self._triangles: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def fill(
        self, surface, rows, mesh_index: int, instance, triangle, origin, weigh: Callable, turned: Callable
    ) -> np.ndarray:
        """Writes what is known at `rows` of the arrays `surface`, which lie on the triangles `triangle` of
        one mesh, and returns the positions there (N, 3) relative to `origin`. `weigh(points, corner)`: the
        weights (N, 3) of the corners (N, 3, 3), which have the numbers `corner` (N, 3) in the mesh;
        `turned(winding)`: -1 where a normal (N, 3) faces the wrong way, else 1."""
        mesh = self._arrays.meshes[mesh_index]
        corners, faces = self.split(mesh_index)
        corner, face = corners[triangle], faces[triangle]
        matrices = self._arrays.matrices[instance]
        linear, offset = matrices[:, :3, :3], matrices[:, :3, 3] - np.array(origin)
        points = mesh.positions[mesh.corner_vertices[corner]].astype(np.float64)
        points = np.einsum("nij,nkj->nki", linear, points) + offset[:, None]
        weights = weigh(points, corner)
        position = np.einsum("nk,nki->ni", weights, points)
        winding = _unit(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]))
        turn = turned(winding)[:, None]
        values = {
            "position": position,
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
        return position

    def split(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the triangles (T, 3) of the mesh with that index, and their faces (T,)."""
        if index not in self._triangles:
            self._triangles[index] = self._triangulate(self._arrays.meshes[index])
        return self._triangles[index]

    def _materials(self, instance: np.ndarray, slots: np.ndarray) -> np.ndarray:
        """Of each hit; a slot beyond the last counts as the last, as in Blender."""
        result = np.empty(len(slots), np.int32)
        for each in np.unique(instance):
            materials = np.array(self._outline.instances[each].materials)
            there = instance == each
            result[there] = materials[np.clip(slots[there], 0, len(materials) - 1)]
        return result


def nothing(count: int, attributes: frozenset[str]) -> dict[str, np.ndarray]:
    """A surface of misses."""
    surface = {}
    for name in attributes:
        each = ATTRIBUTES[name]
        surface[name] = np.full((count, each.channels) if each.channels > 1 else count, each.miss, each.dtype)
    return surface


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)
