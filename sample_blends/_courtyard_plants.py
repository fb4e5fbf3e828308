"""The plants of the courtyard: orange trees, agaves and a climber, all instanced leaves."""

import math

import _kit as kit
import bpy
import numpy as np


def leaf_picture(size=96):
    """A leaf with a midrib on a clear background; its alpha is 0 or 1, so it clips the same everywhere."""
    u, v = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size)
    half = 0.47 * np.sin(math.pi * np.clip(u, 0, 1) ** 0.75) ** 0.8
    inside = np.abs(v - 0.5) < half * (1 + 0.07 * np.sin(u * 60))
    rib = np.clip(1 - np.abs(v - 0.5) / 0.025, 0, 1) + 0.5 * np.clip(
        1 - np.abs((u * 7 - np.abs(v - 0.5) * 5) % 1 - 0.5) / 0.08, 0, 1
    )
    base = np.array([0.42, 0.56, 0.24]) + np.outer((u - 0.5).ravel(), [0.08, 0.1, 0.02]).reshape(
        size, size, 3
    )
    rgb = base + 0.14 * np.clip(rib, 0, 1)[..., None]
    return kit.image("Leaf", np.concatenate([rgb, inside[..., None].astype(float)], 2))


def leaf_card(name, surface, length, width, bend):
    """A bent strip of four quads along +X whose picture is cut out by its alpha."""
    steps = 3
    vertices = [
        (
            length * i / steps,
            side * width / 2,
            bend * math.sin(math.pi * 0.8 * i / steps) + (0.12 * width if side else 0),
        )
        for i in range(steps + 1)
        for side in (-1, 0, 1)
    ]
    faces = [(3 * i + s, 3 * i + s + 3, 3 * i + s + 4, 3 * i + s + 1) for i in range(steps) for s in (0, 1)]
    made = kit.mesh(name, vertices, faces, surface, smooth=True)
    layer = made.uv_layers.new(name="UVMap")
    for loop in made.loops:
        layer.data[loop.index].uv = (loop.vertex_index // 3 / steps, (loop.vertex_index % 3) / 2)
    return made


def _pot(name, surface, into, height=0.45, **placement):
    """A rimmed pot, with earth in it."""
    h = height
    outline = [
        (0.001, 0),
        (0.6 * h / 2, 0),
        (0.64 * h / 2, 0.04 * h),
        (0.9 * h / 2, 0.55 * h),
        (0.96 * h / 2, 0.82 * h),
        (1.1 * h / 2, 0.83 * h),
    ]
    outline += [
        (1.13 * h / 2, 0.86 * h),
        (1.13 * h / 2, 0.97 * h),
        (1.1 * h / 2, h),
        (0.97 * h / 2, h),
        (0.94 * h / 2, 0.9 * h),
        (0.001, 0.88 * h),
    ]
    return kit.lathe(name, outline, surface, into, 48, **placement)


def _emitter(name, into, balls):
    """A mesh of a few icospheres for leaves to sprout from: (centre, radius) each."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2, radius=1)
    source = bpy.context.object
    points = np.array([vertex.co[:] for vertex in source.data.vertices])
    triangles = np.array([polygon.vertices[:] for polygon in source.data.polygons])
    ball = source.data
    bpy.data.objects.remove(source)
    bpy.data.meshes.remove(ball)
    vertices = np.concatenate([points * radius + centre for centre, radius in balls])
    faces = np.concatenate([triangles + len(points) * index for index in range(len(balls))])
    return kit.add_object(name, kit.mesh(name, vertices, faces), into)


def _tree(look, leaves):
    """An orange tree in a clay pot, as a collection to instance."""
    tree = kit.collection("Orange tree", linked=False)
    _pot("Tree pot", look["clay"], tree, 0.5)
    trunk = [
        ((0, 0, 0.4), (0.015, 0.01, 0.85), 0.032, 0.026),
        ((0.015, 0.01, 0.85), (-0.01, 0, 1.25), 0.026, 0.022),
    ]
    trunk += [
        ((-0.01, 0, 1.2), (0.2 * math.cos(t), 0.2 * math.sin(t), 1.55), 0.018, 0.006) for t in (0.3, 2.2, 4.4)
    ]
    kit.add_object("Trunk", kit.tubes("Trunk", trunk, look["wood"], 12), tree)
    balls = [
        ((0, 0, 1.5), 0.36),
        ((0.17, 0.08, 1.62), 0.26),
        ((-0.16, 0.1, 1.58), 0.27),
        ((0.02, -0.18, 1.6), 0.26),
        ((0, 0.02, 1.78), 0.24),
    ]
    kit.scatter(_emitter("Crown", tree, balls), leaves, 210, seed=3, scale=(0.7, 1.25), tilt=40)
    fruit = kit.collection("Fruit", linked=False)
    kit.lathe(
        "Orange",
        [(0.045 * math.sin(t) + 1e-5, -0.045 * math.cos(t)) for t in np.linspace(0, math.pi, 15)],
        look["orange"],
        fruit,
        24,
    )
    kit.scatter(_emitter("Fruit places", tree, [((0, 0, 1.6), 0.42)]), fruit, 7, seed=8, scale=(0.85, 1.1))
    return tree


def _agave(look):
    """A rosette of thick pointed leaves in a glazed pot."""
    agave = kit.collection("Agave", linked=False)
    _pot("Agave pot", look["glazed"], agave, 0.42)
    vertices, faces = [], []
    for leaf in range(26):
        turn, lift = leaf * 2.39996, 0.25 + 1.1 * leaf / 26
        start = len(vertices)
        for i, width in enumerate((0.03, 0.05, 0.045, 0.025, 0.004)):
            reach = 0.13 * i
            out, up = (
                reach * math.cos(lift) + 0.02,
                reach * math.sin(lift) - 0.05 * (i / 4) ** 2 * math.cos(lift) * 2,
            )
            for across, raised in ((-1, 0.02), (0, -0.006), (1, 0.02), (0, -0.028 * (1 - i / 4.5))):
                x, y = out, across * width
                vertices.append(
                    (
                        x * math.cos(turn) - y * math.sin(turn),
                        x * math.sin(turn) + y * math.cos(turn),
                        up + raised + 0.36,
                    )
                )
        for i in range(4):
            for k in range(4):
                a, b = start + 4 * i + k, start + 4 * i + (k + 1) % 4
                faces.append((b, a, a + 4, b + 4))
    shape = kit.add_object(
        "Agave leaves", kit.mesh("Agave leaves", vertices, faces, look["agave"], smooth=True), agave
    )
    kit.subdivide(shape, 1)
    return agave


def _climber(look, leaves, into):
    """Bougainvillea over the right wall and the corner: patches along a path carry leaves and bracts."""
    rng = np.random.default_rng(31)
    vertices, faces = [], []
    path = [
        (6.4, 3.2, 0.5),
        (6.42, 3.1, 1.6),
        (6.4, 2.9, 2.7),
        (6.38, 2.5, 3.5),
        (6.3, 1.4, 3.95),
        (6.3, 0.2, 4.1),
        (6.35, -0.9, 3.95),
        (6.4, -1.6, 3.6),
    ]
    ticks = np.linspace(0, len(path) - 1, 150)
    spots = np.stack([np.interp(ticks, range(len(path)), axis) for axis in zip(*path, strict=True)], 1)
    for tick, spot in zip(ticks, spots, strict=True):
        spread = 0.1 + 0.32 * min(tick / 4, 1)
        centre = spot + rng.normal(size=3) * (0.03, spread, 0.55 * spread)
        centre[0] = min(centre[0], 6.44)
        start, turn = len(vertices), rng.uniform(0, 6.28)
        for corner in range(3):
            angle = turn + corner * 2.094
            offset = np.array([rng.uniform(-0.1, 0.02), 0.17 * math.cos(angle), 0.17 * math.sin(angle)])
            vertices.append(centre + offset)
        normal = np.cross(vertices[start + 1] - vertices[start], vertices[start + 2] - vertices[start])
        faces.append((start, start + 1, start + 2) if normal[0] < 0 else (start, start + 2, start + 1))
    patches = kit.mesh("Climber", vertices, faces)
    kit.scatter(
        kit.add_object("Climber leaves", patches, into), leaves, 260, seed=11, scale=(0.7, 1.2), tilt=55
    )
    bracts = kit.collection("Bracts", linked=False)
    petals = [(0.06 * math.cos(t), 0.06 * math.sin(t), 0.05) for t in (0, 2.1, 4.2)]
    flower, cells = [(0, 0, 0)], []
    for index, tip in enumerate(petals):
        turn = 2.1 * index
        flower += [(0.04 * math.cos(turn + s), 0.04 * math.sin(turn + s), 0.02) for s in (-0.7, 0.7)] + [tip]
        cells += [(0, 3 * index + 1, 3 * index + 3), (0, 3 * index + 3, 3 * index + 2)]
    kit.add_object("Bract", kit.mesh("Bract", flower, cells, look["bract"]), bracts)
    kit.scatter(
        kit.add_object("Climber flowers", patches.copy(), into),
        bracts,
        330,
        seed=12,
        scale=(0.8, 1.5),
        tilt=45,
    )
    kit.curve("Climber stem", [(6.38, 3.25, 0), *path[:5]], 0.022, look["wood"], into)


def plant(look, into):
    """Trees, agaves and the climber."""
    leaves = kit.collection("Leaf kinds", linked=False)
    for index, (length, width, bend) in enumerate(
        [(0.13, 0.065, 0.02), (0.16, 0.07, 0.035), (0.11, 0.06, 0.01)]
    ):
        kit.add_object(f"Leaf {index}", leaf_card(f"Leaf {index}", look["leaf"], length, width, bend), leaves)
    tree, agave = _tree(look, leaves), _agave(look)
    trees = [
        ((-3.9, 3.1, 0), 20, 1.15),
        ((1.3, 3.0, 0), 140, 1.1),
        ((-4.6, -0.9, 0), 260, 1.2),
        ((5.6, -0.3, 0), 75, 1.0),
    ]
    for index, (place, turn, size) in enumerate(trees):
        kit.instance(f"Orange tree {index}", tree, into, location=place, rotation=(0, 0, turn), scale=size)
    agaves = [
        ((3.7, 2.9, 0), 0, 1.2),
        ((4.3, -2.2, 0), 80, 1.35),
        ((-3.45, -1.75, 0), 200, 1.15),
        ((5.75, 3.1, 0), 30, 1.0),
    ]
    for index, (place, turn, size) in enumerate(agaves):
        kit.instance(f"Agave {index}", agave, into, location=place, rotation=(0, 0, turn), scale=size)
    _climber(look, leaves, into)
