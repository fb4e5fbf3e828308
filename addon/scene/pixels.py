"""Pixels of images, by their colour space."""

from __future__ import annotations

from functools import cache
from hashlib import sha256

import bpy
import mathutils
import numpy as np

from .tiles import tiled_pixels, tiles_content

_LINEAR_REC709 = {"Linear Rec.709", "Linear"}


_ROWS = 64  # converted at a time: the steps in between would take several times what an image does
LARGEST = 4096  # texels a side of what is put together or evaluated


def pixels_of(image: bpy.types.Image) -> np.ndarray | None:
    """(H, W, 4) f32 as Blender keeps them, row 0 at the bottom; None for an image that cannot be loaded."""
    if image.source == "TILED":
        return tiled_pixels(image, LARGEST)
    width, height = image.size
    channels = image.channels
    if width * height == 0 or channels not in {1, 3, 4}:
        return None
    flat = np.empty(width * height * channels, np.float32)
    try:
        image.pixels.foreach_get(flat)
    except (RuntimeError, TypeError):
        return None
    pixels = flat.reshape(height, width, channels)
    if channels == 4:
        return pixels
    whole = np.ones((height, width, 4), np.float32)
    whole[..., :3] = pixels
    return whole


def content_of(image: bpy.types.Image) -> tuple:
    """Differs wherever `pixels_of`, or what `channel_of` makes of it, may."""
    kind = image.alpha_mode, image.colorspace_settings.name, image.is_float
    if image.source == "TILED":
        return (*kind, *tiles_content(image))
    pixels = pixels_of(image)
    return (*kind, None) if pixels is None else (*kind, pixels.shape, sha256(pixels).digest())


def channel_of(
    pixels: np.ndarray, image: bpy.types.Image, channel: str, is_straight: bool = True
) -> tuple[np.ndarray, str]:
    """'ALPHA' and 'LUMINANCE' (H, W) f32, 'COLOR' (H, W, 4) f32 in the working space; a warning or ''.

    Cycles multiplies the colours in the file by alpha before they become linear. `is_straight`: it divides
    again, as where a node's Alpha is used beside its Color."""
    if channel == "ALPHA":
        if image.alpha_mode == "NONE":
            return np.ones(pixels.shape[:2], np.float32), ""
        return np.ascontiguousarray(pixels[..., 3]), ""
    height, width = pixels.shape[:2]
    found = np.empty((height, width) if channel == "LUMINANCE" else (height, width, 4), np.float32)
    weights, warning = luminance_weights().astype(np.float32), ""
    for rows in (slice(start, start + _ROWS) for start in range(0, height, _ROWS)):
        colours, warning = _scene_linear(_encoded(pixels[rows], image, is_straight), image)
        if channel == "LUMINANCE":
            found[rows] = colours @ weights
        else:
            found[rows, :, :3], found[rows, :, 3] = colours, pixels[rows, :, 3]
    return found, warning


def _encoded(pixels: np.ndarray, image: bpy.types.Image, is_straight: bool) -> np.ndarray:
    """Colours (H, W, 3) as in the file, times alpha or not."""
    encoded, alpha = pixels[..., :3], pixels[..., 3:]
    is_kept_straight = image.alpha_mode == "STRAIGHT"
    if not has_own_alpha(image) or is_straight == is_kept_straight:
        return encoded
    if is_straight:
        return np.where(alpha > 0.0, encoded / np.where(alpha > 0.0, alpha, 1.0), encoded)
    return encoded * alpha


def has_own_alpha(image: bpy.types.Image) -> bool:
    """Whether its alpha says how much of its colour there is."""
    return image.alpha_mode in {"STRAIGHT", "PREMUL"} and not image.colorspace_settings.is_data


def _scene_linear(colours: np.ndarray, image: bpy.types.Image) -> tuple[np.ndarray, str]:
    # Blender converts float images when it loads them; byte images keep what the file says.
    space = image.colorspace_settings.name
    if image.is_float or image.colorspace_settings.is_data:
        return colours, ""
    warning = ""
    if space not in _LINEAR_REC709:
        if space != "sRGB":
            warning = f"image '{image.name_full}' has colour space '{space}', it is read as sRGB"
        # IEC 61966-2-1.
        low = colours / 12.92
        high = ((np.maximum(colours, 0.04045) + 0.055) / 1.055) ** 2.4
        colours = np.where(colours <= 0.04045, low, high).astype(np.float32)
    return colours @ _working_primaries(), warning


def luminance_weights() -> np.ndarray:
    """(3,) float64: what Cycles turns a colour of the file's working space into a float with."""
    return _weights_of(bpy.data.colorspace.working_space)


@cache
def _weights_of(_working_space: str) -> np.ndarray:
    weights = np.array(
        [mathutils.Color(unit).from_scene_linear_to_xyz_d65()[1] for unit in np.eye(3).tolist()], np.float64
    )
    return weights / weights.sum()


def _working_primaries() -> np.ndarray:
    """(3, 3) f32: rows are Rec.709's red, green and blue in the file's working space, told by Blender."""
    return np.array(
        [mathutils.Color(unit).from_rec709_linear_to_scene_linear()[:] for unit in np.eye(3).tolist()],
        np.float32,
    )
