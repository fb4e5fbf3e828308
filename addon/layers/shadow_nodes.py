"""Nodes of a compositor that multiply baked shadows, and filters before them, onto light groups.

The picture is the image + the sum over light groups of (its image times (what scales its lamp - 1)), so that
what no group has (the sky, emission, lamps that are not joined) stays as it is. Where Cycles denoises, the
noisy image is taken and denoised after that: light groups are noisy, and of a denoised image their noise
would stay where a shadow takes most of the light away.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import bpy

GROUP_NAME = "Strata Shadows"
_NOISY = "Noisy Image"  # Cycles' pass beside a denoised image
_GUIDES = {"Denoising Albedo": "Albedo", "Denoising Normal": "Normal"}
"""Sockets of the Denoise node by Cycles' passes."""
_STEP = 200  # of the grid that nodes are laid out on


def load_file(path: Path, is_sequence: bool, is_relative: bool) -> bpy.types.Image:
    image = bpy.data.images.load(str(path), check_existing=True)
    if is_relative:
        image.filepath = bpy.path.relpath(str(path))
    source = "SEQUENCE" if is_sequence else "FILE"
    if image.source != source:
        image.source = source
    else:
        image.reload()
    return image


def new_tree(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> bpy.types.NodeTree:
    """A render that goes out as it comes in."""
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    output = tree.nodes.new("NodeGroupOutput")
    output.location = (4 * _STEP, 0)
    tree.links.new(new_source(tree, scene, view_layer).outputs["Image"], output.inputs[0])
    scene.compositing_node_group = tree
    return tree


def new_source(tree: bpy.types.NodeTree, scene, view_layer) -> bpy.types.Node:
    node = tree.nodes.new("CompositorNodeRLayers")
    node.scene, node.layer = scene, view_layer.name
    return node


def sources_of(tree: bpy.types.NodeTree, scene, view_layer) -> list[bpy.types.Node]:
    """Nodes that have the render of a view layer."""
    return [
        node
        for node in tree.nodes
        if node.type == "R_LAYERS" and node.scene == scene and node.layer == view_layer.name
    ]


def shows_image(tree: bpy.types.NodeTree, sources: list[bpy.types.Node]) -> bool:
    """Whether the image of a view layer goes on, through nodes of ours or not."""
    ours = [node for node in tree.nodes if _is_ours(node)]
    return any(
        _goes_on(source.outputs["Image"]) or any(_reads(node, source) for node in ours) for source in sources
    )


def lit_passes_shown(source: bpy.types.Node) -> list[str]:
    """Passes beside the image that have lamps' light and go on."""
    return [
        socket.name
        for socket in source.outputs
        if (socket.name == _NOISY or socket.name.endswith((" Direct", " Indirect"))) and _goes_on(socket)
    ]


def _goes_on(socket: bpy.types.NodeSocket) -> bool:
    """To more than to be looked at."""
    return any(link.to_node.type != "VIEWER" for link in socket.links)


def passes_of(source: bpy.types.Node) -> set[str]:
    return {output.name for output in source.outputs if output.enabled and not output.is_unavailable}


def _is_ours(node: bpy.types.Node) -> bool:
    return node.type == "GROUP" and node.node_tree is not None and node.node_tree.name.startswith(GROUP_NAME)


def nodes_of(scene: bpy.types.Scene) -> list[bpy.types.Node]:
    tree = scene.compositing_node_group
    return [] if tree is None else [node for node in tree.nodes if _is_ours(node)]


def join(
    tree: bpy.types.NodeTree,
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    file: bpy.types.Image,
    joined: dict[str, tuple[str, ...]],
    is_sequence: bool,
) -> None:
    """`joined`: by pass of a light group, names of the layers to multiply onto it."""
    sources = sources_of(tree, scene, view_layer)
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
    return _NOISY if _NOISY in passes_of(source) else "Image"


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


def unjoin(tree: bpy.types.NodeTree, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
    """Takes away what an earlier build made for a view layer that has nothing to join any more."""
    sources = sources_of(tree, scene, view_layer)
    for node in [node for node in tree.nodes if _is_ours(node)]:
        if any(_reads(node, source) for source in sources):
            bypass(tree, node)


def bypass(tree: bpy.types.NodeTree, group: bpy.types.Node) -> None:
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
    passes, is_denoised = passes_of(source), _whole(source) == _NOISY
    # What guides a denoiser belongs to Cycles' Denoising Data.
    guides = {name: socket for name, socket in _GUIDES.items() if is_denoised and name in passes}
    _set_sockets(inside, ["Image", *guides, *joined])
    start, end = inside.nodes.new("NodeGroupInput"), inside.nodes.new("NodeGroupOutput")
    result = start.outputs["Image"]
    for row, (group, names) in enumerate(joined.items(), start=1):
        change = _less_one(inside, [image.outputs[name] for name in names], row)
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


def _less_one(tree, factors: list[bpy.types.NodeSocket], row: int):
    """Their product - 1."""
    product, *others = factors
    for factor in others:
        product = _mix(tree, "MULTIPLY", product, factor, (1, -row))
    if product.type == "VALUE":
        return _math(tree, "SUBTRACT", product, 1.0, (2, -row))
    return _mix(tree, "SUBTRACT", product, (1.0, 1.0, 1.0, 0.0), (2, -row))


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
        if isinstance(value, (float, tuple)):
            socket.default_value = value
        else:
            tree.links.new(value, socket)
    return output
