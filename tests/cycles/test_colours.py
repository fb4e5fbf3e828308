"""Colours against Cycles: a card under a sun that stands above it is as bright as its base colour."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.planning import Options
from strata.addon.scene.materials import Images, material_of
from strata.addon.scene.nodes.pictures import sample
from strata.addon.scene.pixels import pixels_of
from strata.tests.support.cycles_card import card_scene, diffuse_colour, rendered
from strata.tests.support.random_nodes import float_image

SIZE = (32, 32)
CELLS = 4


@pytest.fixture
def card() -> bpy.types.Object:
    """Of triangles, whose corners and points carry random colours; half of it in the shadow of a sheet that
    only lamps see."""
    card = card_scene(SIZE)
    scene, rng = bpy.context.scene, np.random.default_rng(5)
    x, y = np.meshgrid(*[np.linspace(0.0, 1.0, CELLS + 1)] * 2)
    points = np.stack([x, y, 0.0 * x], axis=-1).reshape(-1, 3)
    row, column = np.divmod(np.arange(CELLS * CELLS), CELLS)
    a = row * (CELLS + 1) + column
    faces = np.concatenate([[a, a + 1, a + CELLS + 2], [a, a + CELLS + 2, a + CELLS + 1]], axis=1).T
    mesh = bpy.data.meshes.new("Cells")
    mesh.from_pydata(points.tolist(), [], faces.tolist())
    uvs = points[[loop.vertex_index for loop in mesh.loops], :2]
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs.astype(np.float32).ravel())
    for name, kind, domain in (("Bytes", "BYTE_COLOR", "CORNER"), ("Floats", "FLOAT_COLOR", "POINT")):
        data = mesh.attributes.new(name, kind, domain).data
        colours = rng.random((len(data), 4)).astype(np.float32)
        colours[:, 3] = 0.8 + 0.2 * colours[:, 3]
        data.foreach_set("color", colours.ravel())
    card.data = mesh
    mesh.materials.append(bpy.data.materials.new("Card"))
    sheet = bpy.data.meshes.new("Sheet")
    sheet.from_pydata([(0.3, -1, 0.5), (2, -1, 0.5), (2, 2, 0.5), (0.3, 2, 0.5)], [], [(0, 1, 2, 3)])
    above = bpy.data.objects.new("Sheet", sheet)
    above.visible_camera = above.visible_diffuse = False
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle = math.pi, 0.0
    for thing in (above, bpy.data.objects.new("Sun", sun)):
        scene.collection.objects.link(thing)
    scene.cycles.max_bounces = 0
    # No middle of a pixel lies where two triangles meet, whose corners may be of different colours.
    scene.camera.location.x += 0.004
    return card


def attribute(tree, name: str, output: str = "Color"):
    node = tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = name
    return node.outputs[output]


def multiplied(tree, share: float, *colours):
    node = tree.nodes.new("ShaderNodeMixRGB")
    node.blend_type, node.inputs[0].default_value = "MULTIPLY", share
    for socket, colour in zip(node.inputs[1:], colours, strict=True):
        tree.links.new(colour, socket)
    return node.outputs[0]


def textured(tree, name: str, seed: int, size: int = 8):
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = float_image(name, size, seed)
    return node.outputs["Color"]


def painted(tree):
    return attribute(tree, "Bytes")


def of_points(tree):
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = "Floats"
    return node.outputs["Color"]


def times_a_texture(tree):
    return multiplied(tree, 1.0, textured(tree, "Leaf", 1), attribute(tree, "Floats"))


def partly_times_two(tree):
    """By an alpha, and of another attribute."""
    once = multiplied(tree, 0.6, attribute(tree, "Bytes"), attribute(tree, "Floats", "Alpha"))
    return multiplied(tree, 1.0, once, textured(tree, "Leaf", 2))


def shown(scene) -> np.ndarray:
    """(H, W, 3) what Strata's composite has of it."""
    options = Options(("soft_shadow",), "cpu", samples=1, probes=0, composite=True)
    baked = bake(scene, scene.view_layers[0], options, size=SIZE)
    assert not [warning for warning in baked.report.warnings if "not read" in warning]
    return baked.composite[..., :3]


@pytest.mark.parametrize("colour", [painted, of_points, times_a_texture, partly_times_two])
def test_colours_of_attributes_are_cycles_own(card, colour, tmp_path):
    tree = card.data.materials[0].node_tree
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(colour(tree), diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    found, expected = shown(bpy.context.scene), rendered(tmp_path)[..., :3]
    assert (expected[:, SIZE[0] // 2 :] == 0.0).all()  # in the shadow
    assert expected[:, : SIZE[0] // 4].std() > 0.1
    # A product of interpolated values is not their interpolated product: between corners it is off by up to a
    # quarter of how far the two factors go, 1 and 0.6 times 0.2.
    most = 0.03 if colour is partly_times_two else 2e-3
    assert np.abs(found - expected).max() < most


@pytest.mark.parametrize("colour", [painted, times_a_texture, lambda tree: textured(tree, "Glow", 3)])
def test_emission_is_cycles_own(card, colour, tmp_path):
    tree = card.data.materials[0].node_tree
    glow = tree.nodes.new("ShaderNodeEmission")
    glow.inputs["Strength"].default_value = 3.0
    tree.links.new(colour(tree), glow.inputs["Color"])
    tree.links.new(glow.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    found, expected = shown(bpy.context.scene), rendered(tmp_path)[..., :3]
    assert expected.std() > 0.3
    assert np.abs(found - expected).max() < 6e-3


def test_diffuse_colours_of_metallic_textures_are_cycles_own(card, tmp_path):
    """As in glTF: roughness and metallic are the green and the blue of a texture."""
    bpy.context.scene.camera.location.x = 0.5
    material = card.data.materials[0]
    tree = material.node_tree
    principled = tree.nodes["Principled BSDF"]
    principled.inputs["Specular IOR Level"].default_value = 0.0
    tree.links.new(textured(tree, "Base", 1, SIZE[0]), principled.inputs["Base Color"])
    separate = tree.nodes.new("ShaderNodeSeparateColor")
    tree.links.new(textured(tree, "Orm", 2, SIZE[0]), separate.inputs[0])
    for name, output in (("Roughness", "Green"), ("Metallic", "Blue")):
        tree.links.new(separate.outputs[output], principled.inputs[name])
    images = Images()
    read, warnings = material_of(material, images)
    assert not warnings
    index, corners = read.diffuse
    assert not corners
    assert index != read.base_color_image
    ticks = (np.arange(SIZE[0]) + 0.5) / SIZE[0]
    places = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    found = sample(images.sources[index].texels(pixels_of)[0], places, "REPEAT")[:, :3].reshape(*SIZE, 3)
    expected = diffuse_colour(tmp_path)
    assert expected.std() > 0.1
    # Pixels are texels: Cycles' ray is off a pixel's middle by some hundredths.
    assert np.abs(found - expected).max() < 0.02


def curves_of(rng) -> bpy.types.Object:
    """Thick ones of three points each, across the picture; every second in a colour of the curve's own."""
    made = bpy.data.hair_curves.new("Fur")
    made.add_curves([3] * 12)
    y = (np.arange(12) + 0.5) / 12
    points = np.stack([np.tile([0.05, 0.5, 0.95], 12), np.repeat(y, 3), np.zeros(36)], axis=1)
    made.attributes["position"].data.foreach_set("vector", points.astype(np.float32).ravel())
    radii = made.attributes.get("radius") or made.attributes.new("radius", "FLOAT", "POINT")
    radii.data.foreach_set("value", np.full(36, 0.03, np.float32))
    made.attributes.new("Dye", "FLOAT_COLOR", "CURVE").data.foreach_set(
        "color", rng.random(48).astype(np.float32)
    )
    return bpy.data.objects.new("Fur", made)


def points_of(rng) -> bpy.types.Object:
    made = bpy.data.pointclouds.new("Dust")
    made.resize(36)
    x, y = np.meshgrid(*[(np.arange(6) + 0.5) / 6] * 2)
    points = np.stack([x, y, 0.0 * x], axis=-1).reshape(-1, 3)
    made.attributes["position"].data.foreach_set("vector", points.astype(np.float32).ravel())
    made.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", np.full(36, 0.07, np.float32))
    return bpy.data.objects.new("Dust", made)


@pytest.mark.parametrize(
    ("make", "name"),
    [(curves_of, "Tint"), (curves_of, "Dye"), (curves_of, "radius"), (points_of, "Tint"),
     (points_of, "radius")],
)  # fmt: skip
def test_attributes_of_hair_and_points_are_cycles_own(card, make, name, tmp_path):
    scene, rng = bpy.context.scene, np.random.default_rng(8)
    card.visible_camera = False
    shown_one = make(rng)
    scene.collection.objects.link(shown_one)
    tint = shown_one.data.attributes.new("Tint", "FLOAT_COLOR", "POINT").data
    tint.foreach_set("color", rng.random(4 * len(tint)).astype(np.float32))
    material = bpy.data.materials.new("Glow")
    tree = material.node_tree
    glow, node = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = name
    tree.links.new(node.outputs["Color"], glow.inputs["Color"])
    tree.links.new(glow.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    shown_one.data.materials.append(material)
    found, expected = shown(scene), rendered(tmp_path)[..., :3]
    if name == "radius":  # is not there to nodes
        assert not found.any()
        assert not expected.any()
        return
    both = (found.sum(axis=2) > 0.0) & (expected.sum(axis=2) > 0.0)
    assert both.mean() > 0.3
    # Cycles goes along a curve at Catmull-Rom's pace, a tube of two straight pieces evenly; of a point all is
    # of one colour.
    assert np.abs(found - expected)[both].max() < (0.1 if make is curves_of else 1e-4)
    assert expected[both].std() > 0.1
