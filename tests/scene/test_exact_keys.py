"""What Blender bakes of materials: by what it is known again, and when it is not to be used."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest
from strata.addon.bake import read_depsgraph
from strata.addon.scene.exact import reading
from strata.addon.scene.exact.leaves import Appearance, BakedLeaves
from strata.addon.scene.exact.rounds import MOST_ROUNDS
from strata.addon.scene.exact.upstream import upstream_of
from strata.addon.scene.nodes.graph import Graph
from strata.addon.scene.nodes.values import FLOAT, unread
from strata.addon.scene.render_depsgraph import with_render_depsgraph
from strata.tests.support.exact_reading import OPTIONS, read, with_own_store
from strata.tests.support.procedural import card, clear_by, floor_scene, noise
from strata.tests.support.random_nodes import float_image


@pytest.fixture(autouse=True)
def store(monkeypatch):
    return with_own_store(monkeypatch)


def shown_by(outline, name: str):
    """The material that an object's first slot shows."""
    (instance,) = (each for each in outline.instances if each.name == name)
    return outline.materials[instance.materials[0]]


# Keys


def _output_value(value):
    return lambda node: setattr(node.outputs[0], "default_value", value)


def _set_ramp(node):
    node.color_ramp.elements[0].color = (0.5, 0.2, 0.1, 1.0)


def _set_curve(node):
    node.mapping.curves[0].points[0].location = (0.0, 0.5)


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("ShaderNodeValue", _output_value(0.7)),
        ("ShaderNodeRGB", _output_value((0.1, 0.2, 0.3, 1.0))),
        ("ShaderNodeNormal", _output_value((0.6, 0.0, 0.8))),
        ("ShaderNodeValToRGB", _set_ramp),
        ("ShaderNodeFloatCurve", _set_curve),
        ("ShaderNodeRGBCurve", _set_curve),
    ],
)
def test_a_digest_changes_with_the_numbers_that_nodes_hold(kind, change):
    floor_scene()
    tree = bpy.data.materials.new("Card").node_tree
    texture, node = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new(kind)
    tree.links.new(node.outputs[0], texture.inputs["Scale"])

    def digest():
        return upstream_of(Graph(), texture, texture.outputs[0], ()).digest

    before = digest()
    assert digest() == before
    node.location, node.color, node.select = (5.0, 5.0), (0.1, 0.2, 0.3), True
    assert digest() == before
    change(node)
    assert digest() != before


def test_objects_of_one_mesh_have_their_own_constants():
    """What is baked is the same all over each of them, and no texture of theirs tells them apart."""
    scene = floor_scene()
    material = bpy.data.materials.new("Card")
    tree = material.node_tree
    information = tree.nodes.new("ShaderNodeObjectInfo")
    tree.links.new(information.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    first = card(material)
    second = first.copy()
    scene.collection.objects.link(second)
    first.name, second.name = "First", "Second"
    first.color, second.color = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
    second.location.x = 4.0
    outline, *_ = read(scene, composite=True)
    assert not outline.warnings
    np.testing.assert_allclose(shown_by(outline, "First").base_color, (1.0, 0.0, 0.0), atol=1e-6)
    np.testing.assert_allclose(shown_by(outline, "Second").base_color, (0.0, 0.0, 1.0), atol=1e-6)


def test_a_materials_own_index_counts():
    scene = floor_scene()

    def by_index(tree):
        node = tree.nodes.new("ShaderNodeMath")
        node.operation, node.inputs[1].default_value = "MULTIPLY", 0.25
        tree.links.new(tree.nodes.new("ShaderNodeObjectInfo").outputs["Material Index"], node.inputs[0])
        return node.outputs[0]

    material = clear_by("Card", by_index)
    name = card(material).name
    for index in (1, 2):
        material.pass_index = index
        outline, *_ = read(scene)
        assert [each.value for each in shown_by(outline, name).opacities] == [0.25 * index]


def test_a_script_is_baked_anew_where_cycles_starts_to_run_it():
    floor_scene()
    tree = bpy.data.materials.new("Card").node_tree
    script, texture = tree.nodes.new("ShaderNodeScript"), tree.nodes.new("ShaderNodeTexNoise")
    output = script.outputs.new("NodeSocketFloat", "Out")
    appearance = Appearance(tuple(map(tuple, np.eye(4))), (1.0,) * 4, 0, 0.5)

    def keys(node, socket):
        for uses_osl in (False, True):
            leaves = BakedLeaves(
                "mesh", (0,), 128, appearance, lambda _key: None, {}, True, 0, uses_osl
            )  # fmt: skip
            leaves.value(Graph(), node, socket, (), unread(FLOAT, "it"))
            yield from leaves.found

    assert len(set(keys(script, output))) == 2
    assert len(set(keys(texture, texture.outputs[0]))) == 1


def test_wires_are_as_wide_on_objects_of_any_size():
    """So what is baked of objects that share a mesh differs with their size."""
    scene = floor_scene()

    def by_wires(tree):
        node = tree.nodes.new("ShaderNodeWireframe")
        node.inputs["Size"].default_value = 0.2
        return node.outputs[0]

    material = clear_by("Card", by_wires)
    first = card(material)
    second = first.copy()
    scene.collection.objects.link(second)
    second.location.z, second.scale = 2.0, (2.0, 2.0, 2.0)
    outline, *_ = read(scene)
    assert "of 2 meshes" in outline.baked[0]
    material.node_tree.nodes["Wireframe"].use_pixel_size = True
    outline, *_ = read(scene)
    (warning,) = outline.warnings
    assert warning == "material 'Card': node 'Wireframe' is not read for opacity, it counts as opaque"


# When it is not to be used


def layer_weight(tree):
    return tree.nodes.new("ShaderNodeLayerWeight").outputs["Facing"]


@pytest.mark.parametrize("has_noise", [False, True])
def test_a_strength_that_cannot_be_baked_keeps_its_own_number(has_noise):
    scene = floor_scene()
    material = bpy.data.materials.new("Card")
    tree = material.node_tree
    shader = tree.nodes["Principled BSDF"]
    shader.inputs["Emission Color"].default_value = (1.0, 0.5, 0.0, 1.0)
    shader.inputs["Emission Strength"].default_value = 2.0
    tree.links.new(layer_weight(tree), shader.inputs["Emission Strength"])
    if has_noise:
        tree.links.new(noise(tree), shader.inputs["Base Color"])
    name = card(material).name
    outline, *_ = read(scene, composite=True)
    fast, *_ = read(scene, composite=True, read="fast")
    assert bool(outline.baked) == has_noise
    for each in (outline, fast):
        assert shown_by(each, name).emission == (2.0, 1.0, 0.0)
        assert "material 'Card': node 'Layer Weight' is not read for emission" in each.warnings
    if not has_noise:
        assert outline.warnings == fast.warnings


def test_a_picture_stays_as_fine_where_opacity_cannot_be_baked():
    scene = floor_scene()
    material = bpy.data.materials.new("Card")
    tree = material.node_tree
    shader, mix = tree.nodes["Principled BSDF"], tree.nodes.new("ShaderNodeMixShader")
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Fine", 1024, 1)
    tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(layer_weight(tree), mix.inputs[0])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
    tree.links.new(shader.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    name = card(material).name
    outline, *_ = read(scene, composite=True)
    fast, *_ = read(scene, composite=True, read="fast")
    assert not outline.baked
    assert outline.warnings == fast.warnings
    assert outline.images[shown_by(outline, name).base_color_image].size == (1024, 1024)


def test_a_mesh_that_is_another_one_in_the_viewport_is_told_of():
    """A bake does not help a preview there."""
    scene = floor_scene()
    shown = card(clear_by("Card", noise))
    modifier = shown.modifiers.new("Subdivision", "SUBSURF")
    modifier.subdivision_type, modifier.levels, modifier.render_levels = "SIMPLE", 1, 2
    outline, *_ = read(scene)
    assert outline.baked
    exact = reading.Exact(can_bake=False)

    def warnings():
        depsgraph = bpy.context.evaluated_depsgraph_get()
        return read_depsgraph(depsgraph, OPTIONS, size=(32, 18), exact=exact)[0].warnings

    (warning,) = warnings()
    assert "node 'Noise Texture' (not baked yet on this mesh) is not read for opacity" in warning
    modifier.levels = 2
    assert not warnings()


def test_of_what_stays_as_it_was_only_that_is_told():
    """A base colour that is read, beside an opacity that is not baked yet."""
    scene = floor_scene()
    material = clear_by("Card", noise)
    tree = material.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Image", 8, 1)
    tree.links.new(texture.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    name = card(material).name
    exact = reading.Exact(can_bake=False)

    def look(depsgraph):
        return read_depsgraph(depsgraph, replace(OPTIONS, composite=True), size=(32, 18), exact=exact)

    outline, *_ = with_render_depsgraph(scene, scene.view_layers[0], look)
    assert shown_by(outline, name).base_color_image is not None
    (warning,) = outline.warnings
    assert warning.startswith("material 'Card': node 'Noise Texture' (not baked yet")
    assert warning.endswith("is not read for opacity, it counts as opaque")


def test_a_scene_that_is_never_the_same_is_read_in_the_end():
    """A handler of somebody's changes it before each render."""
    scene = floor_scene()
    material = clear_by("Card", noise)
    card(material)
    scale = material.node_tree.nodes["Noise Texture"].inputs["Scale"]
    rounds = []

    def changes(*_):
        rounds.append(1)
        if len(rounds) <= 2 * MOST_ROUNDS:  # so that the test ends
            scale.default_value = 1.0 + len(rounds)

    bpy.app.handlers.render_init.append(changes)
    try:
        outline, *_ = read(scene)
    finally:
        bpy.app.handlers.render_init.remove(changes)
    assert len(rounds) == MOST_ROUNDS + 1
    (warning,) = outline.warnings
    assert "node 'Noise Texture' (not baked yet" in warning
    assert warning.endswith("is not read for opacity, it counts as opaque")
