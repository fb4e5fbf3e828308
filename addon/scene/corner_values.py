"""What the corners of a mesh's faces carry: factors of opacity and of colours, coordinates of pictures."""

from __future__ import annotations

import bpy
import numpy as np

from ..core.arrays import MeshArrays
from .attributes import numbers_of
from .made_mesh import MadeMesh
from .nodes.baked import BAKED_MAP
from .nodes.pictures import IDENTITY, Placement
from .nodes.values import Attribute, Value


def corner_opacity(
    source: bpy.types.Mesh | MadeMesh,
    mesh: MeshArrays,
    values: list[Value | None],
    owner: str,
    warnings: list[str],
) -> np.ndarray | None:
    """(C,) float32 from 0 to 1 of the evaluated or made mesh `source`: of each face's material what the
    expression over attributes in `values` is there, 1 where that is None; None without faces. Attributes that
    the mesh lacks count as 0, as in Cycles, with a warning."""
    return _factors(source, mesh, values, (), 1.0, owner, warnings)


MOST_COLOUR = 1e30
"""What a factor of a colour may be: products of it stay finite."""


def corner_colours(
    source: bpy.types.Mesh | MadeMesh,
    mesh: MeshArrays,
    values: list[Value | None],
    owner: str,
    warnings: list[str],
) -> np.ndarray | None:
    """The same of colours: (C, 3) float32 from 0 on."""
    return _factors(source, mesh, values, (3,), MOST_COLOUR, owner, warnings)


def _factors(
    source, mesh: MeshArrays, values, shape: tuple[int, ...], most: float, owner, warnings
) -> np.ndarray | None:
    """(C, *shape) ones, with the numbers from 0 to `most` of the expressions in their slots."""
    if not len(mesh.corner_vertices):
        return None
    found = np.ones((len(mesh.corner_vertices), *shape), np.float32)
    of_corner = corner_slots(mesh, len(values))
    corners = (Corners if isinstance(source, bpy.types.Mesh) else MadeCorners)(source, mesh)
    for key in sorted({value.key for value in values if value is not None}):
        slots = [slot for slot, value in enumerate(values) if value is not None and value.key == key]
        numbers = np.broadcast_to(values[slots[0]].at(corners), found.shape)
        numbers = np.clip(np.nan_to_num(numbers, posinf=most, neginf=0.0), 0.0, most)
        chosen = np.isin(of_corner, slots)
        found[chosen] = numbers[chosen]
    for name in sorted(corners.missing):
        warnings.append(f"object '{owner}': it has no {name}, which counts as 0")
    return found


def corner_slots(mesh: MeshArrays, count: int) -> np.ndarray:
    """(C,) the slot of each corner's face, of `count` that there are."""
    if mesh.face_slots is None:
        return np.zeros(len(mesh.corner_vertices), np.int64)
    return np.repeat(np.clip(mesh.face_slots, 0, count - 1), np.diff(mesh.face_starts))


class Corners:
    """Where expressions over attributes are evaluated."""

    def __init__(self, source: bpy.types.Mesh | MadeMesh, mesh: MeshArrays):
        self._source, self._mesh = source, mesh
        self.missing: set[str] = set()

    def source(self, source: Attribute) -> np.ndarray:
        """By Cycles' kernel/svm/attribute.h."""
        read = self._read(source.name)
        count, is_many = len(self._mesh.corner_vertices), source.output in {"Color", "Vector"}
        if read is None:
            self.missing.add(f"attribute '{source.name}'" if source.name else "colour attribute")
            return np.zeros((count, 3) if is_many else count)
        width = read.shape[1]
        if source.output == "Alpha":
            return read[:, 3] if width == 4 else np.ones(count)
        if is_many:
            if width == 1:
                return np.repeat(read, 3, axis=1)
            return np.pad(read, ((0, 0), (0, 1))) if width == 2 else read[:, :3]
        return read[:, 0] if width <= 2 else read[:, :3].mean(axis=1)

    def look_up(self, texture, coordinates):
        raise LookupError(texture)

    def _read(self, name: str) -> np.ndarray | None:
        """(C, 1 to 4) float64."""
        name = name or self._source.color_attributes.default_color_name
        attribute = self._source.attributes.get(name)
        values = numbers_of(attribute)
        if values is None:
            return None
        if attribute.domain == "POINT":
            return values[self._mesh.corner_vertices]
        if attribute.domain == "FACE":
            return np.repeat(values, np.diff(self._mesh.face_starts), axis=0)
        return values if attribute.domain == "CORNER" else None


class MadeCorners(Corners):
    """The same of a mesh that is made of curves or points."""

    def _read(self, name: str) -> np.ndarray | None:
        return self._source.attribute(name, self._mesh.corner_vertices) if name else None


def placed_uvs(
    source: bpy.types.Mesh,
    mesh: MeshArrays,
    placements: list[Placement],
    owner: str,
    warnings: list[str],
    baked: np.ndarray | None = None,
) -> np.ndarray | None:
    """(C, 2) float32: each corner's coordinates of the pictures of its face's material, of the `placements`
    of the slots. None for a mesh without the UV maps; a map that it lacks is told, the one for rendering is
    taken instead. `baked` are those where Blender bakes."""
    render = next((layer for layer in source.uv_layers if layer.active_render), None)
    maps: dict[str, np.ndarray] = {} if baked is None else {BAKED_MAP: baked}
    count = len(mesh.corner_vertices)
    if render is None and baked is None:
        return None

    def map_of(name: str) -> np.ndarray:
        if render is None:
            warnings.append(f"object '{owner}': it has no UV map, its textures are read at one point")
            return np.zeros((count, 2), np.float32)
        layer = source.uv_layers.get(name) if name else render
        if layer is None:
            warnings.append(f"object '{owner}': it has no UV map '{name}', its UV map for rendering is read")
            layer = render
        flat = np.empty(2 * count, np.float32)
        layer.uv.foreach_get("vector", flat)
        uvs = flat.reshape(count, 2)
        with np.errstate(over="ignore", invalid="ignore"):
            is_finite = bool(np.isfinite(np.dot(flat, flat)))
        if not is_finite:
            warnings.append(f"object '{owner}': some texture coordinates are not finite, they count as 0")
            np.nan_to_num(uvs, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        return uvs

    different = list(dict.fromkeys(placements)) or [Placement()]
    for placement in different:
        if placement.uv_map not in maps:
            maps[placement.uv_map] = map_of(placement.uv_map)
    if len(different) == 1:
        return moved_uvs(maps[different[0].uv_map], different[0])
    found = np.empty((count, 2), np.float32)
    of_corner = corner_slots(mesh, len(placements))
    for placement in different:
        chosen = np.isin(of_corner, [slot for slot, each in enumerate(placements) if each == placement])
        found[chosen] = moved_uvs(maps[placement.uv_map][chosen], placement)
    return found


def moved_uvs(uvs: np.ndarray, placement: Placement) -> np.ndarray:
    """Coordinates (C, 2) of a mesh, as those of pictures."""
    if placement.matrix == IDENTITY:
        return uvs
    matrix = np.array(placement.matrix, np.float64).reshape(2, 3)
    return (uvs @ matrix[:, :2].T + matrix[:, 2]).astype(np.float32)
