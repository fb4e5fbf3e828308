"""Holdouts against Cycles: a hole in the picture, of which nothing counts that is behind it."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.planning import Options
from strata.scripts.bench import cycles
from strata.tests.support.cycles_card import rendered
from strata.tests.support.gpu_scenes import gpu_device
from strata.tests.support.scan_scenes import empty_scene

SIZE = (64, 32)
EDGE = 0.03
"""Metres: where the holdout begins and the shadow ends, in the middle of a pixel of a sixteenth."""


def card(name: str, z: float, left: float, right: float) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(left, -9, z), (right, -9, z), (right, 9, z), (left, 9, z)], [], [(0, 1, 2, 3)])
    shown = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(shown)
    return shown


@pytest.fixture
def scene():
    """A floor from above, in shadow from -1 to the edge; from there on it is lit, and a holdout hides it."""
    scene = empty_scene()
    scene.render.engine, scene.render.film_transparent = "CYCLES", True
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = 64, False, False
    scene.camera.location = (0.0, 0.0, 9.0)
    scene.camera.rotation_euler = (0.0, 0.0, 0.0)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 4.0
    card("Floor", 0.0, -9.0, 9.0)
    card("Caster", 1.0, -1.0, EDGE).visible_camera = False
    holdout = card("Holdout", 2.0, EDGE, 9.0)
    holdout.is_holdout, holdout.visible_shadow = True, False
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.angle = math.pi, 0.0
    scene.collection.objects.link(sun)
    return scene


def test_what_a_holdout_hides_weighs_nothing(scene, backend, tmp_path):
    if backend == "gpu":
        gpu_device()
    options = Options(("soft_shadow",), backend, samples=16, probes=256, composite=True)
    baked = bake(scene, scene.view_layers[0], options, size=SIZE)
    assert not [warning for warning in baked.report.warnings if "holdout" in warning]
    (layer,) = baked.layers.layers
    shadow = cycles.shadow(scene, scene.objects["Sun"], 64, seed=1, size=SIZE, filter_width=None)
    pixels, edge = layer.pixels.reshape(SIZE[::-1]), SIZE[0] // 2
    seen = shadow.weight > 0.05 * shadow.weight.max()
    assert seen[:, edge].any()
    assert not seen[:, edge + 2 :].any()
    # Of the pixel at the edge all that is seen lies in shadow. The one at the shadow's other end is split.
    is_split = np.zeros(SIZE[::-1], bool)
    is_split[:, SIZE[0] // 4 - 2 : SIZE[0] // 4 + 2] = True
    seen[:, edge + 1] = False  # by a sample in a hundred, if by any
    assert np.abs(pixels - np.nan_to_num(shadow.visibility))[seen & ~is_split].max() < 0.01
    assert (pixels[:, edge] < 0.01).all()
    assert (pixels[:, edge + 2 :] == 1.0).all()  # nothing is there
    found = baked.composite[..., 3]
    assert np.abs(found - rendered(tmp_path)[..., 3]).max() < 0.1  # where pixels are split
    assert layer.error["value"] < 0.02


def test_fog_ends_at_a_holdout(scene):
    """As at a surface of the same place that sends nothing back."""
    nodes = bpy.data.worlds.new("Fog").node_tree
    scatter = nodes.nodes.new("ShaderNodeVolumeScatter")
    scatter.inputs["Density"].default_value = 0.1
    nodes.links.new(scatter.outputs[0], nodes.nodes["World Output"].inputs["Volume"])
    scene.world = bpy.data.worlds["Fog"]
    options = Options(("volumetric_light",), "cpu", samples=4, probes=128)
    found = []
    for is_holdout in (True, False):
        scene.objects["Holdout"].is_holdout = is_holdout
        baked = bake(scene, scene.view_layers[0], options, size=SIZE)
        found.append({layer.name: layer for layer in baked.layers.layers})
    assert found[0].keys() == found[1].keys()
    for name, layer in found[0].items():
        held, solid = layer.pixels[:, SIZE[0] // 2 + 2 :], found[1][name].pixels[:, SIZE[0] // 2 + 2 :]
        np.testing.assert_allclose(held, solid, rtol=1e-5, err_msg=name)
        assert layer.error["value"] < 0.05, name
