"""What an effect talks to while it records: nothing runs here."""

from __future__ import annotations

from .effect import Effect, LayerKind
from .graph import Graph, LeftOut, Node, PlannedLayer, Step
from .naming import layer_name
from .outline import Outline


class Recorder:
    """Collects the steps of all effects into one graph; equal nodes are one node."""

    def __init__(self, outline: Outline):
        self.outline = outline
        self.effect: Effect | None = None  # whose steps are being recorded
        self._nodes: dict[str, Node] = {}
        self._layers: list[PlannedLayer] = []
        self._left_out: list[LeftOut] = []
        self._attributes: set[str] = set()
        self._instances: set[int] = set()
        self._surface: Node | None = None

    def step(self, step: Step, *inputs: Node, instance: str = "", **params) -> Node:
        """Records a step; asked twice, it is the same node."""
        node = Node(step, instance, inputs, params)
        return self._nodes.setdefault(node.key, node)

    def surface(self, step: Step, geometry: Node, attributes: tuple[str, ...], **params) -> Node:
        """The shading points, with at least these attributes. One for the whole graph."""
        self._attributes.update(attributes)
        self._surface = self.step(step, geometry, instance="camera", **params)
        return self._surface

    def reads_instances(self, instances) -> None:
        """Says which instances the recorded steps look at; others are never extracted."""
        self._instances.update(instances)

    @property
    def instances(self) -> frozenset[int]:
        """Read so far by any step."""
        return frozenset(self._instances)

    def layer(
        self,
        kind: LayerKind,
        node: Node,
        light_index: int | None = None,
        casters: frozenset[int] = frozenset(),
    ) -> None:
        """Declares an image made by `node`; `casters` are the instances that its reference has to trace."""
        light = "" if light_index is None else self.outline.lights[light_index].name
        name = layer_name(kind.title, light, (layer.name for layer in self._layers))
        layer = PlannedLayer(name, self.effect.id, node, kind.channels, light, light_index, casters)
        self._layers.append(layer)

    def left_out(self, what: str, reason: str, light: str = "") -> None:
        self._left_out.append(LeftOut(what, reason, self.effect.id if self.effect else "", light))

    def graph(self) -> Graph:
        return Graph(
            tuple(self._layers),
            tuple(self._left_out),
            self._surface,
            frozenset(self._attributes),
            frozenset(self._instances),
        )


def plan(outline: Outline, effects: dict[Effect, object]) -> Graph:
    """Records every effect that the scene needs; `effects` maps each to its parameters."""
    recorder = Recorder(outline)
    for effect, params in effects.items():
        recorder.effect = effect
        if reason := effect.needed(outline):
            recorder.left_out(effect.id, reason)
        else:
            effect.run(recorder, outline, params)
    return recorder.graph()
