"""Meshes on the GPU, as tables that shaders pull vertices from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import MeshArrays
from ..core.shader import Shader
from .gpu_image import GpuImage

MOST_IN_A_MESH = 1 << 24
# Columns of each table, and its rows to a vertex or a triangle.
TABLES = {"positions": 4, "triangles": 4, "corner_normals": 4, "corner_uvs": 2}
PATCHED_SHARE = 0.5  # with more than this of the rows new, all are uploaded again

COPY_ROWS = Shader(
    "devices/copy_rows.glsl",
    samplers=(("source", "FLOAT_2D"),),
    images=(("table", "RGBA32F", "WRITE"),),
    params=("rows",),
    group=(64, 1),
)
COPY_PAIRS = Shader(
    "devices/copy_rows.glsl",
    samplers=(("source", "FLOAT_2D"),),
    images=(("table", "RG32F", "WRITE"),),
    params=("rows",),
    group=(64, 1),
)


@dataclass(frozen=True)
class MeshPlace:
    """Where a mesh lies in the tables. `slots`: first triangle and count of each material slot in use."""

    centre: np.ndarray
    low: np.ndarray
    high: np.ndarray
    first_vertex: int
    first_triangle: int
    slots: tuple[tuple[int, int, int], ...]


@dataclass(eq=False)
class _Part:
    """A mesh as the tables hold it: `corners` (T, 3) of its triangles, sorted by material slot."""

    mesh: MeshArrays
    corners: np.ndarray
    slots: np.ndarray
    centre: np.ndarray
    low: np.ndarray
    high: np.ndarray
    order: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.mesh.positions), len(self.corners)

    def rows(self, name: str) -> np.ndarray:
        """The mesh's rows of a table, (N, columns) float32."""
        mesh = self.mesh
        if name == "positions":
            local = np.zeros((len(mesh.positions), 4), np.float32)
            with np.errstate(invalid="ignore", over="ignore"):
                np.subtract(mesh.positions, self.centre.astype(np.float32), out=local[:, :3])
            return local
        if name == "triangles":
            vertices = mesh.corner_vertices[self.corners]
            return np.concatenate([vertices, self.order[:, None]], axis=1).astype(np.float32)
        rows = np.zeros((self.corners.size, TABLES[name]), np.float32)
        values = getattr(mesh, name)
        if values is not None:
            rows[:, : values.shape[1]] = values[self.corners.reshape(-1)]
        return rows


class GpuMeshes:
    """The tables of a scene's meshes: positions and triangles at once, normals and uvs when first asked for.

    - `positions`: a row a vertex, x, y, z relative to its mesh's middle, 0. The matrices put the middle back
      in float64: float32 products then lose the fewest digits.
    - `triangles`: a row a triangle, its vertices, counted in its mesh, and its number in its mesh.
    - `corner_normals`: three rows a triangle, unit shading normals in object space, zero for a flat mesh.
    - `corner_uvs`: three rows a triangle; zero where the mesh has none.

    `places` tells where each mesh lies in them.
    """

    def __init__(self, device, meshes: tuple[MeshArrays, ...]):
        self._device = device
        self._parts = [_part_of(mesh) for mesh in meshes]
        self._tables: dict[str, GpuImage] = {}
        self.places = _places_of(self._parts)
        self.table("positions")
        self.table("triangles")

    @staticmethod
    def of(device, meshes: tuple[MeshArrays, ...], last: GpuMeshes | None) -> GpuMeshes:
        """The tables of `meshes`. Those of the last scene, where they hold the same meshes; where some have
        changed but in size, they are written into its tables, so that nothing may draw the last scene any
        more."""
        if last is None or len(last._parts) != len(meshes):
            return GpuMeshes(device, meshes)
        changed = [index for index, mesh in enumerate(meshes) if mesh is not last._parts[index].mesh]
        if not changed:
            return last
        parts = {index: _part_of(meshes[index]) for index in changed}
        sizes = sum(sum(part.shape) for part in last._parts)
        fits = all(part.shape == last._parts[index].shape for index, part in parts.items())
        if not fits or sum(sum(part.shape) for part in parts.values()) > PATCHED_SHARE * sizes:
            return GpuMeshes(device, meshes)
        last._patch(parts)
        return last

    def table(self, name: str) -> GpuImage:
        """One of the four, uploaded when first asked for."""
        if name not in self._tables:
            rows = [np.zeros((0, TABLES[name]), np.float32), *(part.rows(name) for part in self._parts)]
            self._tables[name] = self._device.upload_table(np.concatenate(rows))
        return self._tables[name]

    def _patch(self, parts: dict[int, _Part]) -> None:
        for index, part in parts.items():
            self._parts[index] = part
        self.places = _places_of(self._parts)
        for name, table in self._tables.items():
            shader = COPY_PAIRS if TABLES[name] == 2 else COPY_ROWS
            for index, part in parts.items():
                rows = part.rows(name)
                first = self.places[index].first_vertex
                if name != "positions":
                    first = self.places[index].first_triangle * (1 if name == "triangles" else 3)
                source = self._device.upload_table(rows)
                halves = (first >> 16, first & 0xFFFF, len(rows) >> 16, len(rows) & 0xFFFF)
                self._device.dispatch(
                    shader, source.size, {"table": table}, {"source": source}, {"rows": halves}
                )
                self._device.release(source)


def _part_of(mesh: MeshArrays) -> _Part:
    """Raises ValueError for a mesh that is too large."""
    from .cpu import triangulate  # here, so that programs compile where there are no kernels

    corners, faces = triangulate(mesh)
    if max(len(mesh.positions), len(corners)) >= MOST_IN_A_MESH:
        raise ValueError(f"a mesh has more than {MOST_IN_A_MESH} vertices or triangles")
    slots = np.zeros(len(faces), np.int64)
    order = np.arange(len(faces))
    if mesh.face_slots is not None:
        slots = np.maximum(mesh.face_slots[faces].astype(np.int64), 0)
        order = np.argsort(slots, kind="stable")
        corners, slots = corners[order], slots[order]
    # Vertices that no triangle uses are not the mesh's extent.
    is_used = np.zeros(len(mesh.positions), bool)
    is_used[mesh.corner_vertices[corners]] = True
    used = mesh.positions if is_used.all() else mesh.positions[is_used]
    low = used.min(axis=0).astype(np.float64) if len(used) else np.zeros(3)
    high = used.max(axis=0).astype(np.float64) if len(used) else np.zeros(3)
    centre = (0.5 * low + 0.5 * high).astype(np.float32).astype(np.float64)
    return _Part(mesh, corners, slots, centre, low, high, order)


def _places_of(parts: list[_Part]) -> list[MeshPlace]:
    places, vertex, triangle = [], 0, 0
    for part in parts:
        slots = _slot_ranges(part.slots, triangle)
        places.append(MeshPlace(part.centre, part.low, part.high, vertex, triangle, slots))
        vertex += part.shape[0]
        triangle += part.shape[1]
    return places


def _slot_ranges(slots: np.ndarray, first_triangle: int) -> tuple[tuple[int, int, int], ...]:
    """Slot, first triangle and count, of sorted `slots`."""
    found, starts, counts = np.unique(slots, return_index=True, return_counts=True)
    parts = zip(found.tolist(), starts.tolist(), counts.tolist(), strict=True)
    return tuple((slot, first_triangle + start, count) for slot, start, count in parts)
