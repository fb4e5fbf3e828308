"""Each output of nodes that no reader covers, as Blender bakes it, against what Cycles renders of it."""

from __future__ import annotations

import bpy
import mathutils
import numpy as np
import pytest
from strata.addon.bake import read_scene
from strata.addon.effects.shared.lit import bilinear
from strata.addon.planning import Options
from strata.addon.scene.exact import size
from strata.tests.support.cycles_card import card_scene, rendered

PIXELS = 24
TEXELS = 512
OPTIONS = Options(("soft_shadow",), "cpu", samples=1, probes=0, read="exact", composite=True)
PLACE = mathutils.Matrix.LocRotScale((-0.3, 0.2, -0.1), mathutils.Euler((0.3, 0.5, 0.7)), (2.0, 0.5, 1.5))

KINDS = (
    "TexNoise", "TexVoronoi", "TexWave", "TexMagic", "TexChecker", "TexBrick", "TexGradient", "TexWhiteNoise",
    "TexGabor", "TexSky", "TexEnvironment", "TexCoord", "NewGeometry", "ObjectInfo", "Tangent", "Bevel",
    "Bump", "NormalMap", "Wireframe", "VectorTransform", "VectorRotate", "Wavelength", "Attribute",
    "VertexColor", "UVMap", "RadialTiling",
)  # fmt: skip


@pytest.fixture
def tree(monkeypatch) -> bpy.types.NodeTree:
    """Of a material that glows, on a card that fills the picture and is neither where nor as large as its
    mesh is."""
    monkeypatch.setattr(size, "LEAST", TEXELS)
    card = card_scene((PIXELS, PIXELS))
    backwards = PLACE.inverted()
    places = [(backwards @ vertex.co)[:] for vertex in card.data.vertices]
    card.data.vertices.foreach_set("co", np.array(places, np.float32).ravel())
    card.data.update()
    card.matrix_world, card.color, card.pass_index = PLACE, (0.2, 0.4, 0.6, 0.8), 3
    painted = card.data.attributes.new("painted", "FLOAT_COLOR", "CORNER")
    painted.data.foreach_set("color", np.random.default_rng(1).uniform(0, 1, 16).astype(np.float32))
    lamp = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    lamp.data.energy = 1e-9
    bpy.context.scene.collection.objects.link(lamp)
    material = bpy.data.materials.new("Card")
    material.pass_index = 7
    card.data.materials.append(material)
    made = material.node_tree
    emission = made.nodes.new("ShaderNodeEmission")
    made.links.new(emission.outputs[0], made.nodes["Material Output"].inputs["Surface"])
    return made


def baked() -> tuple[np.ndarray, tuple[str, ...]]:
    """(PIXELS, PIXELS, 3) of what the card emits, in the middle of each pixel; and warnings."""
    scene = bpy.context.scene
    outline, _, arrays, _ = read_scene(scene, scene.view_layers[0], OPTIONS, size=(PIXELS, PIXELS))
    shown = next(instance for instance in outline.instances if instance.name == "Card")
    material = outline.materials[shown.materials[0]]
    ticks = (np.arange(PIXELS) + 0.5) / PIXELS
    x, y = np.meshgrid(ticks, ticks)
    if material.emission_image is None:
        found = np.broadcast_to(material.emission, (PIXELS, PIXELS, 3))
        if material.emission_corners:  # of two triangles, from the first corner to the third
            of_third, of_second, of_fourth = np.minimum(x, y), np.maximum(x - y, 0), np.maximum(y - x, 0)
            weights = [1.0 - of_third - of_second - of_fourth, of_second, of_third, of_fourth]
            found = found * np.einsum("kyx,kc->yxc", weights, arrays.meshes[shown.mesh].corner_colours)
        return found, outline.warnings
    weights = np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=-1).reshape(-1, 4)
    uvs = (weights @ arrays.meshes[shown.mesh].corner_uvs).astype(np.float32)
    found = bilinear(arrays.textures[material.emission_image], uvs)
    return found.reshape(PIXELS, PIXELS, 3), outline.warnings


@pytest.mark.parametrize("kind", KINDS)
def test_outputs_are_what_cycles_renders(tree, kind, tmp_path):
    node = tree.nodes.new(f"ShaderNode{kind}")
    if kind == "Attribute":
        node.attribute_name = "painted"
    elif kind == "VertexColor":
        node.layer_name = "painted"
    compared = 0
    for output in (each for each in node.outputs if each.enabled):
        tree.links.new(output, tree.nodes["Emission"].inputs["Color"])
        found, warnings = baked()
        if warnings:
            assert output.name in {"Incoming", "Camera", "Window", "Reflection"}, warnings
            continue
        seen = rendered(tmp_path)[..., :3]
        apart = (np.abs(found - seen) / (1.0 + np.abs(seen))).max(axis=-1)
        # Four samples of a texel, and what lies between texels; at edges of cells and bricks, which a fifth
        # of these pixels meets, a texel is of both sides.
        assert np.median(apart) < 0.005, output.name
        assert (apart > 0.02).mean() < 0.2, output.name
        compared += 1
    assert compared


def test_what_a_script_computes_is_baked(tree, tmp_path):
    pytest.importorskip("oslquery")  # Blender as a Python module comes without
    scene = bpy.context.scene
    scene.cycles.shading_system = True
    text = bpy.data.texts.new("stripes.osl")
    text.write(
        "shader stripes(output color Stripes = 0) { Stripes = color(mod(4.0 * P[0], 1.0), P[1], 0.5); }"
    )
    node = tree.nodes.new("ShaderNodeScript")
    node.script = text
    import cycles.osl

    cycles.osl.update_script_node(node, lambda kind, message: None)
    tree.links.new(node.outputs["Stripes"], tree.nodes["Emission"].inputs["Color"])
    found, warnings = baked()
    assert not warnings
    apart = np.abs(found - rendered(tmp_path)[..., :3]).max(axis=-1)
    assert np.median(apart) < 0.002
    assert (apart > 0.02).mean() < 0.1


def test_a_value_that_moves_is_baked_as_it_is_in_the_frame(tree, tmp_path):
    node = tree.nodes.new("ShaderNodeTexNoise")
    node.inputs["Detail"].default_value = 0.0
    scale = node.inputs["Scale"]
    for frame, value in ((1, 2.0), (9, 6.0)):
        scale.default_value = value
        scale.keyframe_insert("default_value", frame=frame)
    tree.links.new(node.outputs[0], tree.nodes["Emission"].inputs["Color"])
    scene, pictures = bpy.context.scene, []
    for frame in (1, 5):
        scene.frame_set(frame)
        found, _ = baked()
        np.testing.assert_allclose(found, rendered(tmp_path)[..., :3], atol=0.005)
        pictures.append(found)
    assert np.abs(pictures[0] - pictures[1]).max() > 0.1
