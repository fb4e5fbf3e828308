"""The arrays behind an outline, and only those that somebody reads."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import bpy
import numpy as np

from ..core.arrays import OPAQUE, Arrays, MeshArrays, Opacities, OpacityArrays
from ..core.outline import Material, Opacity, Outline
from .corner_values import corner_opacity, moved_uvs, placed_uvs
from .made_mesh import MadeMesh
from .nodes.pictures import Placement
from .pixels import pixels_of
from .scan import Scan
from .vertex_values import vertex_values

# What a graph may ask for. Positions and polygons always come.
CORNER_NORMALS = "corner_normals"
UV = "uv"
OPACITY = "opacity"
BASE_COLOR = "base_color"
VERTEX = "vertex:"
"""With a name after it: the vertex group or the attribute of vertices of that name."""
WANTS = frozenset({CORNER_NORMALS, UV, OPACITY, BASE_COLOR})


def extract(scan: Scan, wants: Collection[str] = WANTS, instances: Collection[int] | None = None) -> Arrays:
    """Arrays of the meshes that `instances` (indices; None: all) show; other meshes stay empty. `wants` is a
    subset of `WANTS`: `CORNER_NORMALS` of smooth meshes, `UV` of meshes with a material that samples a
    texture, texels for `BASE_COLOR`, texels and factors of corners for `OPACITY`; and may have any `VERTEX`
    with a name."""
    outline = scan.outline
    warnings: list[str] = []
    owners = _owners(outline)
    textured = _textured_meshes(outline, wants) if UV in wants else frozenset()
    read = range(len(outline.instances)) if instances is None else instances
    shown = {outline.instances[index].mesh for index in read}
    meshes = tuple(
        _mesh_arrays(source, CORNER_NORMALS in wants, index in textured, owners[index], warnings)
        if index in shown
        else _no_faces()
        for index, source in enumerate(scan.mesh_sources)
    )
    slots = _slots(outline)
    meshes = tuple(
        _with_uvs(outline, scan.mesh_sources[index], mesh, slots[index], wants, owners[index], warnings)
        if index in textured and index in shown
        else mesh
        for index, mesh in enumerate(meshes)
    )
    names = sorted(want.removeprefix(VERTEX) for want in wants if want.startswith(VERTEX))
    if names:
        meshes = tuple(
            replace(mesh, vertex_values=_values(source, owners[index], names)) if index in shown else mesh
            for index, (mesh, source) in enumerate(zip(meshes, scan.mesh_sources, strict=True))
        )
    if OPACITY in wants:
        meshes = tuple(
            _with_corner_opacity(scan, index, mesh, slots[index], owners[index], warnings)
            if index in shown
            else mesh
            for index, mesh in enumerate(meshes)
        )
    textures = _textures(scan, wants, warnings)
    matrices = np.array([instance.matrix for instance in outline.instances], np.float64).reshape(-1, 4, 4)
    return Arrays(meshes, matrices, _opacities(outline, textures), textures, tuple(warnings))


def _values(mesh: bpy.types.Mesh | MadeMesh, owner: str, names: list[str]) -> dict[str, np.ndarray]:
    if not isinstance(mesh, bpy.types.Mesh):
        return {}
    found = {name: vertex_values(mesh, owner, name) for name in names}
    return {name: values for name, values in found.items() if values is not None}


def _owners(outline: Outline) -> list[str]:
    """Name of the first object that shows each mesh."""
    owners = [mesh.name for mesh in outline.meshes]
    for instance in reversed(outline.instances):
        owners[instance.mesh] = instance.name
    return owners


def _textured_meshes(outline: Outline, wants: Collection[str]) -> frozenset[int]:
    sampling = {index for index, material in enumerate(outline.materials) if _images_of(material, wants)}
    return frozenset(i.mesh for i in outline.instances if not sampling.isdisjoint(i.materials))


def _sums_up(values: np.ndarray) -> bool:
    """One pass over the numbers; only a suspicious sum is to be looked at closer."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(np.dot(values.ravel(), values.ravel())))


def _mesh_arrays(
    mesh: bpy.types.Mesh | MadeMesh, want_normals: bool, want_uv: bool, owner: str, warnings: list[str]
) -> MeshArrays:
    """Corners are read by `attributes[...]`: `loops` goes element by element, a hundred times as long. UVs
    only of what Strata makes; else see `placed_uvs`."""
    if not isinstance(mesh, bpy.types.Mesh):
        return mesh.arrays(want_normals, want_uv)
    corner_count = len(mesh.loops)
    positions = _read(mesh.attributes["position"].data, "vector", np.float32, len(mesh.vertices), 3)
    if not _sums_up(positions):
        bad = ~np.isfinite(positions).all(axis=1)
        if bad.all():
            warnings.append(f"object '{owner}' is left out: none of its vertices is finite")
            return _no_faces()
        if bad.any():
            count = f"{int(bad.sum())} of {len(bad)}"
            warnings.append(f"object '{owner}': faces are left out, {count} vertices are not finite")
    corner_vertices = _read(mesh.attributes[".corner_vert"].data, "value", np.int32, corner_count)
    normals = None
    if want_normals and mesh.normals_domain != "FACE":
        normals = _corner_normals(mesh, corner_count)
    slots = mesh.attributes.get("material_index")
    if slots is not None and (slots.domain != "FACE" or slots.data_type != "INT"):
        slots = None
    face_slots = None if slots is None else _read(slots.data, "value", np.int32, len(mesh.polygons))
    return MeshArrays(positions, corner_vertices, _face_starts(mesh), normals, None, face_slots)


def _read(elements, name: str, dtype, count: int, width: int | None = None) -> np.ndarray:
    flat = np.empty(count * (width or 1), dtype)
    elements.foreach_get(name, flat)
    return flat if width is None else flat.reshape(count, width)


def _face_starts(mesh: bpy.types.Mesh) -> np.ndarray:
    """(F + 1,) i32. Blender keeps this very array, but shows it face by face only."""
    face_count, corner_count = len(mesh.polygons), len(mesh.loops)
    # No face has fewer than three corners, so this many corners means triangles throughout.
    if corner_count == 3 * face_count:
        return np.arange(0, corner_count + 1, 3, dtype=np.int32)
    starts = np.empty(face_count + 1, np.int32)
    mesh.polygons.foreach_get("loop_start", starts[:-1])
    starts[-1] = corner_count
    return starts


def _corner_normals(mesh: bpy.types.Mesh, corner_count: int) -> np.ndarray:
    """(C, 3) f32. Normals that are not finite, at a broken corner, become zero: no normal."""
    normals = _read(mesh.corner_normals, "vector", np.float32, corner_count, 3)
    if not _sums_up(normals):
        np.nan_to_num(normals, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
    return normals


def _no_faces() -> MeshArrays:
    return MeshArrays(np.zeros((0, 3), np.float32), np.zeros(0, np.int32), np.zeros(1, np.int32))


def _textures(scan: Scan, wants: Collection[str], warnings: list[str]) -> dict[int, np.ndarray]:
    outline = scan.outline
    wanted: dict[int, str] = {}
    for material in outline.materials:
        for image in _images_of(material, wants):
            wanted.setdefault(image, material.name)
    loaded: dict[int, np.ndarray | None] = {}

    def load(image: bpy.types.Image) -> np.ndarray | None:
        if image.session_uid not in loaded:
            loaded[image.session_uid] = pixels_of(image)
        return loaded[image.session_uid]

    textures = {}
    for index, material_name in sorted(wanted.items()):
        texels, told = scan.image_sources[index].texels(load)
        if texels is not None:
            textures[index] = texels
        warnings.extend(f"material '{material_name}': {warning}" for warning in told)
    return textures


def _opacities(outline: Outline, textures: dict[int, np.ndarray]) -> tuple[Opacities, ...]:
    made: dict[Opacity, OpacityArrays] = {Opacity(): OPAQUE}

    def arrays_of(opacity: Opacity) -> OpacityArrays:
        if opacity not in made:
            # Without its image it is as its constant says.
            texels = None if opacity.image is None else textures.get(opacity.image)
            by_corner, threshold = bool(opacity.corners), opacity.threshold
            if texels is not None and not by_corner and threshold <= 0.0 and _is_cutout(texels):
                threshold = 0.5
            made[opacity] = OpacityArrays(opacity.value, texels, by_corner, threshold)
        return made[opacity]

    return tuple(
        Opacities(tuple(map(arrays_of, material.seen)), tuple(map(arrays_of, material.casts)))
        for material in outline.materials
    )


def _is_cutout(texels: np.ndarray) -> bool:
    """Whether all are 0 or 1: then what is between is only how they are sampled, and half of it is an edge
    where that of the picture is. Leaves are so, and maps know all there is to know of them."""
    return bool(((texels == 0.0) | (texels == 1.0)).all())


def _slots(outline: Outline) -> dict[int, tuple[int, ...]]:
    """By mesh, the materials of the first instance that shows it."""
    return {instance.mesh: instance.materials for instance in reversed(outline.instances)}


def _with_uvs(
    outline: Outline, source: bpy.types.Mesh | MadeMesh, mesh: MeshArrays, slots: tuple[int, ...],
    wants: Collection[str], owner: str, warnings: list[str],
) -> MeshArrays:  # fmt: skip
    materials = [outline.materials[slot] for slot in slots]
    placements = [Placement(each.uv_map, each.uv_matrix) for each in materials]
    if isinstance(source, bpy.types.Mesh):
        uvs = placed_uvs(source, mesh, placements, owner, warnings)
        if set(placements) != {Placement()}:
            mesh = replace(mesh, chart_uvs=placed_uvs(source, mesh, [Placement()], owner, []))
    else:
        mesh = replace(mesh, chart_uvs=mesh.corner_uvs)
        uvs = None if mesh.corner_uvs is None else moved_uvs(mesh.corner_uvs, placements[0])
    if uvs is None:
        warnings.append(f"object '{owner}': it has no UV map, its textures are read at one point")
    if uvs is not None and uvs.size and (uvs.min() < -_BESIDE or uvs.max() > 1.0 + _BESIDE):
        warnings.extend(
            f"object '{owner}': its UVs leave 0 to 1, beyond that material '{each.name}' is read as repeated"
            for each in dict.fromkeys(materials)
            if not all(outline.images[image].repeats for image in _images_of(each, wants))
        )
    return replace(mesh, corner_uvs=uvs)


# Of the unit square: what a UV may be beside it by rounding.
_BESIDE = 1e-4


def _with_corner_opacity(
    scan: Scan, index: int, mesh: MeshArrays, slots: tuple[int, ...], owner: str, warnings: list[str]
) -> MeshArrays:
    corners, materials = scan.corner_sources, scan.outline.materials
    values = [
        next((corners[each.corners] for each in materials[slot].opacities if each.corners), None)
        for slot in slots
    ]
    if not any(values):
        return mesh
    source = scan.mesh_sources[index]
    if not isinstance(source, bpy.types.Mesh):
        warnings.append(f"object '{owner}': its attributes are not read for opacity, they count as 1")
        return mesh
    found = corner_opacity(source, mesh, values, owner, warnings)
    return replace(mesh, corner_opacity=found)


def _images_of(material: Material, wants: Collection[str]) -> list[int]:
    """Those of it that are wanted."""
    images = [opacity.image for opacity in material.opacities] if OPACITY in wants else []
    images += [material.base_color_image] if BASE_COLOR in wants else []
    return [image for image in images if image is not None]
