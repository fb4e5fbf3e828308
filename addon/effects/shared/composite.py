"""The picture of the whole: every light times its shadow layers, joined by what effects add to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...core.culling import around, receivers_in_view
from ...core.effect import LayerKind
from ...core.graph import Node, PlannedLayer
from ...core.outline import Light, Outline
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


class _Joined:
    """Images with how they join, one after the other."""

    def __init__(self):
        self.inputs: list[Node] = []
        self.joins: list[tuple] = []

    def add(self, how: Join, *nodes: Node, details: tuple = ()) -> None:
        self.inputs.extend(nodes)
        self.joins.append((how.value, *details))

    def picture(self, recorder: Recorder, colour: Node) -> Node:
        return recorder.step(lit.COMPOSITE, colour, *self.inputs, joins=tuple(self.joins))


def _joining(recorder: Recorder) -> list[PlannedLayer]:
    return [layer for layer in recorder.layers if layer.joins]


def _surfaces(
    recorder: Recorder, outline: Outline, brightness: Callable[[Light], tuple] = lit.brightness
) -> _Joined | None:
    """What comes from surfaces: every light that shines on what is in view, those without a layer unshadowed,
    emission and what adds to it; None where nothing is in view. `brightness`: what lights count as."""
    seen, receivers = receivers_in_view(outline, recorder.shot)
    if not len(receivers):
        return None
    visible = outline.instances.subset(seen)
    points = surface(recorder, outline, "material")
    region = around(receivers)
    layers, joined = _joining(recorder), _Joined()
    for index, light in enumerate(outline.lights):
        own = [layer for layer in layers if layer.of == Of.lamp(index)]
        if diffuse := [layer.node for layer in own if layer.role is Role.DIFFUSE]:
            for node in diffuse:
                joined.add(Join.ADD, node)
        elif lit.shines(light, visible, region):
            factors = [layer.node for role in PRODUCT for layer in own if layer.role is role]
            details = (brightness(light), len(factors))
            joined.add(Join.LIGHT, lit.irradiance(recorder, points, light), *factors, details=details)
    if (emission := lit.emission(recorder, outline, points, visible)) is not None:
        joined.add(Join.ADD, emission)
    for role in ADDED_BEFORE:
        for layer in layers:
            if layer.role is role:
                joined.add(Join.ADD, layer.node)
    return joined


def _before_the_eye(recorder: Recorder) -> list[PlannedLayer]:
    """What light from surfaces passes on its way to the eye."""
    layers = _joining(recorder)
    screens = _screens(layers)
    return [
        layer
        for layer in layers
        if layer.role is Role.TRANSMITTANCE and not layer.of.is_lamp and layer not in screens
    ]


def behind(recorder: Recorder, outline: Outline, layer: PlannedLayer, colour: Node) -> Node | None:
    """The picture that a layer of the eye's transmittance multiplies, on surfaces of a colour; None where
    nothing is in view. A negative light counts like any other: what weighs cannot be negative, and lights
    that cancel each other would leave nothing to weigh by."""
    joined = _surfaces(recorder, outline, lit.magnitude)
    if joined is None:
        return None
    for earlier in _before_the_eye(recorder):
        if earlier.name == layer.name:
            break
        joined.add(Join.MULTIPLY, earlier.node)
    return joined.picture(recorder, colour)


def record(recorder: Recorder, outline: Outline) -> None:
    """Adds the composite of everything recorded so far, as a layer of no effect.

    Layers join by their role (core/roles.py): first those that scale one light or are it, then emission and
    what else comes from surfaces, then those that all of this passes, then those that add light of their own,
    then those that lie over it, with the screens of their effects, and last an effect that was chosen and
    makes the picture anew. AMBIENT scales nothing yet: light of the world is not in the composite.
    """
    joined = _surfaces(recorder, outline)
    if joined is None:
        leave_out(recorder, outline, "nothing is in view")
        return
    layers = _joining(recorder)
    screens = _screens(layers)
    for layer in _before_the_eye(recorder):
        joined.add(Join.MULTIPLY, layer.node)
    for layer in layers:
        if layer.role is Role.SCATTERING:
            joined.add(Join.ADD, layer.node)
    over = [layer for layer in layers if layer.role is Role.OVER]
    if sorted_ones := [layer for layer in over if layer.depth is not None]:
        nodes = [node for layer in sorted_ones for node in (layer.node, layer.depth)]
        joined.add(Join.OVER_BY_DEPTH, *nodes, details=(len(sorted_ones),))
    for layer in layers:
        if layer in screens:
            joined.add(Join.MULTIPLY, layer.node)
        elif layer.role is Role.OVER and layer.depth is None:
            joined.add(Join.OVER, layer.node)
    picture = joined.picture(recorder, lit.base_colour(recorder, outline, surface(recorder, outline)))
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
