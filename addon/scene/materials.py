"""Materials, as far as Strata reads them: base colour, alpha, roughness and emission of a Principled BSDF,
and the colour of a Diffuse BSDF.

Base colour and alpha may come from an Image Texture through the mesh's render UV map. Anything else falls
back to the material's viewport colour, with a warning that names material and node. Alpha clips: Cycles
lets light through in proportion, Strata keeps a fragment where alpha is at least `ALPHA_THRESHOLD` or, where
alpha comes out of a Math node Greater Than, that node's threshold.
"""

from __future__ import annotations

import os

import bpy

from ..core.outline import Image, Material, Opacity
from .transforms import as_colour
from .volumes import volume_of

ALPHA_THRESHOLD = 0.5

# Lobes that change what a diffuse layer multiplies onto; at these defaults a Principled BSDF is without them.
_UNREAD_WEIGHTS = ("Transmission Weight", "Subsurface Weight", "Coat Weight", "Sheen Weight", "Metallic")


class Images:
    """Collects the textures that materials read; `headers` become `Outline.images`."""

    def __init__(self):
        self.headers: list[Image] = []
        self.sources: list[bpy.types.Image] = []
        self._indices: dict[str, int] = {}

    def index(self, image: bpy.types.Image, channel: str) -> int:
        key = f"{image.name_full}#{channel}"
        if key not in self._indices:
            self._indices[key] = len(self.headers)
            self.headers.append(Image(image.name_full, key, channel))
            self.sources.append(image.original)
        return self._indices[key]


def default_material() -> Material:
    """Of an empty slot: Blender's grey."""
    return Material("")


def material_of(material: bpy.types.Material, images: Images) -> tuple[Material, list[str]]:
    """A material and its warnings."""
    medium, warnings = volume_of(material.node_tree, f"material '{material.name_full}'")
    if (medium is not None or warnings) and not _has_surface(material):
        colour = as_colour(material.diffuse_color[:3])
        return Material(material.name_full, colour, medium=medium, has_surface=False), warnings
    read, more = _surface_of(material, images)
    if medium is not None:
        warnings.append(f"material '{material.name_full}': its volume is not read, it has a surface too")
    return read, [*more, *warnings]


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


def _has_surface(material: bpy.types.Material) -> bool:
    return _source(material.node_tree.get_output_node("CYCLES").inputs["Surface"])[0] is not None


def _surface_of(material: bpy.types.Material, images: Images) -> tuple[Material, list[str]]:
    name = material.name_full
    node, unread = _surface_node(material)
    if node is None:
        colour = material.diffuse_color
        warning = f"material '{name}': {unread} is not read, its viewport colour is used"
        return Material(name, base_color=as_colour(colour[:3]), roughness=float(material.roughness)), [
            warning
        ]
    reader = _Reader(material, node, images)
    if node.bl_idname == "ShaderNodeBsdfDiffuse":
        base_color, base_color_image = reader.base_color("Color")
        read = Material(name, base_color, base_color_image, roughness=1.0)
        return read, [f"material '{name}': {reason}" for reason in reader.warnings]
    base_color, base_color_image = reader.base_color("Base Color")
    opacity = reader.opacity()
    emission_strength = reader.value("Emission Strength")
    emission = as_colour(c * emission_strength for c in reader.value("Emission Color")[:3])
    read = Material(
        name,
        base_color,
        base_color_image,
        (opacity, opacity),
        (opacity, opacity),
        float(reader.value("Roughness")),
        emission,
        reader.metallic(),
    )
    reader.note_unread_lobes()
    return read, [f"material '{name}': {reason}" for reason in reader.warnings]


def _surface_node(material: bpy.types.Material):
    """The Principled or Diffuse BSDF at the surface, or None and what is there instead."""
    tree = material.node_tree
    output = tree.get_output_node("CYCLES") if tree is not None else None
    if output is None:
        return None, "a surface without nodes"
    node, _socket = _source(output.inputs["Surface"])
    if node is None:
        return None, "a surface without a shader"
    if node.bl_idname not in {"ShaderNodeBsdfPrincipled", "ShaderNodeBsdfDiffuse"}:
        return None, f"node '{node.name}'"
    return node, ""


def _source(socket: bpy.types.NodeSocket):
    """The node and output socket that feed an input, through reroutes; (None, None) where nothing does."""
    for _hop in range(64):
        links = [link for link in socket.links if link.is_valid and not link.is_muted]
        if not links:
            return None, None
        node, output = links[0].from_node, links[0].from_socket
        if node.bl_idname != "NodeReroute":
            return node, output
        socket = node.inputs[0]
    return None, None


class _Reader:
    def __init__(self, material: bpy.types.Material, node: bpy.types.Node, images: Images):
        self.material = material
        self.node = node
        self.images = images
        self.warnings: list[str] = []

    def value(self, name: str):
        """An input's constant; a linked one is warned about."""
        socket = self.node.inputs[name]
        source, _output = _source(socket)
        if source is not None:
            if source.bl_idname in {"ShaderNodeValue", "ShaderNodeRGB"}:
                return source.outputs[0].default_value
            self.warnings.append(f"node '{source.name}' is not read for {name}")
        return socket.default_value

    def metallic(self) -> float:
        """Its constant; 0 where something is linked."""
        source, _output = _source(self.node.inputs["Metallic"])
        if source is None:
            return float(self.node.inputs["Metallic"].default_value)
        return float(source.outputs[0].default_value) if source.bl_idname == "ShaderNodeValue" else 0.0

    def base_color(self, name: str):
        source, _output = _source(self.node.inputs[name])
        if source is None or source.bl_idname == "ShaderNodeRGB":
            return as_colour(self.value(name)[:3]), None
        viewport = as_colour(self.material.diffuse_color[:3])
        if source.bl_idname != "ShaderNodeTexImage":
            self.warnings.append(f"node '{source.name}' is not read for {name}, its viewport colour is used")
            return viewport, None
        return viewport, self._image(source, "COLOR", name)

    def opacity(self) -> Opacity:
        """What Alpha says; the same on both sides, and for cameras and shadows."""
        source, output = _source(self.node.inputs["Alpha"])
        if source is None or source.bl_idname == "ShaderNodeValue":
            alpha = float(self.value("Alpha"))
            if alpha >= 1.0:
                return Opacity()
            if alpha > 0.0:
                self.warnings.append(f"alpha {alpha:.3g} is clipped at {ALPHA_THRESHOLD:g}")
            return Opacity(alpha, threshold=ALPHA_THRESHOLD)
        threshold = ALPHA_THRESHOLD
        if source.bl_idname == "ShaderNodeMath" and source.operation == "GREATER_THAN":
            inner, inner_output = _source(source.inputs[0])
            if inner is not None and _source(source.inputs[1])[0] is None:
                threshold = max(float(source.inputs[1].default_value), 1e-6)
                source, output = inner, inner_output
        if source.bl_idname != "ShaderNodeTexImage":
            self.warnings.append(f"node '{source.name}' is not read for Alpha, it counts as opaque")
            return Opacity()
        channel = "ALPHA" if output.name == "Alpha" else "LUMINANCE"
        image = self._image(source, channel, "Alpha")
        return Opacity(image=image, threshold=threshold) if image is not None else Opacity()

    def _image(self, node: bpy.types.Node, channel: str, use: str) -> int | None:
        """Index of an Image Texture's image; None, with a warning, where it cannot be sampled."""
        image = node.image
        if image is None:
            self.warnings.append(f"node '{node.name}' has no image for {use}")
            return None
        if reason := unreadable(image):
            self.warnings.append(f"image '{image.name_full}' for {use} {reason}")
            return None
        vector, output = _source(node.inputs["Vector"])
        plain = vector is None or (vector.bl_idname == "ShaderNodeTexCoord" and output.name == "UV")
        if vector is not None and vector.bl_idname == "ShaderNodeUVMap":
            plain = not vector.from_instancer
            if vector.uv_map:
                self.warnings.append(
                    f"node '{vector.name}': the render UV map is read, not '{vector.uv_map}'"
                )
        if not plain:
            self.warnings.append(f"node '{vector.name}' is not read for {use}: UVs are taken as they are")
        if node.projection != "FLAT" or node.extension not in {"REPEAT", "EXTEND"}:
            self.warnings.append(f"node '{node.name}': {use} is sampled flat and repeated")
        return self.images.index(image, channel)

    def note_unread_lobes(self) -> None:
        unread = [
            name
            for name in _UNREAD_WEIGHTS
            if self.node.inputs[name].is_linked or self.node.inputs[name].default_value > 0.0
        ]
        unread += [name for name in ("Normal",) if self.node.inputs[name].is_linked]
        if unread:
            self.warnings.append(
                "only base colour, roughness, alpha and emission of Principled BSDF are read, not "
                + ", ".join(name.removesuffix(" Weight") for name in unread)
            )


def unreadable(image: bpy.types.Image) -> str:
    """Why an image cannot be read, seen without loading it; empty where nothing speaks against it."""
    if image.source in {"TILED", "SEQUENCE", "MOVIE", "VIEWER"}:
        return f"is not read: its source is {image.source.lower()}"
    if image.source == "FILE" and image.packed_file is None and not image.has_data:
        path = bpy.path.abspath(image.filepath, library=image.library)
        if not os.path.isfile(path):
            return f"is missing ({os.path.basename(path) or 'no path'})"
    return ""
