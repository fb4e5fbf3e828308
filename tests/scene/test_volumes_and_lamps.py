"""Volumes and lamps whose nodes compute: what is constant in the end is read."""

from __future__ import annotations

import bpy
import mathutils
import numpy as np
import pytest
from strata.addon.scene.lights import light_of
from strata.addon.scene.volumes import volume_of


@pytest.fixture(autouse=True)
def empty():
    bpy.ops.wm.read_factory_settings(use_empty=True)


def linked(tree, kind, *inputs, **properties):
    """A node's first output; its inputs, by order, from outputs, or constants; None leaves one."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    for name, value in properties.items():
        setattr(node, name, value)
    for socket, given in zip(node.inputs, inputs, strict=False):
        if isinstance(given, bpy.types.NodeSocket):
            tree.links.new(given, socket)
        elif given is not None:
            socket.default_value = given
    return node.outputs[0]


def volume_tree():
    tree = bpy.data.materials.new("Fog").node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    return tree


def medium_of(tree, volume):
    tree.links.new(volume, tree.nodes["Material Output"].inputs["Volume"])
    return volume_of(tree, "fog")


def test_inputs_of_volumes_may_be_computed():
    tree = volume_tree()
    density = linked(tree, "Math", 0.25, 0.5, operation="ADD")
    colour = linked(tree, "Invert", 1.0, (0.25, 0.5, 1.0, 1.0))
    medium, warnings = medium_of(tree, linked(tree, "VolumeScatter", colour, density, 0.25))
    assert not warnings
    np.testing.assert_allclose(medium.scattering, [0.5625, 0.375, 0.0])
    assert medium.anisotropy == 0.25


def test_mixes_of_volumes_in_a_group():
    """A quarter of scattering 2 per metre, and three quarters of absorption 4 per metre."""
    group = bpy.data.node_groups.new("Fog", "ShaderNodeTree")
    group.interface.new_socket("Volume", in_out="OUTPUT", socket_type="NodeSocketShader")
    scatter = linked(group, "VolumeScatter", (1.0, 1.0, 1.0, 1.0), 2.0)
    absorption = linked(group, "VolumeAbsorption", (0.0, 0.0, 0.0, 1.0), 4.0)
    end = group.nodes.new("NodeGroupOutput")
    group.links.new(linked(group, "MixShader", 0.75, scatter, absorption), end.inputs[0])
    tree = volume_tree()
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    medium, warnings = medium_of(tree, node.outputs[0])
    assert not warnings
    np.testing.assert_allclose(medium.scattering, [0.5] * 3)
    np.testing.assert_allclose(medium.absorption, [3.0] * 3)


def test_volumes_that_vary_are_told():
    tree = volume_tree()
    noise = linked(tree, "TexNoise")
    medium, warnings = medium_of(tree, linked(tree, "VolumeScatter", None, noise))
    assert medium is None
    assert warnings == ["fog: its volume is not read (its density: node 'Noise Texture' is not read)"]


def intensity(light):
    read, warnings = light_of(light, mathutils.Matrix(), "Lamp", "Lamp")
    return np.array(read.intensity), warnings


def lamp():
    light = bpy.data.lights.new("Lamp", "POINT")
    if light.node_tree is None:
        light.use_nodes = True
    return light, light.node_tree


def test_lamps_emit_what_their_nodes_compute():
    light, tree = lamp()
    before, _ = intensity(light)
    emission = tree.nodes["Emission"]
    emission.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(linked(tree, "Math", 3.0, 0.5, operation="MULTIPLY"), emission.inputs["Strength"])
    tree.links.new(linked(tree, "Blackbody", 3000.0), emission.inputs["Color"])
    found, warnings = intensity(light)
    assert not warnings
    # Cycles' own terms from 1902 K on.
    red = 4.67028036e3 / 3000.0 + 2.91258199e-5 * 3000.0 + 0.126703442
    assert found[0] / before[0] == pytest.approx(1.5 * red, rel=1e-6)
    assert found[0] > found[1] > found[2] > 0.0


def test_lamps_that_are_not_read_shine_evenly():
    light, tree = lamp()
    before, _ = intensity(light)
    emission = tree.nodes["Emission"]
    tree.links.new(linked(tree, "TexNoise"), emission.inputs["Strength"])
    found, warnings = intensity(light)
    np.testing.assert_allclose(found, before)
    assert warnings == [
        "light 'Lamp': node 'Noise Texture' is not read for emission: the light shines evenly"
    ]
    tree.links.new(linked(tree, "LightFalloff", 8.0), emission.inputs["Strength"])
    found, warnings = intensity(light)
    np.testing.assert_allclose(found, 8.0 * before)
    assert not warnings
    tree.links.remove(next(iter(tree.get_output_node("CYCLES").inputs["Surface"].links)))
    found, _ = intensity(light)
    assert (found == 0.0).all()
