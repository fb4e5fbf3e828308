"""The arrays behind an outline, and only those that somebody reads."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import bpy
import numpy as np

from ..core.arrays import OPAQUE, Arrays, MeshArrays, Opacities, OpacityArrays
from ..core.material import BothSides, Material, Opacity
from ..core.outline import Instance, Outline
from .corner_values import corner_colours, corner_opacity, moved_uvs, placed_uvs
from .displacement import displaced
from .known_texels import KnownTexels
from .made_mesh import MadeMesh
from .mesh_arrays import mesh_arrays, no_faces
from .nodes.baked import BAKED_MAP
from .nodes.pictures import Placement
from .scan import Scan
from .vertex_values import vertex_values

# What a graph may ask for. Positions and polygons always come.
CORNER_NORMALS = "corner_normals"
UV = "uv"
OPACITY = "opacity"
BASE_COLOR, DIFFUSE, EMISSION = "base_color", "diffuse", "emission"
CORNER_COLOUR = "corner_colour"
VERTEX = "vertex:"
"""With a name after it: the vertex group or the attribute of vertices of that name."""
WANTS = frozenset({CORNER_NORMALS, UV, OPACITY, BASE_COLOR, DIFFUSE, EMISSION, CORNER_COLOUR})


def extract(
    scan: Scan,
    wants: Collection[str] = WANTS,
    instances: Collection[int] | None = None,
    known: KnownTexels | None = None,
) -> Arrays:
    """Arrays of the meshes that `instances` (indices; None: all) show; other meshes stay empty. `wants` is a
    subset of `WANTS`: `CORNER_NORMALS` of smooth meshes, `UV` of meshes with a material that samples a
    texture, texels for `BASE_COLOR`, `DIFFUSE` and `EMISSION`, texels and factors of corners for `OPACITY`,
    factors of colours for `CORNER_COLOUR`; and may have any `VERTEX` with a name. `known`: texels of the
    extraction before, which then are those of this one."""
    outline = scan.outline
    warnings: list[str] = []
    first = _first_instances(outline)
    owners = [first[index].name if index in first else mesh.name for index, mesh in enumerate(outline.meshes)]
    textured = _textured_meshes(outline, wants) if UV in wants else frozenset()
    read = range(len(outline.instances)) if instances is None else instances
    shown = {outline.instances[index].mesh for index in read}
    meshes = tuple(
        _arrays_of(scan, index, CORNER_NORMALS in wants, index in textured, owners[index], warnings)
        if index in shown
        else no_faces()
        for index in range(len(scan.mesh_sources))
    )
    slots = {mesh: instance.materials for mesh, instance in first.items()}
    meshes = tuple(
        _with_uvs(
            outline,
            scan.mesh_sources[index],
            mesh,
            slots[index],
            wants,
            owners[index],
            warnings,
            scan.baked_uvs[index]() if index in scan.baked_uvs else None,
        )
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
    if OPACITY in wants or CORNER_COLOUR in wants:
        meshes = tuple(
            _with_corner_factors(scan, index, mesh, slots[index], wants, owners[index], warnings)
            if index in shown
            else mesh
            for index, mesh in enumerate(meshes)
        )
    textures = _textures(scan, wants, known or KnownTexels(are_kept=False), warnings)
    return Arrays(
        meshes, outline.instances.matrices, _opacities(outline, textures), textures, tuple(warnings)
    )


def _arrays_of(
    scan: Scan, index: int, want_normals: bool, want_uv: bool, owner: str, warnings: list[str]
) -> MeshArrays:
    """UVs only of what Strata makes; else see `placed_uvs`."""
    source = scan.mesh_sources[index]
    if not isinstance(source, bpy.types.Mesh):
        return source.arrays(want_normals, want_uv)
    mesh = mesh_arrays(source, want_normals, owner, warnings)
    by_slot = scan.displacements.get(index)
    return mesh if by_slot is None else displaced(mesh, source, by_slot, owner, warnings)


def _values(mesh: bpy.types.Mesh | MadeMesh, owner: str, names: list[str]) -> dict[str, np.ndarray]:
    if not isinstance(mesh, bpy.types.Mesh):
        return {}
    found = {name: vertex_values(mesh, owner, name) for name in names}
    return {name: values for name, values in found.items() if values is not None}


def _first_instances(outline: Outline) -> dict[int, Instance]:
    """By mesh, the first that shows it."""
    return {instance.mesh: instance for instance in reversed(outline.instances)}


def _textured_meshes(outline: Outline, wants: Collection[str]) -> frozenset[int]:
    sampling = {index for index, material in enumerate(outline.materials) if _images_of(material, wants)}
    if not sampling:
        return frozenset()
    shown = {(instance.mesh, instance.materials) for instance in outline.instances}
    return frozenset(mesh for mesh, materials in shown if not sampling.isdisjoint(materials))


def _textures(
    scan: Scan, wants: Collection[str], known: KnownTexels, warnings: list[str]
) -> dict[int, np.ndarray]:
    outline = scan.outline
    wanted: dict[int, str] = {}
    for material in outline.materials:
        for image in _images_of(material, wants):
            wanted.setdefault(image, material.name)
    read = known.read({index: scan.image_sources[index] for index in sorted(wanted)})
    for index, (_texels, told) in read.items():
        warnings.extend(f"material '{wanted[index]}': {warning}" for warning in told)
    return {index: texels for index, (texels, _told) in read.items() if texels is not None}


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


def with_known_clips(outline: Outline, arrays: Arrays) -> Outline:
    """The outline once its textures are read: of some it shows that they are clips, so that plans need not
    look for what gets through in part."""

    def known(sides: BothSides, read: tuple[OpacityArrays, OpacityArrays]) -> BothSides:
        return tuple(
            replace(each, threshold=of_read.threshold)
            if of_read.threshold > 0.0 and each.threshold <= 0.0
            else each
            for each, of_read in zip(sides, read, strict=True)
        )

    materials = tuple(
        replace(each, seen=known(each.seen, read.seen), casts=known(each.casts, read.casts))
        for each, read in zip(outline.materials, arrays.opacities, strict=True)
    )
    return replace(outline, materials=materials)


def _is_cutout(texels: np.ndarray) -> bool:
    """Whether all are 0 or 1: then what is between is only how they are sampled, and half of it is an edge
    where that of the picture is. Leaves are so, and maps know all there is to know of them."""
    return bool(((texels == 0.0) | (texels == 1.0)).all())


def _with_uvs(
    outline: Outline, source: bpy.types.Mesh | MadeMesh, mesh: MeshArrays, slots: tuple[int, ...],
    wants: Collection[str], owner: str, warnings: list[str], baked: np.ndarray | None = None,
) -> MeshArrays:  # fmt: skip
    materials = [outline.materials[slot] for slot in slots]
    # Beside what is baked, what has no pictures lies nowhere.
    placements = [
        Placement(each.uv_map, each.uv_matrix)
        if baked is None or _images_of(each, wants)
        else Placement(BAKED_MAP)
        for each in materials
    ]
    if isinstance(source, bpy.types.Mesh):
        uvs = placed_uvs(source, mesh, placements, owner, warnings, baked)
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


def _with_corner_factors(
    scan: Scan, index: int, mesh: MeshArrays, slots: tuple[int, ...], wants: Collection[str], owner: str,
    warnings: list[str],
) -> MeshArrays:  # fmt: skip
    source, materials = scan.mesh_sources[index], [scan.outline.materials[slot] for slot in slots]
    opacities = [next((o.corners for o in each.opacities if o.corners), "") for each in materials]
    colours = [each.colour_corners for each in materials]
    found = {}
    for want, field, read, names in (
        (OPACITY, "corner_opacity", corner_opacity, opacities),
        (CORNER_COLOUR, "corner_colours", corner_colours, colours),
    ):
        if want not in wants or not any(names):
            continue
        if isinstance(source, bpy.types.Mesh) or source.has_attributes:
            values = [scan.corner_sources[name] if name else None for name in names]
            found[field] = read(source, mesh, values, owner, warnings)
        else:
            use = "opacity" if want == OPACITY else "colours"
            line = f"object '{owner}': attributes of its hair are not read for {use}"
            warnings.append(f"{line}, they count as 1")
    return replace(mesh, **found) if found else mesh


def texel_bytes(outline: Outline, wants: Collection[str]) -> int:
    """What the textures of an extraction take."""
    images = {image for material in outline.materials for image in _images_of(material, wants)}
    return sum(outline.images[image].nbytes for image in images)


def _images_of(material: Material, wants: Collection[str]) -> list[int]:
    """Those of it that are wanted."""
    images = list(material.opacity_images) if OPACITY in wants else []
    colours = {
        BASE_COLOR: material.base_color_image,
        DIFFUSE: material.diffuse[0],
        EMISSION: material.emission_image,
    }
    found = [image for want, image in colours.items() if want in wants and image is not None]
    return [*images, *dict.fromkeys(found)]
