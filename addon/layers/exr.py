"""Layers as a multilayer OpenEXR, the way Blender writes its own passes.

A part for each layer, or one part for all. Parts and channels are named `<ViewLayer>.<Pass>` and
`<ViewLayer>.<Pass>.<C>`: Blender's reader groups by the last two dots, so passes have none
(addon/core/naming.py) while a view layer may.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..core.layers import Layer, LayerSet
from . import openexr, openimageio
from .exr_params import Codec, Depth, ExrParams, Parts, Window
from .files import replaced
from .openexr import Part

COMPOSITE = "Combined"  # Blender's name for the picture of the whole
LARGEST_HALF = 65504.0
DEFAULTS = ExrParams()

# Blender's working spaces under the names that the Color Interop Forum gave them.
COLOUR_INTEROP_IDS = {
    "Linear Rec.709": "lin_rec709_scene",
    "Linear Rec.2020": "lin_rec2020_scene",
    "ACEScg": "lin_ap1_scene",
}


def check_codec(params: ExrParams) -> None:
    """Raises StrataError where this machine cannot write `params.codec`: to be asked before the work."""
    if params.codec == Codec.DWAA:
        openimageio.library()


def write_layers(
    path: str | Path,
    layer_set: LayerSet,
    params: ExrParams = DEFAULTS,
    composite: np.ndarray | None = None,
) -> tuple[str, ...]:
    """Writes every layer of `layer_set`. The file is replaced whole or not at all. Returns warnings, which
    are in the report that the file holds too.

    `composite`, (height, width, 4) float32, comes first where `params` want it. Raises StrataError where the
    file cannot be written, ValueError where there is nothing to write (OpenEXR has no file of no parts).
    """
    layers = list(layer_set.images)
    if params.composite and composite is not None:
        layers.insert(0, Layer(COMPOSITE, "RGBA", composite, effect=""))
    if not layers:
        raise ValueError("an EXR needs at least one layer")
    warnings = []
    if params.depth == Depth.HALF:
        layers = [_clamped(layer, warnings) if layer.fits_half else layer for layer in layers]
    parts = [_part(layer_set, layer, params) for layer in layers]
    if params.parts == Parts.SINGLE:
        parts = [_joined(layer_set, layers, parts)]
    report = layer_set.report
    if warnings:
        report = {**report, "warnings": [*report.get("warnings", ()), *warnings]}
    parts[0].attributes["strata:report"] = to_json(report)
    parts[0].attributes["strata:working_space"] = layer_set.working_space
    with replaced(path) as stream:
        if params.codec == Codec.DWAA:
            openimageio.write_parts(stream.name, parts)
        else:
            openexr.write_parts(stream, parts)
    return tuple(warnings)


def layer_attributes(layer: Layer) -> dict[str, str | float]:
    """What the file says of a layer."""
    if not layer.effect:
        return layer.attributes
    return {
        "strata:effect": layer.effect,
        "strata:light": layer.light,
        "strata:settings": to_json(layer.settings),
        "strata:weight": layer.weight,
        "strata:placement": layer.placement,
        "strata:samples": float(layer.samples),
        "strata:seconds": layer.seconds,
        "strata:error": to_json(layer.error),
    }


def _clamped(layer: Layer, warnings: list[str]) -> Layer:
    """Finite values that float16 has no number for are its largest."""
    pixels = layer.pixels
    with np.errstate(invalid="ignore"):
        too_large = (np.abs(pixels) > LARGEST_HALF) & np.isfinite(pixels)
    count = np.count_nonzero(too_large)
    if not count:
        return layer
    warnings.append(f"layer '{layer.name}': {count} values are beyond 65504, the largest half: clamped")
    return replace(layer, pixels=np.where(too_large, np.copysign(np.float32(LARGEST_HALF), pixels), pixels))


def _part(layer_set: LayerSet, layer: Layer, params: ExrParams) -> Part:
    attributes = {
        "BlenderMultiChannel": "Blender V2.55.1 and newer",
        **layer_set.stamp,
        "colorInteropID": _interop_id(layer_set) if layer.is_colour else "data",
        **layer_attributes(layer),
        **_cut_from(layer_set),
    }
    name = f"{layer.view_layer or layer_set.view_layer}.{layer.name}"
    width, height = frame_size = layer_set.width, layer_set.height
    x0, y0, x1, y1 = 0, 0, width, height
    offset = 0, 0
    if layer_set.region and params.window == Window.REGION:
        frame_size = layer_set.frame_size or frame_size
        offset = layer_set.region[0], frame_size[1] - layer_set.region[3]
        if not layer_set.is_cropped:
            x0, y0, x1, y1 = layer_set.region
    # The one place that turns rows over: Blender's row 0 is the bottom, OpenEXR's the top.
    planes = {f"{name}.{letter}": plane[y0:y1, x0:x1][::-1] for letter, plane in layer.planes()}
    is_half = params.depth == Depth.HALF and layer.fits_half
    half = frozenset(planes) if is_half else frozenset()
    return Part(name, planes, attributes, layer_set.pixel_aspect, offset, frame_size, half)


def _joined(layer_set: LayerSet, layers: list[Layer], parts: list[Part]) -> Part:
    """All parts as one. What is said of a layer gets its name behind: `strata:error.<ViewLayer>.<Pass>`."""
    attributes: dict[str, str | float] = {}
    for layer, part in zip(layers, parts, strict=True):
        own = layer_attributes(layer)
        attributes |= {name: value for name, value in part.attributes.items() if name not in own}
        attributes |= {f"{name}.{part.name}": value for name, value in own.items()}
    if any(layer.is_colour for layer in layers):
        attributes["colorInteropID"] = _interop_id(layer_set)
    channels = {name: plane for part in parts for name, plane in part.channels.items()}
    half = frozenset().union(*(part.half for part in parts))
    return replace(parts[0], name="", channels=channels, attributes=attributes, half=half)


def _interop_id(layer_set: LayerSet) -> str:
    return COLOUR_INTEROP_IDS.get(layer_set.working_space, "unknown")


def _cut_from(layer_set: LayerSet) -> dict[str, str]:
    """Where a cropped picture was cut from: the offset of its top left pixel, as OpenEXR counts. Of a whole
    frame with a render region, where that lies in it."""
    if not layer_set.region:
        return {}
    x0, y0, x1, y1 = layer_set.region
    if not layer_set.is_cropped:
        place = {"offset": [x0, layer_set.height - y1], "size": [x1 - x0, y1 - y0]}
        return {"strata:region": to_json(place)}
    width, height = layer_set.frame_size
    return {"strata:cropped_from": to_json({"frame": [width, height], "offset": [x0, height - y1]})}


def to_json(value: dict[str, Any]) -> str:
    """Strict JSON: a NaN in an error would otherwise make a file that strict readers refuse."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
