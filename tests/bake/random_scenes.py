"""Scenes out of plain values, any of them.

A recipe is a dict that JSON could hold, so that one that failed can be kept as it is. What a recipe does not
mention is plain: a camera that looks at the origin, and nothing else.
"""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

# Meshes: vertices and faces

_STAR = [
    (r * math.cos(a), r * math.sin(a), 0.0) for r, a in ((1 + i % 2, i * math.pi / 5) for i in range(10))
]
_BOX = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
_SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
_SQUARE = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
NAN, INF = math.nan, math.inf


def _grid(count: int) -> tuple[list, list]:
    side = [2.0 * i / count - 1.0 for i in range(count + 1)]
    points = [(x, y, 0.3 * math.sin(5 * x) * math.cos(4 * y)) for y in side for x in side]
    row = count + 1
    first = [y * row + x for y in range(count) for x in range(count)]
    return points, [(i, i + 1, i + row + 1, i + row) for i in first]


MESHES: dict[str, tuple[list, list]] = {
    "square": (_SQUARE, [(0, 1, 2, 3)]),
    "box": (_BOX, _SIDES),
    "triangle": (_SQUARE[:3], [(0, 1, 2)]),
    "star": (_STAR, [tuple(range(10))]),
    "grid": _grid(12),
    "open box": (_BOX, _SIDES[:5]),
    "inside out": (_BOX, [side[::-1] for side in _SIDES]),
    "box with a flap": ([*_BOX, (3, 0, 3)], [*_SIDES, (0, 1, 8)]),
    "nothing": ([], []),
    "vertices": (_BOX, []),
    "edge": (_SQUARE[:2], []),
    "a point of a triangle": ([(0, 0, 0)] * 3, [(0, 1, 2)]),
    "a line of a triangle": ([(0, 0, 0), (1, 1, 1), (2, 2, 2)], [(0, 1, 2)]),
    "sliver": ([(-1, 0, 0), (1, 0, 0), (0, 1e-9, 0)], [(0, 1, 2)]),
    "needles": ([(0, 0, 0), (1e6, 1e-3, 0), (1e6, 0, 1e-3)], [(0, 1, 2)]),
    "bow": ([_SQUARE[0], _SQUARE[2], _SQUARE[1], _SQUARE[3]], [(0, 1, 2, 3)]),
    "twice": (_SQUARE, [(0, 1, 2), (0, 1, 2), (0, 2, 1)]),
    "folded": ([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 2)], [(0, 1, 2, 3)]),
    "nan": ([*_BOX[:7], (NAN, 0, 0)], _SIDES),
    "all nan": ([(NAN, NAN, NAN)] * 3, [(0, 1, 2)]),
    "inf": ([*_BOX[:7], (INF, 0, -INF)], _SIDES),
    "1e30": ([*_BOX[:7], (1e30, 1e30, 1e30)], _SIDES),
    "3e38": ([*_BOX[:7], (3e38, -3e38, 3e38)], _SIDES),
    "1e-30": ([tuple(1e-30 * c for c in p) for p in _BOX], _SIDES),
}


def _mesh(kind: str) -> bpy.types.Mesh:
    points, faces = MESHES[kind]
    mesh = bpy.data.meshes.new(kind)
    mesh.from_pydata(
        [tuple(map(float, point)) for point in points], [(0, 1)] if kind == "edge" else [], faces
    )
    if kind in {"square", "grid"}:
        uvs = mesh.uv_layers.new()
        uvs.data.foreach_set("uv", np.random.default_rng(0).random(2 * len(mesh.loops), np.float32))
    if kind == "grid":
        mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    return mesh


def _curve() -> bpy.types.Curve:
    curve = bpy.data.curves.new("curve", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.1
    line = curve.splines.new("BEZIER")
    line.bezier_points.add(2)
    for i, point in enumerate(line.bezier_points):
        point.co, point.handle_left_type, point.handle_right_type = (i - 1, i % 2, 0.5 * i), "AUTO", "AUTO"
    return curve


def _text() -> bpy.types.Curve:
    text = bpy.data.curves.new("text", "FONT")
    text.body, text.extrude = "Aé", 0.1
    return text


def _ball() -> bpy.types.MetaBall:
    ball = bpy.data.metaballs.new("ball")
    ball.resolution = ball.render_resolution = 0.4
    ball.elements.new()
    return ball


OTHERS = {
    "curve": _curve,
    "text": _text,
    "ball": _ball,
    "bare curve": lambda: bpy.data.curves.new("bare", "CURVE"),
    "volume": lambda: bpy.data.volumes.new("volume"),
    "hair curves": lambda: bpy.data.hair_curves.new("hair"),
    "point cloud": lambda: bpy.data.pointclouds.new("points"),
    "lattice": lambda: bpy.data.lattices.new("lattice"),
}


def _arrayed(thing: bpy.types.Object) -> None:
    thing.modifiers.new("array", "ARRAY").count = 3


def _subdivided(thing: bpy.types.Object) -> None:
    modifier = thing.modifiers.new("subdivided", "SUBSURF")
    modifier.levels = modifier.render_levels = 2


def _haired(thing: bpy.types.Object) -> None:
    thing.modifiers.new("hair", "PARTICLE_SYSTEM")
    settings = thing.particle_systems[0].settings
    settings.type, settings.count = "HAIR", 5


def _scattered(thing: bpy.types.Object) -> None:
    _haired(thing)
    settings = thing.particle_systems[0].settings
    settings.render_type, settings.instance_object = "OBJECT", _object("seed", _mesh("box"))
    settings.particle_size = 0.1


def _keyed(thing: bpy.types.Object) -> None:
    thing.shape_key_add(name="Basis")
    key = thing.shape_key_add(name="Key")
    for point in key.data:
        point.co = point.co * 1.5
    key.value = 0.5


def _instanced(thing: bpy.types.Object) -> None:
    """The thing again, by an empty that instances its collection."""
    group = bpy.data.collections.new("group")
    group.objects.link(thing)
    empty = _object("instancer", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", group
    empty.matrix_world = Matrix.Translation((0.5, 0.5, 0.7)) @ Matrix.Diagonal((1, -1, 2, 1))


def _on_vertices(thing: bpy.types.Object) -> None:
    child = _object("child", _mesh("triangle"))
    child.parent = thing
    thing.instance_type = "VERTS"


def _parented(thing: bpy.types.Object) -> None:
    parent = _object("parent", None)
    parent.scale, parent.rotation_euler = (1, 3, 0.2), (0.3, 0.2, 1)
    thing.parent = parent


CHANGES = {
    "arrayed": _arrayed,
    "subdivided": _subdivided,
    "haired": _haired,
    "scattered": _scattered,
    "keyed": _keyed,
    "instanced": _instanced,
    "on vertices": _on_vertices,
    "parented": _parented,
}

# Materials


def _nodes(name: str):
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    return material, tree, tree.nodes.get("Principled BSDF"), tree.nodes.get("Material Output")


def _principled(**values) -> bpy.types.Material:
    material, _tree, node, _output = _nodes("principled")
    for name, value in values.items():
        node.inputs[name.replace("_", " ")].default_value = value
    return material


def _image(kind: str) -> bpy.types.Image:
    if kind == "missing":
        image = bpy.data.images.new("missing", 4, 4)
        image.source, image.filepath = "FILE", "//not_there.png"
        return image
    image = bpy.data.images.new(kind, 8, 8, alpha=True, float_buffer=kind == "wild")
    pixels = np.random.default_rng(1).random(8 * 8 * 4, np.float32)
    if kind == "wild":
        pixels[:12] = [NAN, INF, -INF, 1e38, -1e38, 1e-38, NAN, NAN, NAN, NAN, INF, 0.0]
    image.pixels.foreach_set(pixels)
    image.pack()
    return image


def _textured(kind: str, *inputs: str, compared: bool = False) -> bpy.types.Material:
    material, tree, node, _output = _nodes(kind)
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = _image(kind)
    for name in inputs:
        source = texture.outputs["Alpha" if name == "Alpha" else "Color"]
        if compared:
            math_node = tree.nodes.new("ShaderNodeMath")
            math_node.operation = "GREATER_THAN"
            tree.links.new(source, math_node.inputs[0])
            source = math_node.outputs[0]
        tree.links.new(source, node.inputs[name])
    return material


def _medium(kind: str, density: float, anisotropy: float = 0.0) -> bpy.types.Material:
    material, tree, node, output = _nodes("medium")
    tree.nodes.remove(node)
    _add_volume(tree, output, kind, density, anisotropy)
    return material


def _add_volume(tree, output, kind: str, density: float, anisotropy: float) -> None:
    volume = tree.nodes.new(kind)
    volume.inputs["Density"].default_value = density
    if "Anisotropy" in volume.inputs:
        volume.inputs["Anisotropy"].default_value = anisotropy
    tree.links.new(volume.outputs[0], output.inputs["Volume"])


def _other_surface(kind: str) -> bpy.types.Material:
    material, tree, node, output = _nodes(kind)
    tree.nodes.remove(node)
    if kind:
        tree.links.new(tree.nodes.new(kind).outputs[0], output.inputs["Surface"])
    return material


def _without_output() -> bpy.types.Material:
    material, tree, _node, _output = _nodes("without output")
    tree.nodes.clear()
    return material


MATERIALS = {
    "plain": _principled,
    "red": lambda: _principled(Base_Color=(0.8, 0.1, 0.1, 1.0)),
    "clear": lambda: _principled(Alpha=0.3),
    "away": lambda: _principled(Alpha=0.0),
    "glowing": lambda: _principled(Emission_Strength=5.0),
    "blazing": lambda: _principled(Emission_Strength=3e38, Emission_Color=(3e38, 1, 1, 1)),
    "black hole": lambda: _principled(Base_Color=(-1.0, 1e30, 0, 1)),
    "diffuse": lambda: _other_surface("ShaderNodeBsdfDiffuse"),
    "emission": lambda: _other_surface("ShaderNodeEmission"),
    "transparent": lambda: _other_surface("ShaderNodeBsdfTransparent"),
    "glass": lambda: _other_surface("ShaderNodeBsdfGlass"),
    "mixed": lambda: _other_surface("ShaderNodeMixShader"),
    "no shader": lambda: _other_surface(""),
    "no output": _without_output,
    "leaves": lambda: _textured("leaves", "Base Color", "Alpha"),
    "cut": lambda: _textured("leaves", "Alpha", compared=True),
    "wild": lambda: _textured("wild", "Base Color", "Alpha"),
    "missing": lambda: _textured("missing", "Base Color", "Alpha"),
    "mist": lambda: _medium("ShaderNodeVolumeScatter", 0.3),
    "thick": lambda: _medium("ShaderNodeVolumeScatter", 1e4, 0.9),
    "soot": lambda: _medium("ShaderNodeVolumeAbsorption", 2.0),
    "smoke": lambda: _medium("ShaderNodeVolumePrincipled", 1.0, -0.5),
    "no mist": lambda: _medium("ShaderNodeVolumeScatter", 0.0),
    "negative": lambda: _medium("ShaderNodeVolumeScatter", -1.0),
}


# Building


def _object(name: str, data) -> bpy.types.Object:
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


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
    thing = _object("Camera", data)
    _placed(thing, {"at": (4, -5, 3), "to": (0, 0, 0)} | recipe, offset)
    if recipe.get("parented"):
        _parented(thing)
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
    thing = _object("Lamp", data)
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
        _instanced(thing)


def _thing(recipe: dict, offset: Vector) -> None:
    kind = recipe.get("mesh", "box")
    data = OTHERS[kind]() if kind in OTHERS else _mesh(kind)
    for name in recipe.get("materials", ("plain",)):
        if hasattr(data, "materials"):
            data.materials.append(MATERIALS[name]() if name else None)
    if kind in MESHES and len(recipe.get("materials", ())) > 1:
        data.polygons.foreach_set("material_index", [i % 3 for i in range(len(data.polygons))])
    thing = _object(kind, data)
    _placed(thing, recipe, offset)
    for name in recipe.get("hidden", ()):
        setattr(thing, name, not getattr(thing, name))
    if thing.type == "MESH" and (change := recipe.get("changed")):
        CHANGES[change](thing)


def _world(recipe: dict) -> None:
    world = bpy.context.scene.world = bpy.data.worlds.new("World")
    output = world.node_tree.nodes.get("World Output")
    _add_volume(world.node_tree, output, recipe["volume"], recipe["density"], recipe.get("anisotropy", 0.0))


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
