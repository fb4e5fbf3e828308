"""Materials, as Cycles renders them: how much they stop, of what colour they are, what they emit.

Their nodes are read as expressions (nodes/). What hangs on textures becomes a picture, evaluated at its
texels; what cannot be read falls back to the material's viewport colour, and counts as opaque, with a warning
that names material and node.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import bpy

from ..core.material import Colour, Image, Material, Opacity
from .nodes.baked import BakedTexture
from .nodes.closures import Closure
from .nodes.factors import Product, product_of
from .nodes.graph import Leaves, origins
from .nodes.opacities import Parts, parts_of
from .nodes.pictures import Picture, Placement, placement_of
from .nodes.surface import Surface, surface_at
from .nodes.values import COLOUR, Attribute, Uv, Value, complement, constant, converted, product
from .transforms import as_colour
from .volumes import volume_of

OPACITY, BASE_COLOUR, METALLIC, EMISSION = "opacity", "base colour", "metallic", "emission"


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
        """The name by which a material tells it."""
        names = sorted({source.name for source in value.sources if isinstance(source, Attribute)})
        name = f"{', '.join(names)}#{value.key}"
        self.corners[name] = value
        return name


def default_material() -> Material:
    """Of an empty slot: Blender's grey."""
    return Material("")


@dataclass(frozen=True, eq=False)
class ReadMaterial:
    """A material and its warnings. `unread` is what of 'opacity', 'base colour', 'metallic' and 'emission' is
    not read, and only for what its nodes are. By such words, `baked` has keys of the textures that Blender
    bakes for it."""

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
            warning = f"material '{name}': it has no nodes, its viewport colour is used"
            return ReadMaterial(Material(name, as_colour(material.diffuse_color[:3])), [warning])
        warning = f"material '{name}': without a shader it is black, as in Cycles"
        return ReadMaterial(Material(name, (0.0, 0.0, 0.0)), [warning])
    return _Maker(material, images, leaves).made()


def _baked(values: Iterable[Value | None]) -> frozenset[str]:
    parts = (part for value in values if value is not None for part in value.parts())
    return frozenset(part.texture.key for part in parts if isinstance(part.texture, BakedTexture))


BLACK = constant(COLOUR, [0.0] * 3)


def _maps_of(pictures: list[Value]) -> frozenset[str]:
    """Names of the UV maps that they lie on; of the one for rendering empty."""
    return frozenset(s.name for picture in pictures for s in picture.sources if isinstance(s, Uv))


class _Maker:
    """Makes a Material of a Surface."""

    def __init__(self, material: bpy.types.Material, images: Images, leaves: Leaves | None):
        self.material = material
        self.images = images
        self.surface: Surface = surface_at(_surface_socket(material), leaves)
        self.warnings = list(self.surface.warnings)
        self.placement = Placement()
        self.corners: Value | None = None
        self.colour_corners: Value | None = None
        self.maps: frozenset[str] = frozenset()
        self.unread: dict[str, None] = dict.fromkeys({EMISSION} & self.surface.lacking)

    def made(self) -> ReadMaterial:
        surface, shown = self.surface, self.surface.shown
        closures = list(dict.fromkeys((*surface.seen, *surface.casts)))
        parts = [self._parts(closure) for closure in closures]
        base = self._base(shown)
        pictures = [each.picture for each in parts if each.picture is not None]
        pictures += [] if base.picture.is_constant else [base.picture]
        self.maps = _maps_of(pictures)
        diffuse, metallic = self._diffuse(shown, base)
        emission = self._emission(shown)
        pictures += [each.picture for each in (diffuse, emission) if not each.picture.is_constant]
        if pictures:
            self.placement, warnings = placement_of(pictures)
            self.warnings += warnings
        opacities = {closure: self._opacity(each) for closure, each in zip(closures, parts, strict=True)}
        seen = opacities[surface.seen[0]], opacities[surface.seen[1]]
        casts = opacities[surface.casts[0]], opacities[surface.casts[1]]
        read = Material(
            self.material.name_full,
            *self._colour(base, self.material.diffuse_color[:3]),
            seen,
            casts,
            *self._colour(emission),
            metallic,
            *self._colour(diffuse)[1:],
            unread_opacity=OPACITY in self.unread,
            tints=surface.tints,
            is_holdout=self._is_holdout(shown),
            uv_map=self.placement.uv_map,
            uv_matrix=self.placement.matrix,
        )
        name = self.material.name_full
        warnings = [f"material '{name}': {warning}" for warning in dict.fromkeys(self.warnings)]
        baked = {
            OPACITY: _baked(each.picture for each in parts),
            BASE_COLOUR: _baked([base.picture]),
            METALLIC: _baked([diffuse.picture]),
            EMISSION: _baked([emission.picture]),
        }
        return ReadMaterial(read, warnings, tuple(self.unread), baked)

    def _base(self, closure: Closure) -> Product:
        """The base colour; the viewport colour for one that is not read."""
        found = self._product(closure.base, BASE_COLOUR, "its viewport colour is used")
        if found is None:
            self.unread[BASE_COLOUR] = None
            return Product(constant(COLOUR, self.material.diffuse_color[:3]))
        return found

    def _emission(self, closure: Closure) -> Product:
        found = self._product(closure.emission, EMISSION, "0 is used")
        if found is None:
            self.unread[EMISSION] = None
            return Product(BLACK)
        return found

    def _diffuse(self, closure: Closure, base: Product) -> tuple[Product, float]:
        """What diffuse light comes back by where metallic is not the same all over, else nothing; and what of
        metallic is the same all over."""
        if closure.metallic.is_constant:
            return Product(), closure.metallic.number()
        dielectric = complement(closure.metallic)
        value = product(base.value, dielectric)
        found = self._product(value, METALLIC, "0 is used", dielectric)
        if found is None:
            self.unread[METALLIC] = None
            return Product(), 0.0
        if found.corners.is_constant or not found.picture.is_constant:
            return found, 0.0
        # A picture has the constant factor in it; corners are not scaled, what else is there may share them.
        return found, 1.0 - product_of(dielectric).uniform.number()

    def _product(self, value: Value, use: str, instead: str, of: Value | None = None) -> Product | None:
        """A colour as a product; None, with a warning, for one that is not read. `of`: the part of it to
        blame."""
        found = None if value.unread else product_of(value)
        if found is not None and not found.picture.is_constant and self.maps:
            # All pictures of a material lie on one map: those of opacity and base colour decide.
            found = found if _maps_of([found.picture]) <= self.maps else None
        if found is not None and not found.corners.is_constant:
            # A corner of a face carries one colour.
            if self.colour_corners is None:
                self.colour_corners = found.corners
            found = found if self.colour_corners.key == found.corners.key else None
        if found is None:
            self.warnings.append(f"{origins(of or value)} not read for {use}, {instead}")
            return None
        # A product of pictures alone stays as the nodes have it, to the last bit.
        return Product(picture=value) if found.corners.is_constant and not value.is_constant else found

    def _colour(self, of: Product, instead=(0.0, 0.0, 0.0)) -> tuple[Colour, int | None, str]:
        """The constant, the picture and the corners; `instead`: for a picture that turns out unreadable."""
        corners = "" if of.corners.is_constant else self.images.corner(converted(of.corners, COLOUR))
        if of.picture.is_constant:
            return as_colour(converted(of.uniform, COLOUR).constant.tolist()), None, corners
        picture = converted(product(of.picture, of.uniform), COLOUR)
        return as_colour(instead), self.images.index(picture, self.placement), corners

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

    def _is_holdout(self, closure: Closure) -> bool:
        if closure.holdout.equals(1.0):
            return True
        if not closure.holdout.equals(0.0):
            self.warnings.append("a holdout in a part of it is not read, it counts as black")
        return False
