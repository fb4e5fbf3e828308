"""Layers as images of the open Blender file."""

from __future__ import annotations

import numpy as np

from ..core.layers import Layer, LayerSet


def make_images(layer_set: LayerSet) -> list:
    """One new float `bpy.types.Image` a layer, in order.

    Always new: undo does not reliably cover pixels, so a user's image of the same name is left alone and
    Blender adds a number to ours. Data layers are Non-Color; colour is in the scene's working space.
    """
    return [_make_image(layer_set, layer) for layer in layer_set.layers]


def _make_image(layer_set: LayerSet, layer: Layer):
    import bpy

    image = bpy.data.images.new(
        layer.name,
        layer_set.width,
        layer_set.height,
        alpha=layer.channels.endswith("A"),
        float_buffer=True,
        is_data=not layer.is_colour,
    )
    if layer.is_colour:
        image.colorspace_settings.name = layer_set.working_space
        image.alpha_mode = "PREMUL"
    image.pixels.foreach_set(_rgba(layer).reshape(-1))
    image.update()
    return image


def _rgba(layer: Layer) -> np.ndarray:
    """(height, width, 4) float32: one channel is spread to grey, missing ones are 0, alpha 1."""
    height, width = layer.pixels.shape[:2]
    rgba = np.zeros((height, width, 4), np.float32)
    rgba[:, :, 3] = 1.0
    if layer.pixels.ndim == 2:
        rgba[:, :, :3] = layer.pixels[:, :, None]
    else:
        count = min(layer.pixels.shape[2], 4)
        rgba[:, :, :count] = layer.pixels[:, :, :count]
    return rgba
