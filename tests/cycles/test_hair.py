"""Shadows of hair and of points against Cycles, which knows them as curves and as spheres."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.planning import Options
from strata.scripts.bench import cycles
from strata.tests.support.scan_scenes import empty_scene

SIZE = (64, 64)
SAMPLES = 64

MEAN_SHADOW = 0.01
"""What the mean over the ground may be off: a polyhedron's width is right on the mean over directions."""


@pytest.fixture
def scene():
    """A ground seen from above, under a sun that stands not quite over it."""
    scene = empty_scene()
    scene.camera.location = (0.0, 0.0, 9.0)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 3.0
    bpy.ops.mesh.primitive_plane_add(size=20.0)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.angle = 3.0, 0.02
    sun.rotation_euler = (0.2, 0.1, 0.0)
    scene.collection.objects.link(sun)
    return scene


def shadows(scene) -> tuple[np.ndarray, np.ndarray]:
    """What the sun lets through, (height, width), as Cycles renders it and as it is baked."""
    sun = scene.objects["Sun"]
    sizes = {"size": SIZE, "filter_width": None}
    both = [cycles.shadow(scene, sun, SAMPLES, seed=seed, **sizes).visibility for seed in (1, 2)]
    options = Options(backend="cpu", samples=16, probes=0, effects=("soft_shadow",))
    (layer,) = bake(scene, scene.view_layers[0], options, size=SIZE).layers.layers
    return 0.5 * (both[0] + both[1]), layer.pixels.reshape(SIZE[::-1])


def shape_of(made, name, points, radii=None, lengths=None, location=(0.0, 0.0, 1.0)):
    """An object of hair curves or of points, which no camera sees."""
    made.add_curves(lengths) if lengths is not None else made.resize(len(points))
    made.attributes["position"].data.foreach_set("vector", np.asarray(points, np.float32).ravel())
    if radii is not None:
        made.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", np.float32(radii))
    shown = bpy.data.objects.new(name, made)
    shown.location, shown.visible_camera = location, False
    bpy.context.scene.collection.objects.link(shown)
    return shown


def curls(count: int, steps: int, seed: int):
    """(count * steps, 3): strands that curl out of a ball of a quarter of a metre."""
    random = np.random.default_rng(seed)
    out = random.normal(size=(count, 1, 3))
    out /= np.linalg.norm(out, axis=2, keepdims=True)
    along = np.linspace(0.0, 1.0, steps)[None, :, None]
    aside = np.cross(out, random.normal(size=(count, 1, 3)))
    angle = 5.0 * along + random.uniform(0.0, math.tau, (count, 1, 1))
    curl = aside * np.cos(angle) + np.cross(out, aside) * np.sin(angle)
    return (out * (0.25 + 0.6 * along) + 0.1 * along * curl).reshape(-1, 3)


def hairy_ball(**settings):
    """Particle hair with children on a ball, none of which a camera sees."""
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.25, location=(0.0, 0.0, 1.0))
    ball = bpy.context.object
    ball.visible_camera = False
    hair = ball.modifiers.new("Hair", "PARTICLE_SYSTEM").particle_system.settings
    hair.type, hair.count, hair.hair_length = "HAIR", 200, 0.5
    for name, value in settings.items():
        setattr(hair, name, value)
    return ball


@pytest.mark.parametrize("shape", ["RIBBONS", "THICK", "THICK_LINEAR"])
def test_curves(scene, shape):
    scene.cycles_curves.shape = shape
    shape_of(
        *(bpy.data.hair_curves.new("Fur"), "Fur", curls(800, 5, 3)),
        radii=np.tile(np.linspace(0.006, 0.002, 5), 800),
        lengths=[5] * 800,
    )
    theirs, ours = shadows(scene)
    assert theirs.mean() < 0.9
    assert abs(ours.mean() - theirs.mean()) < MEAN_SHADOW


@pytest.mark.parametrize(
    "settings",
    [
        {"child_type": "NONE", "root_radius": 3.0, "count": 600},
        {
            "child_type": "INTERPOLATED",
            "rendered_child_count": 10,
            "root_radius": 1.0,
            "tip_radius": 0.2,
            "shape": 0.5,
        },
        {
            "child_type": "SIMPLE",
            "rendered_child_count": 10,
            "kink": "CURL",
            "use_close_tip": True,
            "shape": -0.5,
        },
        {"child_type": "NONE", "render_step": 1, "radius_scale": 0.03, "tip_radius": 1.0},
    ],
    ids=["parents", "interpolated", "curled", "coarse"],
)
def test_particle_hair(scene, settings):
    hairy_ball(**settings)
    theirs, ours = shadows(scene)
    assert theirs.mean() < 0.95
    assert abs(ours.mean() - theirs.mean()) < MEAN_SHADOW


@pytest.mark.parametrize("count", [300, 3000, 30_000])
def test_points(scene, count):
    """Of each of the three kinds of spheres."""
    random = np.random.default_rng(count)
    points = random.normal(scale=0.35, size=(count, 3))
    radii = random.uniform(0.3, 1.0, count) / math.sqrt(count)
    shape_of(bpy.data.pointclouds.new("Dust"), "Dust", points, radii)
    theirs, ours = shadows(scene)
    assert theirs.mean() < 0.9
    assert abs(ours.mean() - theirs.mean()) < MEAN_SHADOW
