"""One click to shadows on a render: compared with the layers multiplied by hand, and with Cycles."""

from __future__ import annotations

import bpy
import numpy as np
import OpenEXR
import pytest
import strata
from conftest import SAMPLES
from exr_layers import read_layers
from scan_scenes import empty_scene
from strata.addon.effects.registry import EFFECTS
from strata.addon.engine import passes
from strata.addon.layers import shadow_nodes
from strata.addon.layers.exr_header import header_of
from strata.addon.layers.shadow_nodes import GROUP_NAME
from strata.addon.scene.open import open_blend
from strata.addon.ui import draw, rows
from strata.ops.cli import main

SIZE = (32, 18)
COMBINED, GROUP, NOISY = 0.8, 0.1, 0.6
"""In each pixel of the flat engine's passes."""


class FlatEngine(bpy.types.RenderEngine):
    """Stands in for Cycles: a pass has one value, so that what nodes do is known to a few roundings."""

    bl_idname = "FLAT"
    bl_label = "Flat"
    has_groups = True
    is_denoised = False
    size = SIZE

    @classmethod
    def passes(cls, view_layer) -> dict[str, float]:
        names = [f"Combined_{group.name}" for group in view_layer.lightgroups] if cls.has_groups else []
        return dict.fromkeys(names, GROUP) | ({"Noisy Image": NOISY} if cls.is_denoised else {})

    def update_render_passes(self, scene=None, renderlayer=None):
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        for name in self.passes(renderlayer):
            self.register_pass(scene, renderlayer, name, 3, "RGB", "COLOR")

    def render(self, depsgraph):
        layer = depsgraph.view_layer.name
        values = self.passes(depsgraph.view_layer)
        for name in values:
            self.add_pass(name, 3, "RGB", layer=layer)
        result = self.begin_result(0, 0, *self.size, layer=layer)
        for found in result.layers[0].passes:
            value = np.full(
                (self.size[0] * self.size[1], found.channels), values.get(found.name, COMBINED), np.float32
            )
            found.rect.foreach_set(value.reshape(-1))
        self.end_result(result)


@pytest.fixture(scope="module", autouse=True)
def registered():
    strata.register()
    bpy.utils.register_class(FlatEngine)
    yield
    bpy.utils.unregister_class(FlatEngine)
    strata.unregister()


def small(scene, output) -> None:
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.strata.backend, scene.strata.samples, scene.strata.probes = "cpu", 1, 0
    scene.strata.save_to, scene.strata.output = "FILE", str(output)


@pytest.fixture(scope="module")
def courtyard(tmp_path_factory):
    """Baked once: a Blender file whose output is a file beside it."""
    folder = tmp_path_factory.mktemp("courtyard")
    open_blend(SAMPLES / "courtyard.blend")
    scene = bpy.context.scene
    scene.render.engine = "FLAT"
    small(scene, folder / "baked.exr")
    assert bpy.ops.strata.bake() == {"FINISHED"}
    scene.strata.output = "//baked.exr"
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"), relative_remap=False)
    return folder


@pytest.fixture
def scene(courtyard):
    """The courtyard, as it was baked."""
    FlatEngine.has_groups, FlatEngine.is_denoised = True, False
    bpy.ops.wm.open_mainfile(filepath=str(courtyard / "scene.blend"))
    return bpy.context.scene


def shadows(scene) -> dict[str, np.ndarray]:
    path = bpy.path.abspath(scene.strata.output)
    return {la.light: la.pixels for la in read_layers(path).layers if la.effect == "soft_shadow"}


def lamps(scene) -> dict[str, bpy.types.Object]:
    return {thing.name: thing for thing in scene.objects if thing.type == "LIGHT"}


def composited(scene, tmp_path) -> np.ndarray:
    settings = scene.render.image_settings
    settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGBA"
    path = tmp_path / "composited.exr"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True, scene=scene.name)
    with OpenEXR.File(str(path)) as file:
        return file.channels()["RGBA"].pixels[::-1].copy()


def summed(*masks: np.ndarray) -> np.ndarray:
    """What the nodes make of the flat engine's render."""
    return COMBINED + GROUP * sum(mask - 1.0 for mask in masks)


def expect(image: np.ndarray, expected: np.ndarray) -> None:
    for channel in range(3):
        np.testing.assert_allclose(image[:, :, channel], expected, atol=1e-6)  # a few roundings of float32
    assert np.ptp(expected) > 0.05


def built(capfd, **arguments) -> list[str]:
    """What pressing the button says, a line each."""
    return told(capfd, bpy.ops.strata.build_compositor, **arguments)


def told(capfd, operator, **arguments) -> list[str]:
    capfd.readouterr()
    assert operator(**arguments) == {"FINISHED"}
    return [line.partition(": ")[2] for line in capfd.readouterr().out.splitlines() if ": " in line]


def refused(**arguments) -> str:
    with pytest.raises(RuntimeError) as error:
        bpy.ops.strata.build_compositor(**arguments)
    return str(error.value)


# What it does


def test_each_lamp_gets_a_group_and_its_shadow_is_multiplied_onto_that(scene, tmp_path, capfd):
    by_light = shadows(scene)
    assert len(by_light) > 2
    told = built(capfd)
    assert told[-1].startswith(f"Joined {len(by_light)} shadows; the lights' own are now off: ")
    for name, lamp in lamps(scene).items():
        joined = name in by_light
        assert (lamp.lightgroup, lamp.data.use_shadow) == ((name, False) if joined else ("", True))
        assert lamp.data.strata_shadow_composited == joined
    assert {group.name for group in bpy.context.view_layer.lightgroups} == set(by_light)
    image = composited(scene, tmp_path)
    expect(image, summed(*by_light.values()))
    assert (image[:, :, 3] == np.float32(COMBINED)).all()
    assert bpy.data.images["baked.exr"].filepath == "//baked.exr"


def test_where_the_engine_denoises_the_noisy_image_is_shadowed_and_denoised_after_that(scene, tmp_path):
    FlatEngine.is_denoised = True
    bpy.context.view_layer.update_render_passes()
    bpy.ops.strata.build_compositor()
    expected = summed(*shadows(scene).values()) - COMBINED + NOISY
    (denoiser,) = (node for node in bpy.data.node_groups[GROUP_NAME].nodes if node.type == "DENOISE")
    assert denoiser.outputs["Image"].links[0].to_node.type == "GROUP_OUTPUT"
    assert not np.allclose(composited(scene, tmp_path)[:, :, 0], expected, atol=1e-3)
    denoiser.mute = True
    expect(composited(scene, tmp_path), expected)


def test_a_users_node_before_the_shadows_stays_where_the_engine_denoises(scene, tmp_path):
    FlatEngine.is_denoised = True
    bpy.context.view_layer.update_render_passes()
    bpy.ops.strata.build_compositor()
    tree, added = scene.compositing_node_group, summed(*shadows(scene).values()) - COMBINED
    (layers,) = (node for node in tree.nodes if node.type == "R_LAYERS")
    ours, mine = tree.nodes[GROUP_NAME], tree.nodes.new("CompositorNodeInvert")
    assert ours.inputs["Image"].links[0].from_socket.name == "Noisy Image"
    tree.links.new(ours.inputs["Image"].links[0].from_socket, mine.inputs["Color"])
    tree.links.new(mine.outputs["Color"], ours.inputs["Image"])
    for is_denoised, image in ((True, NOISY), (False, COMBINED), (True, NOISY)):
        FlatEngine.is_denoised = is_denoised
        bpy.context.view_layer.update_render_passes()
        bpy.ops.strata.build_compositor()
        for node in bpy.data.node_groups[GROUP_NAME].nodes:
            node.mute = node.type == "DENOISE"
        expect(composited(scene, tmp_path), 1.0 - image + added)
    bpy.ops.strata.restore_shadows()
    assert mine.inputs["Color"].links[0].from_socket == layers.outputs["Image"]
    np.testing.assert_allclose(composited(scene, tmp_path)[:, :, :3], 1.0 - COMBINED, atol=1e-6)


def test_an_engine_without_light_groups_finds_its_image_unchanged(scene, tmp_path):
    """Of a scene that was built for another."""
    bpy.ops.strata.build_compositor()
    for has_groups, expected in ((False, np.float32(COMBINED)), (True, summed(*shadows(scene).values()))):
        FlatEngine.has_groups = has_groups
        bpy.context.view_layer.update_render_passes()
        image = composited(scene, tmp_path)
        np.testing.assert_allclose(image[:, :, 0], np.broadcast_to(expected, image.shape[:2]), atol=1e-6)


@pytest.mark.parametrize("crop", [False, True])
def test_a_render_region_lies_in_its_place_and_nothing_changes_around_it(scene, tmp_path, crop):
    whole = sum(shadows(scene).values())
    render = scene.render
    scene.strata.output = str(tmp_path / "part.exr")
    render.use_border, render.use_crop_to_border = True, crop
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.5, 0.0, 0.5
    bpy.ops.strata.bake()
    masks = list(shadows(scene).values())
    part = sum(masks) if crop else sum(masks)[:9, 8:16]
    assert part.shape == (9, 8)
    # Maps are fitted to what is in view; a wrong place would be off by far more.
    assert np.abs(part - whole[:9, 8:16]).mean() < 0.2
    assert np.ptp(part) > 0.2
    bpy.ops.strata.build_compositor()
    render.use_border = False
    if crop:  # the file is a picture of its own, for renders that are cropped alike
        render.resolution_x, render.resolution_y = 8, 9
        FlatEngine.size = (8, 9)
    image = composited(scene, tmp_path)
    FlatEngine.size = SIZE
    expect(image, summed(*masks))
    if not crop:
        around = np.ones(image.shape[:2], bool)
        around[:9, 8:16] = False
        np.testing.assert_allclose(image[around][:, :3], COMBINED, atol=1e-6)


def everything(scene) -> list:
    """All that a press may change."""
    return [
        [
            (t.name, t.lightgroup, t.data.use_shadow, t.data.strata_shadow_composited)
            for t in lamps(scene).values()
        ],
        [(layer.name, [group.name for group in layer.lightgroups]) for layer in scene.view_layers],
        sorted((tree.name, len(tree.nodes), len(tree.links)) for tree in bpy.data.node_groups),
        sorted(image.name for image in bpy.data.images),
        getattr(scene.compositing_node_group, "name", None),
        scene.render.use_compositing,
    ]


def test_twice_is_as_once(scene, tmp_path, capfd):
    bpy.ops.strata.build_compositor()
    before = everything(scene)
    assert built(capfd)[-1] == f"Joined {len(shadows(scene))} shadows"
    assert everything(scene) == before
    expect(composited(scene, tmp_path), summed(*shadows(scene).values()))


def test_all_of_it_is_undone_in_one_step(scene):
    before = everything(scene)
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.strata.build_compositor()
    bpy.ops.ed.undo_push(message="after")
    after = everything(scene)
    assert after != before
    bpy.ops.ed.undo()
    assert everything(bpy.context.scene) == before
    bpy.ops.ed.redo()
    assert everything(bpy.context.scene) == after


def test_another_scene_with_the_same_lamps_is_told(scene, capfd):
    bpy.ops.scene.new(type="LINK_COPY")
    bpy.context.scene.name = "Copy"
    told = "Scene 'Courtyard' shows some of these lamps too, now without shadows"
    assert told in built(capfd)
    bpy.context.window.scene = scene
    built(capfd)
    bpy.context.window.scene = bpy.data.scenes["Copy"]
    assert told not in built(capfd)


def test_another_scene_that_shadows_lamps_twice_is_told(scene, capfd):
    built(capfd)
    bpy.ops.scene.new(type="LINK_COPY")
    copy = bpy.context.scene
    copy.name, copy.compositing_node_group = "Copy", None
    built(capfd)
    warning = (
        "Scene 'Courtyard' shadows some of these lamps twice now: give lamps their shadows back there too"
    )
    lamp = lamps(copy)["Sun"]
    lamp.data.keyframe_insert("use_shadow", frame=1)  # so it is not joined any more
    assert warning in built(capfd)
    lamp.data.animation_data_clear()
    built(capfd)
    assert warning in told(capfd, bpy.ops.strata.restore_shadows)
    bpy.context.window.scene = scene
    assert bpy.ops.strata.restore_shadows.poll()
    (line,) = told(capfd, bpy.ops.strata.restore_shadows)
    assert line == "Shadow nodes are away; no lamp had its own shadow switched off"
    assert not bpy.ops.strata.restore_shadows.poll()
    assert not [node for node in scene.compositing_node_group.nodes if node.type == "GROUP"]


def test_a_full_copy_of_a_scene_gets_shadows_of_its_own(scene, tmp_path):
    bpy.ops.strata.build_compositor()
    (before,) = (tree for tree in bpy.data.node_groups if tree.name.startswith(GROUP_NAME))
    nodes = {node.name for node in before.nodes}
    bpy.ops.scene.new(type="FULL_COPY")
    copy = bpy.context.scene
    first, *rest = lamps(copy).values()
    for lamp in rest:
        lamp.hide_render = True
    copy.strata.output = str(tmp_path / "copy.exr")
    bpy.ops.strata.bake()
    bpy.ops.strata.build_compositor()
    assert {node.name for node in before.nodes} == nodes
    expect(composited(copy, tmp_path), summed(shadows(copy)[first.name]))
    expect(composited(scene, tmp_path), summed(*shadows(scene).values()))


def test_lamps_get_their_shadows_back(scene, tmp_path):
    assert not bpy.ops.strata.restore_shadows.poll()
    bpy.ops.strata.build_compositor()
    assert bpy.ops.strata.restore_shadows() == {"FINISHED"}
    for lamp in lamps(scene).values():
        assert (lamp.data.use_shadow, lamp.data.strata_shadow_composited) == (True, False)
    assert not [tree.name for tree in bpy.data.node_groups if tree.name.startswith(GROUP_NAME)]
    assert (composited(scene, tmp_path)[:, :, :3] == np.float32(COMBINED)).all()
    assert not bpy.ops.strata.restore_shadows.poll()


def test_a_shadow_switched_on_again_by_hand_is_the_lamps_own(scene):
    bpy.ops.strata.build_compositor()
    name = next(iter(shadows(scene)))
    light = lamps(scene)[name].data
    light.use_shadow = True
    bpy.ops.strata.restore_shadows()
    assert (light.use_shadow, light.strata_shadow_composited) == (True, False)
    bpy.ops.strata.build_compositor()
    assert (light.use_shadow, light.strata_shadow_composited) == (False, True)


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
    expect(composited(scene, tmp_path), 1.0 - summed(*shadows(scene).values()))
    # A user's node before ours stays there, too.
    ours, before = tree.nodes[GROUP_NAME], tree.nodes.new("CompositorNodeInvert")
    tree.links.new(layers.outputs["Image"], before.inputs["Color"])
    tree.links.new(before.outputs["Color"], ours.inputs["Image"])
    bpy.ops.strata.build_compositor()
    expect(composited(scene, tmp_path), COMBINED - (summed(*shadows(scene).values()) - COMBINED))
    tree.links.new(layers.outputs["Image"], ours.inputs["Image"])
    bpy.ops.strata.restore_shadows()
    np.testing.assert_allclose(composited(scene, tmp_path)[:, :, :3], 1.0 - COMBINED, atol=1e-6)


@pytest.fixture
def animated(tmp_path):
    """Frames 2 and 9 are baked; expected pictures by frame."""
    FlatEngine.has_groups, FlatEngine.is_denoised = True, False
    open_blend(SAMPLES / "animated.blend")
    scene = bpy.context.scene
    scene.render.engine = "FLAT"
    small(scene, tmp_path / "baked_####.exr")
    expected = {}
    for frame in (2, 9):
        scene.frame_set(frame)
        bpy.ops.strata.bake()
        (layer,) = read_layers(tmp_path / f"baked_{frame:04d}.exr").layers
        expected[frame] = summed(layer.pixels)
    return scene, expected


def test_an_animation_reads_its_own_frames(animated, tmp_path, capfd):
    scene, expected = animated
    (warning,) = (line for line in built(capfd) if "frames" in line)
    count = scene.frame_end - scene.frame_start - 1
    assert warning.startswith(
        f"{count} frames of the scene's range have no file, and would lie in full shadow: 1, 3, 4,"
    )
    for frame in (2, 9):
        scene.frame_set(frame)
        expect(composited(scene, tmp_path), expected[frame])
    assert np.abs(expected[2] - expected[9]).max() > 0.05


def test_one_frame_of_an_animation_is_told(animated, tmp_path, capfd):
    scene, _ = animated
    path = str(tmp_path / "baked_0002.exr")
    assert "The file is of frame 2, and the scene is at 9" in built(capfd, filepath=path)
    scene.frame_set(2)
    assert not [line for line in built(capfd, filepath=path) if "frame" in line]


# What Cycles makes of it


def plane(scene, name: str, side: float, place: tuple[float, float, float]) -> None:
    mesh, half = bpy.data.meshes.new(name), side / 2
    mesh.from_pydata(
        [(x, y, 0) for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))],
        [],
        [(0, 1, 2, 3)],
    )
    made = bpy.data.objects.new(name, mesh)
    made.location = place
    scene.collection.objects.link(made)


def lamp(scene, kind: str, place, energy: float, **values) -> None:
    made = bpy.data.objects.new(kind.title(), bpy.data.lights.new(kind.title(), kind))
    made.location, made.data.energy = place, energy
    for name, value in values.items():
        setattr(made.data, name, value)
    scene.collection.objects.link(made)


@pytest.fixture
def roofs(tmp_path):
    """Two roofs over a floor in the light of three lamps, looked at from above; no light groups."""
    scene = empty_scene()
    plane(scene, "Floor", 20, (0, 0, 0))
    plane(scene, "Roof", 1.5, (0, 0, 1))
    plane(scene, "Low roof", 1, (2, 1, 0.6))
    scene.camera.location = (0, 0, 12)
    lamp(scene, "AREA", (2, 0, 5), 300, size=1.0, color=(1, 0.6, 0.3))
    lamp(scene, "POINT", (-3, 1, 3), 200, shadow_soft_size=0.3, color=(0.3, 0.6, 1))
    lamp(scene, "SUN", (0, 0, 5), 1, angle=0.05)
    bpy.data.objects["Sun"].rotation_euler = (0.5, 0.2, 0)
    small(scene, tmp_path / "baked.exr")
    scene.render.engine, scene.strata.samples = "CYCLES", 8
    scene.render.resolution_x, scene.render.resolution_y = 96, 64
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_adaptive_sampling = "CPU", 64, False
    return scene


def rms(image: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(image[:, :, :3]))))


@pytest.mark.parametrize(("denoises", "bounces"), [(False, 0), (True, 0), (True, 4)])
def test_the_picture_is_what_cycles_renders_with_its_own_shadows(roofs, tmp_path, denoises, bounces):
    scene = roofs
    scene.cycles.use_denoising, scene.cycles.max_bounces = denoises, bounces
    truth = composited(scene, tmp_path)
    scene.cycles.seed = 1
    noise = rms(composited(scene, tmp_path) - truth)  # of two renders
    assert bpy.ops.strata.bake() == {"FINISHED"}
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    image = composited(scene, tmp_path)
    assert {group.name for group in bpy.context.view_layer.lightgroups} == {"Area", "Point", "Sun"}
    bright = truth[:, :, :3].mean()
    # Beyond the noise, what a shadow of default settings may be off (test_cycles.py, LAYER_RMSE). Measured:
    # 0, .008 and .020, the last for light that bounces, which is shadowed like what comes straight.
    assert max(rms(image - truth) ** 2 - noise**2, 0.0) ** 0.5 < 0.03 * bright
    assert abs((image - truth)[:, :, :3].mean()) < 0.01 * bright
    # Measured 1.17, 1.01 and .80; all shadows on everything would make it black.
    assert image[:, :, :3].min() > 0.7 * truth[:, :, :3].min()
    bpy.ops.strata.restore_shadows()
    assert rms(composited(scene, tmp_path) - truth) < 1.1 * noise


# A user's light groups, and lamps that cannot be joined


def groups(scene, **members: str) -> None:
    for name, group in members.items():
        lamps(scene)[name.replace("_", " ")].lightgroup = group
        if group not in bpy.context.view_layer.lightgroups:
            bpy.context.view_layer.lightgroups.add(name=group)


def test_a_users_group_of_one_lamp_is_taken(scene, tmp_path):
    groups(scene, Sun="Warm")
    bpy.ops.strata.build_compositor()
    assert lamps(scene)["Sun"].lightgroup == "Warm"
    assert "Sun" not in bpy.context.view_layer.lightgroups
    expect(composited(scene, tmp_path), summed(*shadows(scene).values()))


def test_lamps_that_share_a_users_group_are_named_and_keep_their_shadows(scene, tmp_path, capfd):
    by_light = shadows(scene)
    first, second = list(by_light)[:2]
    for name in (first, second):
        lamps(scene)[name].lightgroup = "Warm"
    bpy.context.view_layer.lightgroups.add(name="Warm")
    told = built(capfd)
    for name, other in ((first, second), (second, first)):
        lamp = lamps(scene)[name]
        assert (lamp.lightgroup, lamp.data.use_shadow, lamp.data.strata_shadow_composited) == (
            "Warm",
            True,
            False,
        )
        reason = f"it shares light group 'Warm' with '{other}': give it a group of its own"
        assert f"Not joined: Soft Shadow {name}: {reason}" in told
    expect(
        composited(scene, tmp_path),
        summed(*(by_light[name] for name in by_light if name not in (first, second))),
    )
    # Apart from now on, where it was joined before.
    lamps(scene)[second].lightgroup = ""
    bpy.ops.strata.build_compositor()
    assert not lamps(scene)[first].data.use_shadow
    lamps(scene)[second].lightgroup = "Warm"
    told = built(capfd)
    assert all(lamps(scene)[name].data.use_shadow for name in (first, second))
    given_back = ", ".join(sorted(lamps(scene)[name].data.name for name in (first, second)))
    assert f"Cast their own shadows again: {given_back}" in told


def test_a_group_with_something_else_that_shines_is_shared(scene, capfd):
    groups(scene, Sun="Warm")
    mesh = next(t for t in scene.objects if t.type == "MESH" and t.material_slots)
    mesh.lightgroup = "Warm"
    told = built(capfd)
    assert not [line for line in told if line.startswith("Not joined: Soft Shadow Sun")]
    glow = bpy.data.materials.new("Glow")
    inputs = glow.node_tree.nodes["Principled BSDF"].inputs
    inputs["Emission Strength"].default_value, inputs["Emission Color"].default_value = 1.0, (0, 0, 0, 1)
    mesh.material_slots[0].material = glow
    assert not [line for line in built(capfd) if line.startswith("Not joined: Soft Shadow Sun")]
    inputs["Emission Color"].default_value = (0, 0.1, 0, 1)
    assert [
        line
        for line in built(capfd)
        if line.startswith(f"Not joined: Soft Shadow Sun: it shares light group 'Warm' with '{mesh.name}'")
    ]
    mesh.lightgroup, scene.world.lightgroup = "", "Warm"
    assert [
        line
        for line in built(capfd)
        if "Soft Shadow Sun: it shares light group 'Warm' with 'the world'" in line
    ]


def test_a_group_that_is_called_like_a_lamp_and_has_another_in_it_stays(scene, tmp_path):
    first, second = list(shadows(scene))[:2]
    lamps(scene)[second].lightgroup = first
    bpy.ops.strata.build_compositor()
    assert (lamps(scene)[first].lightgroup, lamps(scene)[second].lightgroup) == (f"{first} 2", first)
    expect(composited(scene, tmp_path), summed(*shadows(scene).values()))


def test_lights_that_cannot_be_switched_are_named(scene, tmp_path, capfd):
    by_light = shadows(scene)
    off, moving, shared, *rest = by_light
    there = lamps(scene)
    there[off].data.use_shadow = False
    there[moving].data.keyframe_insert("use_shadow", frame=1)
    twin = bpy.data.objects.new("Twin", there[shared].data)
    scene.collection.objects.link(twin)
    told = built(capfd)
    for name, reason in (
        (off, "its shadow is switched off"),
        (moving, "its shadow is switched by an animation or a driver"),
        (shared, "its light is also that of 'Twin', which cannot be joined"),
    ):
        assert f"Not joined: Soft Shadow {name}: {reason}" in told
    assert [there[name].data.use_shadow for name in (off, moving, shared)] == [False, True, True]
    expect(composited(scene, tmp_path), summed(*(by_light[name] for name in rest)))


def test_a_lamp_of_a_library_is_named(courtyard, tmp_path):
    scene = empty_scene()
    with bpy.data.libraries.load(str(courtyard / "scene.blend"), link=True) as (_, taken):
        taken.objects, taken.lights = ["Sun"], ["Sun"]
    (sun,) = taken.objects
    scene.collection.objects.link(sun)
    small(scene, courtyard / "baked.exr")
    header = header_of(courtyard / "baked.exr")
    scene.render.engine, scene.camera.name = "FLAT", header.text("Camera")
    (bpy.context.view_layer.name,) = header.passes
    assert "linked from a library and cannot be changed: make a library override" in refused()
    mine = sun.override_hierarchy_create(scene, bpy.context.view_layer, do_fully_editable=True)
    light = mine.data.override_create(remap_local_usages=True)
    scene.collection.objects.unlink(sun)
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    assert (mine.lightgroup, light.use_shadow, light.strata_shadow_composited) == ("Sun", False, True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "overridden.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "overridden.blend"))
    (light,) = (light for light in bpy.data.lights if light.library is None)
    assert (light.use_shadow, light.strata_shadow_composited) == (False, True)


def test_lamps_that_a_library_keeps_without_a_shadow_are_named(scene, tmp_path, capfd):
    bpy.ops.strata.build_compositor()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "built.blend"))
    linked = empty_scene()
    with bpy.data.libraries.load(str(tmp_path / "built.blend"), link=True) as (_, taken):
        taken.objects = ["Sun"]
    linked.collection.objects.link(*taken.objects)
    with pytest.raises(RuntimeError, match="Still without a shadow: Sun: linked from a library"):
        bpy.ops.strata.restore_shadows()
    lamp(linked, "POINT", (0, 0, 3), 100, use_shadow=False, strata_shadow_composited=True)
    lines = told(capfd, bpy.ops.strata.restore_shadows)
    assert lines[0].startswith(
        "Still without a shadow: Sun: linked from a library and cannot be changed here"
    )
    assert lines[1:] == ["Cast their own shadows again: Point"]
    assert not bpy.ops.strata.restore_shadows.poll()


@pytest.mark.parametrize("output", ["both.exr", "{view_layer_name}.exr"])
def test_every_view_layer_that_renders_is_shadowed(scene, tmp_path, output):
    """Where the tree shows it; light groups are on all of them. Both are in one file, or each in its own."""
    scene.view_layers.new("Second")
    scene.strata.output = str(tmp_path / output)
    path, size = str(tmp_path / "both.blend"), "x".join(map(str, SIZE))
    bpy.ops.wm.save_as_mainfile(filepath=path)
    names = ["all"] if output == "both.exr" else [layer.name for layer in scene.view_layers]
    for name in names:
        out = str(tmp_path / output.format(view_layer_name=name))
        flags = ["--view-layer", name, "--size", size, "--backend", "cpu", "-q"]
        assert main(["bake", path, "-o", out, *flags]) == 0
    bpy.ops.wm.open_mainfile(filepath=path)
    scene, second = bpy.context.scene, bpy.context.scene.view_layers["Second"]
    tree = bpy.data.node_groups.new("Mine", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    mine, end = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("NodeGroupOutput")
    mine.scene, mine.layer = scene, "Second"
    tree.links.new(mine.outputs["Image"], end.inputs[0])
    scene.compositing_node_group = tree
    bpy.ops.strata.build_compositor()
    by_light = {la.light: la.pixels for la in read_layers(out).layers if la.effect == "soft_shadow"}
    assert {group.name for group in second.lightgroups} == set(by_light)
    expect(composited(scene, tmp_path), summed(*by_light.values()))


def test_a_view_layer_with_nothing_left_to_join_loses_its_nodes(scene):
    """Its lamps may cast their own shadows again."""
    bpy.ops.strata.build_compositor()
    tree, old = scene.compositing_node_group, scene.view_layers["ViewLayer"]
    apart = bpy.data.collections.new("Lamps")
    scene.collection.children.link(apart)
    for lamp in lamps(scene).values():
        for collection in lamp.users_collection:
            collection.objects.unlink(lamp)
        apart.objects.link(lamp)
    old.name = "Old"
    scene.view_layers.new("ViewLayer")  # that of the file
    old.layer_collection.children["Lamps"].exclude = True
    (before,) = (node for node in tree.nodes if node.type == "R_LAYERS")
    assert before.layer == "Old"
    (end,) = (node for node in tree.nodes if node.type == "GROUP_OUTPUT")
    layers, mixed = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeAlphaOver")
    layers.scene, layers.layer = scene, "ViewLayer"
    tree.links.new(tree.nodes[GROUP_NAME].outputs["Image"], mixed.inputs["Background"])
    tree.links.new(layers.outputs["Image"], mixed.inputs["Foreground"])
    tree.links.new(mixed.outputs["Image"], end.inputs[0])
    bpy.ops.strata.build_compositor()
    (ours,) = (node for node in tree.nodes if node.type == "GROUP")
    assert mixed.inputs["Background"].links[0].from_node == before
    assert mixed.inputs["Foreground"].links[0].from_node == ours
    assert ours.inputs["Image"].links[0].from_node == layers


def test_layers_that_are_no_shadows_are_told(scene, tmp_path, capfd):
    scene.strata.toon.enabled = True
    scene.strata.output = str(tmp_path / "toon.exr")
    bpy.ops.strata.bake()
    (told,) = (line for line in built(capfd) if line.startswith("Not joined, as they are no shadows: "))
    assert "Toon" in told
    expect(composited(scene, tmp_path), summed(*shadows(scene).values()))


def test_the_panel_looks_for_the_file_of_a_view_layer_that_renders(scene, courtyard):
    (courtyard / "ViewLayer.exr").write_bytes((courtyard / "baked.exr").read_bytes())
    scene.strata.output = "//{view_layer_name}.exr"
    bpy.context.window.view_layer = scene.view_layers.new("Second")
    assert "There is no" in draw.unjoinable(bpy.context)
    bpy.context.view_layer.use = False
    assert not draw.unjoinable(bpy.context)
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}


class Shown:
    """Stands in for a panel's layout, which only a window has: what labels and buttons say."""

    def __init__(self):
        self.words = []

    def prop(self, *_, **__): ...

    def label(self, text, icon):
        self.words.append(text)

    def operator(self, name, text, icon):
        self.words.append(name)


def test_a_lamp_that_is_shadowed_twice_is_told_the_way_out(scene):
    bpy.ops.strata.build_compositor()
    for effect in EFFECTS:
        getattr(scene.strata, effect.id).enabled = False
    light = lamps(scene)["Sun"].data
    for use_shadow, words in (
        (False, "Shadow from compositor"),
        (True, "Shadowed twice: switch Cast Shadow off, or give the shadows back"),
    ):
        light.use_shadow, shown = use_shadow, Shown()
        rows.own_settings(shown, light, "Light", scene)
        assert " ".join(shown.words) == f"{words} strata.restore_shadows"


# What is baked of a marked lamp


def test_a_marked_lamp_casts_a_shadow_for_strata(scene, tmp_path, capfd):
    before = shadows(scene)
    bpy.ops.strata.build_compositor()
    scene.strata.output = str(tmp_path / "again.exr")
    bpy.ops.strata.bake()
    again = shadows(scene)
    assert list(again) == list(before)
    for name in before:
        np.testing.assert_array_equal(again[name], before[name])
    names = {kind.name for kind in passes.registered(scene, bpy.context.view_layer)}
    assert {f"Soft Shadow {name}" for name in before} <= names
    path = str(tmp_path / "marked.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    capfd.readouterr()
    assert main(["plan", path]) == 0
    assert "switched off" not in capfd.readouterr().out


# What is refused


def test_renders_that_cannot_have_it_are_refused_before_the_press(scene):
    for engine in ("STRATA", "BLENDER_EEVEE", "BLENDER_WORKBENCH"):
        scene.render.engine = engine
        assert not bpy.ops.strata.build_compositor.poll(), engine
    scene.render.engine = "FLAT"
    assert bpy.ops.strata.build_compositor.poll()
    scene.render.use_multiview = True
    assert not bpy.ops.strata.build_compositor.poll()


def larger(scene):
    scene.render.resolution_percentage = 200


def cropped(scene):
    scene.render.use_border = scene.render.use_crop_to_border = True
    scene.render.border_max_x = 0.5


def other_camera(scene):
    scene.camera = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))


def other_view_layer(scene):
    scene.view_layers.new("Second")


def no_view_layer(scene):
    bpy.context.view_layer.use = False


def nowhere(scene):
    scene.strata.output = "//none.exr"


def no_exr(scene):
    scene.strata.output = "//scene.blend"


def tree_of_a_user(scene) -> bpy.types.NodeTree:
    """With nothing but a way out."""
    tree = bpy.data.node_groups.new("Mine", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree.nodes.new("NodeGroupOutput")
    scene.compositing_node_group = tree
    return tree


def render_layers_in_a_group(scene):
    inner = bpy.data.node_groups.new("Inner", "CompositorNodeTree")
    inner.nodes.new("CompositorNodeRLayers")
    tree_of_a_user(scene).nodes.new("CompositorNodeGroup").node_tree = inner


def linked_nodes(scene):
    bpy.data.libraries.write(path := bpy.path.abspath("//nodes.blend"), {tree_of_a_user(scene)})
    with bpy.data.libraries.load(path, link=True) as (_, taken):
        taken.node_groups = ["Mine"]
    (scene.compositing_node_group,) = taken.node_groups


def only_the_noisy_image(scene):
    tree, FlatEngine.is_denoised = tree_of_a_user(scene), True
    layers, denoise = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeDenoise")
    bpy.context.view_layer.update_render_passes()
    tree.links.new(layers.outputs["Noisy Image"], denoise.inputs["Image"])
    tree.links.new(denoise.outputs["Image"], tree.nodes["Group Output"].inputs[0])
    tree.links.new(layers.outputs["Image"], tree.nodes.new("CompositorNodeViewer").inputs["Image"])


def only_alpha(scene):
    tree = tree_of_a_user(scene)
    layers = tree.nodes.new("CompositorNodeRLayers")
    tree.links.new(layers.outputs["Alpha"], tree.nodes["Group Output"].inputs[0])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (nowhere, "none.exr: bake to a file first"),
        (no_exr, "There is no"),
        (larger, "The file has 32 x 18 pixels and the render 64 x 36: bake again"),
        (cropped, "The render is cropped to its region and the file is not: bake again"),
        (other_camera, "and the scene renders from 'Other': bake again"),
        (other_view_layer, "view layer 'Second' renders too and has no shadow of it: bake that as well"),
        (no_view_layer, "no view layer renders"),
        (
            tree_of_a_user,
            "the compositor has no Render Layers node of view layer 'ViewLayer' at its top level",
        ),
        (render_layers_in_a_group, "no Render Layers node of view layer 'ViewLayer' at its top level"),
        (linked_nodes, "the compositor's nodes 'Mine' are linked from a library and cannot be changed"),
        (only_the_noisy_image, "for view layer 'ViewLayer' nothing does, only Noisy Image: use Image"),
        (only_alpha, "for view layer 'ViewLayer' nothing does: use Image"),
    ],
)
def test_a_file_that_does_not_fit_is_refused_and_nothing_changes(scene, change, reason):
    change(scene)
    before = everything(scene)
    assert reason in refused()
    assert everything(scene) == before


def test_an_engine_without_light_groups_is_refused_and_nothing_changes(scene):
    FlatEngine.has_groups = False
    bpy.context.view_layer.update_render_passes()
    before = everything(scene)
    assert "FLAT renders no light groups" in refused()
    assert everything(scene) == before


def test_whatever_fails_leaves_each_lamp_a_shadow(scene, monkeypatch):
    def fails(*_):
        raise MemoryError

    monkeypatch.setattr(shadow_nodes, "_fill", fails)
    assert "not enough memory" in refused()
    assert all(lamp.data.use_shadow for lamp in lamps(scene).values())
    assert not any(lamp.data.strata_shadow_composited for lamp in lamps(scene).values())
    assert not bpy.context.view_layer.lightgroups


def test_a_file_of_a_render_region_does_not_do_for_more(scene, tmp_path):
    render = scene.render
    scene.strata.output = str(tmp_path / "part.exr")
    render.use_border, render.border_max_x = True, 0.5
    bpy.ops.strata.bake()
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    render.border_max_x = 0.25
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    for wider in (True, False):
        render.use_border, render.border_max_x = wider, 0.75
        assert "The file has shadows in its render region only, and the render is larger" in refused()
    render.use_border, render.border_max_x, scene.strata.exr.window = True, 0.5, "region"
    bpy.ops.strata.bake()
    assert "which Blender's compositor misplaces: bake with Window set to Frame" in refused()
    scene.strata.exr.window, render.use_crop_to_border = "frame", True
    bpy.ops.strata.bake()
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    render.border_min_x, render.border_max_x = 0.25, 0.75
    assert "The file is cropped to another region than the render" in refused()
    render.use_crop_to_border = False
    assert "The file is cropped to a render region and the render is not" in refused()


def test_what_layers_do_not_know_is_warned_of(scene, capfd):
    scene.render.use_motion_blur = True
    assert "Motion blur is not read, layers show one instant" in built(capfd)


@pytest.mark.parametrize(
    "content", [b"", b"BLENDER17-01v0502", b"\x76\x2f\x31\x01\x02\x04\x00\x00channels\x00chlist"]
)
def test_what_is_no_exr_file_is_said(scene, tmp_path, content):
    scene.strata.output = str(tmp_path / "broken.exr")
    (tmp_path / "broken.exr").write_bytes(content)
    assert "broken.exr is no OpenEXR file" in refused()


def test_a_header_is_read_as_openexr_reads_it(courtyard):
    found = header_of(courtyard / "baked.exr")
    with OpenEXR.File(str(courtyard / "baked.exr"), separate_channels=True) as file:
        assert len(found.parts) == len(file.parts)
        for part, theirs in zip(found.parts, file.parts, strict=True):
            header = theirs.header
            assert part.channels == tuple(sorted(theirs.channels))
            for ours, name in ((part.data_window, "dataWindow"), (part.display_window, "displayWindow")):
                assert ours == tuple(int(n) for corner in header[name] for n in corner)
            texts = {
                name: value for name, value in header.items() if isinstance(value, str) and name != "name"
            }
            assert {name: part.texts[name] for name in texts} == texts
    assert found.size == SIZE
