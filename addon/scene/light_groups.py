"""Which lamps a compositor can give their shadows: those that have the image of a light group to themselves,
and whose own shadow can be switched off. Deciding changes nothing; `apply` does."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import count

import bpy

from .changing import is_surely_hidden, moves
from .lamp_names import DEEPEST, LampNames, NamedLamp
from .materials import may_glow
from .own_settings import casts_shadow, is_composited


@dataclass(frozen=True, eq=False)
class Joined:
    """A lamp that has light group `group` to itself. `carrier`: the object to put into it, None where it is
    in it already. `is_shadowed`: it gets a shadow in place of its own, not only a filter."""

    named: NamedLamp
    group: str
    carrier: bpy.types.Object | None
    is_shadowed: bool


@dataclass(frozen=True, eq=False)
class Division:
    """`joined` and `apart`, which says why not, by pass name; `shown`: pass names by view layer's name."""

    joined: dict[str, Joined]
    apart: dict[str, str]
    shown: dict[str, frozenset[str]]


def lamps_of(view_layer: bpy.types.ViewLayer, names: LampNames) -> dict[str, NamedLamp]:
    """By pass name, those that a render may show; also lamps that only an evaluated scene has."""
    lamps = {named.pass_name: named for named in names.standing(view_layer)}
    if view_layer.depsgraph is not None:
        lamps |= {named.pass_name: named for named in names.shown(view_layer.depsgraph)}
    return {name: named for name, named in lamps.items() if not is_surely_hidden(named.path)}


def divide(
    scene: bpy.types.Scene,
    found: Mapping[bpy.types.ViewLayer, Mapping[str, bool]],
    idle: Collection[str] = (),
) -> Division:
    """`found`: for each view layer that renders, by pass name the lamps that there is something to put onto,
    and whether a shadow is among it. `idle`: names of lamps that are known to shadow nothing in view, which
    have no shadow to lose."""
    return _Divider(scene, found, idle).divide()


@dataclass(eq=False)
class _Divider:
    scene: bpy.types.Scene
    found: Mapping[bpy.types.ViewLayer, Mapping[str, bool]]
    idle: Collection[str]
    lamps: dict[str, NamedLamp] = field(default_factory=dict)
    members: dict[str, list[str]] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)

    def divide(self) -> Division:
        names = LampNames()
        by_layer = {layer: lamps_of(layer, names) for layer in self.found}
        for lamps in by_layer.values():
            self.lamps |= lamps
        self._find_members()
        joined: dict[str, Joined] = {}
        apart: dict[str, str] = {}
        for name in (name for name in self.lamps if name in self.wanted):
            lacking = [
                layer.name
                for layer, there in by_layer.items()
                if name in there and self.found[layer].get(name) != self.wanted[name]
            ]
            if lacking:
                apart[name] = (
                    f"view layer '{lacking[0]}' renders too and has no {_what(self.wanted[name])} of it: "
                    "bake that as well"
                )
                continue
            judged = self._judged(self.lamps[name], self.wanted[name])
            (apart if isinstance(judged, str) else joined)[name] = judged
        self._keep_whole_data(joined, apart)
        shown = {layer.name: frozenset(there) for layer, there in by_layer.items()}
        return Division(joined, apart, shown)

    @cached_property
    def wanted(self) -> dict[str, bool]:
        """Whether a shadow is among what there is of a lamp."""
        names = {name for found in self.found.values() for name in found}
        return {name: any(found.get(name) for found in self.found.values()) for name in names}

    def _is_idle(self, named: NamedLamp) -> bool:
        return named.pass_name not in self.wanted and named.name in self.idle

    def _find_members(self) -> None:
        """Who shines into each light group, and which names of groups are taken."""
        for named in self.lamps.values():
            if group := _group_of(named):
                self.members.setdefault(group, []).append(named.name)
        for thing in {thing for layer in self.found for thing in layer.objects}:
            if thing.lightgroup and thing.type != "LIGHT" and _glows(thing):
                self.members.setdefault(thing.lightgroup, []).append(thing.name)
        world = self.scene.world
        if world is not None and world.lightgroup:
            self.members.setdefault(world.lightgroup, []).append("the world")
        owners = (*bpy.data.objects, *bpy.data.worlds)
        self.taken = {owner.lightgroup for owner in owners if owner.lightgroup}

    def _judged(self, named: NamedLamp, is_shadowed: bool) -> Joined | str:
        """Or why not."""
        light = named.lamp.data
        if is_shadowed and not casts_shadow(light):
            return "its shadow is switched off"
        if is_shadowed and not light.is_editable:
            return "its light is linked from a library and cannot be changed: make a library override"
        if is_shadowed and moves(light, "use_shadow"):
            return "its shadow is switched by an animation or a driver"
        group = _group_of(named)
        if group:
            others = [name for name in self.members[group] if name != named.name]
            if others or len(self.members[group]) > 1:
                with_whom = ", ".join(f"'{name}'" for name in others) or "its other instances"
                return f"it shares light group '{group}' with {with_whom}: give it a group of its own"
            return Joined(named, group, None, is_shadowed)
        carriers = [thing for thing in self._carriers(named) if thing.is_editable]
        if not carriers:
            return "no object that shows it alone can be put into a light group"
        group = self._free_name(named.pass_name)
        self.taken.add(group)
        return Joined(named, group, carriers[0], is_shadowed)

    def _carriers(self, named: NamedLamp) -> Iterable[bpy.types.Object]:
        """Objects by whose light group this lamp has one, and nothing else has it."""
        alike = self.lamps.values()
        if sum(other.lamp == named.lamp for other in alike) == 1:
            yield named.lamp
        outer = named.outermost
        without = [other for other in alike if other.outermost == outer and not other.lamp.lightgroup]
        if outer != named.lamp and len(without) == 1 and not _glows(outer):
            yield outer

    def _free_name(self, wanted: str) -> str:
        if wanted not in self.taken:
            return wanted
        return next(name for n in count(2) if (name := f"{wanted} {n}") not in self.taken)

    def _keep_whole_data(self, joined: dict[str, Joined], apart: dict[str, str]) -> None:
        """A light that several lamps have keeps its shadow where one of them would be left without any."""
        for pass_name, found in list(joined.items()):
            if not found.is_shadowed:
                continue
            data = found.named.lamp.data
            others = [
                other
                for other in self.lamps.values()
                if other.lamp.data == data and other.pass_name not in joined and not self._is_idle(other)
            ]
            if others:
                apart[pass_name] = f"its light is also that of '{others[0].name}', which cannot be joined"
        for pass_name in apart:
            joined.pop(pass_name, None)


def _what(is_shadowed: bool) -> str:
    return "shadow" if is_shadowed else "filter"


def _group_of(named: NamedLamp) -> str:
    """As Cycles takes it: the lamp's own goes over its instancer's."""
    return named.lamp.lightgroup or named.outermost.lightgroup


def _glows(thing: bpy.types.Object, depth: int = DEEPEST) -> bool:
    """Whether an object, or one that it shows, may have a surface that shines."""
    if any(slot.material is not None and may_glow(slot.material) for slot in thing.material_slots):
        return True
    inside = thing.instance_collection.all_objects if depth and thing.instance_collection else ()
    return any(_glows(inner, depth - 1) for inner in inside)


def add_groups(division: Division, view_layers: Iterable[bpy.types.ViewLayer]) -> list[tuple]:
    """Makes the groups that are missing; returns them, each as (view layer, name). No lamp is in them yet."""
    made = []
    for layer in view_layers:
        for pass_name, found in division.joined.items():
            if pass_name in division.shown[layer.name] and found.group not in layer.lightgroups:
                layer.lightgroups.add(name=found.group)
                made.append((layer, found.group))
        layer.update_render_passes()
    return made


def remove_groups(made: Iterable[tuple]) -> None:
    """What `add_groups` returned."""
    for layer, name in made:
        layer.lightgroups.remove(layer.lightgroups[name])
        layer.update_render_passes()


def apply(division: Division, scene: bpy.types.Scene) -> tuple[list[str], list[bpy.types.Light]]:
    """Puts lamps into their groups, switches their own shadows off and marks them; a lamp of the scene that
    was marked and is not joined any more gets its own back. Returns names of lights that were switched off,
    and lights that `give_back` switched on."""
    for found in division.joined.values():
        if found.carrier is not None:
            found.carrier.lightgroup = found.group
    lights = {found.named.lamp.data for found in division.joined.values() if found.is_shadowed}
    switched = sorted(light.name for light in lights if light.use_shadow)
    for light in lights:
        # Only what changes: each assignment is an update, and a library override.
        if light.use_shadow:
            light.use_shadow = False
        if not light.strata_shadow_composited:
            light.strata_shadow_composited = True
    return switched, give_back(scene, lights)


def marked(scene: bpy.types.Scene) -> list[bpy.types.Light]:
    """Lights of lamps in the scene, instanced ones too, whose shadows are the compositor's."""
    if not any(map(is_composited, bpy.data.lights)):
        return []  # asked at every redraw, and nearly always so
    return [light for light in lights_of(scene) if is_composited(light)]


def lights_of(scene: bpy.types.Scene) -> list[bpy.types.Light]:
    """Of lamps in the scene, instanced ones too."""
    lamps = {thing for thing in scene.objects if thing.type == "LIGHT"}
    for thing in scene.objects:
        if thing.instance_collection is not None:
            lamps |= {inner for inner in thing.instance_collection.all_objects if inner.type == "LIGHT"}
    return sorted({lamp.data for lamp in lamps}, key=lambda light: light.name_full)


def returnable(scene: bpy.types.Scene) -> list[bpy.types.Light]:
    """Lights that `give_back` changes: those with the mark, also where somebody switched the shadow on."""
    if not any(light.strata_shadow_composited for light in bpy.data.lights):
        return []
    return [light for light in lights_of(scene) if light.is_editable and light.strata_shadow_composited]


def give_back(scene: bpy.types.Scene, kept: Collection[bpy.types.Light] = ()) -> list[bpy.types.Light]:
    """Takes the mark off lights, but of those in `kept`, and switches the shadows on again that it stood for;
    returns those."""
    switched = []
    for light in returnable(scene):
        if light in kept:
            continue
        if not light.use_shadow:
            light.use_shadow = True
            switched.append(light)
        light.strata_shadow_composited = False
    return switched
