"""What a bake is to make, and its plan: of a scene's headers alone, before anything is extracted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from .core.effect import Effect, Offer, Registry
from .core.errors import StrataError
from .core.free_memory import free_bytes
from .core.graph import Graph, PlannedLayer, Rate
from .core.memory import ROOM_BYTES, MemoryEstimate, in_groups, too_large
from .core.outline import Outline
from .core.placement import Placement, Places
from .core.reach import fitted
from .core.read import MOST_TEXELS, TEXELS, Read
from .core.recorder import Recorder, plan
from .core.roles import Role
from .core.sampling import Sampling, passes_up_to
from .core.shot import Shot
from .core.weight import Weight
from .devices.start import traces_rays
from .effects.registry import EFFECTS
from .effects.shared import composite, lit, weights
from .effects.shared.steps import surface

TARGET_ERROR = 0.02
"""Where nobody asks for another: what an eye sees only side by side (measure/verdict.py)."""
USUAL_SAMPLES = 8
"""Of layers that have no target, or that nobody measures."""
ENOUGH_SAMPLES = 64


@dataclass(frozen=True)
class Options:
    """How to bake. `effects`: ids, None for those on by default; `values`: parameter values by effect id and
    name; `samples` jittered surfaces a pixel of a layer without a target, None: as usual. With a
    `target_error` each layer gets as many as bring its error (docs/accuracy.md) down to that, unless lamps
    and effects have their own (`own_targets`: by effect, in place of those that they have); 0: TARGET_ERROR,
    or none where samples or a time are set. `time_budget_s`: all get as many as there is time for, 0: it may
    take any; `most_samples`: with either no layer gets more; `samples_of`: how many each layer gets, by its
    name, where that was chosen before; `probes` points to measure the error at, 0 for none, None for at most
    2048 and so few that measuring takes 15% of the bake; `lights`: names of the lamps whose layers are
    wanted, None for all layers; `lit` also makes each light's unshadowed image, and `composite` the picture
    of the whole; `memory_bytes` are what it may take beside what Blender has, 0: half of what is free, or
    less where more is of no use; `providers`: the effect to take a role from, where several offer it and a
    lamp asks for none; `keeps_unused` also makes their layers that the picture does not take; `weight`: what
    samples of layers that multiply weigh (Weight); `placement`: where in a pixel its samples lie (Placement);
    `rgb_layers`: lamps' shadows are in colour, each channel weighed by itself; `error_images`: each measured
    layer gets an image of its error too; `read`: how materials are (Read), and `read_texels`: how fine at
    most what Blender bakes of them is, texels a side of a mesh's picture; `registry`: the effects that there
    are."""

    effects: tuple[str, ...] | None = None
    backend: str = "auto"
    samples: int | None = None
    probes: int | None = None
    values: dict[str, dict[str, Any]] = field(default_factory=dict)
    seed: int = 0
    lights: tuple[str, ...] | None = None
    lit: bool = False
    composite: bool = False
    memory_bytes: int = 0
    providers: dict[Role, str] = field(default_factory=dict)
    keeps_unused: bool = False
    weight: str = Weight.RADIANCE.value
    placement: str = Placement.SHARED.value
    rgb_layers: bool = False
    error_images: bool = False
    read: str = Read.FAST.value
    read_texels: int = TEXELS
    registry: Registry = EFFECTS
    target_error: float = 0.0
    samples_of: Mapping[str, int] = field(default_factory=dict)
    time_budget_s: float = 0.0
    most_samples: int = ENOUGH_SAMPLES
    own_targets: Mapping[str, float] | None = None

    def __post_init__(self):
        if self.memory_bytes < 0:
            raise StrataError(f"memory: {self.memory_bytes} bytes are less than 0")
        if self.weight not in (names := [each.value for each in Weight]):
            raise StrataError(f"weight: '{self.weight}' is none of {', '.join(names)}")
        if self.placement not in (names := [each.value for each in Placement]):
            raise StrataError(f"placement: '{self.placement}' is none of {', '.join(names)}")
        if self.read not in (names := [each.value for each in Read]):
            raise StrataError(f"read: '{self.read}' is none of {', '.join(names)}")
        if not 1 <= self.read_texels <= MOST_TEXELS:
            raise StrataError(f"read texels: {self.read_texels} is not between 1 and {MOST_TEXELS}")
        if self.set_samples < 1:
            raise StrataError(f"samples: {self.samples} is less than 1")
        if self.most_samples < 1:
            raise StrataError(f"most samples: {self.most_samples} is less than 1")
        if not 0.0 <= self.target_error < 1.0:
            raise StrataError(f"target error: {self.target_error:g} is not between 0 and 1")
        if self.time_budget_s < 0.0:
            raise StrataError(f"time budget: {self.time_budget_s:g} s is less than 0")
        if any(samples < 1 for samples in self.samples_of.values()):
            raise StrataError("samples of layers: less than 1")
        if self.probes is not None and self.probes < 0:
            raise StrataError(f"probes: {self.probes} is less than 0")
        for effect_id, values in self.values.items():
            self.registry.named(effect_id).params.checked(effect_id, values)

    def chosen(self) -> dict[Effect, Any]:
        """The effects to run with their parameters."""
        if self.effects is None:
            effects = tuple(effect for effect in self.registry if effect.on_by_default)
        else:
            effects = tuple(self.registry.named(name) for name in self.effects)
        return {effect: self._params_of(effect) for effect in effects}

    @property
    def set_samples(self) -> int:
        """Of layers without a target."""
        return USUAL_SAMPLES if self.samples is None else self.samples

    @property
    def aim(self) -> float:
        """The target error of all layers that have none of their own; 0: there is none."""
        is_said = self.samples is not None or self.time_budget_s or self.samples_of
        return self.target_error or (0.0 if is_said else TARGET_ERROR)

    def target_of(self, layer: PlannedLayer) -> float:
        """What samples of a layer are chosen for; 0: it has as many as are set, or as were chosen before."""
        return 0.0 if self.samples_of else self.asked_of(layer)

    def asked_of(self, layer: PlannedLayer) -> float:
        """What the error of a layer is to come down to; 0: nobody asks, or could tell how far it is."""
        if not layer.kind.score or layer.node.rate != Rate.SAMPLE:
            return 0.0
        own = layer.target_error if self.own_targets is None else self.own_targets.get(layer.effect, 0.0)
        return own or self.aim

    def wants(self, name: str, pass_name: str) -> bool:
        """Whether a lamp's layers are to be made."""
        return self.lights is None or name in self.lights or pass_name in self.lights

    def offers(self) -> dict[Role, tuple[Offer, ...]]:
        """What chosen effects offer, that of `providers` first; what none of them offers, from that of
        `providers` too, or else from the first that does."""
        chosen = self.chosen()
        found: dict[Role, list[Offer]] = {}
        for effect in sorted(self.registry, key=lambda effect: effect not in chosen):
            for role, record in effect.offers.items():
                offers = found.setdefault(role, [])
                is_wanted = self.providers.get(role) == effect.id
                is_open = not any(offer.is_chosen for offer in offers)
                if effect in chosen or not offers or (is_wanted and is_open):
                    offer = Offer(effect, self._params_of(effect), record, effect in chosen)
                    offers.insert(0 if is_wanted else len(offers), offer)
        return {role: tuple(offers) for role, offers in found.items()}

    def _params_of(self, effect: Effect) -> Any:
        return effect.params.checked(effect.id, self.values.get(effect.id, {}))


def plan_scene(outline: Outline, shot: Shot, options: Options) -> Graph:
    """What would run, what is left out, and why."""
    recordings = [_put_in_colour] * options.rgb_layers
    recordings += [partial(weights.record, how=Weight(options.weight))]
    recordings += [composite.record if options.composite else composite.leave_out]
    recordings += [lit.record] * options.lit + [_record_probed]
    lamps = None
    if options.lights is not None:
        lights = enumerate(outline.lights)
        lamps = tuple(index for index, light in lights if options.wants(light.name, light.pass_name))
    left_out: dict[str, str] = {}
    while True:
        graph = plan(
            outline,
            shot,
            options.chosen(),
            *recordings,
            offers=options.offers(),
            lamps=lamps,
            keeps_unused=options.keeps_unused,
            without=left_out,
            traces_rays=traces_rays(options.backend),
        )
        found = too_large(graph, outline, sampling_of(graph, options), _budget_bytes(options))
        if not found:
            return graph
        # A composite may be too large for a layer's sake: it is made of the others then.
        of_effects = {layer.name for layer in graph.layers if layer.effect} & found.keys()
        left_out |= {name: found[name] for name in of_effects or found}


def _put_in_colour(recorder: Recorder, outline: Outline) -> None:
    recorder.put_in_colour()


def _record_probed(recorder: Recorder, outline: Outline) -> None:
    """Probes are the shot's own points, also where an effect looks at none but others."""
    if any(layer.kind.score for layer in recorder.layers):
        surface(recorder, outline)


def passes_of(graph: Graph, options: Options) -> tuple[int, ...]:
    """How many samples a pixel may have; empty where there is nothing to choose."""
    if chosen := options.samples_of.values():
        return passes_up_to(max(chosen), *chosen)
    if options.aim or options.time_budget_s:
        return passes_up_to(options.most_samples)
    layers = [layer for layer in graph.layers if layer.effect]
    if not any(map(options.target_of, layers)):
        return ()
    set_ones = () if all(map(options.target_of, layers)) else (options.set_samples,)
    return passes_up_to(max((options.most_samples, *set_ones)), *set_ones)


def places_of(shot: Shot, options: Options) -> Places | None:
    """Each pixel's own, if it is to have them; texels of a chart share theirs."""
    return Places.of(shot) if shot.has_eye and options.placement == Placement.PER_PIXEL.value else None


def sampling_of(graph: Graph, options: Options) -> Sampling:
    shot = graph.shot
    passes = passes_of(graph, options) if shot.has_eye else ()
    samples = passes[-1] if passes else options.set_samples
    places = places_of(shot, options)
    sampling = Sampling(*shot.computed_size, samples, shot.pixel_filter, passes=passes, places=places)
    return fitted(sampling, graph.nodes())


def _budget_bytes(options: Options) -> int:
    return options.memory_bytes or free_bytes() // 2


def groups_of(
    outline: Outline, graph: Graph, options: Options, held: int, layers_before: int = 0
) -> tuple[tuple[Graph, ...], MemoryEstimate]:
    """The graph in graphs that fit into the memory there is, and what a bake takes beside the `held` bytes
    that the process had before and `layers_before`, which a job's earlier shots hold."""
    room, budget = None if options.memory_bytes else ROOM_BYTES, _budget_bytes(options)
    if options.memory_bytes:  # of what is free, layers that are there take no part
        budget = max(budget - layers_before, 0)
    sampling, has_images = sampling_of(graph, options), options.error_images and options.probes != 0
    return in_groups(graph, outline, sampling, budget, held + layers_before, room, has_images)
