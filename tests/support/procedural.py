"""Scenes whose materials hang on what no reader of nodes covers."""

from __future__ import annotations

import bpy


def clear_by(name: str, make) -> bpy.types.Material:
    """A material that is as opaque as `make(tree)` says, an output of a node in its tree."""
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    tree.links.new(make(tree), tree.nodes["Principled BSDF"].inputs["Alpha"])
    return material


def stretched(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """From 0.35 to 0.65 made 0 to 1: most of a noise lies there."""
    node = tree.nodes.new("ShaderNodeMapRange")
    node.inputs["From Min"].default_value, node.inputs["From Max"].default_value = 0.35, 0.65
    tree.links.new(socket, node.inputs["Value"])
    return node.outputs["Result"]


def noise(tree: bpy.types.NodeTree, coordinates: bpy.types.NodeSocket | None = None, scale: float = 4.0):
    node = tree.nodes.new("ShaderNodeTexNoise")
    node.inputs["Scale"].default_value, node.inputs["Detail"].default_value = scale, 0.0
    if coordinates is not None:
        tree.links.new(coordinates, node.inputs["Vector"])
    return stretched(tree, node.outputs[0])


def coordinates(tree: bpy.types.NodeTree, name: str) -> bpy.types.NodeSocket:
    return tree.nodes.new("ShaderNodeTexCoord").outputs[name]


def card(material: bpy.types.Material, location=(0.0, 0.0, 1.0), size: float = 3.0) -> bpy.types.Object:
    """Over the floor, not seen."""
    bpy.ops.mesh.primitive_plane_add(size=size, location=location)
    made = bpy.context.object
    made.data.materials.append(material)
    made.visible_camera = False
    return made


def floor_scene() -> bpy.types.Scene:
    """A floor under a sun, seen from above."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=12.0)
    bpy.context.object.name = "Floor"
    bpy.ops.object.light_add(type="SUN", location=(0.3, -0.2, 4.0))
    bpy.context.object.name = "Sun"
    bpy.context.object.data.energy, bpy.context.object.data.angle = 3.0, 0.01
    bpy.ops.object.camera_add(location=(0.0, 0.0, 8.0))
    scene.camera = bpy.context.object
    return scene
