"""Scenes out of plain values, any of them.

A recipe is a dict that JSON could hold, so that one that failed can be kept as it is. What a recipe does not
mention is plain: a camera that looks at the origin, and nothing else.
"""

from __future__ import annotations

from typing import Any

import bpy
from mathutils import Matrix, Vector
from strata.tests.bake.random_materials import MATERIALS, add_volume
from strata.tests.bake.random_things import CHANGES, MESHES, OTHERS, instanced, new_mesh, new_object, parented


def _placed(thing: bpy.types.Object, recipe: dict, offset: Vector) -> None:
    """`at`, looking `to` (down its -z) or turned by `turn`, scaled by `scale`."""
    at = Vector(recipe.get("at", (0, 0, 0)))
    turn = Matrix.Rotation(recipe.get("turn", 0.0), 4, (0.3, 0.5, 0.8))
    if "to" in recipe:
        way = Vector(recipe["to"]) - at
        turn = (
            way.to_track_quat("-Z", "Y") if way.length > 0.0 else Vector((0, 0, -1)).to_track_quat("-Z", "Y")
        )
        turn = turn.to_matrix().to_4x4()
    thing.location, thing.rotation_euler = at + offset, turn.to_euler()
    thing.scale = recipe.get("scale", (1, 1, 1))


def _camera(recipe: dict, offset: Vector) -> None:
    data = bpy.data.cameras.new("Camera")
    for name, value in recipe.items():
        if name not in {"at", "to", "turn", "scale", "parented"}:
            setattr(data, name, value)
    thing = new_object("Camera", data)
    _placed(thing, {"at": (4, -5, 3), "to": (0, 0, 0)} | recipe, offset)
    if recipe.get("parented"):
        parented(thing)
    bpy.context.scene.camera = thing


_LAMPS_OWN = {"type", "at", "to", "turn", "scale", "linked", "blocked", "nodes", "instanced"}


def _lamp(recipe: dict, offset: Vector) -> None:
    data = bpy.data.lights.new("Lamp", recipe["type"])
    for name, value in recipe.items():
        if name not in _LAMPS_OWN and hasattr(data, name):
            setattr(data, name, value)
    if nodes := recipe.get("nodes"):
        data.use_nodes = True
        tree = data.node_tree
        node = tree.nodes.get("Emission")
        if nodes == "none":
            tree.nodes.clear()
        elif nodes == "texture":
            tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], node.inputs["Color"])
        else:
            node.inputs["Strength"].default_value = nodes
    thing = new_object("Lamp", data)
    _placed(thing, {"at": (1, -1, 4), "to": (0, 0, 0)} | recipe, offset)
    for name, role in (("linked", "receiver_collection"), ("blocked", "blocker_collection")):
        if name in recipe:
            group = bpy.data.collections.new(name)
            for other in bpy.data.objects:
                if other.type == "MESH" and recipe[name]:
                    group.objects.link(other)
                    break
            setattr(thing.light_linking, role, group)
    if recipe.get("instanced"):
        instanced(thing)


def _thing(recipe: dict, offset: Vector) -> None:
    kind = recipe.get("mesh", "box")
    data = OTHERS[kind]() if kind in OTHERS else new_mesh(kind)
    for name in recipe.get("materials", ("plain",)):
        if hasattr(data, "materials"):
            data.materials.append(MATERIALS[name]() if name else None)
    if kind in MESHES and len(recipe.get("materials", ())) > 1:
        data.polygons.foreach_set("material_index", [i % 3 for i in range(len(data.polygons))])
    thing = new_object(kind, data)
    _placed(thing, recipe, offset)
    for name in recipe.get("hidden", ()):
        setattr(thing, name, not getattr(thing, name))
    if thing.type == "MESH" and (change := recipe.get("changed")):
        CHANGES[change](thing)


def _world(recipe: dict) -> None:
    world = bpy.context.scene.world = bpy.data.worlds.new("World")
    output = world.node_tree.nodes.get("World Output")
    add_volume(world.node_tree, output, recipe["volume"], recipe["density"], recipe.get("anisotropy", 0.0))


def build(recipe: dict[str, Any]) -> bpy.types.Scene:
    """The scene of a recipe, in a new file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    offset = Vector(recipe.get("offset", (0, 0, 0)))
    if (camera := recipe.get("camera", {})) is not None:
        _camera(camera, offset)
    for thing in recipe.get("things", ()):
        _thing(thing, offset)
    for lamp in recipe.get("lamps", ()):
        _lamp(lamp, offset)
    if world := recipe.get("world"):
        _world(world)
    render = scene.render
    render.resolution_x, render.resolution_y = recipe.get("size", (32, 18))
    render.resolution_percentage = 100
    if region := recipe.get("region"):
        render.use_border = True
        render.use_crop_to_border = region[4]
        render.border_min_x, render.border_min_y, render.border_max_x, render.border_max_y = region[:4]
    if "pixel_aspect" in recipe:
        render.pixel_aspect_x, render.pixel_aspect_y = recipe["pixel_aspect"]
    return scene


_QUICK = {
    "soft_shadow.resolution": 256,
    "volumetric_light.resolution": 128,
    "volumetric_light.light_samples": 2,
}


def words_of(recipe: dict[str, Any]) -> list[str]:
    """How the command line is to bake it."""
    words = ["--samples", str(recipe.get("samples", 1)), "--probes", str(recipe.get("probes", 16))]
    words += ["--backend", recipe.get("backend", "cpu")]
    if "effects" in recipe:
        words += ["--effects", ",".join(recipe["effects"])]
    for name, value in (_QUICK | recipe.get("settings", {})).items():
        words += ["--set", f"{name}={value}"]
    return words
