"""What all files of a sequence have, and what stands in a file where its frame does not need it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .effect import LayerKind
from .graph import Graph, LeftOut, PlannedLayer
from .layers import Layer
from .naming import lamp_pass_name, layer_name
from .outline import Outline
from .params import in_words


@dataclass(frozen=True)
class SequenceLayer:
    """A layer that some frame needs; `effect` is the effect's id, `light` the lamp's own name and
    `pass_name` that in passes."""

    name: str
    kind: LayerKind
    effect: str
    light: str = ""
    pass_name: str = ""

    @classmethod
    def of(cls, layer: PlannedLayer) -> SequenceLayer:
        return cls(layer.name, layer.kind, layer.effect, layer.light, layer.pass_name)

    def neutral(self, size: tuple[int, int], settings: dict[str, Any]) -> Layer:
        """For a frame of `size`, width and height, that does not need it. Its pixels are one number, repeated
        by strides of 0."""
        depth = () if len(self.kind.channels) == 1 else (len(self.kind.channels),)
        value = np.float32(self.kind.role.neutral)
        pixels = np.broadcast_to(value, (size[1], size[0], *depth))
        return Layer(self.name, self.kind.channels, pixels, self.effect, self.light, settings=settings)


def with_neutral(
    graph: Graph, sequence: Iterable[SequenceLayer], outline: Outline
) -> tuple[Graph, tuple[SequenceLayer, ...]]:
    """Layers of the sequence that the graph does not make, and the graph with the reasons why, each in one
    entry."""
    there = {layer.name for layer in graph.layers}
    missing = tuple(layer for layer in sequence if layer.name not in there)
    left_out = tuple(
        LeftOut(
            layer.name,
            f"neutral ({layer.kind.role.neutral:g}), other frames need it: {_reason(layer, graph, outline)}",
            layer.effect,
            layer.light,
        )
        for layer in missing
    )
    named = {entry.what for entry in left_out}
    others = tuple(entry for entry in graph.left_out if entry.what not in named)
    return replace(graph, left_out=others + left_out), missing


def _reason(layer: SequenceLayer, graph: Graph, outline: Outline) -> str:
    """Why a frame does not need it, as its plan says."""
    named = {light.pass_name or lamp_pass_name(light.name, light.key) for light in outline.lights}
    if layer.light and not any(layer_name(layer.kind.title, name) == layer.name for name in named):
        return "the lamp is not there"
    subjects = (f"{layer.kind.title} {layer.light}".strip(), layer.kind.title, in_words(layer.effect))
    for subject in subjects:
        for entry in graph.left_out:
            if entry.effect == layer.effect and entry.what == subject:
                return entry.reason
    return "nothing needs it"
