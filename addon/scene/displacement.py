"""True displacement: what a material moves a surface by when it is rendered, which no evaluated mesh has."""

from __future__ import annotations

import bpy


def displacing_node(material: bpy.types.Material) -> str | None:
    """The name of the node that displaces, None where nothing does: nothing is linked, it is for bumps only,
    or it moves by 0."""
    if material.displacement_method == "BUMP" or material.node_tree is None:
        return None
    output = material.node_tree.get_output_node("CYCLES")
    node = None if output is None else _source(output.inputs["Displacement"])
    return None if node is None or _moves_nothing(node) else node.name


def _source(socket: bpy.types.NodeSocket) -> bpy.types.Node | None:
    """What feeds an input, through reroutes."""
    for _hop in range(64):
        links = [link for link in socket.links if link.is_valid and not link.is_muted]
        if not links:
            return None
        node = links[0].from_node
        if node.bl_idname != "NodeReroute":
            return node
        socket = node.inputs[0]
    return None


def _moves_nothing(node: bpy.types.Node) -> bool:
    if node.bl_idname != "ShaderNodeDisplacement":
        return False
    height, midlevel, scale = (node.inputs[name] for name in ("Height", "Midlevel", "Scale"))
    if not scale.is_linked and scale.default_value == 0.0:
        return True
    return not (height.is_linked or midlevel.is_linked) and height.default_value == midlevel.default_value
