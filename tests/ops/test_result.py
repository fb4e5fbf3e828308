"""What can be done after a bake: its image shown, its lamps selected, and who uses its file shows it anew."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import strata
from strata.addon.layers.images import image_of
from strata.addon.scene.open import open_blend
from strata.addon.ui.state import STATE
from strata.tests.support.places import SAMPLES

LAYER = "Soft Shadow Panel"


@pytest.fixture
def scene(tmp_path):
    strata.register()
    open_blend(SAMPLES / "stacked.blend")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 32, 18
    settings = scene.strata
    settings.backend, settings.samples, settings.probes = "cpu", 1, 0
    settings.soft_shadow.resolution, settings.soft_shadow.layers = 64, 1
    yield scene
    strata.unregister()


@pytest.fixture
def editor(scene):
    """An open Image Editor."""
    area = bpy.context.window_manager.windows[0].screen.areas[0]
    before, area.ui_type = area.ui_type, "IMAGE_EDITOR"
    yield area.spaces.active
    area.ui_type = before


def in_window(operator, **values):
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        return operator(**values)


def node_of(image):
    """A compositor's node that loads an image: it has an output for each layer."""
    tree = bpy.data.node_groups.new("test", "CompositorNodeTree")
    node = tree.nodes.new("CompositorNodeImage")
    node.image = image
    return node


def test_a_row_selects_its_lamp_and_shows_its_image(scene, editor):
    bpy.ops.strata.bake()
    ball = scene.objects["Ball 0"]
    bpy.context.view_layer.objects.active = ball
    ball.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    assert in_window(bpy.ops.strata.show_layer, layer=LAYER, light="Panel") == {"FINISHED"}
    assert bpy.context.view_layer.objects.active == scene.objects["Panel"]
    assert [thing.name for thing in bpy.context.selected_objects] == ["Panel"]
    assert ball.mode == bpy.context.mode == "OBJECT"
    assert editor.image == image_of(scene.name, "ViewLayer", LAYER)
    # A render's layers have no images, nor those of a bake to a file only.
    scene.strata.save_to = "FILE"
    bpy.ops.strata.bake()
    editor.image = None
    assert in_window(bpy.ops.strata.show_layer, layer=LAYER, light="Panel") == {"FINISHED"}
    assert editor.image is None
    assert in_window(bpy.ops.strata.show_layer, layer="Transmittance") == {"FINISHED"}
    assert in_window(bpy.ops.strata.show_layer, layer="x", light="Gone") == {"FINISHED"}


def test_the_baked_file_is_shown_and_whoever_shows_it_sees_the_next(scene, editor, tmp_path):
    assert not bpy.ops.strata.show_baked.poll()
    scene.strata.save_to, scene.strata.output = "FILE", "//a_##.exr"
    bpy.ops.strata.bake()
    path = tmp_path / f"a_{scene.frame_current:02d}.exr"
    in_window(bpy.ops.strata.show_baked)
    assert bpy.path.abspath(editor.image.filepath) == str(path)
    shown = editor.image
    nodes = [node_of(shown), node_of(bpy.data.images.load(str(path)))]
    nodes[1].image.source = "SEQUENCE"
    other = node_of(bpy.data.images.load(str(path)))
    other.image.pack()
    scene.strata.toon.enabled = True
    bpy.ops.strata.bake()
    for node in nodes:
        assert {LAYER, "Toon"} <= set(node.outputs.keys())
    assert "Toon" not in other.outputs
    in_window(bpy.ops.strata.show_baked)
    assert editor.image == shown
    scene.strata.save_to = "IMAGES"
    bpy.ops.strata.bake()
    in_window(bpy.ops.strata.show_baked)
    assert editor.image.get("strata")
    assert STATE.made[scene.session_uid].file is None


def test_a_render_takes_away_what_a_bake_left(scene):
    scene.strata.save_to = "IMAGES"
    bpy.ops.strata.bake()
    assert STATE.made[scene.session_uid].has_images
    values = np.empty(32 * 18 * 4, np.float32)
    image_of(scene.name, "ViewLayer", LAYER).pixels.foreach_get(values)
    assert values.reshape(-1, 4)[:, 0].std() > 0.1
    scene.render.engine = "STRATA"
    bpy.ops.render.render()
    assert scene.session_uid not in STATE.made
    assert not bpy.ops.strata.show_baked.poll()
