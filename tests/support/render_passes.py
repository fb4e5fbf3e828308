"""Reads back what Blender itself wrote, with the OpenEXR library."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import OpenEXR


def read_passes(path: str | Path) -> dict[str, np.ndarray]:
    """(height, width[, channels]) float32 by `<view layer>.<pass>`, row 0 at the bottom."""
    found: dict[str, dict[str, np.ndarray]] = {}
    with OpenEXR.File(str(path), separate_channels=True) as file:
        for part in file.parts:
            for name, channel in part.channels.items():
                owner, _, letter = name.rpartition(".")
                found.setdefault(owner, {})[letter] = channel.pixels[::-1]
    return {name: _stacked(planes) for name, planes in found.items()}


def _stacked(planes: dict[str, np.ndarray]) -> np.ndarray:
    letters = sorted(planes, key="RGBXYZWUVA".index)
    image = np.stack([planes[letter] for letter in letters], axis=-1)
    return image[:, :, 0] if len(letters) == 1 else image


def write_multilayer(scene: bpy.types.Scene, path: Path) -> None:
    """Sets up the render's own output: multilayer EXR, 32 bits, so that nothing is rounded."""
    settings = scene.render.image_settings
    settings.media_type = "MULTI_LAYER_IMAGE"
    settings.color_depth = "32"
    scene.render.filepath = str(path)
