"""What may stand in a random scene, and what may be done to it."""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Matrix

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


# Vertices and faces, by name.
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


def new_mesh(kind: str) -> bpy.types.Mesh:
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
    settings.render_type, settings.instance_object = "OBJECT", new_object("seed", new_mesh("box"))
    settings.particle_size = 0.1


def _keyed(thing: bpy.types.Object) -> None:
    thing.shape_key_add(name="Basis")
    key = thing.shape_key_add(name="Key")
    for point in key.data:
        point.co = point.co * 1.5
    key.value = 0.5


def instanced(thing: bpy.types.Object) -> None:
    """The thing again, by an empty that instances its collection."""
    group = bpy.data.collections.new("group")
    group.objects.link(thing)
    empty = new_object("instancer", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", group
    empty.matrix_world = Matrix.Translation((0.5, 0.5, 0.7)) @ Matrix.Diagonal((1, -1, 2, 1))


def _on_vertices(thing: bpy.types.Object) -> None:
    child = new_object("child", new_mesh("triangle"))
    child.parent = thing
    thing.instance_type = "VERTS"


def parented(thing: bpy.types.Object) -> None:
    parent = new_object("parent", None)
    parent.scale, parent.rotation_euler = (1, 3, 0.2), (0.3, 0.2, 1)
    thing.parent = parent


CHANGES = {
    "arrayed": _arrayed,
    "subdivided": _subdivided,
    "haired": _haired,
    "scattered": _scattered,
    "keyed": _keyed,
    "instanced": instanced,
    "on vertices": _on_vertices,
    "parented": parented,
}


def new_object(name: str, data) -> bpy.types.Object:
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing
