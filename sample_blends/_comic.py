"""A page of a comic: a masked hero on a rooftop at night, for toon shading."""

import math

import _kit as kit
import bpy
import numpy as np

INK_NIGHT = (0.055, 0.075, 0.19)
LEDGE = 0.52  # metres; the hero stands on it


def comic():
    """A hero with a cape, a cat, a chimney, a water tower and a skyline under the moon, in flat colours."""
    kit.new_scene("Comic")
    look = {
        "suit": kit.material("Suit", (0.05, 0.3, 0.62)),
        "red": kit.material("Red", (0.78, 0.045, 0.05)),
        "gold": kit.material("Gold", (0.95, 0.6, 0.06)),
        "skin": kit.material("Skin", (0.86, 0.5, 0.33)),
        "hair": kit.material("Hair", (0.09, 0.03, 0.05)),
        "white": kit.material("White", (0.92, 0.92, 0.9)),
        "mouth": kit.material("Mouth", (0.35, 0.04, 0.06)),
        "brick": kit.material("Brick", (0.52, 0.16, 0.11)),
        "stone": kit.material("Stone", (0.5, 0.47, 0.52)),
        "roof": kit.material("Roof", (0.3, 0.28, 0.4)),
        "wood": kit.material("Wood", (0.42, 0.22, 0.12)),
        "metal": kit.material("Metal", (0.3, 0.36, 0.45)),
        "cat": kit.material("Cat", (0.95, 0.42, 0.07)),
        "city": kit.material("City", (0.075, 0.07, 0.2)),
        "far city": kit.material("Far city", (0.1, 0.095, 0.26)),
        "window": _glowing("Window", (1.0, 0.72, 0.2)),
        "moon": _glowing("Moon", (1.0, 0.93, 0.72)),
        "night": _glowing("Night", INK_NIGHT),
    }
    _rooftop(look)
    _water_tower(look, (-2.9, 3.1, 0.0))
    _chimney(look, (2.35, 1.5, 0.0))
    _city(look)
    scenery = set(bpy.context.scene.objects)
    _hero(look)
    for part in set(bpy.context.scene.objects) - scenery:
        part.location += kit.Vector((-0.25, -0.34, LEDGE))
    _cat(look, (0.98, -0.34, LEDGE))
    kit.lamp("Key", "SUN", (-3, -6, 3.6), (0, 0, 0.9), 4.0, (1, 0.96, 0.88), angle=math.radians(1))
    kit.sky(INK_NIGHT, strength=0.4)
    kit.camera((0.55, -5.2, 1.02), (0.16, 0, 1.42), 38)


def _glowing(name, color):
    """A material that only shines by itself."""
    made = kit.material(name, (0.0, 0.0, 0.0))
    made.diffuse_color = (*color, 1.0)
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Emission Color"].default_value = (*color, 1.0)
    shader.inputs["Emission Strength"].default_value = 1.0
    return made


# The hero


def _limb(name, surface, points, into=None, levels=2):
    """A smooth body around bones: `points` holds (place, radius, index of the one before or None)."""
    shape = bpy.data.meshes.new(name)
    edges = [(before, index) for index, (_, _, before) in enumerate(points) if before is not None]
    shape.from_pydata([place for place, _, _ in points], edges, [])
    shape.materials.append(surface)
    made = kit.add_object(name, shape, into)
    made.modifiers.new("Skin", "SKIN").use_smooth_shade = True
    for layer, (_, radius, before) in zip(shape.skin_vertices[0].data, points, strict=True):
        layer.radius = (radius, radius) if isinstance(radius, float) else radius
        layer.use_root = before is None
    return kit.subdivide(made, levels)


def _ball(name, surface, place, scale, rotation=(0, 0, 0), segments=32, rings=20):
    """A smooth ellipsoid."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=segments, ring_count=rings)
    made = bpy.context.object
    made.name = made.data.name = name
    made.data.shade_smooth()
    made.data.materials.append(surface)
    made.location, made.scale = place, (scale,) * 3 if isinstance(scale, int | float) else scale
    made.rotation_euler = [math.radians(angle) for angle in rotation]
    return made


def _hero(look):
    torso = [
        ((0, 0.01, 0.93), (0.135, 0.105), None),
        ((0, 0.0, 1.08), (0.105, 0.085), 0),
        ((0, -0.015, 1.27), (0.165, 0.12), 1),
        ((0, 0.0, 1.40), (0.13, 0.085), 2),
        ((0, 0.0, 1.49), (0.05, 0.05), 3),
    ]
    for side in (-1, 1):
        first = len(torso)
        torso += [
            ((0.19 * side, 0.01, 1.395), 0.075, 3),
            ((0.40 * side, 0.07, 1.19), 0.052, first),
            ((0.30 * side, -0.03, 1.06), 0.045, first + 1),
        ]
    for side in (-1, 1):
        first = len(torso)
        torso += [
            ((0.10 * side, 0.0, 0.86), 0.098, 0),
            ((0.185 * side, -0.025, 0.52), 0.068, first),
            ((0.215 * side, 0.015, 0.36), 0.066, first + 1),
        ]
    _limb("Suit", look["suit"], torso)
    for side, name in ((-1, "right"), (1, "left")):
        _limb(
            f"Boot {name}",
            look["red"],
            [
                ((0.205 * side, 0.01, 0.43), 0.088, None),
                ((0.225 * side, 0.015, 0.25), 0.068, 0),
                ((0.235 * side, 0.03, 0.08), 0.062, 1),
                ((0.265 * side, -0.15, 0.045), (0.062, 0.045), 2),
            ],
        )
        _limb(
            f"Glove {name}",
            look["red"],
            [
                ((0.365 * side, 0.035, 1.15), 0.07, None),
                ((0.30 * side, -0.03, 1.065), 0.05, 0),
                ((0.205 * side, -0.09, 1.0), 0.068, 1),
            ],
        )
    bpy.ops.mesh.primitive_torus_add(
        major_segments=48, minor_segments=12, major_radius=0.128, minor_radius=0.026, location=(0, 0.004, 1.0)
    )
    belt = bpy.context.object
    belt.name, belt.scale = "Belt", (1.0, 0.82, 1.0)
    belt.data.shade_smooth()
    belt.data.materials.append(look["gold"])
    _ball("Buckle", look["gold"], (0, -0.125, 1.0), (0.045, 0.02, 0.04))
    _star("Emblem", look["gold"], (0.0, -0.158, 1.285), 0.075)
    _head(look)
    _cape(look)


def _star(name, surface, place, size):
    """A five-pointed star, a little thick, upright."""
    corners = []
    for index in range(10):
        reach = size * (1.0 if index % 2 == 0 else 0.42)
        turn = math.pi / 2 + index * math.pi / 5
        corners.append((reach * math.cos(turn), reach * math.sin(turn)))
    vertices = [(x, y, z) for y in (-0.012, 0.02) for x, z in corners]
    faces = [tuple(range(10)), tuple(range(19, 9, -1))]
    faces += [(i, i + 10, (i + 1) % 10 + 10, (i + 1) % 10) for i in range(10)]
    made = kit.add_object(name, kit.mesh(name, vertices, faces, surface), location=place, rotation=(-9, 0, 0))
    return made


def _head(look):
    """Head, mask, eyes, grin and a windswept quiff."""
    _ball("Head", look["skin"], (0, -0.01, 1.645), (0.128, 0.135, 0.155), segments=40, rings=28)
    _ball("Chin", look["skin"], (0, -0.055, 1.565), (0.075, 0.075, 0.065))
    _ball("Nose", look["skin"], (0, -0.15, 1.632), (0.02, 0.03, 0.026))
    for side in (-1, 1):
        _ball(f"Ear {side}", look["skin"], (0.126 * side, 0.0, 1.64), (0.02, 0.03, 0.042))
        _ball(
            f"Mask {side}",
            look["red"],
            (0.056 * side, -0.095, 1.672),
            (0.066, 0.05, 0.046),
            (0, 14 * side, 0),
        )
        _ball(
            f"Eye {side}",
            look["white"],
            (0.056 * side, -0.134, 1.674),
            (0.036, 0.016, 0.021),
            (0, 16 * side, 12 * side),
        )
    _ball("Mask bridge", look["red"], (0, -0.115, 1.672), (0.05, 0.034, 0.028))
    _ball("Grin", look["mouth"], (0.014, -0.122, 1.568), (0.036, 0.016, 0.011), (0, -8, 0))
    _limb(
        "Hair",
        look["hair"],
        [
            ((0.0, 0.06, 1.70), 0.105, None),
            ((0.0, -0.03, 1.765), (0.098, 0.07), 0),
            ((-0.03, -0.115, 1.815), 0.05, 1),
            ((-0.085, -0.15, 1.845), 0.026, 2),
            ((-0.12, -0.135, 1.83), 0.008, 3),
            ((0.0, 0.105, 1.61), 0.075, 0),
            ((0.02, 0.135, 1.54), 0.02, 5),
        ],
    )


def _cape(look):
    """Cloth from the shoulders, blown to one side."""
    rows, columns = 28, 36
    vertices = []
    for row in range(rows):
        down = row / (rows - 1)
        for column in range(columns):
            across = column / (columns - 1) * 2 - 1
            spread = 0.17 + 0.5 * down**0.8
            wave = 0.055 * down * math.sin(7.5 * across + 4.0 * down) + 0.03 * down * math.sin(
                13 * across - 2
            )
            x = across * spread + 0.62 * down**1.7 + 0.04 * math.sin(5 * down + across)
            y = 0.075 + 0.05 * (1 - across * across) * (1 - down) + 0.34 * down + wave
            z = 1.425 - 0.055 * across * across * (1 - down) - 1.03 * down + 0.16 * down**2 * (across + 0.4)
            vertices.append((x, y, z))
    faces = [
        (r * columns + c, r * columns + c + 1, (r + 1) * columns + c + 1, (r + 1) * columns + c)
        for r in range(rows - 1)
        for c in range(columns - 1)
    ]
    made = kit.add_object("Cape", kit.mesh("Cape", vertices, faces, look["red"], True))
    solid = made.modifiers.new("Thick", "SOLIDIFY")
    solid.thickness, solid.offset = 0.012, 0.0
    for side in (-1, 1):
        _ball(f"Clasp {side}", look["gold"], (0.135 * side, -0.085, 1.405), (0.03, 0.02, 0.03))
    _limb(
        "Collar",
        look["red"],
        [
            ((-0.17, -0.03, 1.42), 0.04, None),
            ((-0.11, 0.06, 1.455), 0.045, 0),
            ((0.0, 0.085, 1.465), 0.045, 1),
            ((0.11, 0.06, 1.455), 0.045, 2),
            ((0.17, -0.03, 1.42), 0.04, 3),
        ],
    )


# The roof


def _bricks(name, surface, low, high, rows, length, rng):
    """A wall of bevelled bricks, running bond, along its longer side."""
    axis = 0 if high[0] - low[0] >= high[1] - low[1] else 1
    spans, height = [], (high[2] - low[2]) / rows
    for row in range(rows):
        start = low[axis] - (0.5 * length if row % 2 else 0.0)
        while start < high[axis]:
            ends = max(start, low[axis]) + 0.008, min(start + length, high[axis]) - 0.008
            if ends[1] - ends[0] > 0.04:
                out = rng.uniform(0.0, 0.018)
                first, last = list(low), list(high)
                first[axis], last[axis] = ends
                first[1 - axis] -= out
                first[2], last[2] = low[2] + row * height + 0.008, low[2] + (row + 1) * height - 0.008
                spans.append((first, last))
            start += length
    return kit.bevel(kit.add_object(name, kit.boxes(name, spans, surface)), 0.012, 2)


def _rooftop(look):
    rng = np.random.default_rng(5)
    slab = [((-6, -1.0, -0.3), (6, 6, 0.0))]
    kit.add_object("Roof", kit.boxes("Roof", slab, look["roof"]))
    ledge = kit.boxes("Ledge", [((-6, -0.66, LEDGE - 0.12), (6, -0.02, LEDGE))], look["stone"])
    kit.bevel(kit.add_object("Ledge", ledge), 0.025, 3)
    _bricks("Parapet", look["brick"], (-6, -0.5, -0.3), (6, -0.2, LEDGE - 0.12), 5, 0.34, rng)
    vent = [(0.1, 0), (0.1, 0.75), (0.2, 0.8), (0.2, 0.86), (0.02, 0.98)]
    kit.lathe("Vent", vent, look["metal"], steps=32, location=(1.45, 0.9, 0))


def _chimney(look, place):
    x, y, z = place
    rng = np.random.default_rng(8)
    _bricks("Chimney", look["brick"], (x - 0.42, y - 0.35, z), (x + 0.42, y + 0.35, z + 1.75), 11, 0.3, rng)
    top = [((x - 0.5, y - 0.43, z + 1.75), (x + 0.5, y + 0.43, z + 1.9))]
    kit.bevel(kit.add_object("Chimney top", kit.boxes("Chimney top", top, look["stone"])), 0.02, 2)
    for index in (-1, 1):
        pot = [(0.1, 0), (0.12, 0.05), (0.1, 0.3), (0.13, 0.36), (0.09, 0.36)]
        kit.lathe(f"Pot {index}", pot, look["brick"], steps=28, location=(x + 0.2 * index, y, z + 1.9))


def _water_tower(look, place):
    x, y, z = place
    legs = [((x + a, y + b, z), (x + 0.8 * a, y + 0.8 * b, z + 1.5), 0.05, 0.05)
            for a in (-0.75, 0.75) for b in (-0.75, 0.75)]  # fmt: skip
    legs += [((x - 0.72, y - 0.72, z + 0.35), (x + 0.62, y - 0.62, z + 1.4), 0.03, 0.03)]
    legs += [((x + 0.72, y - 0.72, z + 0.35), (x - 0.62, y - 0.62, z + 1.4), 0.03, 0.03)]
    kit.add_object("Tower legs", kit.tubes("Tower legs", legs, look["metal"]))
    floor = [((x - 0.95, y - 0.95, z + 1.5), (x + 0.95, y + 0.95, z + 1.6))]
    kit.bevel(kit.add_object("Tower floor", kit.boxes("Tower floor", floor, look["wood"])), 0.02, 2)
    staves, turns = [], np.linspace(0, 2 * math.pi, 26, endpoint=False)
    for turn in turns:
        at = np.array([x + 0.82 * math.cos(turn), y + 0.82 * math.sin(turn), z + 1.6])
        staves.append((at, at + np.array([0, 0, 1.35]), 0.105, 0.105))
    kit.add_object("Tank", kit.tubes("Tank", staves, look["wood"], 10))
    for height in (1.85, 2.25, 2.65):
        bpy.ops.mesh.primitive_torus_add(
            major_segments=64,
            minor_segments=8,
            major_radius=0.93,
            minor_radius=0.022,
            location=(x, y, z + height),
        )
        hoop = bpy.context.object
        hoop.name = "Hoop"
        hoop.data.shade_smooth()
        hoop.data.materials.append(look["metal"])
    kit.lathe("Tank roof", [(1.05, 2.93), (1.02, 3.0), (0.06, 3.6), (0.001, 3.68)], look["red"], steps=64,
              location=(x, y, z))  # fmt: skip


def _cat(look, place):
    x, y, z = place
    body = [
        ((x, y + 0.03, z + 0.1), 0.105, None),
        ((x, y - 0.01, z + 0.24), 0.08, 0),
        ((x, y - 0.03, z + 0.33), 0.045, 1),
        ((x + 0.1, y + 0.1, z + 0.05), 0.04, 0),
        ((x + 0.2, y + 0.06, z + 0.03), 0.032, 3),
        ((x + 0.26, y - 0.06, z - 0.08), 0.028, 4),
        ((x + 0.27, y - 0.1, z - 0.24), 0.022, 5),
        ((x + 0.2, y - 0.11, z - 0.3), 0.016, 6),
    ]
    _limb("Cat", look["cat"], body)
    _ball("Cat head", look["cat"], (x, y - 0.05, z + 0.4), (0.098, 0.085, 0.08))
    for side in (-1, 1):
        kit.lathe(f"Cat ear {side}", [(0.034, 0), (0.001, 0.075)], look["cat"], steps=16,
                  location=(x + 0.062 * side, y - 0.04, z + 0.45), rotation=(8, 22 * side, 0))  # fmt: skip
        _ball(f"Cat paw {side}", look["white"], (x + 0.05 * side, y - 0.09, z + 0.025), (0.036, 0.05, 0.03))
        _ball(f"Cat eye {side}", look["white"], (x + 0.04 * side, y - 0.123, z + 0.415), (0.022, 0.012, 0.02))
        _ball(
            f"Cat pupil {side}", look["hair"], (x + 0.038 * side, y - 0.133, z + 0.415), (0.007, 0.006, 0.015)
        )
    _ball("Cat muzzle", look["white"], (x, y - 0.122, z + 0.375), (0.036, 0.022, 0.024))
    _ball("Cat nose", look["mouth"], (x, y - 0.145, z + 0.387), (0.01, 0.007, 0.008))


def _city(look):
    """Two rows of towers with lit windows, the moon, and the night behind them."""
    rng = np.random.default_rng(12)
    for distance, name, surface, spread, count in (
        (14, "City", "city", 13, 11),
        (26, "Far city", "far city", 26, 15),
    ):
        towers, panes = [], []
        for index in range(count):
            x = spread * (2 * (index + rng.uniform(0.2, 0.8)) / count - 1)
            half, top = rng.uniform(0.65, 1.25) * distance / 14, rng.uniform(0.6, 4.6) * distance / 14
            low, high = (x - half, distance, -12), (x + half, distance + 2, top)
            towers.append((low, high))
            if index % 3 == 1:
                towers.append(
                    ((x - 0.4 * half, distance, top), (x + 0.4 * half, distance + 1, top + 0.5 * half))
                )
            if distance > 20:
                continue
            for row in range(14):
                for column in range(4):
                    if rng.uniform() < 0.33:
                        u = x - half + half * (0.22 + 0.42 * column)
                        v = top - 0.35 - 0.52 * row
                        panes.append(((u, distance - 0.03, v - 0.26), (u + 0.26 * half, distance, v)))
        kit.add_object(name, kit.boxes(name, towers, look[surface]))
        if panes:
            kit.add_object("Windows", kit.boxes("Windows", panes, look["window"]))
    _ball("Moon", look["moon"], (-4.6, 52, 13.5), 7.2, segments=96, rings=48)
    sky = kit.mesh(
        "Night", [(-90, 70, -40), (90, 70, -40), (90, 70, 70), (-90, 70, 70)], [(0, 1, 2, 3)], look["night"]
    )
    kit.add_object("Night", sky)
