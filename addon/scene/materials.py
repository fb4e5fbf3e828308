"""Materials, as Cycles renders them: how much they stop, of what colour they are, what they emit.

Their nodes are read as expressions (nodes/). What hangs on textures becomes a picture, evaluated at its
texels; what cannot be read falls back to the material's viewport colour, and counts as opaque, with a warning
that names material and node.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from ..core.outline import Image, Material, Opacity
from .nodes.baked import BakedTexture
from .nodes.closures import Closure
from .nodes.graph import Leaves, origins
from .nodes.opacities import Parts, parts_of
from .nodes.pictures import Picture, Placement, placement_of
from .nodes.surface import Surface, surface_at
from .nodes.values import COLOUR, Attribute, Value, constant
from .pixels import pixels_of
from .transforms import as_colour
from .volumes import volume_of

OPACITY, BASE_COLOUR, EMISSION = "opacity", "base colour", "emission"


class Images:
    """Collects the pictures that materials need; `headers` become `Outline.images`. Equal ones are one."""

    def __init__(self):
        self.headers: list[Image] = []
        self.sources: list[Picture] = []
        self.corners: dict[str, Value] = {}
        self._indices: dict[tuple, int] = {}

    def index(self, value: Value, placement: Placement) -> int:
        key = (value.key, placement)
        if key not in self._indices:
            self._indices[key] = len(self.headers)
            picture = Picture(value, placement)
            channel = "COLOR" if value.kind == COLOUR else "VALUE"
            name = ", ".join(picture.names) or "texture coordinates"
            self.headers.append(Image(name, picture.key, channel, picture.repeats, picture.size()))
            self.sources.append(picture)
        return self._indices[key]

    def corner(self, value: Value) -> str:
        """The name by which an opacity tells it."""
        names = sorted({source.name for source in value.sources if isinstance(source, Attribute)})
        name = f"{', '.join(names)}#{value.key}"
        self.corners[name] = value
        return name


def default_material() -> Material:
    """Of an empty slot: Blender's grey."""
    return Material("")


@dataclass(frozen=True, eq=False)
class ReadMaterial:
    """A material and its warnings. `unread` is what of 'opacity', 'base colour' and 'emission' is not read,
    and only for what its nodes are. By the same words, `baked` has keys of the textures that Blender bakes
    for it."""

    material: Material
    warnings: list[str] = field(default_factory=list)
    unread: tuple[str, ...] = ()
    baked: dict[str, frozenset[str]] = field(default_factory=dict)


def material_of(material: bpy.types.Material, images: Images) -> tuple[Material, list[str]]:
    """A material and its warnings."""
    read = read_material(material, images)
    return read.material, read.warnings


def read_material(material: bpy.types.Material, images: Images, leaves: Leaves | None = None) -> ReadMaterial:
    """`leaves` know what else its nodes give."""
    medium, warnings = volume_of(material.node_tree, f"material '{material.name_full}'")
    if (medium is not None or warnings) and not _has_surface(material):
        colour = as_colour(material.diffuse_color[:3])
        return ReadMaterial(Material(material.name_full, colour, medium=medium, has_surface=False), warnings)
    read = _surface_of(material, images, leaves)
    if medium is not None:
        warnings.append(f"material '{material.name_full}': its volume is not read, it has a surface too")
    return replace(read, warnings=[*read.warnings, *warnings])


def is_medium(material: bpy.types.Material) -> bool:
    """Whether it shows a volume and no surface."""
    medium, warnings = volume_of(material.node_tree, "")
    return (medium is not None or bool(warnings)) and not _has_surface(material)


def may_glow(material: bpy.types.Material) -> bool:
    """Whether a surface of it may shine: by its nodes, linked to anything or not."""
    trees = [] if material.node_tree is None else [material.node_tree]
    for tree in trees:
        for node in tree.nodes:
            if node.type == "EMISSION":
                return True
            if node.type == "BSDF_PRINCIPLED":
                strength, colour = node.inputs["Emission Strength"], node.inputs["Emission Color"]
                is_bright = strength.is_linked or strength.default_value > 0.0
                if is_bright and (colour.is_linked or any(value > 0.0 for value in colour.default_value[:3])):
                    return True
            group = getattr(node, "node_tree", None)
            if group is not None and group not in trees:
                trees.append(group)
    return False


def _surface_socket(material: bpy.types.Material) -> bpy.types.NodeSocket | None:
    output = material.node_tree.get_output_node("CYCLES") if material.node_tree is not None else None
    return None if output is None else output.inputs["Surface"]


def _has_surface(material: bpy.types.Material) -> bool:
    socket = _surface_socket(material)
    return socket is not None and any(link.is_valid and not link.is_muted for link in socket.links)


def _surface_of(material: bpy.types.Material, images: Images, leaves: Leaves | None) -> ReadMaterial:
    if not _has_surface(material):
        name = material.name_full
        if material.node_tree is None:
            colour, roughness = as_colour(material.diffuse_color[:3]), float(material.roughness)
            warning = f"material '{name}': it has no nodes, its viewport colour is used"
            return ReadMaterial(Material(name, colour, roughness=roughness), [warning])
        warning = f"material '{name}': without a shader it is black, as in Cycles"
        return ReadMaterial(Material(name, (0.0, 0.0, 0.0)), [warning])
    return _Maker(material, images, leaves).made()


def _baked(values: Iterable[Value | None]) -> frozenset[str]:
    parts = (part for value in values if value is not None for part in value.parts())
    return frozenset(part.texture.key for part in parts if isinstance(part.texture, BakedTexture))


class _Maker:
    """Makes a Material of a Surface."""

    def __init__(self, material: bpy.types.Material, images: Images, leaves: Leaves | None):
        self.material = material
        self.images = images
        self.surface: Surface = surface_at(_surface_socket(material), leaves)
        self.warnings = list(self.surface.warnings)
        self.placement = Placement()
        self.corners: Value | None = None
        self.unread: dict[str, None] = dict.fromkeys({EMISSION} & self.surface.varying)

    def made(self) -> ReadMaterial:
        surface, shown = self.surface, self.surface.shown
        closures = list(dict.fromkeys((*surface.seen, *surface.casts)))
        parts = [self._parts(closure) for closure in closures]
        base = self._base(shown)
        pictures = [each.picture for each in parts if each.picture is not None]
        emission = self._emission(shown)
        pictures += [each for each in (base, emission) if not each.is_constant]
        if pictures:
            self.placement, warnings = placement_of(pictures)
            self.warnings += warnings
        opacities = {closure: self._opacity(each) for closure, each in zip(closures, parts, strict=True)}
        seen = opacities[surface.seen[0]], opacities[surface.seen[1]]
        casts = opacities[surface.casts[0]], opacities[surface.casts[1]]
        image = None if base.is_constant else self.images.index(base, self.placement)
        colour = base.constant.tolist() if base.is_constant else self.material.diffuse_color[:3]
        read = Material(
            self.material.name_full,
            as_colour(colour),
            image,
            seen,
            casts,
            self._constant(shown.roughness, "roughness", 0.5),
            as_colour(self._mean(emission)),
            self._constant(shown.metallic, "metallic", 0.0),
            unread_opacity=OPACITY in self.unread,
            is_holdout=self._is_holdout(shown),
            uv_map=self.placement.uv_map,
            uv_matrix=self.placement.matrix,
            emission_image=None if emission.is_constant else self.images.index(emission, self.placement),
        )
        name = self.material.name_full
        warnings = [f"material '{name}': {warning}" for warning in dict.fromkeys(self.warnings)]
        baked = {
            OPACITY: _baked(each.picture for each in parts),
            BASE_COLOUR: _baked([base]),
            EMISSION: _baked([emission]),
        }
        return ReadMaterial(read, warnings, tuple(self.unread), baked)

    def _base(self, closure: Closure) -> Value:
        """The base colour; the viewport colour for one that is not read."""
        value = closure.base
        if value.unread or value.hangs_on(Attribute):
            self.unread[BASE_COLOUR] = None
            self.warnings.append(f"{origins(value)} not read for base colour, its viewport colour is used")
            return constant(COLOUR, self.material.diffuse_color[:3])
        return value

    def _emission(self, closure: Closure) -> Value:
        value = closure.emission
        if value.is_constant or not (value.unread or value.hangs_on(Attribute)):
            return value
        self.unread[EMISSION] = None
        return constant(COLOUR, self._constant(value, "emission", [0.0] * 3))

    def _mean(self, value: Value) -> list[float]:
        """What stands for it where only a constant counts; of what is not baked yet, anything."""
        if value.is_constant:
            return value.constant.tolist()
        texels, _ = Picture(value, self.placement).texels(pixels_of)
        return [1.0] * 3 if texels is None else texels[..., :3].mean(axis=(0, 1)).tolist()

    def _parts(self, closure: Closure) -> Parts:
        value = closure.opacity
        parts = None if value.unread else parts_of(value)
        if parts is not None and parts.corners is not None:
            # A corner of a face carries one factor.
            if self.corners is None:
                self.corners = parts.corners
            parts = parts if self.corners.key == parts.corners.key else None
        if parts is None:
            self.unread[OPACITY] = None
            self.warnings.append(f"{origins(value)} not read for opacity, it counts as opaque")
            return Parts()
        return parts

    def _opacity(self, parts: Parts) -> Opacity:
        image = None if parts.picture is None else self.images.index(parts.picture, self.placement)
        corners = "" if parts.corners is None else self.images.corner(parts.corners)
        return Opacity(parts.uniform, image, corners, parts.threshold)

    def _constant(self, value: Value, use: str, instead):
        """The number, or the list of them, of what is read where it is constant."""
        if value.is_constant:
            return value.constant.tolist()
        self.warnings.append(f"{origins(value)} not read for {use}, {np.mean(instead):g} is used")
        return instead

    def _is_holdout(self, closure: Closure) -> bool:
        if closure.holdout.equals(1.0):
            return True
        if not closure.holdout.equals(0.0):
            self.warnings.append("a holdout in a part of it is not read, it counts as black")
        return False
