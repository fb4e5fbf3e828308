"""Reads the layers of a file back, with the OpenEXR library, which had no part in writing it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from strata.addon.core.layers import Layer, LayerSet


def read_layers(path: str | Path) -> LayerSet:
    """All that `write_layers` wrote, except `of`."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        parts = [(part.name(), dict(part.header), _planes(part)) for part in file.parts]
    first = parts[0][1]
    layers = tuple(_layer(name, header, planes) for name, header, planes in parts)
    height, width = layers[0].pixels.shape[:2]
    return LayerSet(
        layers,
        width,
        height,
        view_layer=parts[0][0].rpartition(".")[0],
        working_space=first["strata:working_space"],
        report=json.loads(first["strata:report"]),
        pixel_aspect=first["pixelAspectRatio"],
    )


def _planes(part) -> dict[str, np.ndarray]:
    """(height, width) arrays by channel letter, bottom row first."""
    return {name.rpartition(".")[2]: channel.pixels[::-1] for name, channel in part.channels.items()}


def _layer(part_name: str, header: dict[str, Any], planes: dict[str, np.ndarray]) -> Layer:
    # OpenEXR sorts channels by name; ours come in the order that Blender gives them a meaning in.
    channels = "".join(sorted(planes, key="RGBXYZWUVA".index))
    pixels = np.stack([planes[letter] for letter in channels], axis=-1)
    return Layer(
        name=part_name.rpartition(".")[2],
        channels=channels,
        pixels=np.ascontiguousarray(pixels[:, :, 0] if len(channels) == 1 else pixels),
        effect=header["strata:effect"],
        light=header["strata:light"],
        seconds=header["strata:seconds"],
        error=json.loads(header["strata:error"]),
        settings=json.loads(header["strata:settings"]),
        weight=header["strata:weight"],
    )
