"""Which lamps are joined: a user's light groups, view layers, libraries, and lamps that are told apart."""

from __future__ import annotations

import bpy
import pytest
from strata.addon.effects.registry import EFFECTS
from strata.addon.layers.exr_header import header_of
from strata.addon.layers.shadow_nodes import GROUP_NAME
from strata.addon.ui import last_bake, rows
from strata.ops.cli import main
from strata.tests.layers.compositor.scene import (
    SIZE,
    add_lamp,
    built,
    composited,
    expect,
    lamps,
    refused,
    shadows,
    small,
    summed,
    told,
)
from strata.tests.support.exr_layers import read_layers
from strata.tests.support.scan_scenes import empty_scene


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
    add_lamp(linked, "POINT", (0, 0, 3), 100, use_shadow=False, strata_shadow_composited=True)
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
    assert "There is no" in last_bake.unjoinable(bpy.context)
    bpy.context.view_layer.use = False
    assert not last_bake.unjoinable(bpy.context)
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
