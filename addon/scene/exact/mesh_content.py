"""What of a mesh a material's nodes may read."""

from __future__ import annotations

import hashlib

import bpy
import numpy as np

# By an attribute's data type: what its elements are read by, how many numbers each has, of which type.
_FIELDS = {
    "FLOAT": ("value", 1, np.float32), "INT": ("value", 1, np.int32), "BOOLEAN": ("value", 1, bool),
    "INT8": ("value", 1, np.int8), "INT16_2D": ("value", 2, np.int16), "INT32_2D": ("value", 2, np.int32),
    "FLOAT2": ("vector", 2, np.float32), "FLOAT_VECTOR": ("vector", 3, np.float32),
    "FLOAT_COLOR": ("color", 4, np.float32), "BYTE_COLOR": ("color", 4, np.float32),
    "QUATERNION": ("value", 4, np.float32), "FLOAT4X4": ("value", 16, np.float32),
}  # fmt: skip
_OF_THE_EDITOR = (".select", ".hide", ".uv_select", ".sculpt", ".pn", ".a_")


def mesh_digest(mesh: bpy.types.Mesh, generated: np.ndarray) -> str:
    """Of an evaluated mesh: its faces, all its attributes, and where generated coordinates are."""
    digest = hashlib.sha256()
    for attribute in sorted(mesh.attributes, key=lambda each: each.name):
        if attribute.name.startswith(_OF_THE_EDITOR):
            continue
        digest.update(f"{attribute.name} {attribute.domain} {attribute.data_type}".encode())
        if attribute.data_type in _FIELDS:
            field, width, dtype = _FIELDS[attribute.data_type]
            values = np.empty(len(attribute.data) * width, dtype)
            attribute.data.foreach_get(field, values)
            digest.update(values)
    starts = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_start", starts)
    digest.update(starts)
    digest.update(generated)
    render = next((layer.name for layer in mesh.uv_layers if layer.active_render), "")
    digest.update(f"{render} {mesh.color_attributes.default_color_name}".encode())
    return digest.hexdigest()


def generated_of(mesh: bpy.types.Mesh) -> np.ndarray:
    """(V, 3) f32: generated texture coordinates, as Cycles has them (blender/mesh.cpp): places before
    deforming modifiers, within the texture space."""
    places = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("undeformed_co", places)
    middle = np.array(mesh.texspace_location, np.float32)
    half = np.array(mesh.texspace_size, np.float32)
    inverse = np.where(half != 0.0, 0.5 / np.where(half != 0.0, half, 1.0), 0.0).astype(np.float32)
    return np.nan_to_num((places.reshape(-1, 3) - (middle - half)) * inverse)
