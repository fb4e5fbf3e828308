"""Blender's startup file, as it is there before anything was saved."""

from __future__ import annotations

import bpy
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.ui import properties
from strata.addon.ui.output import output_of, waits_for_saving
from strata.ops import bake
from strata.tests.support.exr_layers import read_layers


@pytest.fixture
def scene():
    bpy.ops.wm.read_factory_settings()
    properties.register()
    bake.register()
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 64, 36
    scene.strata.samples = 1
    yield scene
    bake.unregister()
    properties.unregister()


def float_images() -> list[str]:
    """The startup file's own is the compositor's viewer."""
    return [image.name for image in bpy.data.images if image.is_float and image.type != "COMPOSITING"]


def test_a_file_that_was_never_saved_bakes_to_images(scene):
    assert waits_for_saving(scene)
    assert bpy.ops.strata.bake() == {"FINISHED"}
    assert float_images() == ["Soft Shadow Light"]


def test_once_saved_the_layers_go_to_a_file_too(scene, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert not waits_for_saving(scene)
    assert bpy.ops.strata.bake() == {"FINISHED"}
    (file,) = tmp_path.glob("*.exr")
    assert [layer.name for layer in read_layers(file).layers] == ["Soft Shadow Light"]
    assert float_images() == ["Soft Shadow Light"]


def test_who_wants_a_file_only_is_told_to_save_first(scene):
    scene.strata.save_to = "FILE"
    assert not waits_for_saving(scene)
    with pytest.raises(StrataError, match="never saved"):
        output_of(scene, bpy.context.view_layer)


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT"])
def test_a_bake_from_within_a_mode_is_that_of_object_mode(scene, mode):
    scene.strata.probes = 0
    cube = bpy.context.object
    bpy.ops.mesh.primitive_plane_add(size=20.0, location=(0.0, 0.0, -1.0))
    bpy.context.view_layer.objects.active = cube
    assert bpy.ops.strata.bake() == {"FINISHED"}
    (name,) = float_images()
    first = bpy.data.images[name].pixels[:]
    assert min(first) < 0.5  # there is a shadow
    bpy.ops.object.mode_set(mode=mode)
    assert bpy.ops.strata.bake() == {"FINISHED"}
    (name,) = float_images()
    assert bpy.data.images[name].pixels[:] == first
    assert bpy.context.object.mode == mode
