"""Layers as a multi-part, multilayer OpenEXR, the way Blender writes its own passes.

One part a pass. Part and channels are named `<ViewLayer>.<Pass>` and `<ViewLayer>.<Pass>.<C>`: Blender's
reader groups by the last two dots, so passes have none (addon/core/naming.py) while a view layer may.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import StrataError
from ..core.layers import Layer, LayerSet
from .files import replaced

# Blender's working spaces under the names that the Color Interop Forum gave them.
COLOUR_INTEROP_IDS = {
    "Linear Rec.709": "lin_rec709_scene",
    "Linear Rec.2020": "lin_rec2020_scene",
    "ACEScg": "lin_ap1_scene",
}


def write_layers(path: str | Path, layer_set: LayerSet) -> None:
    """Writes every layer of `layer_set`, float32, ZIP. The file is replaced whole or not at all.

    Raises StrataError where the file cannot be written, ValueError where there is no layer (OpenEXR has no
    file of no parts).
    """
    if not layer_set.layers:
        raise ValueError("an EXR needs at least one layer")
    from OpenEXR import File  # a native wheel: loaded by the first bake, not by enabling the extension

    parts = [_part(layer_set, layer) for layer in layer_set.layers]
    parts[0].header["strata:report"] = _to_json(layer_set.report)
    parts[0].header["strata:working_space"] = layer_set.working_space
    with replaced(path) as stream:
        File(parts).write(stream)


def _part(layer_set: LayerSet, layer: Layer):
    from OpenEXR import ZIP_COMPRESSION, Part, Storage

    interop_id = COLOUR_INTEROP_IDS.get(layer_set.working_space, "unknown") if layer.is_colour else "data"
    header = {
        "type": Storage.scanlineimage,
        "compression": ZIP_COMPRESSION,
        "pixelAspectRatio": float(layer_set.pixel_aspect),
        "colorInteropID": interop_id,
        "strata:effect": layer.effect,
        "strata:light": layer.light,
        "strata:settings": _to_json(layer.settings),
        "strata:seconds": float(layer.seconds),
        "strata:error": _to_json(layer.error),
    }
    name = f"{layer_set.view_layer}.{layer.name}"
    # The one place that turns rows over: Blender's row 0 is the bottom, OpenEXR's the top.
    planes = {f"{name}.{letter}": np.ascontiguousarray(plane[::-1]) for letter, plane in layer.planes()}
    return Part(header, planes, name)


def read_layers(path: str | Path) -> LayerSet:
    """The layers of a file that `write_layers` wrote, except `light_index`. Raises StrataError."""
    from OpenEXR import File

    try:
        with File(str(path), separate_channels=True) as file:
            parts = [(part.name(), dict(part.header), _planes(part)) for part in file.parts]
    except (OSError, RuntimeError) as error:
        raise StrataError(f"cannot read {path}: {error}") from None
    first = parts[0][1]
    if "strata:report" not in first:
        raise StrataError(f"cannot read {path}: Strata did not write it")
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
    )


def _to_json(value: dict[str, Any]) -> str:
    """Strict JSON: a NaN in an error would otherwise make a file that strict readers refuse."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
