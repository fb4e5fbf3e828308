"""Toon from a scene to its layers: what is made, what is left out and why, overrides, measured error."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from strata.addon.bake import bake, read_scene
from strata.addon.core.ramp import Ramp
from strata.addon.planning import Options
from strata.addon.ui import properties
from strata.addon.ui.properties import fill_ramp
from strata.tests.effects.toon.mask_errors import edge_errors

SIZE = (120, 90)


@pytest.fixture
def stage():
    """Two balls over a ground under a sun, seen from above: the left one red, the right one blue."""
    properties.register()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    for name, x, color in (("Left", -1.2, (0.8, 0.1, 0.1)), ("Right", 1.2, (0.1, 0.2, 0.8))):
        bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, location=(x, 0, 1))
        ball = bpy.context.object
        ball.name = name
        ball.data.shade_smooth()
        material = bpy.data.materials.new(name)
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*color, 1.0)
        ball.data.materials.append(material)
    bpy.ops.mesh.primitive_plane_add(size=30.0)
    bpy.context.object.name = "Ground"
    bpy.ops.object.light_add(type="SUN", rotation=(0.5, 0.4, 0.0))
    bpy.context.object.name = "Sun"
    bpy.ops.object.camera_add(location=(0, -7, 4), rotation=(math.radians(64), 0, 0))
    scene.camera = bpy.context.object
    yield scene
    properties.unregister()


def baked(scene, backend="cpu", samples=1, probes=0, effects=("toon",), **values):
    options = Options(effects, backend, samples, probes, {"toon": {"shadows": False, **values}})
    return bake(scene, scene.view_layers[0], options, size=SIZE)


def layers_of(result) -> dict[str, np.ndarray]:
    return {layer.name: layer.pixels for layer in result.layers.layers}


def planned(scene, effects=("toon",), **values):
    options = Options(effects, values={"toon": values})
    return read_scene(scene, scene.view_layers[0], options, size=SIZE)[1]


def ball_of(result, side: int) -> tuple[int, int]:
    """Row and column of a pixel in the middle of the left (-1) or the right (1) ball."""
    return 52, 60 + side * 17


# What is made


def test_there_are_three_layers(stage, backend):
    layers = layers_of(baked(stage, backend, samples=4, halftone_scale=1.2))
    assert list(layers) == ["Toon", "Toon Halftone", "Toon Outline"]
    assert layers["Toon"].shape == (SIZE[1], SIZE[0], 4)
    assert layers["Toon Halftone"].shape == SIZE[::-1]
    toon = layers["Toon"]
    assert toon[..., 3].max() == 1.0
    assert (toon[..., :3] <= 1.0 + 1e-6).all()
    # Four samples with a ramp of three steps: five levels of a colour at most in a ball's middle.
    assert layers["Toon Outline"][..., 3].max() == 1.0
    assert layers["Toon Halftone"].min() < 0.1


def glowing(scene, how: str) -> None:
    """Both balls: one by a constant, one `how`."""
    for name in ("Left", "Right"):
        tree = bpy.data.materials[name].node_tree
        principled = tree.nodes["Principled BSDF"]
        principled.inputs["Emission Color"].default_value = (0.1, 0.3, 0.05, 1.0)
        principled.inputs["Emission Strength"].default_value = 2.0
    if how == "attribute":
        paint = scene.objects["Right"].data.attributes.new("Paint", "FLOAT_COLOR", "POINT")
        paint.data.foreach_set("color", [0.1, 0.3, 0.05, 1.0] * len(paint.data))
        node = tree.nodes.new("ShaderNodeVertexColor")
        node.layer_name = "Paint"
    elif how == "texture":
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = bpy.data.images.new("Glow", 2, 2, float_buffer=True)
        node.image.colorspace_settings.name = "Non-Color"
        node.image.pixels.foreach_set(np.array([0.1, 0.3, 0.05, 1.0] * 4, np.float32))
    if how != "constant":
        tree.links.new(node.outputs["Color"], principled.inputs["Emission Color"])


@pytest.mark.parametrize("how", ["attribute", "texture"])
def test_glow_of_textures_and_attributes_is_as_that_of_constants(stage, backend, how):
    found = []
    for each in ("constant", how):
        glowing(stage, each)
        found.append(baked(stage, backend, probes=128, emission=0.5))
    first, second = found
    assert not [warning for warning in second.report.warnings if "not read" in warning]
    toon = layers_of(first)["Toon"]
    np.testing.assert_allclose(layers_of(second)["Toon"], toon, atol=1e-6)
    row, column = ball_of(first, 1)
    plain = layers_of(baked(stage, backend, emission=0.0))["Toon"]
    np.testing.assert_allclose((toon - plain)[row, column, :3], (0.1, 0.3, 0.05), atol=1e-6)
    errors = [each.layers.report["layers"][0]["error"]["value"] for each in found]
    assert errors[1] == pytest.approx(errors[0], rel=1e-3)


def test_what_is_switched_off_is_left_out_with_a_reason(stage):
    graph = planned(stage, halftone=False, outline=False, key_light="Moon")
    assert [layer.name for layer in graph.layers] == ["Toon"]
    reasons = {entry.what: entry.reason for entry in graph.left_out}
    assert reasons["Toon Halftone"] == reasons["Toon Outline"] == "it is switched off"
    assert "only 'Moon' counts" in reasons["Toon light Sun"]
    assert "there is no light 'Moon'" in reasons["Toon light"]
    graph = planned(stage, halftone_scale=0.3, outline_width_px=0.0)
    reasons = {entry.what: entry.reason for entry in graph.left_out}
    assert "cutoff" in reasons["Toon Halftone"]
    assert "width is 0" in reasons["Toon Outline"]
    # No lines, no normals and no hull are asked for.
    assert {node.step.name for node in graph.nodes()}.isdisjoint({"toon/hull", "toon/lines"})


def test_a_key_light_counts_wherever_instances_show_it(stage):
    """Chosen by its object, as the panel does, or by what its layers would be called."""
    sun = bpy.data.objects["Sun"]
    within = bpy.data.collections.new("Lamps")
    within.objects.link(sun)
    stage.collection.objects.unlink(sun)
    for name in ("Rig", "Other rig"):
        rig = bpy.data.objects.new(name, None)
        rig.instance_type, rig.instance_collection = "COLLECTION", within
        stage.collection.objects.link(rig)
    bpy.ops.object.light_add(type="SUN")
    bpy.context.object.name = "Fill"
    for key, left_out in (
        ("Sun", {"Fill"}),
        ("Sun Rig", {"Fill", "Sun Other rig"}),
        ("Fill", {"Sun Rig", "Sun Other rig"}),
    ):
        found = {each.light for each in planned(stage, key_light=key).left_out if "counts" in each.reason}
        assert found == left_out, key


def test_soft_shadows_are_the_nodes_of_soft_shadow(stage):
    both = planned(stage, ("soft_shadow", "toon"), shadow_edge="soft")
    shadow = next(layer.node for layer in both.layers if layer.effect == "soft_shadow")
    toon = next(layer.node for layer in both.layers if layer.name == "Toon")
    assert shadow.key in {node.key for node in both.nodes([toon])}
    for values in ({"shadows": False}, {"shadow_edge": "crisp"}):
        names = {node.step.name for node in planned(stage, **values).nodes()}
        assert not any(name.startswith("soft_shadow") for name in names)


@pytest.mark.parametrize("edge", ["crisp", "soft"])
def test_a_cast_shadow_falls_on_the_ground(stage, edge):
    plain = layers_of(baked(stage))["Toon"]
    shadowed = layers_of(baked(stage, shadows=True, shadow_edge=edge))["Toon"]
    darker = (plain - shadowed)[..., 0] > 0.1
    assert 0.01 < darker.mean() < 0.3


@pytest.mark.parametrize("kind", ["SUN", "POINT"])
def test_crisp_shadows_of_balls_are_where_rays_to_the_lights_middle_meet_them(stage, backend, kind):
    lamp = bpy.data.objects["Sun"]
    if kind == "POINT":
        lamp.data = bpy.data.lights.new("Lamp", "POINT")
        lamp.data.shadow_soft_size, lamp.location = 0.5, (0.5, -1.0, 5.0)
    values = {"ramp": "0:#000000,0.01:#ffffff;constant", "mix": "ramp", "shadows": True}
    outline, graph, *_ = read_scene(
        stage, stage.view_layers[0], Options(("toon",), values={"toon": values}), size=SIZE
    )
    view, emitter = graph.shot.view, outline.lights[0].emitter
    toon = layers_of(baked(stage, backend, **values))["Toon"]
    # Pixel centres on the ground, and which of them a ball hides from the lamp.
    left, right, bottom, top = view.window
    x = left + (np.arange(SIZE[0]) + 0.5) / SIZE[0] * (right - left)
    y = bottom + (np.arange(SIZE[1]) + 0.5) / SIZE[1] * (top - bottom)
    rays = (
        x[None, :, None] * np.array(view.right)
        + y[:, None, None] * np.array(view.up)
        + np.array(view.forward)
    )
    ground = rays[..., 2] < -1e-3
    distance = np.where(ground, -view.eye[2] / np.where(ground, rays[..., 2], 1.0), 0.0)
    points = np.array(view.eye) + distance[..., None] * rays
    towards = -np.array(emitter.forward) if kind == "SUN" else np.array(emitter.centre) - points
    towards = np.broadcast_to(towards / np.linalg.norm(towards, axis=-1, keepdims=True), points.shape)
    ground &= (np.abs(points[..., :2]) < 12.0).all(axis=-1)
    nearest = np.full(ground.shape, np.inf)
    for ball in (np.array([-1.2, 0.0, 1.0]), np.array([1.2, 0.0, 1.0])):
        to = np.array(view.eye) - ball
        along = (to * rays).sum(axis=-1)
        seen = along**2 - (rays**2).sum(axis=-1) * (to @ to - 1.02)
        ground &= seen < 0.0  # the ball itself
        off = ball - points
        beside = np.linalg.norm(off - (off * towards).sum(axis=-1)[..., None] * towards, axis=-1)
        nearest = np.minimum(nearest, beside)
    # A ball of 64 x 32 faces lies up to 0.5% within the sphere.
    clear = ground & (np.abs(nearest - 1.0) > 0.006)
    assert (nearest[clear] < 1.0).sum() > 150
    np.testing.assert_array_equal(toon[..., 0][clear] > 0.5, nearest[clear] > 1.0)


def test_flat_normals_make_facets(stage):
    for name in ("Left", "Right"):
        bpy.data.objects[name].data.shade_smooth()
    smooth = layers_of(baked(stage, ramp="0:#000000,1:#ffffff", mix="ramp"))["Toon"]
    flat = layers_of(baked(stage, ramp="0:#000000,1:#ffffff", mix="ramp", normals="flat"))["Toon"]
    row, column = ball_of(None, -1)
    ball = np.s_[row - 10 : row + 10, column - 10 : column + 10, 0]
    assert len(np.unique(np.round(flat[ball], 4))) < 0.7 * len(np.unique(np.round(smooth[ball], 4)))


def test_brightness_follows_the_lights_power(stage):
    values = {"ramp": "0:#000000,1:#ffffff", "mix": "ramp", "light": "brightness"}
    bpy.data.objects["Sun"].data.energy = 1.0
    dim = layers_of(baked(stage, **values))["Toon"]
    bright = layers_of(baked(stage, exposure=2.0, **values))["Toon"]
    # A white surface that faces a sun of 1 W/m2 sends back 1 / pi.
    assert dim[..., 0].max() == pytest.approx(1.0 / math.pi, abs=0.01)
    np.testing.assert_allclose(bright, np.concatenate([2 * dim[..., :3], dim[..., 3:]], axis=2), atol=1e-5)


# Overrides


def test_an_object_may_be_left_to_the_picture_below(stage):
    settings = bpy.data.objects["Left"].strata
    settings.use_own, settings.toon.excluded = True, True
    result = baked(stage)
    layers, left, right = layers_of(result), ball_of(result, -1), ball_of(result, 1)
    assert layers["Toon"][left][3] == 0.0
    assert layers["Toon"][right][3] == 1.0
    assert layers["Toon Halftone"][left[0] - 12 : left[0] + 5, left[1]].min() == 1.0
    ink = layers["Toon Outline"][..., 3]
    assert ink[:, 60:].sum() > 3 * ink[:20, :60].sum()
    for name in ("Right", "Ground"):
        other = bpy.data.objects[name].strata
        other.use_own, other.toon.excluded = True, True
    graph = planned(stage)
    assert not graph.layers
    assert any("excluded" in entry.reason for entry in graph.left_out)


def test_a_material_alone_may_be_left_to_the_picture_below(stage, backend):
    """One of the two materials of a ball, the other way round for its upper and its lower half."""
    ball = bpy.data.objects["Left"].data
    ball.materials.append(bpy.data.materials["Right"])
    upper = np.array([polygon.center.z > 0.0 for polygon in ball.polygons])
    ball.polygons.foreach_set("material_index", upper.astype(np.int32))
    settings = bpy.data.materials["Left"].strata
    settings.use_own, settings.toon.excluded = True, True
    bpy.data.objects["Sun"].rotation_euler = (0.5, -1.4, 0.0)
    layers = layers_of(baked(stage, backend, halftone_scale=2.0))
    row, column = ball_of(None, -1)
    above, below = np.s_[row + 4 : row + 10, column - 3 : column + 4], np.s_[row - 16 : row - 10, column]
    assert (layers["Toon"][above][..., 3] == 1.0).all()
    assert (layers["Toon"][below][..., 3] == 0.0).all()
    assert layers["Toon Halftone"][above].min() < 0.5
    assert (layers["Toon Halftone"][below] == 1.0).all()


def test_objects_and_materials_may_have_ramps_of_their_own(stage, backend):
    ramps = {}
    for name, text in (("Green", "0:#00ff00"), ("White", "0:#ffffff")):
        ramps[name] = bpy.data.textures.new(name, "NONE")
        ramps[name].use_color_ramp = True
        fill_ramp(ramps[name].color_ramp, Ramp.parse(text))
    of_material = bpy.data.materials["Left"].strata
    of_material.use_own, of_material.toon.use_ramp, of_material.toon.ramp = True, True, ramps["Green"]
    result = baked(stage, backend, mix="ramp", ramp="0:#0000ff")
    left, right = ball_of(result, -1), ball_of(result, 1)
    toon = layers_of(result)["Toon"]
    np.testing.assert_allclose(toon[left], (0, 1, 0, 1), atol=1e-6)
    np.testing.assert_allclose(toon[right], (0, 0, 1, 1), atol=1e-6)
    of_object = bpy.data.objects["Left"].strata
    of_object.use_own, of_object.toon.use_ramp, of_object.toon.ramp = True, True, ramps["White"]
    toon = layers_of(baked(stage, backend, mix="ramp", ramp="0:#0000ff"))["Toon"]
    np.testing.assert_allclose(toon[left], (1, 1, 1, 1), atol=1e-6)


def test_objects_may_have_outlines_of_their_own(stage):
    result = baked(stage)
    usual = layers_of(result)["Toon Outline"]
    settings = bpy.data.objects["Right"].strata
    settings.use_own, settings.toon.outline_scale, settings.toon.use_outline_color = True, 2.0, True
    settings.toon.outline_color = (1.0, 0.0, 0.0)
    material = bpy.data.materials["Left"].strata
    material.use_own, material.toon.outline = True, False
    own = layers_of(baked(stage))["Toon Outline"]
    red = own[..., 0] > 0.5
    assert red[:, 60:].sum() == pytest.approx(2 * (usual[:, 60:, 3] > 0.5).sum(), rel=0.4)
    # The left ball has none; what is left there is the horizon's.
    assert own[25:65, 20:55, 3].sum() == 0.0
    assert usual[25:65, 20:55, 3].sum() > 20.0


def test_a_vertex_group_or_an_attribute_scales_the_line(stage):
    for name, x in (("Left", -1.0), ("Right", 1.0)):
        ball = bpy.data.objects[name]
        inner = [v.index for v in ball.data.vertices if v.co.x * x < 0.0]
        if name == "Left":
            ball.vertex_groups.new(name="Ink").add(inner, 1.0, "REPLACE")
        else:
            values = np.zeros(len(ball.data.vertices), np.float32)
            values[inner] = 1.0
            ball.data.attributes.new("Ink", "FLOAT", "POINT").data.foreach_set("value", values)
    ink = layers_of(baked(stage, outline_thickness="Ink"))["Toon Outline"][..., 3]
    usual = layers_of(baked(stage))["Toon Outline"][..., 3]
    # Only the sides that face each other keep their line.
    assert ink[30:60, 45:75].sum() == pytest.approx(usual[30:60, 45:75].sum(), rel=0.1)
    assert usual[35:60, :35].sum() > 10.0
    assert ink[35:60, :35].sum() == 0.0
    assert ink[35:60, 85:].sum() == 0.0


# The error


@pytest.mark.parametrize("anchor", ["screen", "surface"])
def test_the_measured_error_is_that_of_eight_samples(stage, backend, anchor):
    result = baked(
        stage, backend, samples=8, probes=400, shadows=True, halftone_anchor=anchor, halftone_cell_m=0.15,
        halftone_repeat=40,
    )  # fmt: skip
    errors = {layer["name"]: layer["error"] for layer in result.layers.report["layers"]}
    for name, most in (("Toon", 0.005), ("Toon Halftone", 0.025), ("Toon Outline", 0.005)):
        # A mean of 8 samples against one of 64 at random places, each off by a twentieth where it changes.
        assert errors[name]["mean_absolute_error"] < most, name
        assert abs(errors[name]["bias"]) < 0.004, name
        assert errors[name]["max"] < 0.5, name


def test_a_wrong_layer_is_found_out(stage):
    """The measurement must see a broken layer: here, one of a ramp that is not the reference's."""
    from strata.addon.effects.toon import reference

    right = reference._mixed
    reference._mixed = lambda ramp, base, mix: 0.8 * right(ramp, base, mix)
    try:
        result = baked(stage, samples=4, probes=100)
    finally:
        reference._mixed = right
    error = next(layer for layer in result.layers.report["layers"] if layer["name"] == "Toon")["error"]
    assert error["mean_absolute_error"] > 0.02


def test_edges_are_right_to_an_eighth(stage):
    """Every pixel whose samples are not all the same, against 64 samples: how many are off by over 1/8. Of
    straight edges in all places and directions the pattern of eight samples gets 2.8% wrong by that (this
    scene's outline: 2.4% against 256 samples), that of sixteen none; the 64 have errors of their own."""
    for name in ("Left", "Right"):
        bpy.data.objects[name].scale = (1.3, 1.3, 1.3)
    options = Options(("toon",), values={"toon": {"shadows": False}})
    *read, _ = read_scene(stage, stage.view_layers[0], options, size=(320, 240))
    found = edge_errors(read, [8, 16])
    for layer in ("Toon", "Toon Halftone", "Toon Outline"):
        assert found[layer, 8].edges > 0.01
        assert found[layer, 8].wrong <= 0.04, layer
        assert found[layer, 16].wrong <= 0.005, layer
        assert found[layer, 16].mean < 0.8 * found[layer, 8].mean
