"""What an effect talks to while it records: nothing runs here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import replace

from .effect import Effect, LayerKind, Need, Offer
from .graph import Graph, LeftOut, Node, PlannedLayer, Step
from .naming import lamp_pass_name, layer_name, named_some
from .outline import Outline
from .params import Params
from .roles import THE_IMAGE, Of, Role, Subject
from .shot import Shot
from .surface import ATTRIBUTES


class Recorder:
    """Collects the steps of all effects for one shot into a graph; equal nodes are one node."""

    def __init__(
        self,
        outline: Outline,
        shot: Shot,
        offers: Mapping[Role, tuple[Offer, ...]] | None = None,
        lamps: tuple[int, ...] | None = None,
        keeps_unused: bool = False,
        without: Mapping[str, str] | None = None,
        traces_rays: bool = True,
    ):
        self.outline = outline
        self.shot = shot
        # Of which lights to record layers, by index; where it is not all, other layers are not wanted at all.
        self.lamps = tuple(range(len(outline.lights))) if lamps is None else lamps
        self._wants_others = lamps is None
        self._keeps_unused = keeps_unused
        self._without = without or {}
        self._traces_rays = traces_rays
        self._offers = {
            role: tuple(
                sorted(
                    (offer for offer in offered if self._meets(offer.effect.needs)),
                    # What the scene does not need makes no layers that another could not make in its place.
                    key=lambda offer: offer.effect.needed(outline) is not None,
                )
            )
            for role, offered in (offers or {}).items()
        }
        self.effect: Effect | None = None  # whose steps are being recorded
        self.params: Params | None = None  # that effect's
        self._nodes: dict[str, Node] = {}
        self._layers: list[PlannedLayer] = []
        self._left_out: list[LeftOut] = []
        self._instance_sets: set[frozenset[int]] = set()
        self._wants: set[str] = set()
        self._surfaces: dict[Node, set[str]] = {}
        self._own_surface: Node | None = None

    @property
    def layers(self) -> tuple[PlannedLayer, ...]:
        """Declared so far."""
        return tuple(self._layers)

    def step(self, step: Step, *inputs: Node, instance: str = "", **params) -> Node:
        """Records a step; asked twice, it is the same node."""
        node = Node(step, instance, inputs, params)
        return self._nodes.setdefault(node.key, node)

    def surface(self, node: Node, *attributes: str) -> Node:
        """Says that the node's values are shading points, and that these attributes of them are read
        (core/surface.py)."""
        self._surfaces.setdefault(node, set()).update(attributes)
        self._wants.update(ATTRIBUTES[name].wants for name in attributes if ATTRIBUTES[name].wants)
        return node

    def own_surface(self, node: Node, *attributes: str) -> Node:
        """The same of the shot's own shading points: one node for all effects, which the composite, the
        coarse picture and the probes rest on. Raises ValueError if it is another than before."""
        if self._own_surface not in (None, node):
            raise ValueError("a shot has one surface of its own")
        self._own_surface = node
        return self.surface(node, *attributes)

    def reads_instances(self, instances: frozenset[int]) -> None:
        """Says which instances the recorded steps look at; others are never extracted."""
        if instances in self._instance_sets:
            return
        self._instance_sets.add(instances)
        materials = self.outline.instances.materials_of(instances)
        for opacity in {each for m in materials for each in self.outline.materials[m].opacities}:
            if opacity.image is not None:
                self._wants.update(("uv", "opacity"))
            if opacity.corners:
                self._wants.add("opacity")

    def wants(self, *names: str) -> None:
        """Asks the extraction for more (names as in addon/scene/extract.py)."""
        self._wants.update(names)

    @property
    def instances(self) -> frozenset[int]:
        """Read so far by any step."""
        parts = frozenset(self._instance_sets)
        return self.outline.instances.memo(("union", parts), lambda: frozenset().union(*parts))

    def layer(
        self,
        kind: LayerKind,
        node: Node,
        of: Of | None = None,
        casters: frozenset[int] = frozenset(),
        depth: Node | None = None,
    ) -> None:
        """Declares an image made by `node`; `of`: which lamp or object, of a kind that is of one; `casters`
        are the instances that its reference has to trace; `depth`: how far away an OVER layer is, metres."""
        if not self._meets(kind.needs):
            raise ValueError(f"'{kind.title}' needs what the shot has not")
        of = of or Of(kind.of)
        if self.effect and not (of.index in self.lamps if of.is_lamp else self._wants_others):
            return
        light = pass_name = whose = ""
        if of.is_lamp:
            named = self.outline.lights[of.index]
            light = named.name
            pass_name = whose = named.pass_name or lamp_pass_name(named.name, named.key)
        elif of.subject is Subject.OBJECT:
            whose = self.outline.instances[of.index].name
        name = layer_name(kind.title, whose)
        if any(layer.name == name for layer in self._layers):
            raise ValueError(f"two layers are called '{name}'")
        if name in self._without:
            self.left_out(name, self._without[name], light)
            return
        self.reads_instances(casters)
        effect = self.effect.id if self.effect else ""
        params = self.params and self.own_params(self.params, of)
        layer = PlannedLayer(
            name,
            effect,
            node,
            kind,
            params,
            light,
            of,
            casters,
            depth=depth,
            joins=self._joins(kind, of),
            pass_name=pass_name,
            target_error=params.target_error or self.params.target_error if params else 0.0,
        )
        self._layers.append(layer)

    def own_params[P: Params](self, params: P, of: Of, effect_id: str = "") -> P:
        """An effect's `params` (the one's that is recorded, or that called `effect_id`) for what is `of` a
        lamp or not: with the lamp's own over them, and with nothing left automatic."""
        if of.is_lamp:
            params = self.outline.lights[of.index].params_for(effect_id or self.effect.id, params)
        return params.settled(self._traces_rays)

    def put_in_colour(self) -> None:
        """Makes declared layers colours, where they may be (LayerKind.in_colour)."""
        self._layers = [replace(layer, kind=layer.kind.in_colour()) for layer in self._layers]

    def weigh(self, layer: PlannedLayer, weight: Node, weighed_by: str) -> None:
        """Says what the samples of a declared layer weigh."""
        place = self._layers.index(layer)
        self._layers[place] = replace(layer, weight=weight, weighed_by=weighed_by)

    def lamps_for(self, kind: LayerKind) -> Iterator[int]:
        """Indices of the lights to record a layer of `kind` of; notes those whose picture takes the same from
        another effect."""
        for index in self.lamps:
            if self._keeps_unused or self._joins(kind, Of.lamp(index)):
                yield index
                continue
            light, provider = self.outline.lights[index], self._offer(kind.role, Of.lamp(index)).effect
            self.left_out(
                f"{kind.title} {light.name}", f"{provider.title} is its {kind.role.value}", light.name
            )

    def ask(self, role: Role, of: Of = THE_IMAGE, *inputs: Node):
        """What the one effect that provides `role` offers to build on, with that effect's own parameters; for
        VISIBILITY (node, casters) of a lamp's shadow, or None where there is none. Asked for by several, it
        is the same node. Raises KeyError if no effect offers it."""
        offer = self._offer(role, of)
        if offer is None:
            raise KeyError(role)
        return offer.record(self, self.outline, offer.params, of, *inputs)

    def _offer(self, role: Role, of: Of) -> Offer | None:
        """Of the effect that the lamp asks for, or else of the first."""
        offers = self._offers.get(role, ())
        wanted = dict(self.outline.lights[of.index].providers).get(role) if of.is_lamp else None
        return next((offer for offer in offers if offer.effect.id == wanted), next(iter(offers), None))

    def chosen_offers(self, role: Role) -> tuple[Offer, ...]:
        """Of effects that the scene needs and that are not there only for others to build on; that in use
        first."""
        offers = self._offers.get(role, ())
        return tuple(o for o in offers if o.is_chosen and o.effect.needed(self.outline) is None)

    def _joins(self, kind: LayerKind, of: Of) -> bool:
        offer = self._offer(kind.role, of) if kind.role.is_exclusive else None
        return offer is None or offer.effect is self.effect

    def shot_has(self, needs: Set[Need], what: str) -> bool:
        """Whether the shot has what `what` needs; notes it where not."""
        if self._meets(needs):
            return True
        self.left_out(what, "a UV chart has no eye")
        return False

    def _meets(self, needs: Set[Need]) -> bool:
        return Need.EYE not in needs or self.shot.has_eye

    def left_out(self, what: str, reason: str, light: str = "") -> None:
        """Notes it once, whoever comes upon it again."""
        if not any(known.what == what and known.reason == reason for known in self._left_out):
            self._left_out.append(LeftOut(what, reason, self.effect.id if self.effect else "", light))

    def graph(self) -> Graph:
        return Graph(
            tuple(self._layers),
            tuple(self._left_out),
            {node: frozenset(attributes) for node, attributes in self._surfaces.items()},
            self.instances,
            frozenset(self._wants),
            self.shot,
            self._own_surface,
        )


def plan(
    outline: Outline,
    shot: Shot,
    effects: dict[Effect, Params],
    *recordings: Callable,
    offers: Mapping[Role, tuple[Offer, ...]] | None = None,
    lamps: tuple[int, ...] | None = None,
    keeps_unused: bool = False,
    without: Mapping[str, str] | None = None,
    traces_rays: bool = True,
) -> Graph:
    """Records every effect that a shot of the scene needs; `effects` maps each to its parameters. Each of
    `recordings`, called with recorder and outline, may record more, after them and for no effect. `offers`:
    what effects offer (`Effect.offers`); a lamp that asks for none of them takes the first. `lamps`: indices
    of the only lights whose layers are wanted, and no other layers; None: all. `keeps_unused`: also layers
    that the picture takes from another effect. `without`: by name, why layers are left out. `traces_rays`:
    whether the device that is to run the graph traces rays (Device)."""
    recorder = Recorder(outline, shot, offers, lamps, keeps_unused, without, traces_rays)
    for effect, params in effects.items():
        recorder.effect, recorder.params = effect, params
        if not recorder.shot_has(effect.needs, effect.title):
            continue
        if reason := effect.needed(outline):
            recorder.left_out(effect.title, reason)
        elif lamps is not None and not any(kind.of is Subject.LAMP for kind in effect.layers):
            recorder.left_out(effect.title, "only lamps' layers were asked for")
        else:
            effect.run(recorder, outline, params)
    recorder.effect = recorder.params = None
    if lamps is None:
        _note_other_light(recorder, outline)
    for record in recordings:
        record(recorder, outline)
    return recorder.graph()


def _note_other_light(recorder: Recorder, outline: Outline) -> None:
    """What lights the scene for Blender's own engines, and is no lamp."""
    if outline.world_light:
        recorder.left_out(f"world '{outline.world_light}'", "its light is in no layer")
    glowing = [material.name for material in outline.materials if material.glows]
    if glowing:
        recorder.left_out(f"light of materials {named_some(glowing)}", "they glow, but light nothing else")
