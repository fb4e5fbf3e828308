"""One click to compositor nodes: rendered and compared with the layers multiplied by hand."""

from __future__ import annotations

import bpy
import numpy as np
import OpenEXR
import pytest
import strata
from conftest import SAMPLES
from exr_layers import read_layers
from strata.addon.layers.compositor import GROUP_NAME
from strata.addon.scene.open import open_blend

SIZE = (32, 18)
PASSES = {"Combined": 0.8, "Combined_Warm": 0.5, "Combined_Cold": 0.1}


class FlatEngine(bpy.types.RenderEngine):
    """Stands in for Cycles with light groups: every pass has one value."""

    bl_idname = "FLAT"
    bl_label = "Flat"
    groups = ("Combined_Warm", "Combined_Cold")
    size = SIZE

    def update_render_passes(self, scene=None, renderlayer=None):
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        for name in type(self).groups:
            self.register_pass(scene, renderlayer, name, 3, "RGB", "COLOR")

    def render(self, depsgraph):
        layer = depsgraph.view_layer.name
        for name in type(self).groups:
            self.add_pass(name, 3, "RGB", layer=layer)
        result = self.begin_result(0, 0, *self.size, layer=layer)
        for found in result.layers[0].passes:
            value = np.full((self.size[0] * self.size[1], found.channels), PASSES[found.name], np.float32)
            found.rect.foreach_set(value.reshape(-1))
        self.end_result(result)


@pytest.fixture(scope="module", autouse=True)
def registered():
    strata.register()
    bpy.utils.register_class(FlatEngine)
    yield
    bpy.utils.unregister_class(FlatEngine)
    strata.unregister()


@pytest.fixture
def scene(tmp_path, request):
    """A baked scene that another engine renders."""
    FlatEngine.groups = request.param if hasattr(request, "param") else ()
    open_blend(SAMPLES / "courtyard.blend")
    scene = bpy.context.scene
    scene.render.engine = "FLAT"
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.strata.backend, scene.strata.samples, scene.strata.probes = "cpu", 1, 0
    scene.strata.save_to, scene.strata.output = "FILE", str(tmp_path / "baked.exr")
    assert bpy.ops.strata.bake() == {"FINISHED"}
    return scene


def shadows(scene) -> dict[str, np.ndarray]:
    return {layer.light: layer.pixels for layer in read_layers(scene.strata.output).layers}


def composited(scene, tmp_path) -> np.ndarray:
    settings = scene.render.image_settings
    settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGBA"
    path = tmp_path / "composited.exr"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    with OpenEXR.File(str(path)) as file:
        return file.channels()["RGBA"].pixels[::-1]


def expect_shadowed(scene, tmp_path) -> None:
    expected = PASSES["Combined"] * np.prod(list(shadows(scene).values()), axis=0)
    image = composited(scene, tmp_path)
    for channel in range(3):
        np.testing.assert_allclose(image[:, :, channel], expected, atol=1e-6)  # a few roundings of float32
    assert image[:, :, :3].min() < 0.1 < image[:, :, :3].max()


def test_without_light_groups_the_image_is_multiplied_by_every_shadow(scene, tmp_path):
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    expect_shadowed(scene, tmp_path)


@pytest.mark.parametrize("crop", [False, True])
def test_a_render_region_lies_in_its_place_and_nothing_changes_around_it(scene, tmp_path, crop):
    whole = np.prod(list(shadows(scene).values()), axis=0)
    render = scene.render
    render.use_border, render.use_crop_to_border = True, crop
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.5, 0.0, 0.5
    bpy.ops.strata.bake()
    part = np.prod(list(shadows(scene).values()), axis=0)
    if not crop:
        part = part[:9, 8:16]
    assert part.shape == (9, 8)
    # Maps are fitted to what is in view; a wrong place would be off by far more.
    assert np.abs(part - whole[:9, 8:16]).mean() < 0.05
    assert np.ptp(part) > 0.2
    bpy.ops.strata.build_compositor()
    render.use_border = False
    expected = np.ones((SIZE[1], SIZE[0]), np.float32)
    if crop:  # the file is a picture of its own, for renders that are cropped alike
        render.resolution_x, render.resolution_y = 8, 9
        FlatEngine.size, expected = (8, 9), part
    else:
        expected[:9, 8:16] = part
    image = composited(scene, tmp_path)
    FlatEngine.size = SIZE
    np.testing.assert_allclose(image[:, :, 0], PASSES["Combined"] * expected, atol=1e-6)


def test_twice_is_as_once(scene, tmp_path):
    bpy.ops.strata.build_compositor()
    count = len(bpy.data.node_groups), len(scene.compositing_node_group.nodes)
    bpy.ops.strata.build_compositor()
    assert (len(bpy.data.node_groups), len(scene.compositing_node_group.nodes)) == count
    expect_shadowed(scene, tmp_path)


@pytest.mark.parametrize("scene", [("Combined_Warm", "Combined_Cold")], indirect=True)
def test_with_light_groups_each_is_multiplied_by_its_own_shadows(scene, tmp_path):
    by_light = shadows(scene)
    first, second, third, *others = by_light
    assert others
    for name, group in ((first, "Warm"), (second, "Warm"), (third, "Cold")):
        bpy.data.objects[name].lightgroup = group
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    warm, cold = PASSES["Combined_Warm"], PASSES["Combined_Cold"]
    expected = PASSES["Combined"] - warm - cold  # neither group has it, so nothing shadows it
    expected += warm * by_light[first] * by_light[second] + cold * by_light[third]
    image = composited(scene, tmp_path)
    np.testing.assert_allclose(image[:, :, 0], expected, atol=1e-6)
    assert np.ptp(image[:, :, 0]) > 0.2


def test_a_users_tree_stays_and_gets_the_shadowed_image(scene, tmp_path):
    tree = bpy.data.node_groups.new("Mine", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    layers, mine = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeInvert")
    output = tree.nodes.new("NodeGroupOutput")
    tree.links.new(layers.outputs["Image"], mine.inputs["Color"])
    tree.links.new(mine.outputs["Color"], output.inputs[0])
    scene.compositing_node_group = tree
    bpy.ops.strata.build_compositor()
    assert scene.compositing_node_group == tree
    assert {node.name for node in tree.nodes} == {layers.name, mine.name, output.name, GROUP_NAME}
    expected = 1.0 - PASSES["Combined"] * np.prod(list(shadows(scene).values()), axis=0)
    np.testing.assert_allclose(composited(scene, tmp_path)[:, :, 0], expected, atol=1e-6)


def test_an_animation_reads_its_own_frames(tmp_path):
    FlatEngine.groups = ()
    open_blend(SAMPLES / "animated.blend")
    scene = bpy.context.scene
    scene.render.engine = "FLAT"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *SIZE, 100
    scene.strata.backend, scene.strata.samples, scene.strata.probes = "cpu", 1, 0
    scene.strata.save_to, scene.strata.output = "FILE", str(tmp_path / "baked_####.exr")
    expected = {}
    for frame in (2, 9):
        scene.frame_set(frame)
        bpy.ops.strata.bake()
        (layer,) = read_layers(tmp_path / f"baked_{frame:04d}.exr").layers
        expected[frame] = PASSES["Combined"] * layer.pixels
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    for frame in (2, 9):
        scene.frame_set(frame)
        np.testing.assert_allclose(composited(scene, tmp_path)[:, :, 0], expected[frame], atol=1e-6)
    assert np.abs(expected[2] - expected[9]).max() > 0.1


def test_what_cannot_be_built_is_said(scene, tmp_path):
    scene.strata.output = str(tmp_path / "none.exr")
    with pytest.raises(RuntimeError, match="bake to a file first"):
        bpy.ops.strata.build_compositor()
    scene.render.engine = "STRATA"
    assert not bpy.ops.strata.build_compositor.poll()
