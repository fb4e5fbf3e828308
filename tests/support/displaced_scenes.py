"""Materials that displace, for tests."""

from __future__ import annotations

import bpy
import numpy as np


def displacing(name="Terrain", height=None, midlevel=0.5, scale=1.0, method="DISPLACEMENT", space="OBJECT"):
    """A material; `height` is a number, an image, or None for noise."""
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    material.displacement_method = method
    move = tree.nodes.new("ShaderNodeDisplacement")
    move.space = space
    move.inputs["Midlevel"].default_value, move.inputs["Scale"].default_value = midlevel, scale
    if isinstance(height, float):
        move.inputs["Height"].default_value = height
    elif height is None:
        tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], move.inputs["Height"])
    else:
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image = height
        tree.links.new(texture.outputs["Color"], move.inputs["Height"])
    tree.links.new(move.outputs[0], tree.nodes["Material Output"].inputs["Displacement"])
    return material


def image_of(heights: np.ndarray, is_float: bool = True):
    """An image of (H, W) numbers, row 0 at the bottom."""
    height, width = heights.shape
    image = bpy.data.images.new("Heights", width, height, float_buffer=is_float, is_data=True)
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = heights[..., None]
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    return image


def grid(name, cells, size=2.0):
    """A grid in the plane z = 0, with its UV map from corner to corner."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=cells, y_subdivisions=cells, size=size)
    made = bpy.context.object
    made.name = name
    return made
