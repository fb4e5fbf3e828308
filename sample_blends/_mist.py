"""A cellar full of haze: sun through barred windows, a lantern on a table, a spot lamp above the casks."""

import math

import _kit as kit
import bpy
import numpy as np

WIDTH, DEPTH, HEIGHT = 6.4, 9.0, 4.0  # of the room, metres; the windows are in the wall at x = 0
WALL = 0.45
WINDOWS = [(2.6, 4.0, 1.15, 3.0), (5.2, 6.6, 1.15, 3.0)]  # y from, y to, z from, z to


def _masonry():
    """Courses of stone, tileable: each block a tone of its own between dark joints."""
    size, courses = 128, 8
    rng = np.random.default_rng(7)
    rows, columns = np.mgrid[0:size, 0:size]
    course = rows * courses // size
    shift = rng.integers(0, size, courses)[course]
    block = ((columns + shift) % size) * 4 // size
    tone = 0.75 + 0.25 * rng.random((courses, 4))[course, block]
    height = size // courses
    joint = (rows % height < 1) | ((columns + shift) % (size // 4) < 1)
    tone = np.where(joint, 0.45, tone) * (0.94 + 0.06 * rng.random((size, size)))
    rgb = tone[..., None] * np.array([0.56, 0.49, 0.41])
    return kit.image("Masonry", np.concatenate([rgb, np.ones((size, size, 1))], 2))


def _surfaces():
    make = kit.material
    return {
        "wall": make("Masonry", (0.5, 0.44, 0.37), 0.95, _masonry()),
        "floor": make("Flagstones", (0.3, 0.26, 0.22), 0.8),
        "wood": make("Old oak", (0.26, 0.15, 0.07), 0.75),
        "pale": make("Pine", (0.5, 0.34, 0.18), 0.8),
        "iron": make("Iron", (0.06, 0.06, 0.065), 0.5),
        "glass": make("Bottle", (0.09, 0.16, 0.08), 0.3),
        "clay": make("Clay", (0.5, 0.22, 0.12), 0.85),
        "cloth": make("Cloth", (0.45, 0.1, 0.08), 0.95),
    }


def _shell(surfaces):
    """Walls around the room, the one at x = 0 with its windows left open, floor and ceiling."""
    x, y, z = WIDTH, DEPTH, HEIGHT
    w = WALL
    (y0, y1, low, high), (y2, y3, _, _) = WINDOWS
    walls = [
        ((-w, -w, 0), (0, y + w, low)),
        ((-w, -w, high), (0, y + w, z)),
        ((-w, -w, low), (0, y0, high)),
        ((-w, y1, low), (0, y2, high)),
        ((-w, y3, low), (0, y + w, high)),
        ((x, -w, 0), (x + w, y + w, z)),
        ((0, y, 0), (x, y + w, z)),
        ((0, -w, 0), (x, 0, z)),
    ]
    shape = kit.project_uv(kit.boxes("Walls", walls, surfaces["wall"]), 0.4)
    kit.add_object("Walls", shape)
    flags = [((-w, -w, -0.3), (x + w, y + w, -0.02))]
    rng = np.random.default_rng(3)
    for row in range(9):
        start = -0.5 * (row % 2)
        for column in range(7):
            left, bottom = start + column * 1.02, row * 1.01
            top = -0.012 + 0.012 * rng.random()
            flags.append(((left, bottom, -0.1), (left + 1.0, bottom + 0.99, top)))
    kit.add_object("Floor", kit.boxes("Floor", flags, surfaces["floor"]))
    kit.add_object(
        "Ceiling", kit.boxes("Ceiling", [((-w, -w, z), (x + w, y + w, z + 0.3))], surfaces["wood"])
    )
    beams = [((0, at, z - 0.34), (x, at + 0.26, z)) for at in (0.9, 3.2, 5.5, 7.8)]
    beams.append(((3.05, 0, z - 0.22), (3.3, y, z - 0.001)))
    kit.bevel(kit.add_object("Beams", kit.boxes("Beams", beams, surfaces["wood"])), 0.02)


def _window(name, window, surfaces):
    """Bars, four upright and three across, and a worn sill."""
    y0, y1, low, high = window
    at = -0.5 * WALL
    runs = []
    for step in np.linspace(y0, y1, 6)[1:-1]:
        runs.append(((at, step, low), (at, step, high), 0.022, 0.022))
    for step in np.linspace(low, high, 5)[1:-1]:
        runs.append(((at - 0.01, y0, step), (at - 0.01, y1, step), 0.018, 0.018))
    kit.add_object(f"{name} bars", kit.tubes(f"{name} bars", runs, surfaces["iron"], sides=10))
    sill = kit.boxes(
        f"{name} sill", [((-WALL - 0.04, y0 - 0.08, low - 0.1), (0.07, y1 + 0.08, low))], surfaces["floor"]
    )
    kit.bevel(kit.add_object(f"{name} sill", sill), 0.015)


def _barrel(name, surfaces, location, size=1.0, rotation=(0, 0, 0)):
    profile = [(0.001, 0.03), (0.27, 0.03), (0.27, 0.0), (0.3, 0.0)]
    profile += [(0.3 + 0.07 * math.sin(math.pi * t), 0.86 * t) for t in np.linspace(0.05, 0.95, 9)]
    profile += [(0.3, 0.86), (0.27, 0.86), (0.27, 0.82), (0.001, 0.82)]
    place = {"location": location, "scale": size, "rotation": rotation}
    kit.lathe(name, profile, surfaces["wood"], steps=28, **place)
    for index, (t, out) in enumerate([(0.08, 0.322), (0.3, 0.362), (0.7, 0.362), (0.92, 0.322)]):
        hoop = [(out, 0.86 * t - 0.025), (out + 0.008, 0.86 * t - 0.02), (out + 0.008, 0.86 * t + 0.02)]
        kit.lathe(
            f"{name} hoop {index}", [*hoop, (out, 0.86 * t + 0.025)], surfaces["iron"], steps=28, **place
        )


def _crate(name, surfaces, location, size, turn):
    """A frame of battens around boards with gaps, that light shines through."""
    h, t = 0.5, 0.05
    spans = []
    for a in (-h, h - t):
        for b in (-h, h - t):
            spans += [
                ((a, b, 0), (a + t, b + t, 2 * h)),
                ((a, -h, b + h), (a + t, h, b + h + t)),
                ((-h, a, b + h), (h, a + t, b + h + t)),
            ]
    for step in np.arange(6):
        z = 0.06 + 0.155 * step
        spans += [
            ((-h, -h + 0.01, z), (h, -h + 0.03, z + 0.12)),
            ((-h, h - 0.03, z), (h, h - 0.01, z + 0.12)),
        ]
        spans += [
            ((-h + 0.01, -h, z), (-h + 0.03, h, z + 0.12)),
            ((h - 0.03, -h, z), (h - 0.01, h, z + 0.12)),
        ]
    made = kit.boxes(name, spans, surfaces["pale"])
    kit.add_object(name, made, location=location, rotation=(0, 0, turn), scale=size)


def _table(surfaces, at):
    x, y = at
    legs = [
        ((x + a, y + b, 0), (x + a + 0.09, y + b + 0.09, 0.74)) for a in (-0.62, 0.53) for b in (-0.36, 0.27)
    ]
    top = [
        ((x - 0.72, y - 0.45 + 0.182 * i, 0.74), (x + 0.72, y - 0.45 + 0.182 * i + 0.176, 0.79))
        for i in range(5)
    ]
    kit.bevel(kit.add_object("Table", kit.boxes("Table", legs + top, surfaces["wood"])), 0.008)


def _lantern(surfaces, at):
    """Four posts, a roof and a ring: the light is in it."""
    x, y, z = at
    runs = [
        ((x + 0.075 * a, y + 0.075 * b, z), (x + 0.075 * a, y + 0.075 * b, z + 0.26), 0.007, 0.007)
        for a in (-1, 1)
        for b in (-1, 1)
    ]
    runs += [
        (
            (x - 0.075, y - 0.075 + 0.15 * i, z + 0.13),
            (x + 0.075, y - 0.075 + 0.15 * i, z + 0.13),
            0.004,
            0.004,
        )
        for i in (0, 1)
    ]
    kit.add_object("Lantern posts", kit.tubes("Lantern posts", runs, surfaces["iron"], sides=6))
    base = [(0.001, 0.0), (0.11, 0.0), (0.11, 0.02), (0.03, 0.035), (0.03, 0.06), (0.001, 0.06)]
    kit.lathe("Lantern base", base, surfaces["iron"], steps=16, location=at)
    roof = [(0.13, 0.26), (0.12, 0.275), (0.05, 0.35), (0.05, 0.37), (0.02, 0.4), (0.001, 0.405)]
    kit.lathe("Lantern roof", roof, surfaces["iron"], steps=16, location=at)


def _lamp_shade(surfaces, at):
    """An open bell around the spot, on a chain from the beam."""
    x, y, z = at
    bell = [(0.2, -0.1), (0.205, -0.1), (0.12, 0.05), (0.05, 0.1), (0.02, 0.12), (0.001, 0.12)]
    kit.lathe("Lamp shade", bell, surfaces["iron"], steps=32, location=at)
    run = [((x, y, z + 0.11), (x, y, HEIGHT - 0.3), 0.008, 0.008)]
    kit.add_object("Lamp rod", kit.tubes("Lamp rod", run, surfaces["iron"], sides=6))


def _haze(density, anisotropy):
    """A box of scattering medium that reaches into the walls."""
    made = bpy.data.materials.new("Haze")
    nodes = made.node_tree.nodes
    nodes.remove(nodes["Principled BSDF"])
    scatter = nodes.new("ShaderNodeVolumePrincipled")
    scatter.inputs["Color"].default_value = (0.92, 0.94, 1.0, 1.0)
    scatter.inputs["Density"].default_value = density
    scatter.inputs["Anisotropy"].default_value = anisotropy
    made.node_tree.links.new(scatter.outputs["Volume"], nodes["Material Output"].inputs["Volume"])
    room = [((-0.1, -0.1, -0.05), (WIDTH + 0.1, DEPTH + 0.1, HEIGHT + 0.1))]
    kit.add_object("Haze", kit.boxes("Haze", room, made)).display_type = "BOUNDS"


def mist():
    """Shafts of light of every kind: a sun through bars, a point in a lantern, a spot in a shade."""
    kit.new_scene("Mist")
    surfaces = _surfaces()
    _shell(surfaces)
    for index, window in enumerate(WINDOWS):
        _window(f"Window {index + 1}", window, surfaces)
    _table(surfaces, (4.55, 4.25))
    _lantern(surfaces, (4.3, 4.2, 0.79))
    bottle = [(0.001, 0), (0.04, 0), (0.042, 0.16), (0.015, 0.21), (0.014, 0.29), (0.001, 0.29)]
    for index, place in enumerate([(4.62, 4.42, 0.79), (4.82, 4.33, 0.79), (4.74, 4.1, 0.79)]):
        kit.lathe(f"Bottle {index}", bottle, surfaces["glass"], steps=20, location=place)
    jug = [(0.001, 0), (0.06, 0), (0.1, 0.09), (0.095, 0.15), (0.05, 0.21), (0.06, 0.25), (0.001, 0.25)]
    kit.lathe("Jug", jug, surfaces["clay"], steps=24, location=(5.05, 4.3, 0.79))
    for index, (x, y, size) in enumerate(
        [(3.9, 7.7, 1.15), (4.85, 8.1, 1.2), (4.4, 7.0, 0.9), (5.7, 7.5, 1.1)]
    ):
        _barrel(f"Barrel {index}", surfaces, (x, y, 0), size)
    _barrel("Barrel on its side", surfaces, (5.9, 5.9, 0.36), 1.0, (90, 0, 25))
    _crate("Crate 0", surfaces, (1.15, 7.9, 0), 1.0, 12)
    _crate("Crate 1", surfaces, (2.35, 8.2, 0), 0.85, -8)
    _crate("Crate 2", surfaces, (1.3, 7.95, 1.0), 0.7, 31)
    _crate("Crate 3", surfaces, (2.3, 4.4, 0), 0.55, 22)
    _lamp_shade(surfaces, (4.45, 7.35, 3.05))
    _haze(0.09, 0.35)
    kit.lamp(
        "Sun", "SUN", (-6, 8, 9), (-6 + 0.72, 8 - 0.3, 9 - 0.56), 22, (1, 0.9, 0.74), angle=math.radians(0.53)
    )
    kit.lamp("Lantern", "POINT", (4.3, 4.2, 0.92), (4.3, 4.2, 0), 38, (1, 0.56, 0.2), shadow_soft_size=0.012)
    kit.lamp(
        "Lamp", "SPOT", (4.45, 7.35, 3.02), (4.5, 7.5, 0), 420, (0.78, 0.88, 1),
        spot_size=math.radians(52), spot_blend=0.25, shadow_soft_size=0.02,
    )  # fmt: skip
    kit.sky((0.25, 0.35, 0.5), strength=0.6)
    kit.camera((5.5, 0.35, 1.75), (2.55, 6.0, 1.6), 24.0)
