"""What textures take is known before they are read."""

from __future__ import annotations

import bpy
import pytest
from strata.addon.core.material import Image
from strata.addon.effects.shared.steps import GEOMETRY, TRIANGLE_BYTES
from strata.addon.scene.extract import BASE_COLOR, OPACITY, WANTS, extract, texel_bytes
from strata.addon.scene.render_depsgraph import with_render_depsgraph
from strata.addon.scene.scan import scan

WIDTH, HEIGHT = 24, 10


@pytest.fixture
def leaf():
    """The nodes of a card's material, an image's among them, and what links two sockets."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    bpy.ops.mesh.primitive_plane_add()
    material = bpy.data.materials.new("Leaf")
    bpy.context.object.data.materials.append(material)
    tree = material.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.new("Leaf", WIDTH, HEIGHT, alpha=True)

    def link(socket, other):
        tree.links.new(socket, other)

    return tree.nodes["Principled BSDF"], texture, tree.nodes, link


def read(wants=WANTS):
    scene = bpy.context.scene

    def look(depsgraph):
        scanned = scan(depsgraph)
        return scanned.outline, extract(scanned, wants)

    return with_render_depsgraph(scene, scene.view_layers[0], look)


def test_sizes_are_those_of_the_texels(leaf):
    """Of an image as it is, and of one that a node changes and that lies twice in the unit square."""
    shader, texture, nodes, link = leaf
    link(texture.outputs["Color"], shader.inputs["Base Color"])
    other, mapping, uv = (
        nodes.new("ShaderNodeTexImage"),
        nodes.new("ShaderNodeMapping"),
        nodes.new("ShaderNodeUVMap"),
    )
    other.image = texture.image
    mapping.inputs["Scale"].default_value[0] = 2.0
    half = nodes.new("ShaderNodeMath")
    half.operation, half.inputs[1].default_value = "MULTIPLY", 0.5
    link(uv.outputs["UV"], mapping.inputs["Vector"])
    link(mapping.outputs["Vector"], other.inputs["Vector"])
    link(other.outputs["Alpha"], half.inputs[0])
    link(half.outputs[0], shader.inputs["Alpha"])
    outline, arrays = read()
    assert {image.size for image in outline.images} == {(WIDTH, HEIGHT), (2 * WIDTH, HEIGHT)}
    for index, texels in arrays.textures.items():
        width, height = outline.images[index].size
        assert texels.shape[:2] == (height, width)
        assert outline.images[index].nbytes == texels.nbytes
    assert len(arrays.textures) == 2


@pytest.mark.parametrize("interpolation", ["Linear", "Closest"])
@pytest.mark.parametrize("wants", [{OPACITY}, {BASE_COLOR}, {OPACITY, BASE_COLOR}, set()])
def test_bytes_are_those_of_what_is_wanted(leaf, interpolation, wants):
    shader, texture, _nodes, link = leaf
    texture.interpolation = interpolation
    link(texture.outputs["Color"], shader.inputs["Base Color"])
    link(texture.outputs["Alpha"], shader.inputs["Alpha"])
    outline, arrays = read(wants)
    assert texel_bytes(outline, wants) == sum(texels.nbytes for texels in arrays.textures.values())
    assert bool(wants) == bool(arrays.textures)


def test_a_geometry_has_the_texels_of_its_opacities(leaf):
    shader, texture, _nodes, link = leaf
    link(texture.outputs["Color"], shader.inputs["Base Color"])
    link(texture.outputs["Alpha"], shader.inputs["Alpha"])
    outline, _ = read()
    assert GEOMETRY.bytes_of(None, outline) == 2 * TRIANGLE_BYTES + 4 * WIDTH * HEIGHT


def test_a_colour_has_four_channels():
    assert Image("", "", "VALUE", size=(3, 5)).nbytes == 60
    assert Image("", "", "COLOR", size=(3, 5)).nbytes == 240
