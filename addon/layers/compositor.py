"""Compositor nodes that put baked shadows onto a render, beside whatever a user's tree does already."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..core.culling import UNREACHED, WITHOUT_CASTERS
from ..core.effect import Registry
from ..core.errors import StrataError
from ..core.roles import PRODUCT, Role
from ..effects.registry import EFFECTS
from ..scene import light_groups
from ..scene.light_groups import Division
from .exr_header import ExrHeader, header_of
from .shadow_nodes import (
    GROUP_NAME,
    bypass,
    join,
    lit_passes_shown,
    load_file,
    new_source,
    new_tree,
    nodes_of,
    passes_of,
    shows_image,
    sources_of,
    unjoin,
)

_NO_LAMP = "no lamp that renders has it"


def _titles(registry: Registry, role: Role) -> tuple[str, ...]:
    return tuple(kind.title for effect in registry for kind in effect.layers if kind.role is role)


@dataclass(frozen=True)
class _Scaling:
    """A layer that scales the light of lamp `lamp`, which is the lamp's pass name."""

    name: str
    lamp: str
    role: Role


@dataclass(frozen=True)
class Built:
    """Layers by name: what `build` joined, and what not and why; `others` are no shadows. Names of lights
    whose own shadows were switched off, and of those that got theirs back. `elsewhere`: other scenes that
    show such a lamp and have no nodes for its shadow; `twice`: those that have nodes for one given back."""

    joined: tuple[str, ...]
    apart: dict[str, str]
    others: tuple[str, ...]
    switched: tuple[str, ...]
    given_back: tuple[str, ...]
    elsewhere: tuple[str, ...]
    twice: tuple[str, ...]


@dataclass(frozen=True)
class TakenAway:
    """Names of lights that got their shadows back, of those that a library keeps without, and of other scenes
    that shadow one of the former twice now."""

    given_back: tuple[str, ...]
    without: tuple[str, ...]
    twice: tuple[str, ...]


def build(
    scene: bpy.types.Scene,
    paths: Mapping[bpy.types.ViewLayer, Path],
    is_sequence: bool,
    is_relative: bool,
    registry: Registry = EFFECTS,
) -> Built:
    """Makes the nodes, or makes them anew where they are already; gives each joined lamp a light group where
    it has none, and switches its own shadow off. A user's groups, nodes and links stay: what the Render
    Layers' image went to now gets it by way of the shadows. `paths`: the file of each view layer that
    renders, which may be missing or be that of others too; `is_relative`: files are looked for beside the
    Blender file. Raises StrataError, with nothing changed, where nothing can be joined.
    """
    headers = {layer: header_of(path) for layer, path in paths.items() if path.is_file()}
    scaling = {layer: _scaling(headers[layer], layer) if layer in headers else () for layer in paths}
    idle = {name for header in headers.values() for name in _idle(header, registry)}
    division = light_groups.divide(
        scene, {layer: _has_shadow(found) for layer, found in scaling.items()}, idle
    )
    apart = _apart(scaling, division)
    if not division.joined:
        raise StrataError(_nothing(next(iter(paths.values())), apart))
    joined = _joined_passes(scaling, division)
    layers = _layers_to_join(scene, joined)
    made = light_groups.add_groups(division, paths)
    if lacking := _lacking(scene, paths, division):
        light_groups.remove_groups(made)
        raise StrataError(f"{scene.render.engine} renders no light groups: there is no pass '{lacking}'")
    try:
        switched, given_back = light_groups.apply(division, scene)
        tree = scene.compositing_node_group or new_tree(scene, layers[0])
        for layer in layers:
            image = load_file(paths[layer], is_sequence, is_relative)
            join(tree, scene, layer, image, joined[layer], is_sequence)
        for layer in paths:
            if layer not in joined:
                unjoin(tree, scene, layer)
    except BaseException:
        # Lamps that have no shadow at all would be the worst of it, and no undo step is there.
        take_away(scene)
        light_groups.remove_groups(made)
        raise
    scene.render.use_compositing = True
    names = [each.name for found in scaling.values() for each in found if each.lamp in division.joined]
    others = {name for layer, header in headers.items() for name in _others(header, layer, scaling[layer])}
    return Built(
        tuple(dict.fromkeys(names)),
        apart,
        tuple(sorted(others)),
        tuple(switched),
        tuple(light.name for light in given_back),
        tuple(_elsewhere(scene)),
        tuple(_twice(scene, given_back)),
    )


def can_take_away(scene: bpy.types.Scene) -> bool:
    """Whether there is anything to. Cheap enough to be asked at every redraw."""
    return bool(nodes_of(scene) or light_groups.returnable(scene))


def take_away(scene: bpy.types.Scene) -> TakenAway:
    """Gives lamps their own shadows back and takes the nodes away that stand in for them. Light groups
    stay."""
    for node in nodes_of(scene):
        bypass(scene.compositing_node_group, node)
    lights = light_groups.give_back(scene)
    given_back, without = (
        tuple(light.name for light in some) for some in (lights, light_groups.marked(scene))
    )
    return TakenAway(given_back, without, tuple(_twice(scene, lights)))


# What there is to join


def _scaling(header: ExrHeader, view_layer: bpy.types.ViewLayer) -> tuple[_Scaling, ...]:
    """Those of a view layer that are in use: not a second shadow that was baked to be looked at."""
    there = header.passes.get(view_layer.name, set())
    entries = [
        entry
        for entry in header.json("strata:report").get("layers", ())
        if entry.get("view_layer", view_layer.name) == view_layer.name and entry["name"] in there
    ]
    return tuple(
        _Scaling(entry["name"], entry["pass_name"], role)
        for role in PRODUCT
        for entry in sorted(entries, key=lambda entry: entry["name"])
        if entry.get("role") == role.value and entry["pass_name"] and entry.get("joins", True)
    )


def _has_shadow(found: Iterable[_Scaling]) -> dict[str, bool]:
    """Whether a lamp's shadow is among what scales it, by pass name."""
    lamps = {each.lamp: False for each in found}
    return lamps | {each.lamp: True for each in found if each.role is Role.VISIBILITY}


def _others(header: ExrHeader, view_layer: bpy.types.ViewLayer, scaling: Iterable[_Scaling]) -> set[str]:
    """Layers that scale no lamp."""
    there = header.passes.get(view_layer.name, set()) - {"Combined"} - _error_images(header)
    return there - {each.name for each in scaling}


def _error_images(header: ExrHeader) -> set[str]:
    """Names of what only tells how far layers are off."""
    entries = header.json("strata:report").get("layers", ())
    return {entry["error_image"] for entry in entries if "error_image" in entry}


def _idle(header: ExrHeader, registry: Registry) -> set[str]:
    """Names of lamps that the bake's plan knew to shadow nothing in view."""
    return {
        entry["what"].removeprefix(f"{title} ")
        for entry in header.json("strata:report").get("left_out", ())
        for title in _titles(registry, Role.VISIBILITY)
        if entry["reason"] in (UNREACHED, WITHOUT_CASTERS)
    }


def _apart(scaling: dict[bpy.types.ViewLayer, tuple[_Scaling, ...]], division: Division) -> dict[str, str]:
    """Why layers of the file are not joined."""
    return {
        each.name: division.apart.get(each.lamp, _NO_LAMP)
        for found in scaling.values()
        for each in found
        if each.lamp not in division.joined
    }


def _joined_passes(
    scaling: dict[bpy.types.ViewLayer, tuple[_Scaling, ...]], division: Division
) -> dict[bpy.types.ViewLayer, dict[str, tuple[str, ...]]]:
    """For each view layer that has any, by pass of a light group the layers to multiply onto it."""
    joined: dict[bpy.types.ViewLayer, dict[str, tuple[str, ...]]] = {}
    for layer, found in scaling.items():
        for each in found:
            if each.lamp in division.joined:
                passes = joined.setdefault(layer, {})
                group = _pass_of(division.joined[each.lamp].group)
                passes[group] = (*passes.get(group, ()), each.name)
    return joined


def _layers_to_join(scene: bpy.types.Scene, joined: Iterable[bpy.types.ViewLayer]) -> list:
    """Those of `joined` that the compositor shows; the first where there is no compositor yet. Raises
    StrataError for a compositor that cannot be built into."""
    tree = scene.compositing_node_group
    if tree is None:
        return list(joined)[:1]
    if not tree.is_editable:
        raise StrataError(
            f"the compositor's nodes '{tree.name}' are linked from a library and cannot be changed: "
            "make them local"
        )
    found = [layer for layer in joined if sources_of(tree, scene, layer)]
    if not found:
        raise StrataError(
            f"the compositor has no Render Layers node of view layer '{next(iter(joined)).name}' at its top "
            "level: add one"
        )
    shown = [layer for layer in found if shows_image(tree, sources_of(tree, scene, layer))]
    for layer in found:
        lit = {name for source in sources_of(tree, scene, layer) for name in lit_passes_shown(source)}
        if layer not in shown and (lit or not shown):
            raise StrataError(
                "shadows are put onto what goes out of Image of the compositor's Render Layers node, and for "
                f"view layer '{layer.name}' nothing does{f', only {min(lit)}' if lit else ''}: use Image"
            )
    return shown


def _elsewhere(scene: bpy.types.Scene) -> list[str]:
    """Other scenes that render lamps of this one, whose own shadows are off, without our nodes."""
    lights = set(light_groups.marked(scene))
    return [
        other.name
        for other in bpy.data.scenes
        if other != scene and not lights.isdisjoint(light_groups.marked(other)) and not nodes_of(other)
    ]


def _twice(scene: bpy.types.Scene, given_back: Iterable[bpy.types.Light]) -> list[str]:
    """Other scenes whose nodes of ours shadow lamps that cast their own shadows again."""
    lights = set(given_back)
    return [
        other.name
        for other in bpy.data.scenes
        if other != scene and nodes_of(other) and not lights.isdisjoint(light_groups.lights_of(other))
    ]


def _nothing(path: Path, apart: dict[str, str]) -> str:
    if not apart:
        return f"{path.name} has no shadow of a light of this scene"
    # Of a lamp that is there it helps more to know why.
    name, reason = min(apart.items(), key=lambda item: item[1] == _NO_LAMP)
    more = f" ({len(apart) - 1} more cannot be joined either)" if len(apart) > 1 else ""
    return f"nothing is joined: {name}: {reason}{more}"


def _pass_of(group: str) -> str:
    """Of a light group."""
    return f"Combined_{group}"


def _lacking(scene: bpy.types.Scene, layers: Iterable[bpy.types.ViewLayer], division: Division) -> str:
    """A pass that the engine should render and does not; empty where it renders them all."""
    tree = bpy.data.node_groups.new(GROUP_NAME, "CompositorNodeTree")
    try:
        for layer in layers:
            there = passes_of(new_source(tree, scene, layer))
            for lamp, joined in division.joined.items():
                if lamp in division.shown[layer.name] and _pass_of(joined.group) not in there:
                    return _pass_of(joined.group)
        return ""
    finally:
        bpy.data.node_groups.remove(tree)
