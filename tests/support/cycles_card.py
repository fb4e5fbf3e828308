"""What Cycles makes of a material: a card that fills the picture, seen straight, one ray through the middle
of each pixel."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import OpenEXR


def card_scene(size: tuple[int, int] = (16, 16)) -> bpy.types.Object:
    """An empty file but for a card of 1 m with UVs from 0 to 1, and a camera above it that sees all of it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    mesh = bpy.data.meshes.new("Card")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    card = bpy.data.objects.new("Card", mesh)
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 1.0
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location = (0.5, 0.5, 1.0)
    for thing in (card, scene.camera):
        scene.collection.objects.link(thing)
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.film_transparent = True
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = "CPU", 1, False, False
    cycles.pixel_filter_type, cycles.filter_width = "GAUSSIAN", 0.01
    return card


def rendered(folder: Path) -> np.ndarray:
    """(H, W, 4) f32 as it is in the file, premultiplied; row 0 at the bottom."""
    return _channels(folder, list("RGBA"))


def diffuse_colour(folder: Path) -> np.ndarray:
    """(H, W, 3) f32: Cycles' pass of what diffuse light comes back by."""
    scene = bpy.context.scene
    scene.render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    scene.view_layers[0].use_pass_diffuse_color = True
    name = f"{scene.view_layers[0].name}.Diffuse Color"
    return _channels(folder, [f"{name}.{channel}" for channel in "RGB"])


def _channels(folder: Path, names: list[str]) -> np.ndarray:
    path = folder / "card.exr"
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {name: channel.pixels for part in file.parts for name, channel in part.channels.items()}
        return np.stack([channels[name] for name in names], axis=-1)[::-1].astype(np.float32)
