"""Nodes that hang on the mesh: images, texture coordinates and attributes."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..pixels import channel_of, has_own_alpha
from ..tiles import TileRange, range_of, unreadable_tile
from .arithmetic import normalized, safe_divide
from .graph import At
from .registry import value_of
from .values import (
    COLOUR,
    FLOAT,
    VECTOR,
    Attribute,
    Uv,
    Value,
    apply,
    constant,
    looked_up,
    number,
    unread,
    variable,
)

Loader = Callable[[bpy.types.Image], np.ndarray | None]
"""(H, W, 4) f32 as Blender keeps them, or None."""


@dataclass(frozen=True, eq=False)
class Texture:
    """An image as a node samples it. Cycles keeps colours times alpha, and takes them apart again only where
    the node's Alpha is used too (`is_straight`)."""

    image: bpy.types.Image
    name: str
    extension: str
    interpolation: str
    is_straight: bool

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in texels, about; of all tiles."""
        width, height = self.image.size
        if self.image.source == "TILED":
            extent = range_of(self.image)
            width, height = width * extent.columns, height * extent.rows
        return width, height

    @property
    def key(self) -> str:
        return f"{self.name}#{self.extension}#{self.interpolation}#{self.is_straight}"

    @property
    def words(self) -> str:
        return f"image '{self.name}'"

    def colours(self, load: Loader) -> tuple[np.ndarray | None, str]:
        """(H, W, 4) f32 in the working space, row 0 at the bottom; None where it cannot be read. A warning
        or ''."""
        pixels = load(self.image)
        if pixels is None:
            return None, f"{self.words} cannot be read"
        return channel_of(pixels, self.image, "COLOR", self.is_straight)


@value_of(
    "ShaderNodeTexImage",
    how="Color and Alpha of an image or of tiles, by any UV map, with all extensions",
    instead="Cubic and Smart are read as Linear; Box, Sphere and Tube projections, sequences and movies "
    "are not read; a missing image counts as opaque",
)
def _image_texture(at: At, output) -> Value:
    node = at.node
    image = node.image
    is_alpha = output.identifier == "Alpha"
    kind = FLOAT if is_alpha else COLOUR
    reason = f"image of node '{node.name}' (none)" if image is None else unreadable(image)
    if reason:
        if is_alpha and is_missing(image):
            # As Cycles shows it.
            at.graph.tell(f"{reason} counts as opaque")
            return number(1.0)
        return unread(kind, reason)
    if node.projection != "FLAT":
        return unread(kind, f"node '{node.name}' ({node.projection.lower()} projection)")
    coordinates = at.input("Vector") if at.is_linked("Vector") else variable(VECTOR, Uv())
    if not coordinates.inputs and any(isinstance(source, Attribute) for source in coordinates.sources):
        (source,) = coordinates.sources
        coordinates = variable(VECTOR, Uv(source.name))
    if coordinates.is_constant or any(not isinstance(source, Uv) for source in coordinates.sources):
        why = ", ".join(coordinates.unread) or "its coordinates"
        return unread(kind, f"node '{node.name}' (by {why})")
    if image.source == "TILED":
        coordinates = _in_range(coordinates, range_of(image))
    if node.interpolation not in {"Linear", "Closest"}:
        at.graph.tell(f"node '{node.name}': its interpolation is read as linear")
    is_straight = not has_own_alpha(image) or node.outputs["Alpha"].is_linked
    extension = "EXTEND" if image.source == "TILED" else node.extension
    texture = Texture(image.original, image.name_full, extension, node.interpolation, is_straight)
    texel = looked_up(texture, coordinates)
    if is_alpha:
        if image.alpha_mode == "NONE":
            return number(1.0)
        return apply("alpha", FLOAT, lambda t: t[..., 3], texel, low=0.0, high=1.0)
    bounds = {} if image.is_float else {"low": 0.0, "high": 1.0}
    return apply("colour", COLOUR, lambda t: t[..., :3], texel, **bounds)


def _in_range(coordinates: Value, extent: TileRange) -> Value:
    """From 0 to 1 over all tiles."""
    first = np.array([extent.column, extent.row, 0.0])
    counts = np.array([extent.columns, extent.rows, 1.0])
    return apply(f"tiles {extent}", VECTOR, lambda uv: (uv - first) / counts, coordinates)


def is_missing(image: bpy.types.Image | None) -> bool:
    """Whether there is no picture at all."""
    if image is None:
        return True
    if image.source != "FILE" or image.packed_file is not None or image.has_data:
        return False
    return not os.path.isfile(bpy.path.abspath(image.filepath, library=image.library))


def unreadable(image: bpy.types.Image) -> str:
    """What of an image cannot be read, seen without loading it; empty where nothing speaks against it."""
    if image.source == "TILED":
        reason = unreadable_tile(image)
        return f"image '{image.name_full}' ({reason})" if reason else ""
    if image.source in {"SEQUENCE", "MOVIE", "VIEWER"}:
        return f"image '{image.name_full}' (its source is {image.source.lower()})"
    if is_missing(image):
        name = os.path.basename(bpy.path.abspath(image.filepath, library=image.library))
        return f"image '{image.name_full}' (it is missing: {name or 'no path'})"
    return ""


@value_of(
    "ShaderNodeTexCoord", how="UV, of the mesh's UV map for rendering", instead="no other output is read"
)
def _texture_coordinate(at: At, output) -> Value:
    if output.identifier != "UV" or at.node.from_instancer:
        return at.unread(VECTOR, "from the instancer" if output.identifier == "UV" else output.name)
    return variable(VECTOR, Uv())


@value_of("ShaderNodeUVMap", how="any UV map", instead="From Instancer is not read")
def _uv_map(at: At, output) -> Value:
    return (
        at.unread(VECTOR, "from the instancer")
        if at.node.from_instancer
        else variable(VECTOR, Uv(at.node.uv_map))
    )


@value_of("ShaderNodeMapping", how="every type")
def _mapping(at: At, output) -> Value:
    kind = at.node.vector_type
    names = ["Vector", "Location", "Rotation", "Scale"]
    if kind in {"VECTOR", "NORMAL"}:
        names.remove("Location")

    def evaluate(vector, *rest):
        location = rest[0] if len(rest) == 3 else np.zeros(3)
        turn, scale = _rotation(rest[-2]), rest[-1]
        if kind == "TEXTURE":
            return safe_divide(np.einsum("...ji,...j->...i", turn, vector - location), scale)
        if kind == "NORMAL":
            return normalized(np.einsum("...ij,...j->...i", turn, safe_divide(vector, scale)))
        return np.einsum("...ij,...j->...i", turn, vector * scale) + location

    return apply(f"mapping {kind}", VECTOR, evaluate, *(at.input(name) for name in names))


def _rotation(euler: np.ndarray) -> np.ndarray:
    """(..., 3, 3) of XYZ angles in radians."""
    (cx, cy, cz), (sx, sy, sz) = np.moveaxis(np.cos(euler), -1, 0), np.moveaxis(np.sin(euler), -1, 0)
    rows = [
        [cy * cz, sy * sx * cz - cx * sz, sy * cx * cz + sx * sz],
        [cy * sz, sy * sx * sz + cx * cz, sy * cx * sz - sx * cz],
        [-sy, cy * sx, cy * cx],
    ]
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)


@value_of("ShaderNodeVertexColor", how="Color and Alpha of any colour attribute, at corners")
def _color_attribute(at: At, output) -> Value:
    # Painted ones lie between 0 and 1.
    return replace(_attribute_of(at.node.layer_name, output.identifier), low=0.0, high=1.0)


@value_of("ShaderNodeAttribute",
          how="Geometry: Color, Vector, Fac and Alpha of the mesh's attributes, at corners",
          instead="no other type is read")  # fmt: skip
def _attribute(at: At, output) -> Value:
    if at.node.attribute_type != "GEOMETRY":
        kind = FLOAT if output.type == "VALUE" else VECTOR
        return at.unread(kind, f"{at.node.attribute_type.lower()}'s {at.node.attribute_name}")
    if not at.node.attribute_name:
        return number(0.0) if output.type == "VALUE" else constant(VECTOR, [0.0] * 3)
    return _attribute_of(at.node.attribute_name, output.identifier)


def _attribute_of(name: str, output: str) -> Value:
    kind = {"Color": COLOUR, "Vector": VECTOR}.get(output, FLOAT)
    return variable(kind, Attribute(name, output))
