"""Meshes and instances on the GPU, as tables that shaders pull vertices from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.arrays import Arrays, Cutout, MeshArrays
from ..core.outline import Outline
from ..core.view import View
from .gpu_image import GpuImage

BLOCK = 64  # triangles; a draw list names the run of each block's first triangle (pull.glsl)
HALF = 1 << 16  # integers travel as two halves, since a float32 is exact only below 2^24
MOST_IN_A_MESH = 1 << 24


def halves(values) -> np.ndarray:
    """(..., 2) float32: the high and the low 16 bits."""
    bits = np.asarray(values, np.int64) & 0xFFFFFFFF
    return np.stack([bits // HALF, bits % HALF], axis=-1).astype(np.float32)


@dataclass(frozen=True)
class Range:
    """Triangles `first` to `first + count` of a draw list; `material` has an alpha texture to look up, or
    is None where every fragment is there."""

    first: int
    count: int
    material: int | None


@dataclass(eq=False)
class DrawList:
    """Which triangles to draw, in the order of the instances, those to be alpha tested last.

    A run is one instance's triangles of one material: two texels of `runs`, then a last one that only
    starts where the triangles end. `blocks` holds the run of every BLOCK-th triangle.
    """

    runs: GpuImage
    blocks: GpuImage
    ranges: tuple[Range, ...]


@dataclass(frozen=True)
class _Mesh:
    """Where a mesh lies in the tables. `slots`: first triangle and count of each material slot in use."""

    centre: np.ndarray
    low: np.ndarray
    high: np.ndarray
    first_vertex: int
    slots: tuple[tuple[int, int, int], ...]


class GpuGeometry:
    """The scene's tables: positions and triangles at once, normals, uvs and alpha when first asked for.

    Positions are stored relative to the middle of their mesh's box, which the matrices put back in float64:
    float32 products then lose the fewest digits.
    """

    def __init__(self, device, outline: Outline, arrays: Arrays):
        self._device = device
        self._instances = outline.instances
        self._matrices = np.asarray(arrays.matrices, np.float64).reshape(-1, 4, 4)
        self._cutouts = arrays.cutouts
        self._sources: list[tuple[MeshArrays, np.ndarray]] = []
        self._meshes: list[_Mesh] = []
        self._tables: dict[str, Any] = {}
        self._lists: dict[frozenset[int], DrawList] = {}
        self._build(arrays.meshes)

    def _build(self, meshes: tuple[MeshArrays, ...]) -> None:
        from .cpu import triangulate  # here, so that programs compile where there are no kernels

        positions, triangles = [np.zeros((0, 4), np.float32)], [np.zeros((0, 4), np.float32)]
        vertex_count = triangle_count = 0
        for mesh in meshes:
            corners, faces = triangulate(mesh)
            if max(len(mesh.positions), len(corners)) >= MOST_IN_A_MESH:
                raise ValueError(f"a mesh has more than {MOST_IN_A_MESH} vertices or triangles")
            slots = np.zeros(len(faces), np.int64)
            if mesh.face_slots is not None:
                slots = np.maximum(mesh.face_slots[faces].astype(np.int64), 0)
            order = np.argsort(slots, kind="stable")
            corners, slots = corners[order], slots[order]
            vertices = mesh.corner_vertices[corners]
            used = mesh.positions[np.unique(vertices)].astype(np.float64)
            low = used.min(axis=0) if len(used) else np.zeros(3)
            high = used.max(axis=0) if len(used) else np.zeros(3)
            centre = (0.5 * low + 0.5 * high).astype(np.float32).astype(np.float64)
            local = np.zeros((len(mesh.positions), 4), np.float32)
            with np.errstate(invalid="ignore", over="ignore"):
                local[:, :3] = mesh.positions - centre
            positions.append(local)
            triangles.append(np.concatenate([vertices, order[:, None]], axis=1).astype(np.float32))
            self._meshes.append(_Mesh(centre, low, high, vertex_count, _slot_ranges(slots, triangle_count)))
            self._sources.append((mesh, corners))
            vertex_count += len(local)
            triangle_count += len(corners)
        self._tables["positions"] = self._device.upload_table(np.concatenate(positions))
        self._tables["triangles"] = self._device.upload_table(np.concatenate(triangles))

    @property
    def positions(self) -> GpuImage:
        """A row a vertex: x, y, z relative to its mesh's middle, 0."""
        return self._tables["positions"]

    @property
    def triangles(self) -> GpuImage:
        """A row a triangle: its vertices, counted in its mesh, and its number in its mesh."""
        return self._tables["triangles"]

    @property
    def corner_normals(self) -> GpuImage:
        """Three rows a triangle: unit shading normals in object space, zero for a flat mesh."""
        return self._corner_table("corner_normals", 4)

    @property
    def corner_uvs(self) -> GpuImage:
        """Three rows a triangle; zero where the mesh has none."""
        return self._corner_table("corner_uvs", 2)

    def _corner_table(self, name: str, channels: int) -> GpuImage:
        if name not in self._tables:
            parts = [np.zeros((0, channels), np.float32)]
            for mesh, corners in self._sources:
                rows = np.zeros((corners.size, channels), np.float32)
                values = getattr(mesh, name)
                if values is not None:
                    rows[:, : values.shape[1]] = values[corners.reshape(-1)]
                parts.append(rows)
            self._tables[name] = self._device.upload_table(np.concatenate(parts))
        return self._tables[name]

    def alpha(self, material: int) -> tuple[GpuImage, float]:
        """Alpha texels of a material that `Range.material` names, and its threshold."""
        name, cutout = f"alpha {material}", self._cutouts[material]
        if name not in self._tables:
            self._tables[name] = self._device.upload(np.asarray(cutout.texels, np.float32))
        return self._tables[name], cutout.threshold

    def draw_list(self, instances: frozenset[int]) -> DrawList:
        """What to draw of `instances`; kept, since many views draw the same."""
        if instances not in self._lists:
            self._lists[instances] = self._list(sorted(instances))
        return self._lists[instances]

    def _list(self, instances: list[int]) -> DrawList:
        opaque, tested = [], {}
        for index in instances:
            instance = self._instances[index]
            mesh = self._meshes[instance.mesh]
            for slot, first, count in mesh.slots:
                material = instance.materials[min(slot, len(instance.materials) - 1)]
                run = (index, material, first, mesh.first_vertex, count)
                kind = _alpha_kind(self._cutouts[material])
                if kind == "opaque":
                    opaque.append(run)
                elif kind == "tested":
                    tested.setdefault(material, []).append(run)
        ranges, runs, start = [], [], 0
        for material, group in [(None, opaque), *sorted(tested.items())]:
            count = sum(run[4] for run in group)
            if count:
                ranges.append(Range(start, count, material))
                runs += group
                start += count
        table = np.array([*runs, (0, 0, 0, 0, 0)], np.int64)
        starts = np.concatenate([[0], np.cumsum(table[:-1, 4])])
        first = np.concatenate([halves(starts), table[:, :2].astype(np.float32)], axis=1)
        second = np.concatenate([halves(table[:, 2]), halves(table[:, 3])], axis=1)
        texels = np.stack([first, second], axis=1).reshape(-1, 4)
        blocks = np.searchsorted(starts, np.arange(0, max(start, 1), BLOCK), side="right") - 1
        return DrawList(
            self._device.upload_table(texels),
            self._device.upload_table(blocks[:, None].astype(np.float32)),
            tuple(ranges),
        )

    def depth_bounds(self, view: View, instances: frozenset[int]) -> tuple[float, float]:
        """Smallest and largest depth of the instances' boxes, metres along the view's forward axis."""
        low, high = np.inf, -np.inf
        index = [i for i in sorted(instances) if self._meshes[self._instances[i].mesh].slots]
        if index:
            boxes = np.array([_box_corners(self._meshes[self._instances[i].mesh]) for i in index])
            matrices = self._matrices[index]
            points = np.einsum("nij,nkj->nki", matrices[:, :3, :3], boxes) + matrices[:, None, :3, 3]
            depths = (points - np.array(view.eye)) @ np.array(view.forward)
            depths = depths[np.isfinite(depths)]
            if len(depths):
                low, high = float(depths.min()), float(depths.max())
        return low, high

    def clip_matrices(self, view: View, rows: tuple[int, int], size, jitter=(0.0, 0.0)) -> GpuImage:
        """Three texels an instance: rows x, y (clip space) and depth (metres) of object to view, for image
        rows `rows` of `size` pixels. Composed in float64."""
        to_view = self._to_eye(view, np.array([view.right, view.up, view.forward]))
        window = _window_of_rows(view, rows, size)
        pixels = size[0], rows[1] - rows[0]
        clip = to_view.copy()
        for axis in (0, 1):
            low, high = window[2 * axis], window[2 * axis + 1]
            middle = (high + low) / (high - low) + 2.0 * jitter[axis] / pixels[axis]
            clip[:, axis] = 2.0 / (high - low) * to_view[:, axis]
            if view.orthographic:
                clip[:, axis, 3] -= middle
            else:
                clip[:, axis] -= middle * to_view[:, 2]
        return self._device.upload_table(_float32(clip).reshape(-1, 4))

    def eye_matrices(self, view: View) -> GpuImage:
        """Six texels an instance: rows of object to world axes relative to the eye; then the rows of its
        cofactors, which turn normals (scaled, since only their direction counts), with beside them -1 where
        the matrix mirrors and else 1, and the object id in halves."""
        to_eye = self._to_eye(view, np.eye(3))
        linear = to_eye[:, :, :3]
        a, b, c = linear[:, 0], linear[:, 1], linear[:, 2]
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        mirrored = np.where((linear[:, 0] * cofactors[:, 0]).sum(-1) < 0.0, -1.0, 1.0)
        largest = np.abs(cofactors).max(axis=(1, 2), initial=0.0)
        cofactors /= np.where(largest > 0.0, largest, 1.0)[:, None, None]
        ids = halves([instance.object_id for instance in self._instances]).reshape(-1, 2)
        beside = np.concatenate([mirrored[:, None], ids], axis=1)
        texels = np.concatenate([to_eye, np.concatenate([cofactors, beside[:, :, None]], axis=2)], axis=1)
        return self._device.upload_table(_float32(texels).reshape(-1, 4))

    def _to_eye(self, view: View, axes: np.ndarray) -> np.ndarray:
        """(N, 3, 4) float64: a mesh's positions about its middle, to `axes` relative to the eye."""
        linear = self._matrices[:, :3, :3]
        centres = np.array([self._meshes[i.mesh].centre for i in self._instances]).reshape(-1, 3)
        moved = np.einsum("nij,nj->ni", linear, centres) + (self._matrices[:, :3, 3] - np.array(view.eye))
        return np.concatenate([axes @ linear, (moved @ axes.T)[:, :, None]], axis=2)

    def release(self) -> None:
        """Frees the textures."""
        lists = [item for drawn in self._lists.values() for item in (drawn.runs, drawn.blocks)]
        self._device.release([*self._tables.values(), *lists])
        self._tables.clear()
        self._lists.clear()


def _slot_ranges(slots: np.ndarray, first_triangle: int) -> tuple[tuple[int, int, int], ...]:
    """Slot, first triangle and count, of sorted `slots`."""
    found, starts, counts = np.unique(slots, return_index=True, return_counts=True)
    parts = zip(found.tolist(), starts.tolist(), counts.tolist(), strict=True)
    return tuple((slot, first_triangle + start, count) for slot, start, count in parts)


def _alpha_kind(cutout: Cutout) -> str:
    """As kernels/src/geometry.rs `Cutout`."""
    if cutout.threshold <= 0.0:
        return "opaque"
    if cutout.texels is not None and cutout.texels.size:
        return "tested"
    return "opaque" if cutout.alpha >= cutout.threshold else "absent"


def _box_corners(mesh: _Mesh) -> np.ndarray:
    """(8, 3) corners of the mesh's box."""
    corners = np.stack([mesh.low, mesh.high])
    return np.array([[corners[i >> k & 1, k] for k in range(3)] for i in range(8)])


def _window_of_rows(view: View, rows: tuple[int, int], size: tuple[int, int]) -> tuple[float, ...]:
    left, right, bottom, top = view.window
    step = (top - bottom) / size[1]
    return left, right, bottom + rows[0] * step, bottom + rows[1] * step


def _float32(values: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore", invalid="ignore"):
        return values.astype(np.float32)
