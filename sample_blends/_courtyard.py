"""The courtyard: walls, arcades, paving, lights and camera; two more modules hold its props and plants."""

import math

import _courtyard_plants as plants
import _courtyard_props as props
import _kit as kit
import numpy as np

BAY, SPRING, RADIUS, TOP, DEPTH = 2.6, 2.25, 1.04, 4.0, 0.42
BACK, SIDE = 4.0, 6.5


def _plaster_picture():
    """A 192 pixel tile of warm, patchy plaster."""
    rng = np.random.default_rng(4)
    size = 192
    tone = np.zeros((size, size))
    for period, strength in ((4, 1.0), (9, 0.6), (24, 0.35), (64, 0.25)):
        cells = rng.normal(size=(period, period))
        at = np.arange(size) * period / size
        low = at.astype(int)
        blend = at - low
        blend = blend * blend * (3 - 2 * blend)
        across = cells[:, low] * (1 - blend) + cells[:, (low + 1) % period] * blend
        tone += strength * (across[low] * (1 - blend)[:, None] + across[(low + 1) % period] * blend[:, None])
    tone = np.clip(0.5 + tone / 5, 0, 1)[..., None]
    tone = np.round(tone * 24) / 24
    light, dark = np.array([0.93, 0.83, 0.68]), np.array([0.80, 0.66, 0.50])
    rgb = dark + (light - dark) * tone
    return kit.image("Plaster", np.concatenate([rgb, np.ones_like(tone)], 2))


def _materials():
    """All surfaces of the yard by name."""
    make = kit.material
    return {
        "plaster": make("Plaster", (0.8, 0.68, 0.5), 0.92, _plaster_picture()),
        "trim": make("Pale stone", (0.78, 0.71, 0.6), 0.75),
        "stone": make("Weathered stone", (0.56, 0.52, 0.46), 0.85),
        "marble": make("Marble", (0.76, 0.71, 0.64), 0.5),
        "earth": make("Earth", (0.34, 0.26, 0.18), 0.95),
        "tile": make("Roof tile", (0.56, 0.23, 0.12), 0.8),
        "wood": make("Old wood", (0.26, 0.14, 0.07), 0.7),
        "door": make("Painted wood", (0.10, 0.26, 0.29), 0.6),
        "iron": make("Iron", (0.035, 0.035, 0.04), 0.5),
        "rope": make("Rope", (0.55, 0.42, 0.24), 0.95),
        "water": make("Water", (0.06, 0.2, 0.22), 0.12),
        "glazed": make("Glazed pot", (0.08, 0.2, 0.38), 0.3),
        "clay": make("Clay pot", (0.58, 0.27, 0.15), 0.8),
        "leaf": make("Leaves", (0.2, 0.36, 0.1), 0.6, plants.leaf_picture(), cut_out=True),
        "agave": make("Agave", (0.2, 0.36, 0.24), 0.55),
        "bract": make("Bougainvillea", (0.75, 0.07, 0.28), 0.7),
        "orange": make("Orange", (0.85, 0.32, 0.03), 0.45),
        "cat": make("Ginger fur", (0.62, 0.27, 0.08), 0.9),
    }


def _arch_bay(name, surface, steps=48):
    """One bay of wall above the capitals with a round opening; x along the wall, y through it."""
    turns = np.linspace(math.pi, 0, steps + 1)
    low = (
        [(-BAY / 2, SPRING)]
        + [(RADIUS * math.cos(t), SPRING + RADIUS * math.sin(t)) for t in turns]
        + [(BAY / 2, SPRING)]
    )
    high = [(x, TOP) for x, _ in low]
    vertices = [(x, y, z) for y in (-DEPTH / 2, DEPTH / 2) for x, z in low + high]
    count = len(low)
    faces = []
    for i in range(count - 1):
        a, b, c, d = i, i + 1, count + i + 1, count + i
        faces.append((a, b, c, d))
        faces.append(tuple(2 * count + v for v in (d, c, b, a)))
        faces.append((a, 2 * count + a, 2 * count + b, b))
    return kit.project_uv(kit.mesh(name, vertices, faces, surface))


def _archivolt(name, surface, steps=48):
    """The moulding around an opening: two steps that stand out of the wall on both sides."""
    profile = [
        (RADIUS, 0.0),
        (RADIUS - 0.02, 0.0),
        (RADIUS - 0.02, 0.06),
        (RADIUS + 0.07, 0.06),
        (RADIUS + 0.08, 0.035),
        (RADIUS + 0.17, 0.035),
        (RADIUS + 0.17, 0.0),
    ]
    vertices, faces = [], []
    for sign in (-1, 1):
        start = len(vertices)
        for turn in np.linspace(0, math.pi, steps + 1):
            vertices += [
                (r * math.cos(turn), sign * (DEPTH / 2 + out), SPRING + r * math.sin(turn))
                for r, out in profile
            ]
        for step in range(steps):
            for i in range(len(profile) - 1):
                corner = start + step * len(profile) + i
                face = (corner, corner + 1, corner + len(profile) + 1, corner + len(profile))
                faces.append(face if sign < 0 else face[::-1])
    return kit.mesh(name, vertices, faces, surface)


def _column(look):
    """A collection with one column: plinth, shaft with a little entasis, capital and impost."""
    column = kit.collection("Column", linked=False)
    shaft = [
        (0.24, 0.16),
        (0.25, 0.19),
        (0.24, 0.23),
        (0.2, 0.25),
        (0.2, 0.28),
        (0.215, 0.3),
        (0.2, 0.33),
        (0.18, 0.35),
    ]
    shaft += [(0.18 - 0.025 * t * t, 0.35 + 1.42 * t) for t in np.linspace(0.1, 1, 10)]
    shaft += [
        (0.175, 1.79),
        (0.18, 1.81),
        (0.175, 1.83),
        (0.155, 1.84),
        (0.158, 1.9),
        (0.18, 1.97),
        (0.225, 2.04),
        (0.235, 2.06),
    ]
    kit.lathe("Shaft", shaft, look["trim"], column, 48)
    blocks = kit.boxes(
        "Blocks",
        [((-0.27, -0.27, 0), (0.27, 0.27, 0.16)), ((-0.26, -0.26, 2.06), (0.26, 0.26, SPRING))],
        look["trim"],
    )
    kit.bevel(kit.add_object("Blocks", blocks, column), 0.012, 2)
    return column


def _arcade(name, look, column, bays, into, location, turn):
    """A row of arches on columns that starts at `location` and runs along the turned x axis."""
    placement = {"location": location, "rotation": (0, 0, turn)}
    bay = kit.add_object(f"{name} wall", _arch_bay(f"{name} bay", look["plaster"]), into, **placement)
    kit.array(bay, bays, (BAY, 0, 0))
    kit.array(
        kit.add_object(f"{name} mouldings", _archivolt(f"{name} moulding", look["trim"]), into, **placement),
        bays,
        (BAY, 0, 0),
    )
    length = BAY * bays
    bands = [
        ((-BAY / 2, -0.32, TOP - 0.35), (length - BAY / 2, 0.32, TOP - 0.28)),
        ((-BAY / 2, -0.34, TOP), (length - BAY / 2, 0.34, TOP + 0.1)),
    ]
    bands.append(((-BAY / 2, -0.4, TOP + 0.1), (length - BAY / 2, 0.4, TOP + 0.2)))
    kit.bevel(
        kit.add_object(
            f"{name} cornice", kit.boxes(f"{name} cornice", bands, look["trim"]), into, **placement
        ),
        0.015,
        2,
    )
    heading = np.array([math.cos(math.radians(turn)), math.sin(math.radians(turn)), 0])
    for index in range(bays + 1):
        place = np.asarray(location) + heading * (BAY * (index - 0.5))
        kit.instance(f"{name} column {index}", column, into, location=place, rotation=(0, 0, turn))


def _roof(look, into):
    """A lean-to roof of clay tiles over the back arcade."""
    turns = np.linspace(0, math.pi, 13)
    rows = [(0.0, 0.105), (0.62, 0.085)]
    vertices = [(r * math.cos(t), y, r * math.sin(t)) for y, r in rows for t in turns]
    faces = [(i, i + 1, len(turns) + i + 1, len(turns) + i) for i in range(len(turns) - 1)]
    tile = kit.mesh("Tile", vertices, faces, look["tile"], smooth=True)
    slope = 24
    made = kit.add_object(
        "Roof tiles", tile, into, location=(-SIDE - 0.2, BACK - 0.62, TOP + 0.26), rotation=(slope, 0, 0)
    )
    made.modifiers.new("Thickness", "SOLIDIFY").thickness = 0.018
    kit.array(made, 55, (0.245, 0, 0))
    kit.array(made, 7, (0, 0.52, 0.02)).name = "Rows"
    slab = kit.boxes("Roof slab", [((-SIDE - 0.3, 0, -0.1), (SIDE + 0.5, 3.6, -0.01))], look["wood"])
    kit.add_object("Roof slab", slab, into, location=(0, BACK - 0.5, TOP + 0.29), rotation=(slope, 0, 0))


def _walls(look, into):
    """The walls behind the back arcade and on the right, their plinths and coping."""
    spans = [
        ((-SIDE - 1, BACK + 2.4, 0), (SIDE + 0.4, BACK + 2.7, 5.3)),
        ((SIDE, -10, 0), (SIDE + 0.4, BACK + 2.4, TOP + 0.1)),
    ]
    kit.add_object("Walls", kit.project_uv(kit.boxes("Walls", spans, look["plaster"])), into)
    trims = [
        ((-SIDE - 1, BACK + 2.34, 0), (-0.9, BACK + 2.4, 0.45)),
        ((0.9, BACK + 2.34, 0), (SIDE, BACK + 2.4, 0.45)),
    ]
    trims += [((SIDE - 0.06, -10, 0), (SIDE, BACK + 2.34, 0.45))]
    trims += [
        ((SIDE - 0.1, -10, TOP + 0.1), (SIDE + 0.5, BACK - 0.4, TOP + 0.22)),
        ((-0.95, BACK + 2.3, 0), (-0.7, BACK + 2.4, 2.55)),
    ]
    trims += [
        ((0.7, BACK + 2.3, 0), (0.95, BACK + 2.4, 2.55)),
        ((-1.05, BACK + 2.28, 2.55), (1.05, BACK + 2.4, 2.8)),
    ]
    kit.bevel(kit.add_object("Plinths", kit.boxes("Plinths", trims, look["trim"]), into), 0.012, 2)
    planks = [
        ((-0.7 + 0.2 * i + 0.006, BACK + 2.34, 0.02), (-0.5 + 0.2 * i - 0.006, BACK + 2.39, 2.55))
        for i in range(7)
    ]
    kit.bevel(kit.add_object("Door", kit.boxes("Door", planks, look["door"]), into), 0.01)


def _paving(look, into):
    """Earth below, and paving stones of four kinds put on a running bond by geometry nodes."""
    half = 60
    ground = kit.mesh(
        "Earth",
        [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)],
        [(0, 1, 2, 3)],
        look["earth"],
    )
    kit.add_object("Earth", ground, into, location=(0, 0, -0.03))
    stones = kit.collection("Paving stones", linked=False)
    tints = [(0.50, 0.43, 0.35), (0.44, 0.38, 0.32), (0.55, 0.46, 0.36), (0.40, 0.37, 0.34)]
    for index, tint in enumerate(tints):
        x, y = 0.345 - 0.004 * (index % 2), 0.225 - 0.004 * (index // 2)
        shape = kit.boxes(
            f"Stone {index}", [((-x, -y, -0.08), (x, y, 0))], kit.material(f"Paving {index}", tint, 0.8)
        )
        kit.bevel(kit.add_object(f"Stone {index}", shape, stones), 0.014, 2)
    rng = np.random.default_rng(12)
    places = []
    for row in range(34):
        for column in range(20):
            x, y = -SIDE - 0.2 + 0.71 * (column + 0.5 * (row % 2)), -9 + 0.47 * row
            if math.hypot(x - props.FOUNTAIN[0], y - props.FOUNTAIN[1]) > 1.2 and x < SIDE - 0.1:
                places.append((x, y, rng.uniform(-0.012, 0.012)))
    bond = kit.add_object("Paving", kit.mesh("Paving", places, []), into)
    kit.scatter(bond, stones, seed=5, scale=(0.985, 1.0), tilt=0.5, spin=0.6)


def _lights(into):
    """A low sun, a cool sky panel, the wall lantern's spot and the candle in the hanging lantern."""
    kit.lamp(
        "Sun", "SUN", (-8, -6, 9), (0, 0, 0.5), 4.2, (1.0, 0.84, 0.62), into, angle=math.radians(1.5)
    ).rotation_euler = kit.Vector((0.86, 0.28, -0.55)).to_track_quat("-Z", "Y").to_euler()
    sky = {"shape": "RECTANGLE", "size": 2.6, "size_y": 1.2}
    kit.lamp("Sky panel", "AREA", (3.4, -6.6, 5.6), (-1.6, 1.6, 0.6), 260, (0.6, 0.76, 1.0), into, **sky)
    spot = {"spot_size": math.radians(96), "spot_blend": 0.5, "shadow_soft_size": 0.07}
    kit.lamp(
        "Wall lantern light", "SPOT", props.WALL_LANTERN, (5.0, 1.5, 0), 640, (1.0, 0.66, 0.34), into, **spot
    )
    kit.lamp(
        "Lantern light", "POINT", props.LANTERN, (0, 0, 0), 150, (1.0, 0.62, 0.3), into, shadow_soft_size=0.02
    )


def courtyard():
    """An arcaded courtyard in late sun, with a fountain, plants and lanterns."""
    scene = kit.new_scene("Courtyard")
    look = _materials()
    building, furnishing, garden, lights = map(kit.collection, ("Building", "Furnishing", "Plants", "Lights"))
    column = _column(look)
    _arcade("Back", look, column, 5, building, (-2 * BAY, BACK, 0), 0)
    _arcade("Left", look, column, 5, building, (-SIDE - 0.2, BACK - BAY / 2 - 0.25, 0), -90)
    _walls(look, building)
    _roof(look, building)
    _paving(look, building)
    props.furnish(look, furnishing)
    plants.plant(look, garden)
    _lights(lights)
    kit.sky((0.52, 0.70, 1.0), (0.05, 0.20, 0.75), strength=0.34)
    kit.camera((-3.9, -7.2, 2.25), (0.75, 2.2, 1.5), 28)
    scene.view_settings.look = "AgX - Medium High Contrast"
