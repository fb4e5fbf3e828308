"""Layers as Blender's images."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from strata.addon.core.layers import Layer, LayerSet
from strata.addon.layers.images import fill_images, image_of, packed
from strata.tests.layers.made_layers import HEIGHT, WIDTH, layer, pixels


@pytest.fixture
def scene():
    bpy.ops.wm.read_homefile(use_empty=True)
    return bpy.context.scene


def filled(scene, *layers: Layer, view_layer: str = "ViewLayer") -> list:
    height, width = layers[0].pixels.shape[:2]
    made = LayerSet(layers, width, height, view_layer)
    return fill_images(scene.name, made, packed(made))


def rgba(image) -> np.ndarray:
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(image.size[1], image.size[0], 4)


def test_images_are_exact_and_nobody_elses(scene):
    users = bpy.data.images.new("Soft Shadow Key", 1, 1)
    data, colour, vector = (
        layer("Soft Shadow Key"),
        layer("Glow", "RGBA", seed=2),
        layer("Place", "XYZ", seed=3),
    )
    made = filled(scene, data, colour, vector)
    assert users not in made
    assert users.size[:] == (1, 1)
    assert [image.name for image in made] == ["Soft Shadow Key.001", "Glow", "Place"]
    assert [image.is_float for image in made] == [True, True, True]
    assert [i.colorspace_settings.name for i in made] == ["Non-Color", "Linear Rec.709", "Non-Color"]
    np.testing.assert_array_equal(rgba(made[0]), np.dstack([*[data.pixels] * 3, np.ones_like(data.pixels)]))
    np.testing.assert_array_equal(rgba(made[1]), colour.pixels)
    np.testing.assert_array_equal(rgba(made[2])[:, :, :3], vector.pixels)


def test_a_later_bake_fills_the_same_images(scene):
    first = filled(scene, layer("Key"), layer("Glow", "RGBA"))
    texture = bpy.data.textures.new("user", "IMAGE")
    texture.image = first[0]
    assert rgba(first[0]).shape == (HEIGHT, WIDTH, 4)
    wide = np.full((3, 9, 4), 0.25, np.float32)
    again = filled(scene, Layer("Key", "RGBA", wide, "x"))
    assert again == first[:1]
    np.testing.assert_array_equal(rgba(texture.image), wide)
    assert texture.image.colorspace_settings.name == "Linear Rec.709"
    grey = filled(scene, layer("Key", seed=5))
    assert grey == again
    np.testing.assert_array_equal(rgba(grey[0])[:, :, 0], layer("Key", seed=5).pixels)
    assert grey[0].colorspace_settings.name == "Non-Color"
    assert sorted(image.name for image in bpy.data.images) == ["Glow", "Key"]


def test_a_scene_and_a_view_layer_have_images_of_their_own(scene):
    (first,) = filled(scene, layer("Key"))
    (of_layer,) = filled(scene, layer("Key"), view_layer=scene.view_layers.new("Back").name)
    (of_scene,) = filled(bpy.data.scenes.new("Night"), layer("Key"))
    assert len({first, of_layer, of_scene}) == 3
    assert filled(scene, layer("Key")) == [first]
    assert image_of(scene.name, "Back", "Key") == of_layer
    copy = first.copy()  # to keep: it has the mark too
    assert image_of(scene.name, "ViewLayer", "Key") == first != copy
    scene.name = "Renamed"
    assert filled(scene, layer("Key")) == [first]


def test_images_are_saved_with_the_file_and_undone_with_the_rest(scene, tmp_path):
    bpy.ops.ed.undo_push(message="before")
    for seed in (0, 1):
        (image,) = filled(scene, layer("Key", seed=seed))
        assert not image.is_dirty
        bpy.ops.ed.undo_push(message="baked")
    np.testing.assert_array_equal(rgba(image)[:, :, 0], pixels("V", 1))
    bpy.ops.ed.undo()
    np.testing.assert_array_equal(rgba(bpy.data.images["Key"])[:, :, 0], pixels("V", 0))
    bpy.ops.ed.undo()
    assert "Key" not in bpy.data.images
    bpy.ops.ed.redo()
    bpy.ops.ed.redo()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    np.testing.assert_array_equal(rgba(bpy.data.images["Key"])[:, :, 0], pixels("V", 1))
