"""Compositor nodes that put baked shadows onto a render, beside whatever a user's tree does already.

With light groups: image + sum over groups of its image times (its shadows - 1), so that what no group has
(the sky, emission) stays as it is. Without: the image times all shadows, so that each of them darkens every
light. Right only for renders whose lights cast no shadows themselves.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..core.effect import Blend
from ..core.errors import StrataError
from ..core.naming import layer_name
from ..effects.registry import EFFECTS
from ..scene.lamp_names import LampNames, NamedLamp

GROUP_NAME = "Strata Shadows"
_STEP = 200  # of the grid that nodes are laid out on


@dataclass(frozen=True)
class Built:
    """Shadows by name: what `build` joined, those that it did not, as their lights are in no group, and those
    that are of no lamp in the scene."""

    joined: tuple[str, ...]
    apart: tuple[str, ...]
    unknown: tuple[str, ...]


def build(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, path: Path, is_sequence: bool) -> Built:
    """Makes the nodes, or makes them anew where they are already. A user's nodes and links stay: what the
    Render Layers' image went to now gets it by way of the shadows. Raises StrataError if `path` has none.
    """
    image = _load(path, is_sequence)
    tree = scene.compositing_node_group or _new_tree(scene)
    scene.render.use_compositing = True
    source = _render_layers(tree, scene, view_layer)
    inside = bpy.data.node_groups.get(GROUP_NAME) or bpy.data.node_groups.new(
        GROUP_NAME, "CompositorNodeTree"
    )
    names = _fill(inside, image, scene, view_layer, source, is_sequence)
    group = next((node for node in tree.nodes if node.type == "GROUP" and node.node_tree == inside), None)
    if group is None:
        group = _insert(tree, source, inside)
    for socket in group.inputs:
        tree.links.new(source.outputs[socket.name], socket)
    return names


def _load(path: Path, is_sequence: bool) -> bpy.types.Image:
    if not path.is_file():
        raise StrataError(f"there is no {path}: bake to a file first")
    image = bpy.data.images.load(str(path), check_existing=True)
    source = "SEQUENCE" if is_sequence else "FILE"
    if image.source != source:
        image.source = source
    else:
        image.reload()
    return image


def _new_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """A render that goes out as it comes in."""
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    output = tree.nodes.new("NodeGroupOutput")
    output.location = (4 * _STEP, 0)
    layers = tree.nodes.new("CompositorNodeRLayers")
    tree.links.new(layers.outputs["Image"], output.inputs[0])
    scene.compositing_node_group = tree
    return tree


def _render_layers(tree: bpy.types.NodeTree, scene, view_layer) -> bpy.types.Node:
    for node in tree.nodes:
        if node.type == "R_LAYERS" and node.scene == scene and node.layer == view_layer.name:
            return node
    node = tree.nodes.new("CompositorNodeRLayers")
    node.scene, node.layer = scene, view_layer.name
    return node


def _insert(tree: bpy.types.NodeTree, source: bpy.types.Node, inside: bpy.types.NodeTree) -> bpy.types.Node:
    group = tree.nodes.new("CompositorNodeGroup")
    group.node_tree = inside
    group.name = group.label = GROUP_NAME
    group.width = _STEP
    group.location = (source.location.x + source.width + 0.3 * _STEP, source.location.y + 0.8 * _STEP)
    for target in [link.to_socket for link in source.outputs["Image"].links]:
        tree.links.new(group.outputs["Image"], target)
    return group


_SHADOWS = [kind.title for effect in EFFECTS for kind in effect.layers if kind.blend == Blend.SCALE_LIGHT]


def _shadows(view_layer: bpy.types.ViewLayer, image: bpy.types.Node) -> dict[str, NamedLamp]:
    """Lamps by the output of the node that has their shadow; also lamps that only an evaluated scene has."""
    names = LampNames()
    lamps = {named.pass_name: named for named in names.standing(view_layer)}
    if view_layer.depsgraph is not None:
        lamps |= {named.pass_name: named for named in names.shown(view_layer.depsgraph)}
    found = {layer_name(title, name): lamps[name] for title in _SHADOWS for name in lamps}
    return {output: named for output, named in found.items() if output in image.outputs}


def _fill(tree, file: bpy.types.Image, scene, view_layer, source, is_sequence: bool) -> Built:
    tree.nodes.clear()
    image = tree.nodes.new("CompositorNodeImage")
    image.image, image.location = file, (0, -_STEP)
    if image.has_layers:
        image.layer = view_layer.name
    if is_sequence:
        image.frame_duration, image.use_auto_refresh = max(scene.frame_end, 1), True
    groups: dict[str, list[str]] = {}
    shadows = _shadows(view_layer, image)
    for name, named in shadows.items():
        group = f"Combined_{named.lamp.lightgroup or named.outermost.lightgroup}"
        groups.setdefault(group if group in source.outputs else "", []).append(name)
    if not groups:
        raise StrataError(f"{file.name} has no shadow of a light of this scene")
    starts = tuple(f"{title} " for title in _SHADOWS)
    unknown = [o.name for o in image.outputs if o.name.startswith(starts) and o.name not in shadows]
    apart = groups.pop("", []) if set(groups) != {""} else []
    _set_sockets(tree, ["Image", *filter(None, groups)])
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    result, column = start.outputs["Image"], 1
    for row, (group, names) in enumerate(groups.items()):
        shadow = image.outputs[names[0]]
        for name in names[1:]:
            column += 1
            shadow = _math(tree, "MULTIPLY", shadow, image.outputs[name], (column, -row - 1))
        if not group:
            result = _mix(tree, "MULTIPLY", result, shadow, (column + 1, 0))
            continue
        change = _math(tree, "SUBTRACT", shadow, 1.0, (column + 1, -row - 1))
        change = _mix(tree, "MULTIPLY", start.outputs[group], change, (column + 2, -row - 1))
        result = _mix(tree, "ADD", result, change, (column + 3, 0))
        column += 3
    tree.links.new(result, end.inputs["Image"])
    end.location = ((column + 3) * _STEP, 0)
    joined = tuple(name for names in groups.values() for name in names)
    return Built(joined, tuple(apart), tuple(unknown))


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
