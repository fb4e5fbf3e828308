"""The arrays of a scene at one frame: what devices are fed with. Filled by `addon/scene/extract.py`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class MeshArrays:
    """A mesh in object space, as Blender stores it: polygons, and attributes of their corners.

    `positions` (V, 3) f32; `corner_vertices` (C,) i32; `face_starts` (F + 1,) i32, the first corner of each
    face and then C; `corner_normals` (C, 3) f32 unit, None for a flat mesh; `corner_uvs` (C, 2) f32 of the
    pictures of each face's material, None where nothing samples them; `face_slots` (F,) i32 material slots,
    None for slot 0 throughout; `corner_opacity` (C,) f32 factors of the opacity of the face's material
    (`OpacityArrays.by_corner`), None where no material has any; `corner_colours` (C, 3) f32 factors of its
    colours that are by corner, None likewise; `chart_uvs` (C, 2) f32 of the UV map for
    rendering, None where `corner_uvs` are; `vertex_values` (V,) f32 by the name of the vertex group or the
    attribute, of those that were asked for and that the mesh has.
    """

    positions: np.ndarray
    corner_vertices: np.ndarray
    face_starts: np.ndarray
    corner_normals: np.ndarray | None = None
    corner_uvs: np.ndarray | None = None
    face_slots: np.ndarray | None = None
    corner_opacity: np.ndarray | None = None
    corner_colours: np.ndarray | None = None
    chart_uvs: np.ndarray | None = None
    vertex_values: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """All that are there, by name."""
        found = {name: array for name, array in vars(self).items() if isinstance(array, np.ndarray)}
        return found | {f"vertex:{name}": values for name, values in self.vertex_values.items()}

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in self.arrays.values())


@dataclass(frozen=True, eq=False)
class OpacityArrays:
    """An Opacity of the outline: `texels` (H, W) f32, row 0 at the bottom, or None for `value` throughout;
    times the mesh's `corner_opacity` if `by_corner`."""

    value: float = 1.0
    texels: np.ndarray | None = None
    by_corner: bool = False
    threshold: float = 0.0


OPAQUE = OpacityArrays()


@dataclass(frozen=True, eq=False)
class Opacities:
    """Of a material, front and back: what cameras meet, and what shadow rays and maps meet. Equal ones are
    one object."""

    seen: tuple[OpacityArrays, OpacityArrays] = (OPAQUE, OPAQUE)
    casts: tuple[OpacityArrays, OpacityArrays] = (OPAQUE, OPAQUE)

    @classmethod
    def of(cls, opacity: OpacityArrays) -> Opacities:
        """The same on both sides and for both."""
        return cls((opacity, opacity), (opacity, opacity))


CLEAR = Opacities.of(OpacityArrays(0.0))
"""As though nothing were there."""


@dataclass(frozen=True)
class Placed:
    """One appearance of a mesh, as a geometry takes it; an outline's Instance is one too."""

    mesh: int
    object_id: int
    materials: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Arrays:
    """Indices are the outline's: `meshes[i]` belongs to `outline.meshes[i]`, row i of `matrices` (N, 4, 4)
    f64 object to world to `outline.instances[i]`, `opacities[i]` to `outline.materials[i]`, and `textures[i]`
    to `outline.images[i]`: (H, W) f32 or, for COLOR, (H, W, 4) f32 scene-linear and not premultiplied.

    A mesh that cannot be used has no faces; a texture that cannot be read, or was not wanted, is not in
    `textures`. `warnings` says so, one line each.
    """

    meshes: tuple[MeshArrays, ...]
    matrices: np.ndarray
    opacities: tuple[Opacities, ...]
    textures: dict[int, np.ndarray] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


def separate_triangles(corners: np.ndarray) -> MeshArrays:
    """A mesh of triangles (3 T, 3) float32 that share no vertices."""
    count = len(corners)
    starts = np.arange(0, count + 1, 3, dtype=np.int32)
    return MeshArrays(corners, np.arange(count, dtype=np.int32), starts)


def same_arrays(a: MeshArrays, b: MeshArrays) -> bool:
    """Whether two meshes have the same numbers."""
    first, second = a.arrays, b.arrays
    if first.keys() != second.keys():
        return False
    return all(x is second[name] or np.array_equal(x, second[name]) for name, x in first.items())


Pairs = Iterable[tuple[int, int]]
"""Indices of what may be the same, in new arrays and in old ones."""


def reusing(new: Arrays, old: Arrays, meshes: Pairs, textures: Pairs) -> Arrays:
    """`new` with the meshes and textures of `old` wherever they have the same numbers, and its opacities
    where these have the same texels, so that devices need not take them again."""
    kept_meshes = list(new.meshes)
    for mine, other in meshes:
        if same_arrays(kept_meshes[mine], old.meshes[other]):
            kept_meshes[mine] = old.meshes[other]
    kept = dict(new.textures)
    for mine, other in textures:
        before = old.textures.get(other)
        if mine in kept and before is not None:
            texels = kept[mine]
            kept[mine] = before if texels is before or np.array_equal(texels, before) else texels
    instead = {id(texels): kept[index] for index, texels in new.textures.items()}
    known = {_content(each): each for sides in old.opacities for each in (*sides.seen, *sides.casts)}

    def reused(opacity: OpacityArrays) -> OpacityArrays:
        opacity = replace(opacity, texels=instead.get(id(opacity.texels), opacity.texels))
        return known.setdefault(_content(opacity), opacity)

    opacities = tuple(
        Opacities(tuple(map(reused, sides.seen)), tuple(map(reused, sides.casts))) for sides in new.opacities
    )
    return replace(new, meshes=tuple(kept_meshes), opacities=opacities, textures=kept)


def _content(opacity: OpacityArrays) -> tuple:
    """The same for those with the same array of texels."""
    return opacity.value, id(opacity.texels), opacity.by_corner, opacity.threshold


def bytes_of(value: Any) -> int:
    """Of the arrays, and whatever else has `nbytes`, in nested dicts, tuples and lists."""
    if isinstance(value, dict):
        return sum(map(bytes_of, value.values()))
    if isinstance(value, (tuple, list)):
        return sum(map(bytes_of, value))
    return getattr(value, "nbytes", 0)
