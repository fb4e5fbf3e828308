"""Meshes on the GPU, as tables that shaders pull vertices from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import MeshArrays
from ..core.shader import Shader
from .gpu_image import TABLE_WIDTH, GpuImage

MOST_IN_A_MESH = 1 << 24
# Columns of each table, and its rows to a vertex or a triangle.
TABLES = {
    "positions": 4, "triangles": 4, "corner_normals": 4, "corner_uvs": 2, "corner_opacity": 2,
    "corner_colours": 4,
}  # fmt: skip
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
    """A mesh as the tables hold it: `corners` and `vertices` (T, 3) of its triangles, sorted by material
    slot; `corners` is None where they are all of them, in order, `slots` where there is but one, and
    `order`, the triangles' numbers before they were sorted, where they were not."""

    mesh: MeshArrays
    corners: np.ndarray | None
    vertices: np.ndarray
    slots: np.ndarray | None
    centre: np.ndarray
    low: np.ndarray
    high: np.ndarray
    order: np.ndarray | None

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.mesh.positions), len(self.vertices)

    def row_count(self, name: str) -> int:
        """How many rows of a table it has."""
        vertices, triangles = self.shape
        return {"positions": vertices, "triangles": triangles}.get(name, 3 * triangles)

    def write(self, name: str, rows: np.ndarray) -> None:
        """Its rows of a table into `rows` (N, columns) float32, all zero: straight into what is uploaded,
        since each copy takes about as long as the upload."""
        from . import cpu  # here, so that programs compile where there are no kernels

        mesh = self.mesh
        # By kernels, since numpy takes five times as long for rows of three.
        if name == "positions":
            cpu.write_positions(mesh.positions, self.centre, rows)
        elif name == "triangles":
            cpu.write_triangles(self.vertices, self.order, rows)
        else:
            values = getattr(mesh, name)
            if values is not None:
                corners = slice(None) if self.corners is None else self.corners.reshape(-1)
                for column, along in enumerate(np.atleast_2d(values.T)):
                    rows[:, column] = along[corners]
            elif name == "corner_opacity":
                rows[:, 0] = 1.0
            elif name == "corner_colours":
                rows[:, :3] = 1.0


class GpuMeshes:
    """The tables of a scene's meshes: positions and triangles at once, the others when first asked for.

    - `positions`: a row a vertex, x, y, z relative to its mesh's middle, 0. The matrices put the middle back
      in float64: float32 products then lose the fewest digits.
    - `triangles`: a row a triangle, its vertices, counted in its mesh, and its number in its mesh.
    - `corner_normals`: three rows a triangle, unit shading normals in object space, zero for a flat mesh.
    - `corner_uvs`: three rows a triangle; zero where the mesh has none.
    - `corner_opacity`: three rows a triangle, a factor and 0; 1 where the mesh has none.
    - `corner_colours`: three rows a triangle, three factors and 0; 1 where the mesh has none.

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
        """One of the six, uploaded when first asked for."""
        if name not in self._tables:
            self._tables[name] = _uploaded(self._device, name, self._parts)
        return self._tables[name]

    def _patch(self, parts: dict[int, _Part]) -> None:
        for index, part in parts.items():
            self._parts[index] = part
        self.places = _places_of(self._parts)
        for name, table in self._tables.items():
            shader = COPY_PAIRS if TABLES[name] == 2 else COPY_ROWS
            for index, part in parts.items():
                rows = part.row_count(name)
                first = self.places[index].first_vertex
                if name != "positions":
                    first = self.places[index].first_triangle * (1 if name == "triangles" else 3)
                source = _uploaded(self._device, name, [part])
                halves = (first >> 16, first & 0xFFFF, rows >> 16, rows & 0xFFFF)
                self._device.dispatch(
                    shader, source.size, {"table": table}, {"source": source}, {"rows": halves}
                )
                self._device.release(source)


def _uploaded(device, name: str, parts: list[_Part]) -> GpuImage:
    """A table of the parts, one after the other."""
    counts = [part.row_count(name) for part in parts]
    total = sum(counts)
    height = max(1, -(-total // TABLE_WIDTH))
    rows = np.zeros((height * TABLE_WIDTH, TABLES[name]), np.float32)
    first = 0
    for part, count in zip(parts, counts, strict=True):
        part.write(name, rows[first : first + count])
        first += count
    return device.upload(rows.reshape(height, TABLE_WIDTH, TABLES[name]))


def _part_of(mesh: MeshArrays) -> _Part:
    """Raises ValueError for a mesh that is too large."""
    from .cpu import extent  # here, so that programs compile where there are no kernels

    box = extent(mesh.positions)
    corners, faces = _triangles_of(mesh, box)
    vertices = mesh.corner_vertices.reshape(-1, 3) if corners is None else mesh.corner_vertices[corners]
    if max(len(mesh.positions), len(vertices)) >= MOST_IN_A_MESH:
        raise ValueError(f"a mesh has more than {MOST_IN_A_MESH} vertices or triangles")
    order = slots = None
    if mesh.face_slots is not None:
        slots = np.maximum(mesh.face_slots if faces is None else mesh.face_slots[faces], 0)
        order = np.argsort(slots, kind="stable")
        corners = order[:, None] * 3 + np.arange(3) if corners is None else corners[order]
        vertices, slots = vertices[order], slots[order]
    low, high = _extent(mesh.positions, vertices, box)
    centre = (0.5 * low + 0.5 * high).astype(np.float32).astype(np.float64)
    return _Part(mesh, corners, vertices, slots, centre, low, high, order)


def _extent(
    positions: np.ndarray, vertices: np.ndarray, box: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corner, float64, of a box around all triangles; `box` is that of all positions. Vertices
    that none uses count as long as they hardly matter: to tell them takes longer than all else here."""
    if not len(vertices):
        return np.zeros(3), np.zeros(3)
    from .cpu import extent

    low, high = box
    some_low, some_high = extent(positions[vertices[:: 1 + len(vertices) // 4096].reshape(-1)])
    if not (np.isfinite(high - low).all() and (high - low <= 2.0 * (some_high - some_low)).all()):
        is_used = np.zeros(len(positions), bool)
        is_used[vertices] = True
        low, high = extent(positions[is_used])
    return low, high


def _triangles_of(
    mesh: MeshArrays, box: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Corners (T, 3) and faces (T,) of triangles; None where the faces are triangles throughout."""
    from .cpu import triangulate

    starts = mesh.face_starts
    # A face with a vertex that is not finite is for the kernels to drop.
    if np.isfinite(box[0]).all() and np.array_equal(
        starts, np.arange(0, 3 * len(starts), 3, dtype=starts.dtype)
    ):
        return None, None
    return triangulate(mesh)


def _places_of(parts: list[_Part]) -> list[MeshPlace]:
    places, vertex, triangle = [], 0, 0
    for part in parts:
        places.append(
            MeshPlace(part.centre, part.low, part.high, vertex, triangle, _slot_ranges(part, triangle))
        )
        vertex += part.shape[0]
        triangle += part.shape[1]
    return places


def _slot_ranges(part: _Part, first_triangle: int) -> tuple[tuple[int, int, int], ...]:
    """Slot, first triangle and count of each slot in use."""
    if part.slots is None:
        return ((0, first_triangle, len(part.vertices)),) if len(part.vertices) else ()
    found, starts, counts = np.unique(part.slots, return_index=True, return_counts=True)
    parts = zip(found.tolist(), starts.tolist(), counts.tolist(), strict=True)
    return tuple((slot, first_triangle + start, count) for slot, start, count in parts)
