"""The shadows that a displaced ground casts on itself, against Cycles."""

from __future__ import annotations

import math

import bpy
import numpy as np
from strata.addon.bake import bake
from strata.addon.planning import Options
from strata.scripts.bench import cycles
from strata.tests.support.displaced_scenes import displacing, grid, image_of
from strata.tests.support.scan_scenes import empty_scene

SIZE = (96, 96)


def test_hills_of_an_image_shadow_each_other():
    scene = empty_scene()
    scene.camera.location = (0.0, 0.0, 9.0)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 3.8
    x = np.linspace(0.0, 1.0, 64, endpoint=False)
    hills = 0.5 + 0.25 * (np.sin(4.0 * math.tau * x)[:, None] + np.sin(3.0 * math.tau * x)[None])
    ground = grid("Ground", 160, size=4.0)
    for polygon in ground.data.polygons:
        polygon.use_smooth = True
    ground.data.materials.append(displacing(height=image_of(hills.astype(np.float32)), scale=0.6))
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.angle = 3.0, 0.05
    sun.rotation_euler = (math.radians(65.0), 0.0, 0.3)
    scene.collection.objects.link(sun)
    both = [cycles.shadow(scene, sun, 64, seed=seed, size=SIZE, filter_width=None) for seed in (1, 2)]
    theirs = 0.5 * (both[0].visibility + both[1].visibility)
    lit = np.isfinite(theirs) & (both[0].weight > 0.0)
    options = Options(backend="cpu", samples=16, probes=0, effects=("soft_shadow",))
    (layer,) = bake(scene, scene.view_layers[0], options, size=SIZE).layers.layers
    difference = (layer.pixels.reshape(SIZE[::-1]) - theirs)[lit]
    weight = both[0].weight[lit]
    mean = np.average(theirs[lit], weights=weight)
    assert mean < 0.9
    # The project's goal for soft shadows; without displacement it would be all light.
    assert math.sqrt(np.average(difference**2, weights=weight)) < 0.03
    assert abs(np.average(difference, weights=weight)) < 0.01
