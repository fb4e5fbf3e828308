"""Toon in a render region: what lies beside it is still beside it."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from strata.addon.bake import Options, bake

VALUES = {"object_lines": True, "line_width_px": 8.0}
OPTIONS = Options(("toon",), "cpu", samples=1, probes=0, values={"toon": VALUES})


@pytest.fixture
def scene():
    """A cube on a floor, from above: it covers the columns 50 to 60 of 100."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=20.0)
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(0.5, 0.0, 0.5))
    bpy.ops.object.light_add(type="SUN", location=(0.0, 0.0, 5.0))
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 10.0
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location = (0.0, 0.0, 10.0)
    scene.collection.objects.link(scene.camera)
    return scene


@pytest.mark.parametrize("is_cropped", [False, True])
def test_lines_of_what_lies_beside_a_region_reach_into_it(scene, is_cropped):
    whole = bake(scene, scene.view_layers[0], OPTIONS, size=(100, 100)).layers
    render = scene.render
    render.use_border, render.use_crop_to_border = True, is_cropped
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.3, 0.48, 0.4, 0.6
    part = bake(scene, scene.view_layers[0], OPTIONS, size=(100, 100)).layers
    inside = np.s_[40:60, 30:48]
    lines = {layer.name: layer.pixels[inside] for layer in whole.layers}
    assert (lines["Toon Outline"][..., 3] > 0.5).any()
    for layer in part.layers:
        found = layer.pixels if is_cropped else layer.pixels[inside]
        np.testing.assert_array_equal(found, lines[layer.name], err_msg=layer.name)
