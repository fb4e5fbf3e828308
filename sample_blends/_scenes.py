"""The small sample scenes: dandelion, stacked casters, one that needs nothing, animation, benchmark."""

import math

import _kit as kit
import bpy
import numpy as np


def _ground(color=(0.55, 0.53, 0.5), size=12.0):
    """A square plane at height zero."""
    half = size / 2
    corners = [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]
    shape = kit.mesh("Ground", corners, [(0, 1, 2, 3)], kit.material("Ground", color, 0.9))
    return kit.add_object("Ground", shape)


def _sphere_points(count):
    """Evenly spread directions (a golden spiral)."""
    index = np.arange(count) + 0.5
    height = 1 - 2 * index / count
    turn = index * math.pi * (3 - math.sqrt(5))
    ring = np.sqrt(1 - height * height)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), height], 1)


def _parachute(surface, seed_surface, into):
    """One dandelion seed along +Z: a stalk, its seed and a crown of filaments; lengths in metres."""
    crown = [((0, 0, 0.105), (0, 0, 0.09), 0.0006, 0.0006)]
    for index in range(26):
        turn = index * 2.39996
        lift = 0.012 + 0.02 * ((index * 7) % 13) / 13
        reach = 0.042 - 0.25 * lift
        middle = (0.6 * reach * math.cos(turn), 0.6 * reach * math.sin(turn), 0.105 + 0.75 * lift)
        tip = (reach * math.cos(turn), reach * math.sin(turn), 0.105 + lift)
        crown += [((0, 0, 0.105), middle, 0.00035, 0.0003), (middle, tip, 0.0003, 0.00012)]
    crown.append(((0, 0, 0.03), (0, 0, 0.105), 0.0006, 0.0005))
    kit.add_object("Parachute", kit.tubes("Parachute", crown, surface, sides=3), into)
    seed = [((0, 0, 0.006), (0, 0, 0.016), 0.0004, 0.0018), ((0, 0, 0.016), (0, 0, 0.03), 0.0018, 0.0006)]
    kit.add_object("Seed", kit.tubes("Seed", seed, seed_surface, sides=6), into)


def dandelion():
    """Hair-thin casters: a seed head of instanced parachutes over a plane, one area light."""
    kit.new_scene("Dandelion")
    _ground((0.5, 0.46, 0.4), 4.0)
    white, green = kit.material("Down", (0.85, 0.84, 0.8)), kit.material("Stem", (0.22, 0.34, 0.12))
    brown = kit.material("Seed", (0.2, 0.11, 0.05))
    seed = kit.collection("Dandelion seed", linked=False)
    _parachute(white, brown, seed)
    head = kit.collection("Seed head")
    centre = np.array([0, 0, 0.42])
    for index, direction in enumerate(_sphere_points(240)):
        if direction[2] < -0.93 or (direction[0] > 0.55 and 0.1 < direction[2] < 0.75 and index % 3):
            continue
        made = kit.instance(f"Seed {index:03d}", seed, head, location=centre + 0.022 * direction)
        made.rotation_mode = "QUATERNION"
        made.rotation_quaternion = kit.Vector(direction).to_track_quat("Z", "Y")
    for index, (place, turn) in enumerate(
        [((0.36, 0.02, 0.05), 75), ((0.45, 0.18, 0.3), 25), ((0.62, 0.0, 0.5), -15)]
    ):
        kit.instance(f"Flying seed {index}", seed, head, location=place, rotation=(turn, 20, 40 * index))
    receptacle = [(0.001, -0.02), (0.014, -0.016), (0.022, 0), (0.018, 0.014), (0.001, 0.021)]
    kit.lathe("Receptacle", receptacle, green, steps=24, location=centre)
    kit.curve("Stem", [(0.05, 0.02, 0), (0.06, 0.01, 0.12), (0.02, 0, 0.28), (0, 0, 0.405)], 0.006, green)
    kit.lamp(
        "Window", "AREA", (-0.75, -0.35, 1.25), (0.05, 0, 0.2), 34, (1, 0.95, 0.88), shape="SQUARE", size=0.12
    )
    kit.sky((0.45, 0.62, 0.85), strength=0.3)
    kit.camera((0.28, -1.45, 0.62), (0.13, 0, 0.27), 42)


def stacked():
    """Casters above casters, where a shadow map of one layer leaks light: grid, ring, plates and balls."""
    kit.new_scene("Stacked")
    _ground()
    clay, slate = kit.material("Clay", (0.62, 0.3, 0.18)), kit.material("Slate", (0.2, 0.3, 0.38))
    bone = kit.material("Bone", (0.78, 0.72, 0.6))
    for index, (height, half, turn) in enumerate([(0.35, 0.75, 10), (0.8, 0.55, 38), (1.25, 0.35, 64)]):
        plate = kit.boxes(
            f"Plate {index}", [((-half, -half, -0.02), (half, half, 0.02))], (slate, clay, slate)[index]
        )
        kit.bevel(kit.add_object(plate.name, plate, location=(-0.9, 0, height), rotation=(0, 0, turn)), 0.008)
    offsets = [-0.8 + 0.16 * index for index in range(11)]
    bars = [((-0.8, y, 0), (0.8, y, 0), 0.018, 0.018) for y in offsets]
    bars += [((x, -0.8, 0), (x, 0.8, 0), 0.018, 0.018) for x in offsets]
    grid = kit.tubes("Grid", bars, bone, 12)
    for index, height in enumerate((0.5, 1.0, 1.5)):
        kit.add_object(f"Grid {index}", grid, location=(1.0, 0.1, height), rotation=(0, 0, 17 * index))
    ball = _ball("Ball", clay)
    for index, (x, z, size) in enumerate(
        [(1.0, 0.26, 0.2), (0.7, 0.77, 0.16), (1.2, 1.24, 0.15), (1.0, 1.75, 0.2)]
    ):
        kit.add_object(f"Ball {index}", ball, location=(x, 0.1, z), scale=size)
    kit.lamp("Panel", "AREA", (0.0, -0.6, 3.4), (0.1, 0, 0), 480, (1, 0.96, 0.9), shape="SQUARE", size=0.8)
    kit.sky((0.6, 0.7, 0.85), strength=0.15)
    kit.camera((0.5, -5.4, 2.7), (0.1, 0, 0.62), 38)


def _ball(name, surface, rings=32, segments=64):
    """A unit sphere of quads and two triangle fans, smooth."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=segments, ring_count=rings)
    made = bpy.context.object
    shape = made.data
    shape.name = name
    shape.shade_smooth()
    shape.materials.append(surface)
    bpy.data.objects.remove(made)
    return shape


def plain():
    """Nothing to do: a lit ball whose only light casts no shadow."""
    kit.new_scene("Plain")
    _ground()
    kit.add_object("Ball", _ball("Ball", kit.material("Blue", (0.16, 0.3, 0.55))), location=(0, 0, 1))
    kit.lamp("Fill", "POINT", (-2.5, -3, 4), (0, 0, 1), 700, shadow_soft_size=0.3, use_shadow=False)
    kit.sky((0.6, 0.7, 0.85), strength=0.3)
    kit.camera((0.0, -6.5, 2.4), (0, 0, 0.9), 40)


def _bending_mast(surface):
    """A tall column that an armature of two bones bends over the frames."""
    rings, sides = 25, 16
    turns = np.linspace(0, 2 * math.pi, sides, endpoint=False)
    heights = np.linspace(0, 2, rings)
    vertices = [(0.16 * math.cos(t), 0.16 * math.sin(t), z) for z in heights for t in turns]
    faces = [
        (r * sides + s, r * sides + (s + 1) % sides, (r + 1) * sides + (s + 1) % sides, (r + 1) * sides + s)
        for r in range(rings - 1)
        for s in range(sides)
    ]
    faces += [tuple(reversed(range(sides))), tuple(range((rings - 1) * sides, rings * sides))]
    mast = kit.add_object("Mast", kit.mesh("Mast", vertices, faces, surface, True), location=(-1.2, 0.4, 0))
    rig = kit.add_object("Rig", bpy.data.armatures.new("Rig"), location=(-1.2, 0.4, 0))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    lower, upper = (rig.data.edit_bones.new(name) for name in ("Lower", "Upper"))
    lower.head, lower.tail, upper.tail = (0, 0, 0), (0, 0, 1), (0, 0, 2)
    upper.parent, upper.use_connect = lower, True
    bpy.ops.object.mode_set(mode="OBJECT")
    groups = [mast.vertex_groups.new(name=name) for name in ("Lower", "Upper")]
    for index, (_, _, height) in enumerate(vertices):
        weight = min(max((height - 0.6) / 0.8, 0.0), 1.0)
        groups[0].add([index], 1 - weight, "REPLACE")
        groups[1].add([index], weight, "REPLACE")
    mast.modifiers.new("Armature", "ARMATURE").object = rig
    bone = rig.pose.bones["Upper"]
    bone.rotation_mode = "XYZ"
    for frame, angle in ((1, -35), (10, 60)):
        bone.rotation_euler = (math.radians(angle) * 0.3, 0, math.radians(angle))
        bone.keyframe_insert("rotation_euler", frame=frame)


def _keyed_ball(surface):
    """A ball that a shape key flattens over the frames."""
    made = kit.add_object(
        "Squashed ball", _ball("Squashed ball", surface), location=(1.5, 0.9, 0.6), scale=0.6
    )
    made.shape_key_add(name="Basis")
    key = made.shape_key_add(name="Flat")
    positions = np.empty(len(key.data) * 3, np.float32)
    key.data.foreach_get("co", positions)
    positions = positions.reshape(-1, 3) * (1.35, 1.35, 0.45) + (0, 0, -0.55)
    key.data.foreach_set("co", positions.astype(np.float32).ravel())
    for frame, value in ((1, 0.0), (10, 1.0)):
        key.value = value
        key.keyframe_insert("value", frame=frame)


def animated():
    """Ten frames: a box moves, the light moves, an armature bends a mast, a shape key flattens a ball."""
    scene = kit.new_scene("Animated", (1, 10))
    _ground()
    red, teal = kit.material("Red", (0.6, 0.14, 0.1)), kit.material("Teal", (0.12, 0.4, 0.4))
    cream = kit.material("Cream", (0.75, 0.68, 0.52))
    box = kit.bevel(kit.add_object("Box", kit.boxes("Box", [((-0.3,) * 3, (0.3,) * 3)], red)), 0.04, 3)
    for frame, place, turn in ((1, (-0.6, -1.0, 0.5), 0), (10, (1.4, -0.8, 0.9), 80)):
        box.location, box.rotation_euler[2] = place, math.radians(turn)
        box.keyframe_insert("location", frame=frame)
        box.keyframe_insert("rotation_euler", frame=frame)
    _bending_mast(teal)
    _keyed_ball(cream)
    light = kit.lamp("Moving panel", "AREA", (-2, -2, 3.6), (0, 0, 0.5), 480, shape="SQUARE", size=0.6)
    for frame, place in ((1, (-2.0, -2.0, 3.6)), (10, (1.2, -2.4, 3.6))):
        light.location = place
        kit.aim(light, (0, 0, 0.5))
        light.keyframe_insert("location", frame=frame)
        light.keyframe_insert("rotation_euler", frame=frame)
    kit.sky((0.6, 0.7, 0.85), strength=0.2)
    kit.camera((0.3, -6.2, 2.9), (0.1, 0, 0.7), 36)
    scene.frame_set(1)


def bench_scene(path=None):
    """The benchmark: 276,482 triangles, a plane and 30 tori of 96x48 quads under one 1.5 m square light."""
    kit.new_scene("Benchmark")
    _ground(size=24.0)
    surface = kit.material("Torus", (0.5, 0.45, 0.4))
    rng = np.random.default_rng(20)
    bpy.ops.mesh.primitive_torus_add(
        major_segments=96, minor_segments=48, major_radius=0.55, minor_radius=0.16
    )
    source = bpy.context.object
    shape = source.data
    shape.name = "Torus"
    shape.shade_smooth()
    shape.materials.clear()
    shape.materials.append(surface)
    bpy.data.objects.remove(source)
    for index in range(30):
        column, row = index % 6, index // 6
        x, y = np.array([1.35 * (column - 2.5), 1.2 * (row - 2)]) + rng.uniform(-0.3, 0.3, 2)
        angles = rng.uniform(0, 360, 3)
        height = rng.uniform(0.75, 2.1)
        kit.add_object(f"Torus {index:02d}", shape.copy(), location=(x, y, height), rotation=angles)
    kit.lamp("Panel", "AREA", (0.6, 1.0, 5.6), (0, 0, 0), 1800, shape="SQUARE", size=1.5)
    kit.sky((0.5, 0.5, 0.5), strength=0.1)
    kit.camera((0, -6.6, 7.6), (0, -0.1, 0.3), 35)
    bpy.data.orphans_purge(do_recursive=True)
    if path:
        kit.save(path)
