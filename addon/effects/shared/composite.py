"""The picture of the whole: every light times its shadow layers, joined by what effects add to it."""

from __future__ import annotations

from ...core.culling import around, receivers_in_view
from ...core.effect import LayerKind
from ...core.graph import Node
from ...core.outline import Outline
from ...core.recorder import Recorder
from ...core.roles import Of, Role
from . import lit
from .joins import Join
from .steps import surface

KIND = LayerKind(
    title="Composite",
    channels="RGBA",
    doc="Diffuse light of all lamps with all layers joined; alpha is coverage, colour is premultiplied",
)

JOINS = {Role.TRANSMITTANCE: Join.MULTIPLY, Role.SCATTERING: Join.ADD, Role.OVER: Join.OVER}


def record(recorder: Recorder, outline: Outline) -> None:
    """Adds the composite of everything recorded so far, as a layer of no effect.

    Every light that shines on what is in view counts, those without a layer unshadowed. Layers join as
    their kind declares (`LayerKind.role`): first those that scale one light, then emission, then those that
    all light from surfaces passes, then those that add light of their own, and last those that lie over it.
    """
    seen, receivers = receivers_in_view(outline, recorder.shot)
    if not len(receivers):
        return
    visible = outline.instances.subset(seen)
    surface(recorder, outline, visible, "material")
    region = around(receivers)
    inputs: list[Node] = []
    joins: list[tuple] = []
    for index, light in enumerate(outline.lights):
        if not lit.shines(light, visible, region):
            continue
        shadows = [
            layer.node
            for layer in recorder.layers
            if layer.joins and layer.role is Role.VISIBILITY and layer.of == Of.lamp(index)
        ]
        inputs += [lit.irradiance(recorder, outline, light), *shadows]
        joins.append((Join.LIGHT.value, lit.brightness(light), len(shadows)))
    if (emission := lit.emission(recorder, outline, visible)) is not None:
        inputs.append(emission)
        joins.append((Join.ADD.value,))
    for role, join in JOINS.items():
        for layer in recorder.layers:
            if layer.role is role:
                inputs.append(layer.node)
                joins.append((join.value,))
    albedo = lit.base_colour(recorder, outline)
    recorder.layer(KIND, recorder.step(lit.COMPOSITE, albedo, *inputs, joins=tuple(joins)))
