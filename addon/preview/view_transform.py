"""The scene's view transform as a table, made by Blender itself so that it is the one that Blender shows."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np

LOWEST, HIGHEST = -13, 6
"""Exponents of two of the levels that the table holds besides black; 1 is one of them, where Standard has its
kink. AgX and Filmic begin at -12.5, of which Filmic Log shows the most, and end at 16.3."""

STEPS = 4
"""Levels to a stop."""

SIZE = (HIGHEST - LOWEST) * STEPS + 2

_COPIED = (
    "view_transform",
    "look",
    "gamma",
    "use_curve_mapping",
    "use_white_balance",
    "white_balance_temperature",
    "white_balance_tint",
)


def levels() -> np.ndarray:
    """(SIZE,) float32 scene-linear values of the table's nodes, ascending."""
    steps = np.arange(SIZE - 1) / STEPS + LOWEST
    return np.concatenate([[0.0], np.exp2(steps)]).astype(np.float32)


def signature(scene: bpy.types.Scene) -> tuple:
    """Of the settings that the table depends on."""
    view = scene.view_settings
    curves = ()
    if view.use_curve_mapping:
        mapping = view.curve_mapping
        points = tuple((*p.location, p.handle_type) for curve in mapping.curves for p in curve.points)
        curves = (points, tuple(mapping.black_level), tuple(mapping.white_level), mapping.tone)
    own = tuple(getattr(view, name) for name in _COPIED)
    return own, curves, scene.display_settings.display_device, bpy.data.colorspace.working_space


def read(scene: bpy.types.Scene) -> np.ndarray:
    """(SIZE, SIZE, SIZE, 4) float32, blue first: what the display is sent for each level of red, green and
    blue, where the exposure is 0. Makes a scene and two images and removes them again, so it
    must not be called while Blender draws."""
    size = SIZE
    ramp = levels()
    pixels = np.ones((size, size, size, 4), np.float32)
    pixels[..., 0] = ramp
    pixels[..., 1] = ramp[:, None]
    pixels[..., 2] = ramp[:, None, None]
    scratch = bpy.data.scenes.new("Strata view transform")
    image = bpy.data.images.new("Strata view transform", size * size, size, alpha=True, float_buffer=True)
    try:
        _copy_settings(scene, scratch)
        image.pixels.foreach_set(pixels.ravel())
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "table.png"
            image.save_render(str(path), scene=scratch)
            return _levels_of(path).reshape(size, size, size, 4)
    finally:
        bpy.data.images.remove(image)
        bpy.data.scenes.remove(scratch)


def exposure_factor(scene: bpy.types.Scene) -> float:
    return float(2.0**scene.view_settings.exposure)


def _copy_settings(source: bpy.types.Scene, target: bpy.types.Scene) -> None:
    target.display_settings.display_device = source.display_settings.display_device
    for name in _COPIED:
        setattr(target.view_settings, name, getattr(source.view_settings, name))
    target.view_settings.exposure = 0.0
    if source.view_settings.use_curve_mapping:
        _copy_curves(source.view_settings.curve_mapping, target.view_settings.curve_mapping)
    settings = target.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGBA", "16"
    settings.compression = 0
    settings.color_management = "FOLLOW_SCENE"
    target.render.dither_intensity = 0.0


def _copy_curves(source: bpy.types.CurveMapping, target: bpy.types.CurveMapping) -> None:
    for name in ("black_level", "white_level", "tone", "extend"):
        setattr(target, name, getattr(source, name))
    for given, made in zip(source.curves, target.curves, strict=True):
        while len(made.points) < len(given.points):
            made.points.new(0.5, 0.5)
        while len(made.points) > len(given.points):
            made.points.remove(made.points[1])
        for point, copy in zip(given.points, made.points, strict=True):
            copy.location, copy.handle_type = point.location, point.handle_type
    target.update()


def _levels_of(path: Path) -> np.ndarray:
    """Numbers as the file has them, 0 to 1, row 0 at the bottom."""
    saved = bpy.data.images.load(str(path))
    try:
        saved.colorspace_settings.is_data = True
        saved.alpha_mode = "NONE"
        numbers = np.empty(saved.size[0] * saved.size[1] * 4, np.float32)
        saved.pixels.foreach_get(numbers)
    finally:
        bpy.data.images.remove(saved)
    return numbers
