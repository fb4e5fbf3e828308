"""The picture of the whole: every light times its shadow layers, joined by what effects add to it."""

from __future__ import annotations

from collections.abc import Sequence

from ...core.culling import around, receivers_in_view
from ...core.effect import LayerKind
from ...core.graph import Node, PlannedLayer
from ...core.outline import Outline
from ...core.recorder import Recorder
from ...core.roles import PRODUCT, THE_IMAGE, Of, Role
from . import lit
from .joins import Join
from .steps import surface

KIND = LayerKind(
    title="Composite",
    channels="RGBA",
    doc="Diffuse light of all lamps with all layers joined; alpha is coverage, colour is premultiplied",
)

ADDED_BEFORE = (Role.SPECULAR, Role.INDIRECT)
"""Light from surfaces, as that of lamps."""


def record(recorder: Recorder, outline: Outline) -> None:
    """Adds the composite of everything recorded so far, as a layer of no effect.

    Every light that shines on what is in view counts, those without a layer unshadowed. Layers join by their
    role (core/roles.py): first those that scale one light or are it, then emission and what else comes from
    surfaces, then those that all of this passes, then those that add light of their own, then those that lie
    over it, with the screens of their effects, and last an effect that was chosen and makes the picture anew.
    AMBIENT scales nothing yet: light of the world is not in the composite.
    """
    seen, receivers = receivers_in_view(outline, recorder.shot)
    if not len(receivers):
        leave_out(recorder, outline, "nothing is in view")
        return
    visible = outline.instances.subset(seen)
    points = surface(recorder, outline, "material")
    region = around(receivers)
    layers = [layer for layer in recorder.layers if layer.joins]
    inputs: list[Node] = []
    joins: list[tuple] = []

    def join(how: Join, *nodes: Node, details: tuple = ()) -> None:
        inputs.extend(nodes)
        joins.append((how.value, *details))

    for index, light in enumerate(outline.lights):
        own = [layer for layer in layers if layer.of == Of.lamp(index)]
        if diffuse := [layer.node for layer in own if layer.role is Role.DIFFUSE]:
            for node in diffuse:
                join(Join.ADD, node)
        elif lit.shines(light, visible, region):
            factors = [layer.node for role in PRODUCT for layer in own if layer.role is role]
            details = (lit.brightness(light), len(factors))
            join(Join.LIGHT, lit.irradiance(recorder, points, light), *factors, details=details)
    if (emission := lit.emission(recorder, outline, points, visible)) is not None:
        join(Join.ADD, emission)
    for role in ADDED_BEFORE:
        for layer in layers:
            if layer.role is role:
                join(Join.ADD, layer.node)
    screens = _screens(layers)
    for layer in layers:
        if layer.role is Role.TRANSMITTANCE and not layer.of.is_lamp and layer not in screens:
            join(Join.MULTIPLY, layer.node)
    for layer in layers:
        if layer.role is Role.SCATTERING:
            join(Join.ADD, layer.node)
    over = [layer for layer in layers if layer.role is Role.OVER]
    if sorted_ones := [layer for layer in over if layer.depth is not None]:
        nodes = [node for layer in sorted_ones for node in (layer.node, layer.depth)]
        join(Join.OVER_BY_DEPTH, *nodes, details=(len(sorted_ones),))
    for layer in layers:
        if layer in screens:
            join(Join.MULTIPLY, layer.node)
        elif layer.role is Role.OVER and layer.depth is None:
            join(Join.OVER, layer.node)
    albedo = lit.base_colour(recorder, outline, points)
    picture = recorder.step(lit.COMPOSITE, albedo, *inputs, joins=tuple(joins))
    for number, offer in enumerate(recorder.chosen_offers(Role.PICTURE)):
        if number == 0:
            picture = recorder.ask(Role.PICTURE, THE_IMAGE, picture)
            first = offer.effect.title
        else:
            recorder.left_out(offer.effect.title, f"{first} makes the picture anew, and only one can")
    recorder.layer(KIND, picture)


def _screens(layers: Sequence[PlannedLayer]) -> list[PlannedLayer]:
    """What a picture passes that an effect has laid over it before: dots are on its colours, and what lies
    over the dots was recorded after them."""
    covering, found = set(), []
    for layer in layers:
        if layer.role is Role.OVER:
            covering.add(layer.effect)
        elif layer.role is Role.TRANSMITTANCE and not layer.of.is_lamp and layer.effect in covering:
            found.append(layer)
    return found


def leave_out(
    recorder: Recorder, outline: Outline, reason: str = "it makes the composite anew, and none is made"
) -> None:
    """Where no composite is made: notes what would make it anew."""
    for offer in recorder.chosen_offers(Role.PICTURE):
        recorder.left_out(offer.effect.title, reason)
