"""What Blender bakes of materials: by what it is known again, and when it is not to be used."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest
from strata.addon.bake import read_scene
from strata.addon.planning import Options
from strata.addon.scene.exact import reading
from strata.addon.scene.exact.rounds import MOST_ROUNDS
from strata.addon.scene.exact.store import Store
from strata.addon.scene.exact.upstream import upstream_of
from strata.addon.scene.nodes.graph import Graph
from strata.tests.support.procedural import card, clear_by, floor_scene, noise

OPTIONS = Options(("soft_shadow",), "cpu", samples=1, probes=0, read="exact")


@pytest.fixture(autouse=True)
def store(monkeypatch):
    """One of its own, in memory."""
    made = Store(None)
    monkeypatch.setattr(reading, "STORE", made)
    return made


def read(scene, **changed):
    return read_scene(scene, scene.view_layers[0], replace(OPTIONS, **changed), size=(32, 18))


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


# When it is not to be used


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
