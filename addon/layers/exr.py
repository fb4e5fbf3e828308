"""Layers as a multi-part, multilayer OpenEXR, the way Blender writes its own passes.

One part a pass. Part and channels are named `<ViewLayer>.<Pass>` and `<ViewLayer>.<Pass>.<C>`: Blender's
reader groups by the last two dots, so passes have none (addon/core/naming.py) while a view layer may.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..core.layers import Layer, LayerSet
from .files import replaced
from .openexr import Part, write_parts

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
    parts = [_part(layer_set, layer) for layer in layer_set.layers]
    parts[0].attributes["strata:report"] = _to_json(layer_set.report)
    parts[0].attributes["strata:working_space"] = layer_set.working_space
    with replaced(path) as stream:
        write_parts(stream, parts)


def _part(layer_set: LayerSet, layer: Layer) -> Part:
    interop_id = COLOUR_INTEROP_IDS.get(layer_set.working_space, "unknown") if layer.is_colour else "data"
    attributes = {
        "colorInteropID": interop_id,
        "strata:effect": layer.effect,
        "strata:light": layer.light,
        "strata:settings": _to_json(layer.settings),
        "strata:seconds": layer.seconds,
        "strata:error": _to_json(layer.error),
    }
    name = f"{layer_set.view_layer}.{layer.name}"
    # The one place that turns rows over: Blender's row 0 is the bottom, OpenEXR's the top.
    planes = {f"{name}.{letter}": plane[::-1] for letter, plane in layer.planes()}
    return Part(name, planes, attributes, layer_set.pixel_aspect)


def _to_json(value: dict[str, Any]) -> str:
    """Strict JSON: a NaN in an error would otherwise make a file that strict readers refuse."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
