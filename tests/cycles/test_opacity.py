"""Shadows of what is partly opaque against Cycles."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.planning import Options
from strata.tests.cycles.test_layers import LAYER_RMSE, SIZE, Judge


def principled(name: str, alpha: float, picture=None) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    shader = tree.nodes["Principled BSDF"]
    shader.inputs["Alpha"].default_value = alpha
    if picture is not None:
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image = picture
        tree.links.new(texture.outputs["Color"], shader.inputs["Alpha"])
    return material


def picture() -> bpy.types.Image:
    """Grey values between 0.2 and 0.8."""
    values = np.random.default_rng(3).uniform(0.2, 0.8, (8, 8)).astype(np.float32)
    made = bpy.data.images.new("Grey", 8, 8, float_buffer=True)
    made.colorspace_settings.name = "Non-Color"
    made.pixels.foreach_set(np.repeat(values[..., None], 4, axis=2).ravel())
    made.update()
    return made


@pytest.fixture
def cards() -> bpy.types.Scene:
    """Two cards over one another in part, one of a half and one of a picture, over a floor; not seen."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=12.0)
    bpy.context.object.data.materials.append(principled("Floor", 1.0))
    for place, material in (
        ((-0.5, 0.0, 1.0), principled("Half", 0.5)),
        ((0.5, 0.3, 1.4), principled("Picture", 1.0, picture())),
    ):
        bpy.ops.mesh.primitive_plane_add(size=2.0, location=place)
        bpy.context.object.data.materials.append(material)
        bpy.context.object.visible_camera = False
    bpy.ops.object.camera_add(location=(0.0, 0.0, 8.0))
    scene.camera = bpy.context.object
    return scene


@pytest.mark.parametrize("kind", ["SUN", "AREA", "POINT"])
def test_the_shadow_of_cards_is_what_cycles_renders(cards, kind):
    bpy.ops.object.light_add(type=kind, location=(0.3, -0.2, 4.0))
    lamp = bpy.context.object
    lamp.data.energy = 3.0 if kind == "SUN" else 300.0
    if kind == "AREA":
        lamp.data.size = 0.8
    elif kind == "POINT":
        lamp.data.shadow_soft_size = 0.2
    options = Options(("soft_shadow",), "cpu", samples=1, probes=0)
    (layer,) = bake(cards, cards.view_layers[0], options, size=SIZE).layers.layers
    judge = Judge.of(cards, lamp.name)
    where = judge.weight > 0.0
    assert np.histogram(layer.pixels, (0.05, 0.4, 0.6, 0.9, 1.1))[0].min() > 100  # of all there is
    assert judge.rmse(layer.pixels.ravel(), where) < LAYER_RMSE
    assert abs(judge.bias(layer.pixels.ravel(), where)) < 0.25 * LAYER_RMSE


@pytest.mark.parametrize("stops_back", [False, True])
def test_cards_of_one_side_cast_what_cycles_renders(cards, stops_back):
    """By Backfacing: rays from the floor to the lamp meet the backs of cards that face it."""
    for name in ("Half", "Picture"):
        tree = bpy.data.materials[name].node_tree
        shader, output = tree.nodes["Principled BSDF"], tree.nodes["Material Output"]
        geometry, mix = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeMixShader")
        tree.links.new(geometry.outputs["Backfacing"], mix.inputs[0])
        clear = tree.nodes.new("ShaderNodeBsdfTransparent")
        tree.links.new(clear.outputs[0], mix.inputs[1 if stops_back else 2])
        tree.links.new(shader.outputs[0], mix.inputs[2 if stops_back else 1])
        tree.links.new(mix.outputs[0], output.inputs["Surface"])
        for link in list(shader.inputs["Alpha"].links):
            tree.links.remove(link)
        shader.inputs["Alpha"].default_value = 1.0
    bpy.ops.object.light_add(type="SUN", location=(0.3, -0.2, 4.0))
    lamp = bpy.context.object
    options = Options(("soft_shadow",), "cpu", samples=1, probes=0)
    made = bake(cards, cards.view_layers[0], options, size=SIZE).layers.layers
    # A lamp that nothing hides has no layer.
    pixels = made[0].pixels.ravel() if made else np.ones(SIZE[0] * SIZE[1], np.float32)
    judge = Judge.of(cards, lamp.name)
    where = judge.weight > 0.0
    assert ((pixels[where] < 0.5).mean() > 0.05) == stops_back
    assert judge.rmse(pixels, where) < LAYER_RMSE
