"""Compositor nodes that put baked shadows onto a render, beside whatever a user's tree does already.

The picture is the image + the sum over light groups of (its image times (its lamp's shadow - 1)), so that
what no group has (the sky, emission, lamps that are not joined) stays as it is. Where Cycles denoises, the
noisy image is taken and denoised after that: light groups are noisy, and of a denoised image their noise
would stay where a shadow takes most of the light away.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..core.culling import UNREACHED, WITHOUT_CASTERS
from ..core.effect import Blend
from ..core.errors import StrataError
from ..effects.registry import EFFECTS
from ..scene import light_groups
from ..scene.light_groups import Division
from .exr_header import ExrHeader, header_of

GROUP_NAME = "Strata Shadows"
_NOISY = "Noisy Image"  # Cycles' pass beside a denoised image
_GUIDES = {"Denoising Albedo": "Albedo", "Denoising Normal": "Normal"}
"""Sockets of the Denoise node by Cycles' passes."""
_NO_LAMP = "no lamp that renders has it"
_STEP = 200  # of the grid that nodes are laid out on
_TITLES = tuple(kind.title for effect in EFFECTS for kind in effect.layers if kind.blend == Blend.SCALE_LIGHT)
"""Those of shadows."""


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
    scene: bpy.types.Scene, paths: Mapping[bpy.types.ViewLayer, Path], is_sequence: bool, is_beside: bool
) -> Built:
    """Makes the nodes, or makes them anew where they are already; gives each joined lamp a light group where
    it has none, and switches its own shadow off. A user's groups, nodes and links stay: what the Render
    Layers' image went to now gets it by way of the shadows. `paths`: the file of each view layer that
    renders, which may be missing or be that of others too; `is_beside`: files are looked for beside the
    Blender file. Raises StrataError, with nothing changed, where nothing can be joined.
    """
    headers = {layer: header_of(path) for layer, path in paths.items() if path.is_file()}
    shadows = {layer: _shadows(headers[layer], layer) if layer in headers else {} for layer in paths}
    idle = {name for header in headers.values() for name in _idle(header)}
    division = light_groups.divide(
        scene, {layer: set(found.values()) for layer, found in shadows.items()}, idle
    )
    apart = _apart(shadows, division)
    if not division.joined:
        raise StrataError(_nothing(next(iter(paths.values())), apart))
    joined = _joined_passes(shadows, division)
    layers = _layers_to_join(scene, joined)
    made = light_groups.add_groups(division, paths)
    if lacking := _lacking(scene, paths, division):
        light_groups.remove_groups(made)
        raise StrataError(f"{scene.render.engine} renders no light groups: there is no pass '{lacking}'")
    try:
        switched, given_back = light_groups.apply(division, scene)
        tree = scene.compositing_node_group or _new_tree(scene, layers[0])
        for layer in layers:
            image = _load(paths[layer], is_sequence, is_beside)
            _join(tree, scene, layer, image, joined[layer], is_sequence)
        for layer in paths:
            if layer not in joined:
                _part(tree, scene, layer)
    except BaseException:
        # Lamps that have no shadow at all would be the worst of it, and no undo step is there.
        take_away(scene)
        light_groups.remove_groups(made)
        raise
    scene.render.use_compositing = True
    names = [name for found in shadows.values() for name, lamp in found.items() if lamp in division.joined]
    others = {name for layer, header in headers.items() for name in _others(header, layer)}
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
    return bool(_ours(scene) or light_groups.returnable(scene))


def take_away(scene: bpy.types.Scene) -> TakenAway:
    """Gives lamps their own shadows back and takes the nodes away that stand in for them. Light groups
    stay."""
    for node in _ours(scene):
        _bypass(scene.compositing_node_group, node)
    lights = light_groups.give_back(scene)
    given_back, without = (
        tuple(light.name for light in some) for some in (lights, light_groups.marked(scene))
    )
    return TakenAway(given_back, without, tuple(_twice(scene, lights)))


# What there is to join


def _shadows(header: ExrHeader, view_layer: bpy.types.ViewLayer) -> dict[str, str]:
    """Lamps' pass names by the names of their shadows."""
    return {
        name: name.removeprefix(f"{title} ")
        for title in _TITLES
        for name in sorted(header.passes.get(view_layer.name, ()))
        if name.startswith(f"{title} ")
    }


def _others(header: ExrHeader, view_layer: bpy.types.ViewLayer) -> set[str]:
    """Layers that are no shadows."""
    return header.passes.get(view_layer.name, set()) - {"Combined"} - _shadows(header, view_layer).keys()


def _idle(header: ExrHeader) -> set[str]:
    """Names of lamps that the bake's plan knew to shadow nothing in view."""
    return {
        entry["what"].removeprefix(f"{title} ")
        for entry in header.json("strata:report").get("left_out", ())
        for title in _TITLES
        if entry["reason"] in (UNREACHED, WITHOUT_CASTERS)
    }


def _apart(shadows: dict[bpy.types.ViewLayer, dict[str, str]], division: Division) -> dict[str, str]:
    """Why shadows of the file are not joined."""
    found = {name: lamp for names in shadows.values() for name, lamp in names.items()}
    return {
        name: division.apart.get(lamp, _NO_LAMP)
        for name, lamp in found.items()
        if lamp not in division.joined
    }


def _joined_passes(
    shadows: dict[bpy.types.ViewLayer, dict[str, str]], division: Division
) -> dict[bpy.types.ViewLayer, dict[str, str]]:
    """For each view layer that has any, passes of light groups by the names of the shadows to multiply onto
    them."""
    found = {
        layer: {
            output: _pass_of(division.joined[lamp].group)
            for output, lamp in names.items()
            if lamp in division.joined
        }
        for layer, names in shadows.items()
    }
    return {layer: joined for layer, joined in found.items() if joined}


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
    found = [layer for layer in joined if _sources(tree, scene, layer)]
    if not found:
        raise StrataError(
            f"the compositor has no Render Layers node of view layer '{next(iter(joined)).name}' at its top "
            "level: add one"
        )
    shown = [layer for layer in found if _shows_image(tree, _sources(tree, scene, layer))]
    for layer in found:
        lit = {name for source in _sources(tree, scene, layer) for name in _lit_passes_shown(source)}
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
        if other != scene and not lights.isdisjoint(light_groups.marked(other)) and not _ours(other)
    ]


def _twice(scene: bpy.types.Scene, given_back: Iterable[bpy.types.Light]) -> list[str]:
    """Other scenes whose nodes of ours shadow lamps that cast their own shadows again."""
    lights = set(given_back)
    return [
        other.name
        for other in bpy.data.scenes
        if other != scene and _ours(other) and not lights.isdisjoint(light_groups.lights_of(other))
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
            there = _passes(_new_source(tree, scene, layer))
            for lamp, joined in division.joined.items():
                if lamp in division.shown[layer.name] and _pass_of(joined.group) not in there:
                    return _pass_of(joined.group)
        return ""
    finally:
        bpy.data.node_groups.remove(tree)


# Nodes


def _load(path: Path, is_sequence: bool, is_beside: bool) -> bpy.types.Image:
    image = bpy.data.images.load(str(path), check_existing=True)
    if is_beside:
        image.filepath = bpy.path.relpath(str(path))
    source = "SEQUENCE" if is_sequence else "FILE"
    if image.source != source:
        image.source = source
    else:
        image.reload()
    return image


def _new_tree(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> bpy.types.NodeTree:
    """A render that goes out as it comes in."""
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    output = tree.nodes.new("NodeGroupOutput")
    output.location = (4 * _STEP, 0)
    tree.links.new(_new_source(tree, scene, view_layer).outputs["Image"], output.inputs[0])
    scene.compositing_node_group = tree
    return tree


def _new_source(tree: bpy.types.NodeTree, scene, view_layer) -> bpy.types.Node:
    node = tree.nodes.new("CompositorNodeRLayers")
    node.scene, node.layer = scene, view_layer.name
    return node


def _sources(tree: bpy.types.NodeTree, scene, view_layer) -> list[bpy.types.Node]:
    """Nodes that have the render of a view layer."""
    return [
        node
        for node in tree.nodes
        if node.type == "R_LAYERS" and node.scene == scene and node.layer == view_layer.name
    ]


def _shows_image(tree: bpy.types.NodeTree, sources: list[bpy.types.Node]) -> bool:
    """Whether the image of a view layer goes on, through nodes of ours or not."""
    ours = [node for node in tree.nodes if _is_ours(node)]
    return any(
        _goes_on(source.outputs["Image"]) or any(_reads(node, source) for node in ours) for source in sources
    )


def _lit_passes_shown(source: bpy.types.Node) -> list[str]:
    """Passes beside the image that have lamps' light and go on."""
    return [
        socket.name
        for socket in source.outputs
        if (socket.name == _NOISY or socket.name.endswith((" Direct", " Indirect"))) and _goes_on(socket)
    ]


def _goes_on(socket: bpy.types.NodeSocket) -> bool:
    """To more than to be looked at."""
    return any(link.to_node.type != "VIEWER" for link in socket.links)


def _passes(source: bpy.types.Node) -> set[str]:
    return {output.name for output in source.outputs if output.enabled and not output.is_unavailable}


def _is_ours(node: bpy.types.Node) -> bool:
    return node.type == "GROUP" and node.node_tree is not None and node.node_tree.name.startswith(GROUP_NAME)


def _ours(scene: bpy.types.Scene) -> list[bpy.types.Node]:
    tree = scene.compositing_node_group
    return [] if tree is None else [node for node in tree.nodes if _is_ours(node)]


def _join(
    tree: bpy.types.NodeTree,
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    file: bpy.types.Image,
    joined: dict[str, str],
    is_sequence: bool,
) -> None:
    """`joined`: passes of light groups by the names of the shadows to multiply onto them."""
    sources = _sources(tree, scene, view_layer)
    ours = [node for node in tree.nodes if _is_ours(node)]
    group = next((node for node in ours if any(_reads(node, source) for source in sources)), None)
    if group is None:
        group = _insert(tree, sources)
    source = next(source for source in sources if _reads(group, source))
    if group.node_tree.users > 1:  # a full copy of a scene shares what is in groups
        group.node_tree = group.node_tree.copy()
    _fill(group.node_tree, file, scene, view_layer, source, joined, is_sequence)
    whole = _whole(source)
    for socket in group.inputs:
        if not socket.is_linked:  # a user's nodes may be before it by now
            tree.links.new(source.outputs[whole if socket.name == "Image" else socket.name], socket)
    _take_from(tree, group, sources, whole)


def _whole(source: bpy.types.Node) -> str:
    """The pass of the picture to put shadows onto."""
    return _NOISY if _NOISY in _passes(source) else "Image"


def _take_from(tree: bpy.types.NodeTree, group: bpy.types.Node, sources: list, whole: str) -> None:
    """Makes pass `whole` the picture that comes to a group of ours from `sources`, straight or through a
    user's nodes: whether Cycles denoises may have been switched since."""
    seen, waiting = set(), [group.inputs["Image"]]
    while waiting:
        for link in list(waiting.pop().links):
            node, name = link.from_node, link.from_socket.name
            if node in sources and name in ("Image", _NOISY) and name != whole:
                tree.links.new(node.outputs[whole], link.to_socket)
            elif node not in seen and not _is_ours(node):
                seen.add(node)
                waiting.extend(node.inputs)


def _reads(group: bpy.types.Node, source: bpy.types.Node) -> bool:
    return any(link.from_node == source for socket in group.inputs for link in socket.links)


def _part(tree: bpy.types.NodeTree, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
    """Takes away what an earlier build made for a view layer that has nothing to join any more."""
    sources = _sources(tree, scene, view_layer)
    for node in [node for node in tree.nodes if _is_ours(node)]:
        if any(_reads(node, source) for source in sources):
            _bypass(tree, node)


def _bypass(tree: bpy.types.NodeTree, group: bpy.types.Node) -> None:
    """Takes a group of ours away; what its image went to gets what it got."""
    _take_from(
        tree, group, [node for node in tree.nodes if node.type == "R_LAYERS" and _reads(group, node)], "Image"
    )
    sources = [link.from_socket for link in group.inputs["Image"].links]
    for target in [link.to_socket for link in group.outputs["Image"].links]:
        for source in sources:
            tree.links.new(source, target)
    inside = group.node_tree
    tree.nodes.remove(group)
    if not inside.users:
        bpy.data.node_groups.remove(inside)


def _insert(tree: bpy.types.NodeTree, sources: list[bpy.types.Node]) -> bpy.types.Node:
    """A group of no nodes yet, between the image of the sources and what it went to."""
    inside = bpy.data.node_groups.new(GROUP_NAME, "CompositorNodeTree")
    _set_sockets(inside, ["Image"])
    source, group = sources[0], tree.nodes.new("CompositorNodeGroup")
    group.node_tree = inside
    group.name = group.label = GROUP_NAME
    group.width = _STEP
    group.location = (source.location.x + source.width + 0.3 * _STEP, source.location.y + 0.8 * _STEP)
    for target in [link.to_socket for node in sources for link in node.outputs["Image"].links]:
        tree.links.new(group.outputs["Image"], target)
    tree.links.new(source.outputs["Image"], group.inputs["Image"])
    return group


def _fill(inside, file: bpy.types.Image, scene, view_layer, source, joined, is_sequence: bool) -> None:
    inside.nodes.clear()
    image = inside.nodes.new("CompositorNodeImage")
    image.image, image.location = file, (0, -_STEP)
    if image.has_layers:
        image.layer = view_layer.name
    if is_sequence:
        image.frame_duration, image.use_auto_refresh = max(scene.frame_end, 1), True
    passes, is_denoised = _passes(source), _whole(source) == _NOISY
    # What guides a denoiser belongs to Cycles' Denoising Data.
    guides = {name: socket for name, socket in _GUIDES.items() if is_denoised and name in passes}
    _set_sockets(inside, ["Image", *guides, *joined.values()])
    start, end = inside.nodes.new("NodeGroupInput"), inside.nodes.new("NodeGroupOutput")
    result = start.outputs["Image"]
    for row, (name, group) in enumerate(joined.items(), start=1):
        change = _math(inside, "SUBTRACT", image.outputs[name], 1.0, (2, -row))
        change = _mix(inside, "MULTIPLY", start.outputs[group], change, (3, -row))
        result = _mix(inside, "ADD", result, change, (3 + row, 0))
    column = 4 + len(joined)
    if is_denoised:
        node = inside.nodes.new("CompositorNodeDenoise")
        inputs = [node.inputs["Image"], *(node.inputs[socket] for socket in guides.values())]
        values = [result, *(start.outputs[name] for name in guides)]
        result = _joined(inside, node, inputs, values, (column, 0), node.outputs["Image"])
        column += 1
    inside.links.new(result, end.inputs["Image"])
    end.location = (column * _STEP, 0)


def _set_sockets(tree, inputs: list[str]) -> None:
    """Only what has changed: a socket that is taken away takes the links of the group's nodes along."""
    wanted = [("OUTPUT", "Image"), *(("INPUT", name) for name in inputs)]
    there = {(item.in_out, item.name): item for item in tree.interface.items_tree}
    for key, item in there.items():
        if key not in wanted:
            tree.interface.remove(item)
    for in_out, name in wanted:
        if (in_out, name) not in there:
            tree.interface.new_socket(name, in_out=in_out, socket_type="NodeSocketColor")


def _math(tree, operation: str, left, right, place: tuple[int, int]):
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    return _joined(tree, node, node.inputs[:2], (left, right), place, node.outputs[0])


def _mix(tree, blend_type: str, left, right, place: tuple[int, int]):
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type, node.blend_type, node.clamp_factor = "RGBA", blend_type, False
    by_identifier = {socket.identifier: socket for socket in (*node.inputs, *node.outputs)}
    by_identifier["Factor_Float"].default_value = 1.0
    inputs = by_identifier["A_Color"], by_identifier["B_Color"]
    return _joined(tree, node, inputs, (left, right), place, by_identifier["Result_Color"])


def _joined(tree, node, inputs: Iterable, values: Iterable, place: tuple[int, int], output):
    node.location = (place[0] * _STEP, place[1] * _STEP)
    for socket, value in zip(inputs, values, strict=True):
        if isinstance(value, float):
            socket.default_value = value
        else:
            tree.links.new(value, socket)
    return output
