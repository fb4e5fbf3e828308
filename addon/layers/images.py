"""Layers as images of the open Blender file: one for each layer of a scene's view layer, made by its first
bake and filled anew by every later one.

An image's pixels are an OpenEXR packed into the Blender file: so nothing waits to be saved when Blender is
closed, and undo, which does not cover the pixels of other images reliably, brings them back with the rest.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.layers import Layer, LayerSet
from . import openexr
from .exr import layer_attributes

if TYPE_CHECKING:
    import bpy

_FRAME_NUMBER = re.compile(r"\d+(?=\D*$)")  # the last one of a name, as Blender counts
MARK = "strata"
"""The custom property of an image of ours: which scene, view layer and layer it is of."""


def packed(layer_set: LayerSet) -> tuple[bytes, ...]:
    """Each layer as the OpenEXR that its image keeps, in order. On any thread."""
    return tuple(_packed(layer, layer_set.pixel_aspect) for layer in layer_set.images)


def fill_images(scene: str, layer_set: LayerSet, files: Iterable[bytes]) -> list[bpy.types.Image]:
    """The images of a scene's layers, in order; those that are not there are made. `scene`: its name;
    `files`: what `packed` makes of `layer_set`.

    An image without our mark is somebody else's, whatever it is called: it is left alone, and Blender adds a
    number to the name of ours. Data layers are Non-Color; colour is in the scene's working space.
    """
    return [_filled(scene, layer_set, *each) for each in zip(layer_set.images, files, strict=True)]


def image_of(scene: str, view_layer: str, layer: str) -> bpy.types.Image | None:
    """Our image of a layer; None where there is none."""
    wanted = {"scene": scene, "view_layer": view_layer, "layer": layer}
    found = [image for image, mark in _marked() if mark == wanted]
    # Of a user's copies of it the one that has its name.
    return min(found, key=lambda image: (image.name != layer, image.name), default=None)


def file_image(path: Path) -> bpy.types.Image:
    """An image that shows a file; one that does so already is taken."""
    import bpy

    shown = (image for image in _images_of_file(path) if image.source == "FILE")
    return next(shown, None) or bpy.data.images.load(str(path))


def reload_file(path: Path) -> None:
    """For images of a file that was written anew: as one of a sequence, too."""
    for image in _images_of_file(path):
        image.reload()
        image.update_tag()


def _images_of_file(path: Path) -> list[bpy.types.Image]:
    import bpy

    def place(name: str, is_sequence: bool) -> tuple[str, str]:
        folder, name = os.path.split(os.path.realpath(name))
        return folder, _FRAME_NUMBER.sub("#", name) if is_sequence else name

    found = []
    for image in bpy.data.images:
        if image.source in ("FILE", "SEQUENCE") and image.filepath and image.packed_file is None:
            name = bpy.path.abspath(image.filepath, library=image.library)
            is_sequence = image.source == "SEQUENCE"
            if place(name, is_sequence) == place(str(path), is_sequence):
                found.append(image)
    return found


def _marked() -> Iterator[tuple[bpy.types.Image, dict[str, str]]]:
    import bpy

    for image in bpy.data.images:
        mark = image.get(MARK)
        if image.is_editable and hasattr(mark, "to_dict"):
            yield image, mark.to_dict()


def _left_behind(layer: str) -> bpy.types.Image | None:
    """An image of a scene or view layer that is no more: renamed, most likely."""
    import bpy

    for image, mark in _marked():
        scene = bpy.data.scenes.get(mark.get("scene", ""))
        if mark.get("layer") == layer and (scene is None or mark.get("view_layer") not in scene.view_layers):
            return image
    return None


def _filled(scene: str, layer_set: LayerSet, layer: Layer, file: bytes) -> bpy.types.Image:
    image = image_of(scene, layer_set.view_layer, layer.name) or _left_behind(layer.name) or _new(layer.name)
    image[MARK] = {"scene": scene, "view_layer": layer_set.view_layer, "layer": layer.name}
    image.source = "FILE"
    image.colorspace_settings.name = layer_set.working_space if layer.is_colour else "Non-Color"
    image.alpha_mode = "PREMUL" if layer.is_colour else "STRAIGHT"
    image.pack(data=file, data_len=len(file))
    image.buffers_free()  # whoever shows it reads it anew
    image.update_tag()
    return image


def _new(name: str) -> bpy.types.Image:
    import bpy

    image = bpy.data.images.new(name, 1, 1, float_buffer=True)
    image.use_fake_user = True  # Blender saves no image that nobody uses
    return image


def _packed(layer: Layer, pixel_aspect: float) -> bytes:
    """One channel is Y, which Blender spreads to grey; more are R, G, B, A in order, whatever they mean."""
    names = "Y" if len(layer.channels) == 1 else "RGBA"
    planes = {name: plane[::-1] for name, (_, plane) in zip(names, layer.planes(), strict=False)}
    stream = BytesIO()
    openexr.write_parts(stream, [openexr.Part("", planes, layer_attributes(layer), pixel_aspect)])
    return stream.getvalue()
