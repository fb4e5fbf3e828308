"""Pixels of images, by their colour space."""

from __future__ import annotations

import bpy
import numpy as np

# CIE XYZ of a linear RGB working space (IEC 61966-2-1, ITU-R BT.2020, S-2014-004 adapted to D65 by Bradford).
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
_FROM_REC709 = {
    "Linear Rec.709": np.eye(3),
    "Linear Rec.2020": np.array(
        [
            [0.62740390, 0.32928304, 0.04331307],
            [0.06909729, 0.91954040, 0.01136232],
            [0.01639144, 0.08801331, 0.89559525],
        ]
    ),
    "ACEScg": np.array(
        [
            [0.61309740, 0.33952315, 0.04737945],
            [0.07019373, 0.91635388, 0.01345239],
            [0.02061559, 0.10956977, 0.86981463],
        ]
    ),
}
_DATA = {"Non-Color", "Linear Rec.709", "Linear", "Raw", "Generic Data"}


def pixels_of(image: bpy.types.Image) -> np.ndarray | None:
    """(H, W, 4) f32 as Blender keeps them, row 0 at the bottom; None for an image that cannot be loaded."""
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


def channel_of(
    pixels: np.ndarray, image: bpy.types.Image, channel: str, working_space: str
) -> tuple[np.ndarray, str]:
    """'ALPHA' and 'LUMINANCE' (H, W) f32, 'COLOR' (H, W, 4) f32, scene-linear; and a warning or ''."""
    if channel == "ALPHA":
        if image.alpha_mode == "NONE":
            return np.ones(pixels.shape[:2], np.float32), ""
        return np.ascontiguousarray(pixels[..., 3]), ""
    colours, warning = _scene_linear(pixels[..., :3], image, working_space)
    if channel == "LUMINANCE":
        return np.ascontiguousarray(colours @ _LUMINANCE), warning
    return np.concatenate([colours, pixels[..., 3:]], axis=2), warning


def _scene_linear(colours: np.ndarray, image: bpy.types.Image, working_space: str) -> tuple[np.ndarray, str]:
    # Blender converts float images when it loads them; byte images keep what the file says.
    space = image.colorspace_settings.name
    if image.is_float or space == "Non-Color":
        return colours.copy(), ""
    warning = ""
    if space not in _DATA:
        if space != "sRGB":
            warning = f"image '{image.name_full}' has colour space '{space}', it is read as sRGB"
        low = colours / 12.92
        high = ((np.maximum(colours, 0.04045) + 0.055) / 1.055) ** 2.4
        colours = np.where(colours <= 0.04045, low, high).astype(np.float32)
    matrix = _FROM_REC709.get(working_space)
    if matrix is None:
        return (
            colours,
            warning or f"working space '{working_space}' is not known, textures are left in Rec.709",
        )
    return (colours @ matrix.T.astype(np.float32)).astype(np.float32), warning
