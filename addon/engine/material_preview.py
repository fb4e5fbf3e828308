"""The small pictures of materials in menus and in the asset browser: quick, and nothing that can fail."""

from __future__ import annotations

import bpy
import numpy as np

from ..scene.materials import Images, default_material, material_of

_LIGHT = np.array([-0.42, 0.55, 0.72])  # towards it, in the picture's axes; normalised below
_AMBIENT = 0.12


def picture(depsgraph: bpy.types.Depsgraph, width: int, height: int) -> np.ndarray:
    """(height, width, 4) float32, premultiplied: a lit ball of the material's base colour."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    scale = np.float32(0.46 * min(width, height))
    x, y = (x + 0.5 - 0.5 * width) / scale, (y + 0.5 - 0.5 * height) / scale
    squared = x * x + y * y
    normal = np.stack([x, y, np.sqrt(np.maximum(1.0 - squared, 0.0))], axis=-1)
    facing = np.maximum(normal @ (_LIGHT / np.linalg.norm(_LIGHT)).astype(np.float32), 0.0)
    # One pixel of soft edge.
    coverage = np.clip((1.0 - np.sqrt(squared)) * scale + 0.5, 0.0, 1.0)
    shade = (_AMBIENT + facing)[..., None] * np.float32(_colour(depsgraph))
    image = np.empty((height, width, 4), np.float32)
    image[..., :3] = shade * coverage[..., None]
    image[..., 3] = coverage
    return image


def _colour(depsgraph: bpy.types.Depsgraph) -> tuple[float, float, float]:
    """Of the material that the preview scene shows: Blender puts it on the objects of one of its collections;
    its floor and its lights have materials of their own, without a preview in the file."""
    for instance in depsgraph.object_instances:
        shown = instance.object
        material = shown.active_material if shown.type == "MESH" else None
        if material is not None and not shown.name.startswith("Floor"):
            read, _ = material_of(material, Images())
            base = material.diffuse_color[:3] if read.base_color_corners else read.base_color
            return tuple(colour + glow for colour, glow in zip(base, read.emission, strict=True))
    return default_material().base_color
