"""Whether a world sends light, which no layer holds."""

from __future__ import annotations

import bpy


def gives_light(world: bpy.types.World) -> bool:
    """By its background's colour and strength; whatever nodes make of it counts as light."""
    if world.node_tree is None:
        return any(world.color)
    output = world.node_tree.get_output_node("CYCLES")
    links = output.inputs["Surface"].links if output is not None else ()
    node = next((link.from_node for link in links if link.is_valid and not link.is_muted), None)
    if node is None or node.bl_idname != "ShaderNodeBackground":
        return node is not None
    colour, strength = node.inputs["Color"], node.inputs["Strength"]
    is_dark = not colour.is_linked and not any(colour.default_value[:3])
    return not is_dark and (strength.is_linked or strength.default_value != 0.0)
