"""Meshes and instances on the GPU, as tables that shaders pull vertices from."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Arrays, OpacityArrays, Placed
from ..core.view import View
from .gpu_image import GpuImage
from .gpu_meshes import GpuMeshes, MeshPlace

BLOCK = 64  # triangles; a draw list names the run of each block's first triangle (pull.glsl)
HALF = 1 << 16  # integers travel as two halves, since a float32 is exact only below 2^24


def halves(values) -> np.ndarray:
    """(..., 2) float32: the high and the low 16 bits."""
    bits = np.asarray(values, np.int64) & 0xFFFFFFFF
    return np.stack([bits // HALF, bits % HALF], axis=-1).astype(np.float32)


@dataclass(frozen=True)
class Range:
    """Triangles `first` to `first + count` of a draw list; of `material` each fragment's opacity is to be
    looked up, None: every fragment is there."""

    first: int
    count: int
    material: int | None


@dataclass(eq=False)
class DrawList:
    """Which triangles to draw, in the order of the instances, since of equal depths the first one drawn is
    kept. Those whose opacity is looked up come last, to change programs seldom; but before everything come,
    in their own order, the instances that stand at one place, where alone depths of different instances are
    equal.

    A run is one instance's triangles of one material: two texels of `runs`, then a last one that only
    starts where the triangles end. `blocks` holds the run of every BLOCK-th triangle. `use`: which of the
    materials' opacities count, what is "seen" or what "casts".
    """

    runs: GpuImage
    blocks: GpuImage
    ranges: tuple[Range, ...]
    use: str


class GpuGeometry:
    """A scene's instances, and the tables of their meshes (GpuMeshes), which the next scene may share."""

    def __init__(self, device, instances: Sequence[Placed], arrays: Arrays, meshes: GpuMeshes):
        self._device = device
        self._instances = instances
        self._tables_of_meshes = meshes
        self._meshes = meshes.places
        self._mesh_of = np.array([instance.mesh for instance in instances], int)
        self._boxes = _box_corners(meshes.places)
        self._matrices = np.asarray(arrays.matrices, np.float64).reshape(-1, 4, 4)
        self._opacities = arrays.opacities
        self._texels: dict[OpacityArrays, GpuImage] = {}
        self._lists: dict[tuple[frozenset[int], str, str], DrawList] = {}

    @property
    def instance_count(self) -> int:
        return len(self._instances)

    @property
    def positions(self) -> GpuImage:
        """See GpuMeshes, as the five below."""
        return self._tables_of_meshes.table("positions")

    @property
    def triangles(self) -> GpuImage:
        return self._tables_of_meshes.table("triangles")

    @property
    def corner_normals(self) -> GpuImage:
        return self._tables_of_meshes.table("corner_normals")

    @property
    def corner_uvs(self) -> GpuImage:
        return self._tables_of_meshes.table("corner_uvs")

    @property
    def corner_opacity(self) -> GpuImage:
        return self._tables_of_meshes.table("corner_opacity")

    @property
    def corner_colours(self) -> GpuImage:
        return self._tables_of_meshes.table("corner_colours")

    def opacities(self, material: int, use: str) -> list[tuple[GpuImage, OpacityArrays]]:
        """Front and back of a material that `Range.material` names, with their texels, one where it is a
        constant."""
        return [(self._texels_of(opacity), opacity) for opacity in getattr(self._opacities[material], use)]

    def _texels_of(self, opacity: OpacityArrays) -> GpuImage:
        if opacity not in self._texels:
            texels = [[opacity.value]] if _is_constant(opacity) else opacity.texels
            self._texels[opacity] = self._device.upload(np.asarray(texels, np.float32))
        return self._texels[opacity]

    def draw_list(self, instances: frozenset[int], use: str, kept: str) -> DrawList:
        """What to draw of `instances`, by what they are to `use`, of which "whole", "partial" or "drawn" is
        kept (raster/presence.rs); kept itself, since many views draw the same."""
        key = instances, use, kept
        if key not in self._lists:
            self._lists[key] = self._list(sorted(instances), use, kept)
        return self._lists[key]

    def _list(self, instances: list[int], use: str, kept: str) -> DrawList:
        presences = [_presence(getattr(each, use), kept) for each in self._opacities]
        at_one_place = self._at_one_place(instances)
        found = []  # what to sort by, the material whose opacity to look up or None, and a run
        for index in instances:
            instance = self._instances[index]
            mesh = self._meshes[instance.mesh]
            for slot, first, count in mesh.slots:
                material = instance.materials[min(slot, len(instance.materials) - 1)]
                run = (index, material, first, mesh.first_vertex, count)
                tested = material if presences[material] is None else None
                last = -1 if tested is None else material
                if presences[material] is not False and count:
                    found.append(((0, 0) if index in at_one_place else (1, last), tested, run))
        found.sort(key=lambda each: each[0])
        ranges, runs, start = [], [], 0
        for material, group in itertools.groupby(found, key=lambda each: each[1]):
            some = [run for _, _, run in group]
            count = sum(run[4] for run in some)
            ranges.append(Range(start, count, material))
            runs += some
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
            use,
        )

    def _at_one_place(self, instances: list[int]) -> set[int]:
        """Those that share their matrix and their mesh's box with another one."""

        def place(index: int):
            mesh = self._meshes[self._instances[index].mesh]
            return self._matrices[index].tobytes(), mesh.low.tobytes(), mesh.high.tobytes()

        places = {index: place(index) for index in instances}
        count = Counter(places.values())
        return {index for index, place in places.items() if count[place] > 1}

    def depth_bounds(self, view: View, instances: frozenset[int]) -> tuple[float, float]:
        """Smallest and largest depth of the instances' boxes, metres along the view's forward axis."""
        index = np.array([i for i in sorted(instances) if self._meshes[self._instances[i].mesh].slots], int)
        boxes = self._boxes[self._mesh_of[index]]
        matrices = self._matrices[index]
        points = np.einsum("nij,nkj->nki", matrices[:, :3, :3], boxes) + matrices[:, None, :3, 3]
        depths = (points - np.array(view.eye)) @ np.array(view.forward)
        depths = depths[np.isfinite(depths)]
        return float(depths.min(initial=np.inf)), float(depths.max(initial=-np.inf))

    def clip_matrices(
        self,
        view: View,
        rows: tuple[int, int],
        size,
        jitter=(0.0, 0.0),
        columns: tuple[int, int] | None = None,
    ) -> GpuImage:
        """Three texels an instance: rows x, y (clip space) and depth (metres) of object to view, for image
        rows `rows` and `columns` (None: all) of `size` pixels. Composed in float64."""
        to_view = self._to_eye(view, np.array([view.right, view.up, view.forward]))
        columns = columns or (0, size[0])
        window = _window_of(view, columns, rows, size)
        pixels = columns[1] - columns[0], rows[1] - rows[0]
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
        centres = np.array([mesh.centre for mesh in self._meshes]).reshape(-1, 3)[self._mesh_of]
        moved = np.einsum("nij,nj->ni", linear, centres) + (self._matrices[:, :3, 3] - np.array(view.eye))
        return np.concatenate([axes @ linear, (moved @ axes.T)[:, :, None]], axis=2)

    def release(self) -> None:
        """Frees the textures that are its own."""
        lists = [item for drawn in self._lists.values() for item in (drawn.runs, drawn.blocks)]
        self._device.release([*self._texels.values(), *lists])
        self._texels.clear()
        self._lists.clear()


NEARLY = 1.0 / 512.0
"""As in kernels/src/raster/presence.rs."""


def _is_constant(opacity: OpacityArrays) -> bool:
    return opacity.texels is None or not opacity.texels.size


def _presence(sides: tuple[OpacityArrays, OpacityArrays], kept: str) -> bool | None:
    """Whether fragments of a material are there, None where each has to be looked at: as `Rule::presence`
    there."""
    front, back = (_presence_of(side, kept) for side in sides)
    return front if front == back else None


def _presence_of(opacity: OpacityArrays, kept: str) -> bool | None:
    is_clip = opacity.threshold > 0.0
    if kept == "partial" and is_clip:
        return False
    if opacity.by_corner or not _is_constant(opacity):
        return None
    value = float(opacity.value >= opacity.threshold) if is_clip else opacity.value
    if kept == "drawn":
        return None if 0.0 < value < 1.0 else value > 0.0
    is_whole = value >= 1.0 - NEARLY
    return is_whole if kept == "whole" else value > NEARLY and not is_whole


def _box_corners(meshes: list[MeshPlace]) -> np.ndarray:
    """(meshes, 8, 3) corners of the meshes' boxes."""
    sides = np.array([(mesh.low, mesh.high) for mesh in meshes]).reshape(-1, 2, 3)
    return np.stack([sides[:, [i & 1, i >> 1 & 1, i >> 2], [0, 1, 2]] for i in range(8)], axis=1)


def _window_of(
    view: View, columns: tuple[int, int], rows: tuple[int, int], size: tuple[int, int]
) -> tuple[float, ...]:
    left, right, bottom, top = view.window
    across, along = (right - left) / size[0], (top - bottom) / size[1]
    if columns != (0, size[0]):  # to the last bit where all are wanted
        left, right = left + columns[0] * across, left + columns[1] * across
    return left, right, bottom + rows[0] * along, bottom + rows[1] * along


def _float32(values: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore", invalid="ignore"):
        return values.astype(np.float32)
