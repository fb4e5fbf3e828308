"""Chains of nodes: long ones, and such as look up a texture by what was calculated."""

from __future__ import annotations

from itertools import pairwise

import bpy
import pytest
from strata.addon.scene.materials import Images, material_of
from strata.tests.support.random_nodes import float_image


@pytest.fixture
def material():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.data.materials.new("Chain")


def alpha_from(material, output):
    """What is read of a material whose alpha is that, and its warnings."""
    material.node_tree.links.new(output, material.node_tree.nodes["Principled BSDF"].inputs["Alpha"])
    return material_of(material, Images())


def test_a_texture_that_is_looked_up_by_one_number(material):
    """A table in an image: the number lies behind the look-up, and tells of no threshold."""
    tree = material.node_tree
    kinds = "UVMap", "SeparateXYZ", "CombineXYZ", "TexImage"
    nodes = [tree.nodes.new(f"ShaderNode{kind}") for kind in kinds]
    for before, after in pairwise(nodes):
        tree.links.new(before.outputs[0], after.inputs[0])
    nodes[-1].image = float_image("Table", 16, 1)
    read, _warnings = alpha_from(material, nodes[-1].outputs["Alpha"])
    assert read.casts[0].threshold == 0.0
    assert not read.casts[0].is_uniform


@pytest.mark.parametrize("count", [90, 400])
def test_a_chain_may_be_as_long_as_it_likes(material, count):
    tree = material.node_tree
    output = tree.nodes.new("ShaderNodeVertexColor").outputs["Alpha"]
    for _ in range(count):
        node = tree.nodes.new("ShaderNodeMath")
        node.operation = "ADD"
        node.inputs[1].default_value = 0.001
        tree.links.new(output, node.inputs[0])
        output = node.outputs[0]
    read, warnings = alpha_from(material, output)
    is_told = any("more than 100 in a chain" in warning for warning in warnings)
    assert is_told == read.unread_opacity == (count > 100)
