"""Several view layers in one file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..addon.bake import Baked
from ..addon.core.layers import Layer, LayerSet
from ..addon.layers.exr import COMPOSITE


def joined(bakes: Sequence[Baked]) -> LayerSet:
    """The layers of bakes of one frame, each told its view layer, composites too, and a report of all: its
    steps, layers and what was left out say where they belong, seconds are sums."""
    sets = [bake.layers for bake in bakes]
    layers, error_images = [], []
    for bake, name in ((bake, bake.layers.view_layer) for bake in bakes):
        if bake.composite is not None:
            layers.append(Layer(COMPOSITE, "RGBA", bake.composite, effect="", view_layer=name))
        layers += (replace(layer, view_layer=name) for layer in bake.layers.layers)
        error_images += (replace(image, view_layer=name) for image in bake.layers.error_images)
    reports = [(each.view_layer, each.report) for each in sets]
    report = dict(reports[0][1])
    for key in ("steps", "layers", "left_out"):
        report[key] = [{**entry, "view_layer": name} for name, told in reports for entry in told[key]]
    for key in ("seconds", "compile_seconds"):
        report[key] = sum(told[key] for _, told in reports)
    report["peak_mb"] = max(told["peak_mb"] for _, told in reports)
    report["warnings"] = list(dict.fromkeys(w for _, told in reports for w in told["warnings"]))
    return replace(sets[0], layers=tuple(layers), error_images=tuple(error_images), report=report)
