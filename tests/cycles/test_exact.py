"""Shadows of what Blender bakes of materials against Cycles, which renders the same nodes."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.planning import Options
from strata.tests.cycles.test_layers import LAYER_RMSE, SIZE, Judge
from strata.tests.support.procedural import card, clear_by, coordinates, floor_scene, noise, stretched


def by_generated(tree):
    return noise(tree)


def by_object(tree):
    return noise(tree, coordinates(tree, "Object"))


def by_position(tree):
    return noise(tree, tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"], 1.5)


def by_groups(tree):
    """The noise two groups deep, its scale from outside."""
    inner = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    inner.interface.new_socket("Scale", in_out="INPUT", socket_type="NodeSocketFloat")
    inner.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketFloat")
    given, end = inner.nodes.new("NodeGroupInput"), inner.nodes.new("NodeGroupOutput")
    texture = inner.nodes.new("ShaderNodeTexNoise")
    texture.inputs["Detail"].default_value = 0.0
    inner.links.new(given.outputs[0], texture.inputs["Scale"])
    inner.links.new(texture.outputs[0], end.inputs[0])
    outer = bpy.data.node_groups.new("Outer", "ShaderNodeTree")
    outer.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketFloat")
    group, end = outer.nodes.new("ShaderNodeGroup"), outer.nodes.new("NodeGroupOutput")
    group.node_tree = inner
    group.inputs[0].default_value = 3.0
    outer.links.new(group.outputs[0], end.inputs[0])
    shown = tree.nodes.new("ShaderNodeGroup")
    shown.node_tree = outer
    return stretched(tree, shown.outputs[0])


def by_image_and_noise(tree):
    """An image by UVs, times a noise."""
    values = np.random.default_rng(3).uniform(0.2, 1.0, (8, 8)).astype(np.float32)
    image = bpy.data.images.new("Grey", 8, 8, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(np.repeat(values[..., None], 4, axis=2).ravel())
    image.update()
    texture, product = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeMath")
    texture.image, product.operation = image, "MULTIPLY"
    tree.links.new(texture.outputs["Color"], product.inputs[0])
    tree.links.new(noise(tree), product.inputs[1])
    return product.outputs[0]


def by_step(tree):
    """Sharp edges: where a noise is above a half."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = "GREATER_THAN"
    tree.links.new(noise(tree), node.inputs[0])
    return node.outputs[0]


def by_where_it_is(tree):
    """Coordinates themselves, some of them negative."""
    split, total = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeMath")
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"], split.inputs[0])
    total.inputs[1].default_value = 0.5
    tree.links.new(split.outputs["X"], total.inputs[0])
    return total.outputs[0]


def by_generated_itself(tree):
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(coordinates(tree, "Generated"), split.inputs[0])
    return split.outputs["X"]


def by_random(tree):
    return tree.nodes.new("ShaderNodeObjectInfo").outputs["Random"]


def shadow_of(scene, read: str) -> np.ndarray:
    options = Options(("soft_shadow",), "cpu", samples=1, probes=0, read=read)
    made = bake(scene, scene.view_layers[0], options, size=SIZE)
    assert [layer.light for layer in made.report.layers] == ["Sun"]
    return made.layers.layers[0].pixels.ravel(), made.report


@pytest.mark.parametrize(
    "make",
    [
        by_generated, by_object, by_position, by_groups, by_image_and_noise, by_step, by_where_it_is,
        by_generated_itself, by_random,
    ],
)  # fmt: skip
def test_shadows_of_what_is_baked_are_what_cycles_renders(make):
    scene = floor_scene()
    card(clear_by("Card", make)).rotation_euler = (0.1, 0.0, 0.2)
    pixels, report = shadow_of(scene, "exact")
    if make is not by_random:  # one number, no texels
        assert report.baked[0].startswith("material 'Card': opacity baked by Blender at 256 texels a side")
    assert not report.warnings
    judge = Judge.of(scene, "Sun")
    where = judge.weight > 0.0
    assert judge.rmse(pixels, where) < LAYER_RMSE
    assert abs(judge.bias(pixels, where)) < 0.25 * LAYER_RMSE
    fast, report = shadow_of(scene, "fast")
    # What is read as opaque is off by half of the card or so: the nodes do matter.
    assert judge.rmse(fast, where) > 4.0 * LAYER_RMSE
    assert any("not read for opacity" in warning for warning in report.warnings)


def test_faces_of_one_mesh_have_the_materials_of_their_slots():
    scene = floor_scene()
    shown = card(bpy.data.materials.new("Opaque"))
    shown.data.materials.append(clear_by("Noise", by_object))
    shown.data.materials.append(None)
    shown.data.materials.append(clear_by("Other", by_step))
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide(number_cuts=1)
    bpy.ops.object.mode_set(mode="OBJECT")
    shown.data.polygons.foreach_set("material_index", [1, 0, 3, 2])
    pixels, report = shadow_of(scene, "exact")
    assert len(report.baked) == 2
    judge = Judge.of(scene, "Sun")
    where = judge.weight > 0.0
    assert judge.rmse(pixels, where) < LAYER_RMSE


def test_a_deformed_mesh_has_the_generated_coordinates_of_its_rest():
    scene = floor_scene()
    shown = card(clear_by("Card", by_generated))
    modifier = shown.modifiers.new("Bend", "SIMPLE_DEFORM")
    modifier.deform_method, modifier.factor = "TAPER", 1.5
    shown.modifiers.new("Smooth", "SUBSURF").render_levels = 3
    pixels, _ = shadow_of(scene, "exact")
    judge = Judge.of(scene, "Sun")
    where = judge.weight > 0.0
    assert judge.rmse(pixels, where) < LAYER_RMSE
