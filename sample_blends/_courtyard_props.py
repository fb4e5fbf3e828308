"""What stands in the courtyard: fountain and statue, cat, lanterns, bench, railings, sign."""

import math

import _kit as kit
import bpy
import numpy as np

FOUNTAIN = (-0.9, 0.6)
LANTERN = (3.1, 5.1, 2.15)
WALL_LANTERN = (5.95, 1.2, 2.58)


def _fountain(look, into):
    """Two basins on a step, and the water in them."""
    x, y = FOUNTAIN
    step = [(1.52, -0.05), (1.52, 0.1), (1.5, 0.12), (1.2, 0.12)]
    kit.lathe("Fountain step", step, look["stone"], into, 8, location=(x, y, 0), rotation=(0, 0, 22.5))
    basin = [
        (1.1, 0.1),
        (1.12, 0.16),
        (1.04, 0.2),
        (1.02, 0.28),
        (1.1, 0.42),
        (1.14, 0.5),
        (1.2, 0.52),
        (1.23, 0.55),
        (1.23, 0.59),
    ]
    basin += [(1.2, 0.62), (1.06, 0.62), (1.03, 0.6), (1.02, 0.3), (0.3, 0.28)]
    kit.lathe("Basin", basin, look["trim"], into, 96, location=(x, y, 0))
    stem = [
        (0.34, 0.28),
        (0.34, 0.5),
        (0.3, 0.54),
        (0.22, 0.57),
        (0.15, 0.66),
        (0.13, 0.8),
        (0.17, 0.9),
        (0.2, 0.92),
        (0.18, 0.95),
    ]
    stem += [
        (0.25, 0.98),
        (0.42, 1.04),
        (0.56, 1.13),
        (0.62, 1.2),
        (0.635, 1.215),
        (0.63, 1.24),
        (0.59, 1.24),
        (0.56, 1.2),
        (0.4, 1.15),
        (0.26, 1.14),
    ]
    stem += [(0.26, 1.3), (0.24, 1.33), (0.22, 1.34), (0.001, 1.34)]
    kit.lathe("Upper basin", stem, look["trim"], into, 96, location=(x, y, 0))
    kit.lathe("Water below", [(1.025, 0.52), (0.001, 0.52)], look["water"], into, 48, location=(x, y, 0))
    kit.lathe("Water above", [(0.575, 1.212), (0.001, 1.212)], look["water"], into, 48, location=(x, y, 0))


def _robe(look, into, place):
    """A long folded robe: a coarse cage under a subdivision surface."""
    sides, levels = (
        36,
        [(0.0, 0.27, 0.12), (0.06, 0.26, 0.13), (0.3, 0.225, 0.12), (0.55, 0.19, 0.09), (0.74, 0.165, 0.05)],
    )
    levels += [
        (0.84, 0.135, 0.02),
        (0.9, 0.128, 0.02),
        (1.0, 0.15, 0.02),
        (1.12, 0.16, 0.01),
        (1.2, 0.12, 0.0),
        (1.24, 0.06, 0.0),
    ]
    vertices = []
    for height, radius, fold in levels:
        for side in range(sides):
            turn = 2 * math.pi * side / sides
            r = radius * (
                1 + fold * (math.cos(9 * turn + 1.2 * height) + 0.5 * math.sin(5 * turn - 2 * height))
            )
            vertices.append((r * math.cos(turn) * 1.08, r * math.sin(turn) * 0.8, height))
    faces = [
        (
            sides * level + s,
            sides * level + (s + 1) % sides,
            sides * (level + 1) + (s + 1) % sides,
            sides * (level + 1) + s,
        )
        for level in range(len(levels) - 1)
        for s in range(sides)
    ]
    robe = kit.add_object(
        "Robe", kit.mesh("Robe", vertices, faces, look["marble"], smooth=True), into, **place
    )
    kit.subdivide(robe, 2)


def _limbs(look, into, place):
    """Neck, head and arms from a skin modifier: one arm steadies the jar, the other rests on the hip."""
    joints = [
        ((0, 0, 1.12), 0.1),
        ((0, 0, 1.22), 0.062),
        ((0, -0.005, 1.3), 0.048),
        ((0, -0.02, 1.38), 0.082),
        ((0, -0.015, 1.47), 0.086),
        ((0, 0.0, 1.53), 0.05),
    ]
    joints += [
        ((0.15, 0, 1.16), 0.068),
        ((0.28, -0.03, 1.24), 0.05),
        ((0.32, -0.05, 1.42), 0.042),
        ((0.22, -0.04, 1.6), 0.03),
        ((0.155, -0.03, 1.68), 0.03),
    ]
    joints += [
        ((-0.15, 0, 1.16), 0.068),
        ((-0.25, 0.03, 1.02), 0.05),
        ((-0.31, 0.05, 0.88), 0.042),
        ((-0.23, -0.03, 0.8), 0.032),
        ((-0.15, -0.07, 0.8), 0.028),
    ]
    bones = [
        (0, 1),
        (1, 2),
        (2, 3),
        (3, 4),
        (4, 5),
        (0, 6),
        (6, 7),
        (7, 8),
        (8, 9),
        (9, 10),
        (0, 11),
        (11, 12),
        (12, 13),
        (13, 14),
        (14, 15),
    ]
    shape = bpy.data.meshes.new("Figure")
    shape.from_pydata([where for where, _ in joints], bones, [])
    shape.materials.append(look["marble"])
    figure = kit.add_object("Figure", shape, into, **place)
    skin = figure.modifiers.new("Skin", "SKIN")
    skin.use_smooth_shade = True
    for joint, (_, radius) in zip(shape.skin_vertices[0].data, joints, strict=True):
        joint.radius = (radius, radius)
    shape.skin_vertices[0].data[0].use_root = True
    kit.subdivide(figure, 3)


def _statue(look, into):
    """A water bearer on the upper basin."""
    place = {"location": (*FOUNTAIN, 1.34), "rotation": (0, 0, 14), "scale": 0.86}
    _robe(look, into, place)
    _limbs(look, into, place)
    jar = [
        (0.001, 0),
        (0.05, 0.0),
        (0.055, 0.02),
        (0.1, 0.08),
        (0.135, 0.16),
        (0.13, 0.24),
        (0.085, 0.3),
        (0.052, 0.33),
        (0.05, 0.38),
        (0.075, 0.41),
    ]
    jar += [(0.078, 0.42), (0.06, 0.42), (0.04, 0.38)]
    kit.lathe(
        "Jar",
        jar,
        look["clay"],
        into,
        48,
        location=(FOUNTAIN[0], FOUNTAIN[1], 1.34 + 0.86 * 1.525),
        scale=0.86,
    )


def _lantern(look, into):
    """A lantern of open iron bars around its candle, hung on a rope from the arch."""
    ring = [(0.2 * math.cos(t), 0.2 * math.sin(t)) for t in np.linspace(0, 2 * math.pi, 9)[:8]]
    bars = []
    for (x, y), (p, q) in zip(ring, ring[1:] + ring[:1], strict=True):
        bars += [
            ((0.75 * x, 0.75 * y, -0.3), (x, y, 0.16), 0.014, 0.014),
            ((x, y, 0.16), (0.06 * x, 0.06 * y, 0.36), 0.011, 0.008),
        ]
        for height, size in ((-0.3, 0.75), (-0.04, 0.891), (0.16, 1.0)):
            bars.append(((size * x, size * y, height), (size * p, size * q, height), 0.009, 0.009))
    lantern = kit.collection("Lantern", linked=False)
    kit.add_object("Cage", kit.tubes("Cage", bars, look["iron"], 8), lantern)
    kit.lathe(
        "Tray",
        [(0.001, -0.31), (0.16, -0.31), (0.17, -0.3), (0.15, -0.285), (0.001, -0.285)],
        look["iron"],
        lantern,
        32,
    )
    kit.lathe(
        "Candle", [(0.03, -0.29), (0.03, -0.08), (0.022, -0.07), (0.001, -0.07)], look["trim"], lantern, 24
    )
    cap = [(0.13, 0.26), (0.09, 0.31), (0.04, 0.34), (0.03, 0.4), (0.001, 0.42)]
    kit.lathe("Cap", cap, look["iron"], lantern, 32)
    kit.instance("Hanging lantern", lantern, into, location=LANTERN)
    x, y, z = LANTERN
    hang = [(x, y, z + 0.4), (x + 0.01, y, z + 0.9), (x - 0.01, y, z + 1.6), (x, y, z + 2.4)]
    kit.curve("Rope", hang, 0.013, look["rope"], into)
    lower = (WALL_LANTERN[0] + 0.02, WALL_LANTERN[1], WALL_LANTERN[2] + 0.29)
    kit.instance("Wall lantern cage", lantern, into, location=lower, scale=0.8)
    x, y, z = lower
    arm = [(6.5, y, z + 0.02), (6.3, y, z + 0.1), (6.15, y, z + 0.5), (x, y, z + 0.55), (x, y, z + 0.32)]
    kit.curve("Bracket", arm, 0.018, look["iron"], into)


def _railing(look, into, name, x, y, width):
    """An iron railing with a row of bars and scrolls between two rails."""
    half = width / 2
    rails = [((-half, 0, z), (half, 0, z), 0.018, 0.018) for z in (0.12, 0.78, 0.95)]
    kit.add_object(
        f"{name} rails", kit.tubes(f"{name} rails", rails, look["iron"], 12), into, location=(x, y, 0)
    )
    bar = kit.tubes(
        f"{name} bar", [((-half + 0.065, 0, 0), (-half + 0.065, 0, 0.95), 0.011, 0.011)], look["iron"], 10
    )
    kit.array(
        kit.add_object(f"{name} bars", bar, into, location=(x, y, 0)), round(width / 0.13), (0.13, 0, 0)
    )
    loop = [
        (-half + 0.13 + 0.055 * math.cos(t), 0, 0.865 + 0.07 * math.sin(t))
        for t in np.linspace(0, 2 * math.pi, 9)[:8]
    ]
    scroll = kit.curve(f"{name} rings", loop, 0.008, look["iron"], into, cyclic=True, location=(x, y, 0))
    scroll.data.resolution_u, scroll.data.bevel_resolution = 3, 1
    kit.array(scroll, round(width / 0.13) - 1, (0.13, 0, 0))


def _bench(look, into):
    """A slatted bench on the right wall, a coil of rope and a jug beside it."""
    slats = [((0, -0.9, 0.44), (0.09, 0.9, 0.48))]
    seat = kit.add_object("Seat", kit.boxes("Seat", slats, look["wood"]), into, location=(5.5, 1.7, 0))
    kit.array(seat, 5, (0.108, 0, 0))
    kit.bevel(seat, 0.008, 2)
    back = kit.boxes("Backrest", [((0, -0.9, 0), (0.035, 0.9, 0.1))], look["wood"])
    rest = kit.add_object("Backrest", back, into, location=(6.06, 1.7, 0.56), rotation=(0, 10, 0))
    kit.array(rest, 3, (0, 0, 0.14))
    kit.bevel(rest, 0.008, 2)
    legs = [
        ((5.52 + x, 1.7 + y - 0.03, 0), (5.58 + x, 1.7 + y + 0.03, top))
        for x, top in ((0, 0.44), (0.44, 0.44))
        for y in (-0.75, 0.75)
    ]
    legs += [((5.52, 1.7 + y - 0.03, 0.38), (6.0, 1.7 + y + 0.03, 0.44)) for y in (-0.75, 0.75)]
    legs += [((6.06, 1.7 + y - 0.03, 0.38), (6.1, 1.7 + y + 0.03, 0.98)) for y in (-0.75, 0.75)]
    kit.bevel(kit.add_object("Bench frame", kit.boxes("Bench frame", legs, look["iron"]), into), 0.008, 2)
    coil = [
        ((0.3 - 0.0028 * i) * math.cos(i * 0.42), (0.3 - 0.0028 * i) * math.sin(i * 0.42), 0.03 + 0.0009 * i)
        for i in range(75)
    ]
    kit.curve("Coil of rope", coil, 0.026, look["rope"], into, location=(3.9, 0.1, 0))
    jug = [
        (0.001, 0),
        (0.09, 0),
        (0.1, 0.01),
        (0.15, 0.1),
        (0.16, 0.18),
        (0.13, 0.27),
        (0.07, 0.33),
        (0.06, 0.38),
        (0.08, 0.41),
        (0.07, 0.41),
        (0.05, 0.37),
    ]
    kit.lathe("Jug", jug, look["glazed"], into, 48, location=(5.75, 1.15, 0.48))


def _cat(look, into):
    """A sitting cat of metaballs on the rim of the fountain."""
    place = {
        "location": (FOUNTAIN[0] + 0.45, FOUNTAIN[1] - 1.02, 0.61),
        "rotation": (0, 0, 35),
        "scale": 1.15,
    }
    shape = bpy.data.metaballs.new("Cat")
    shape.resolution = shape.render_resolution = 0.022
    shape.threshold = 0.3
    shape.materials.append(look["cat"])
    lumps = [
        ((0, 0.03, 0.09), 0.17, (1, 1.15, 0.9)),
        ((0, -0.04, 0.19), 0.13, (0.9, 0.85, 1.3)),
        ((0, -0.08, 0.32), 0.115, (1, 1, 0.9)),
    ]
    lumps += [((x, 0.0, 0.06), 0.12, (0.6, 1.2, 0.8)) for x in (-0.08, 0.08)]
    lumps += [((x, -0.11, z), 0.062, (0.8, 0.8, 1.5)) for x in (-0.04, 0.04) for z in (0.035, 0.1, 0.16)]
    lumps += [((x, -0.135, 0.015), 0.055, (0.9, 1.3, 0.6)) for x in (-0.04, 0.04)]
    lumps.append(((0, -0.135, 0.3), 0.06, (1.1, 0.9, 0.7)))
    for centre, size, stretch in lumps:
        lump = shape.elements.new(type="ELLIPSOID")
        lump.co, lump.radius = centre, size
        lump.size_x, lump.size_y, lump.size_z = stretch
    kit.add_object("Cat", shape, into, **place)
    ears = [((x, -0.075, 0.365), (1.25 * x, -0.08, 0.43), 0.026, 0.002) for x in (-0.04, 0.04)]
    kit.add_object("Cat ears", kit.tubes("Cat ears", ears, look["cat"], 12), into, **place)
    tail = [(0, 0.14, 0.04), (0.06, 0.22, 0.02), (0.12, 0.2, -0.1), (0.13, 0.17, -0.24), (0.17, 0.18, -0.32)]
    kit.curve("Cat tail", tail, 0.019, look["cat"], into, **place)


def _sign(look, into):
    """A carved tablet over the middle arch."""
    tablet = kit.boxes("Tablet", [((-0.8, -0.03, -0.17), (0.8, 0.03, 0.17))], look["trim"])
    kit.bevel(kit.add_object("Tablet", tablet, into, location=(0, 3.69, 3.83)), 0.02, 2)
    text = bpy.data.curves.new("Sign", "FONT")
    text.body, text.size, text.extrude, text.bevel_depth = "STRATA", 0.26, 0.015, 0.003
    text.align_x, text.align_y, text.space_character = "CENTER", "CENTER", 1.2
    text.materials.append(look["iron"])
    kit.add_object("Sign", text, into, location=(0, 3.665, 3.83), rotation=(90, 0, 0))


def furnish(look, into):
    """Everything that is not a wall or a plant."""
    _fountain(look, into)
    _statue(look, into)
    _lantern(look, into)
    _railing(look, into, "Left railing", -5.2, 4.0, 2.08)
    _railing(look, into, "Right railing", 5.2, 4.0, 2.08)
    _railing(look, into, "Inner railing", -2.6, 4.0, 2.08)
    _bench(look, into)
    _sign(look, into)
    _cat(look, into)
