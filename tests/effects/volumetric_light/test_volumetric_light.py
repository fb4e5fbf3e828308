"""Volumetric light from Blender's nodes to layers: media, plans, layers and their measured error."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from mathutils import Vector
from strata.addon.bake import bake, read_scene
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.outline import Light
from strata.addon.effects.volumetric_light.sources import sources_of
from strata.addon.planning import Options
from strata.addon.scene.volumes import volume_of
from strata.tests.effects.volumetric_light import airlight_truth as truth

SIZE = (32, 24)
EFFECT = "volumetric_light"


def fresh_scene():
    """An empty scene with a camera at (0, -8, 1) that looks along +Y at a wall 4 m behind the origin."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, -8.0, 1.0), (math.radians(90), 0.0, 0.0)
    camera.data.clip_start = 0.1
    scene.collection.objects.link(camera)
    scene.camera = camera
    box("Wall", (-20, 4, -20), (20, 5, 20))
    return scene


def box(name, low, high, material=None):
    corners = [(x, y, z) for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], faces)
    if material:
        mesh.materials.append(material)
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def lamp(kind, location=(0, 0, 0), rotation=(0, 0, 0), energy=10.0, **settings):
    data = bpy.data.lights.new(kind.title(), kind)
    data.energy = energy
    for name, value in settings.items():
        setattr(data, name, value)
    made = bpy.data.objects.new(kind.title(), data)
    made.location, made.rotation_euler = location, [math.radians(a) for a in rotation]
    bpy.context.scene.collection.objects.link(made)
    return made


def with_volume(owner, kind="ShaderNodeVolumeScatter", output="World Output", **inputs):
    """Puts a volume node with these inputs at the volume output of a world or a material."""
    tree = owner.node_tree
    node = tree.nodes.new(kind)
    for name, value in inputs.items():
        node.inputs[name.replace("_", " ")].default_value = value
    tree.links.new(node.outputs["Volume"], tree.nodes[output].inputs["Volume"])
    return owner


def haze(**inputs):
    material = bpy.data.materials.new("Haze")
    material.node_tree.nodes.remove(material.node_tree.nodes["Principled BSDF"])
    return with_volume(material, output="Material Output", **inputs)


def world(scene, kind="ShaderNodeVolumeScatter", **inputs):
    scene.world = bpy.data.worlds.new("World")
    return with_volume(scene.world, kind, **inputs)


def baked(scene, probes=0, backend="cpu", size=SIZE, **values):
    options = Options((EFFECT,), backend, samples=1, probes=probes, values={EFFECT: values})
    return bake(scene, scene.view_layers[0], options, size=size)


def layers_of(result):
    return {layer.name: layer.pixels for layer in result.layers.layers}


def planned(scene, **values):
    _, graph, _, _ = read_scene(
        scene, scene.view_layers[0], Options((EFFECT,), values={EFFECT: values}), size=SIZE
    )
    return graph


@pytest.mark.parametrize(
    ("kind", "inputs", "scattering", "absorption", "anisotropy"),
    [
        (
            "Scatter",
            {"Color": (0.5, 1.0, 0.0, 1), "Density": 0.2, "Anisotropy": 0.3},
            (0.1, 0.2, 0.0),
            (0, 0, 0),
            0.3,
        ),
        ("Absorption", {"Color": (0.5, 1.0, 0.0, 1), "Density": 0.2}, (0, 0, 0), (0.1, 0.0, 0.2), 0.0),
        (
            "Principled",
            {
                "Color": (0.5, 0.8, 0.2, 1),
                "Density": 2.0,
                "Absorption_Color": (0.25, 1.0, 0.0, 1),
                "Anisotropy": -0.2,
            },
            (1.0, 1.6, 0.4),
            (0.5, 0.0, 1.6),
            -0.2,
        ),
    ],
)
def test_volume_nodes(kind, inputs, scattering, absorption, anisotropy):
    scene = fresh_scene()
    read, warnings = volume_of(world(scene, f"ShaderNodeVolume{kind}", **inputs).node_tree, "world")
    assert read.scattering == pytest.approx(scattering, abs=1e-6)
    assert read.absorption == pytest.approx(absorption, abs=1e-6)
    assert read.anisotropy == pytest.approx(anisotropy)
    assert not warnings


def test_volumes_that_vary_are_left_out_with_a_warning():
    scene = fresh_scene()
    tree = world(scene, Density=0.1).node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(noise.outputs[0], tree.nodes["Volume Scatter"].inputs["Density"])
    read, warnings = volume_of(tree, "world 'World'")
    assert read is None
    assert "Noise Texture" in warnings[0]


def test_plan_says_why():
    scene = fresh_scene()
    lamp("POINT", (0, 0, 2))
    reasons = {each.what: each.reason for each in planned(scene).left_out}
    assert reasons["Volumetric Light"] == "no fog (give the world or an object a volume)"
    assert not planned(scene).layers
    assert [layer.name for layer in planned(scene, use_scene_medium=False).layers] == [
        "Volumetric Point",
        "Transmittance",
    ]
    world(scene, Density=0.05)
    lamp("SPOT", (0, -900, 1), (90, 0, 180)).name = "Away"
    dark = lamp("SUN", energy=0.0)
    dark.name = "Dark"
    graph = planned(scene)
    reasons = {each.what: each.reason for each in graph.left_out}
    assert reasons["Volumetric Dark"] == "no power"
    assert reasons["Volumetric Away"] == "reaches no view ray"
    assert [layer.name for layer in graph.layers] == ["Volumetric Point", "Transmittance"]
    world(scene, "ShaderNodeVolumeAbsorption", Density=0.05, Color=(0, 0, 0, 1))
    assert [layer.name for layer in planned(scene).layers] == ["Transmittance"]


def _depth_and_lengths():
    """The camera's rays to the wall 12 m away: slopes (h, w) and metres along each per metre of depth."""
    half = 0.5 * 36.0 / 50.0
    x = (np.arange(SIZE[0]) + 0.5) / SIZE[0] * 2 * half - half
    y = ((np.arange(SIZE[1]) + 0.5) / SIZE[1] * 2 - 1) * half * SIZE[1] / SIZE[0]
    return x, y, np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2)


@pytest.mark.parametrize("backend", ["cpu", "gpu"])
def test_sun_and_transmittance_in_a_world(backend):
    """Closed forms at every pixel; a small sun's fluence is its irradiance."""
    scene = fresh_scene()
    world(scene, Density=0.1, Color=(0.5, 1.0, 0.2, 1))
    lamp("SUN", rotation=(0, 30, 0), energy=3.0, angle=0.0)
    images = layers_of(baked(scene, backend=backend))
    _, _, lengths = _depth_and_lengths()
    metres = ((12.0 - 0.1) * lengths)[..., None]
    extinction = np.array([0.05, 0.1, 0.02])
    through = np.exp(-extinction * metres)
    assert images["Transmittance"] == pytest.approx(through, rel=2e-5)
    # Straight to the left of the eye the phase is even: 1 / (4 pi).
    assert images["Volumetric Sun"] == pytest.approx(3.0 / (4 * math.pi) * (1.0 - through), rel=1e-4)


@pytest.mark.parametrize("backend", ["cpu", "gpu"])
def test_point_light_without_casters_against_forty_digits(backend):
    """The issue's bound: relative L2 of 1e-4."""
    scene = fresh_scene()
    world(scene, Density=0.15, Color=(1, 1, 1, 1), Anisotropy=0.4)
    lamp("POINT", (0.4, -3.0, 1.5), energy=50.0, shadow_soft_size=0.0, use_shadow=False)
    image = layers_of(baked(scene, backend=backend, light_samples=1))["Volumetric Point"]
    x, y, lengths = _depth_and_lengths()
    errors, values = [], []
    for row in range(0, SIZE[1], 6):
        for column in range(1, SIZE[0], 7):
            direction = np.array([x[column], 1.0, y[row]]) / lengths[row, column]
            origin = np.array([0.0, -8.0, 1.0]) + 0.1 * lengths[row, column] * direction
            away = np.array([0.4, -3.0, 1.5]) - origin
            closest = away @ direction
            height = np.linalg.norm(np.cross(away, direction))
            length = 11.9 * lengths[row, column]
            exact = float(truth.point(height, -closest, length - closest, 0.15, 0.4, 0.0))
            values.append(exact * 0.15 * 50.0 / (4 * math.pi))
            errors.append(image[row, column, 0] - values[-1])
    assert math.sqrt(np.mean(np.square(errors))) < 1e-4 * np.mean(values)


@pytest.mark.parametrize("bounded", [False, True], ids=["world", "mesh"])
@pytest.mark.parametrize("kind", ["SUN", "POINT", "SPOT", "AREA"])
def test_measured_error_with_casters(kind, bounded):
    """Three slats in front of each light: the report's own reference, by rays to the light's true shape."""
    scene = fresh_scene()
    if bounded:
        box("Fog", (-3, -4, -2), (3, 3, 4), haze(Density=0.12, Anisotropy=0.3))
    else:
        world(scene, Density=0.12, Anisotropy=0.3)
    for index in range(3):
        box(f"Slat {index}", (-2, -2 + index, 2.0), (2, -1.6 + index, 2.1))
    size = {"SUN": {"angle": 0.01}, "AREA": {"size": 0.2}}.get(kind, {"shadow_soft_size": 0.02})
    lamp(kind, (0.3, -0.8, 3.2), (10, 5, 0), 5.0 if kind == "SUN" else 200.0, **size)
    result = baked(scene, probes=256, light_samples=4, resolution=1024)
    layer = next(layer for layer in result.layers.layers if layer.light)
    assert np.isfinite(layer.pixels).all()
    error = layer.error
    # Of the method: one sample a pixel is aliased besides.
    assert error["method"] < 0.02
    transmittance = next(layer for layer in result.layers.layers if not layer.light)
    assert transmittance.error["method"] < 1e-6


def test_points_of_a_light_are_as_bright_as_the_light():
    place = {"centre": (1.0, 2.0, 3.0), "right": (1, 0, 0), "up": (0, 1, 0), "forward": (0, 0, -1)}
    for kind in EmitterKind:
        emitter = Emitter(kind, **place, half_width=0.2, half_height=0.2)
        light = Light("Light", "Light", "AREA", emitter, (1.0, 1.0, 1.0))
        for count in (1, 4, 16):
            sources = sources_of(light, count)
            total = sum(source.share for source in sources)
            points = 2 * count if kind == EmitterKind.DISTANT_DISK else count
            assert sum(len(source.eyes) for source in sources) == points
            expected = 2.0 / (1.0 + 1.0 / math.hypot(1.0, 0.2)) if kind == EmitterKind.DISTANT_DISK else 1.0
            assert total == pytest.approx(expected)
            if kind != EmitterKind.DISTANT_DISK:
                centre = np.mean([eye for source in sources for eye in source.eyes], axis=0)
                assert centre == pytest.approx(emitter.centre, abs=1e-12)


@pytest.mark.parametrize("scale", ["1/2", "1/4"])
def test_coarser_images(scale):
    """Half and a quarter of the rays a side, guided by depth; what differs is the edges of the shaft."""
    scene = fresh_scene()
    world(scene, Density=0.1)
    lamp("POINT", (2.0, -1.0, 3.0), energy=50.0)
    box("Pillar", (-1, 0, -3), (0, 1, 4))
    size = (160, 120)
    full = layers_of(baked(scene, light_samples=1, size=size))["Volumetric Point"]
    coarse = layers_of(baked(scene, light_samples=1, size=size, scale=scale))["Volumetric Point"]
    assert np.sqrt(np.mean((coarse - full) ** 2)) < (0.03 if scale == "1/2" else 0.15) * full.mean()


@pytest.mark.parametrize("bounded", [False, True], ids=["world", "mesh"])
@pytest.mark.parametrize("scale", ["1/2", "1/4"])
def test_a_coarser_image_shows_no_tiles(backend, scale, bounded, monkeypatch):
    """Fog in front of a wall alone: no outline that a GPU's tiles may move."""
    scene = fresh_scene()
    if bounded:
        box("Haze", (-30, -3, -30), (30, 3, 30), haze(Density=0.06))
    else:
        world(scene, Density=0.06)
    lamp("POINT", (0.4, 0.0, 1.2))
    found = []
    for rows in (24, 17, 7, 1):
        monkeypatch.setattr("strata.addon.core.sampling.PIXELS_PER_TILE", SIZE[0] * rows)
        found.append(layers_of(baked(scene, backend=backend, light_samples=1, scale=scale)))
    assert found[0]["Volumetric Point"].std() > 0.05 * found[0]["Volumetric Point"].mean() > 0.0
    # A GPU draws the haze's own surface in the clip coordinates of the tile, single precision.
    tolerance = 1e-5 if bounded and backend == "gpu" else 0.0
    for tiled in found[1:]:
        for name, image in found[0].items():
            assert np.allclose(image, tiled[name], rtol=tolerance, atol=0.0), name


@pytest.mark.parametrize("backend", ["cpu", "gpu"])
def test_furnace(backend):
    """Suns from everywhere are a radiance of 1: what a medium scatters towards the eye, what it takes and
    what it lets through make 1 again."""
    scene, count = fresh_scene(), 48
    for index in range(count):
        height = 1.0 - 2.0 * (index + 0.5) / count
        turn = index * math.pi * (3.0 - math.sqrt(5.0))
        out = math.sqrt(1.0 - height**2)
        towards = Vector((out * math.cos(turn), out * math.sin(turn), height))
        euler = towards.to_track_quat("-Z", "Y").to_euler()
        lamp("SUN", rotation=[math.degrees(a) for a in euler], energy=4.0 * math.pi / count, angle=0.0)
    medium = {"scattering_per_m": "0.1,0.05,0.02", "absorption_per_m": "0.0,0.05,0.1", "anisotropy": 0.3}
    for light in scene.objects:
        if light.type == "LIGHT":
            light.data.use_shadow = False
    images = layers_of(baked(scene, backend=backend, use_scene_medium=False, **medium))
    through = images.pop("Transmittance")
    scattered = sum(images.values())
    albedo = np.array([1.0, 0.5, 1.0 / 6.0])
    total = through + scattered + (1.0 - albedo) * (1.0 - through)
    # 48 directions know the mean of the phase function to a thousandth.
    assert total == pytest.approx(np.ones_like(total), abs=2e-3)
