"""What may change in a sequence: found whatever frames are looked at, and quickly."""

from __future__ import annotations

import bpy
import pytest
from strata.addon.scene.changing import may_change, may_make_lamps
from strata.addon.sequence import sequence_layers
from strata.addon.ui.properties import options_of
from strata.tests.bake.sequence_scenes import box, keyed, lamp, names_of

pytestmark = pytest.mark.usefixtures("registered")


def animate_material(scene):
    material = bpy.data.materials.new("Material")
    material.node_tree.nodes["Principled BSDF"].inputs["Alpha"].keyframe_insert("default_value", frame=1)


def drive(scene):
    bpy.data.objects["Key"].driver_add("hide_render").driver.expression = "frame > 2"


def bind_marker(scene):
    scene.timeline_markers.new("Cut", frame=2).camera = scene.camera


def time_in_nodes(scene):
    group = bpy.data.node_groups.new("Group", "GeometryNodeTree")
    inner = bpy.data.node_groups.new("Inner", "GeometryNodeTree")
    inner.nodes.new("GeometryNodeInputSceneTime")
    group.nodes.new("GeometryNodeGroup").node_tree = inner
    bpy.data.objects["Crate"].modifiers.new("Nodes", "NODES").node_group = group


def shape_keys(scene):
    crate = bpy.data.objects["Crate"]
    crate.shape_key_add(name="Basis")
    crate.shape_key_add(name="Other").keyframe_insert("value", frame=1)


@pytest.mark.parametrize(
    "change",
    [
        animate_material,
        drive,
        bind_marker,
        time_in_nodes,
        shape_keys,
        lambda scene: bpy.data.objects["Crate"].modifiers.new("Cloth", "CLOTH"),
        lambda scene: bpy.data.objects["Crate"].modifiers.new("Build", "BUILD"),
        lambda scene: bpy.data.objects["Crate"].modifiers.new("Particles", "PARTICLE_SYSTEM"),
        lambda scene: setattr(bpy.data.images.new("Movie", 4, 4), "source", "SEQUENCE"),
        lambda scene: bpy.ops.rigidbody.world_add(),
        lambda scene: scene.strata.soft_shadow.keyframe_insert("layers", frame=1),
    ],
)
def test_what_may_change_is_found(scene, change):
    change(scene)
    assert may_change(scene)


def test_lamps_that_come_and_go_belong_to_every_frame(scene):
    keyed(lamp("Torch").data, "energy", f1=0.0, f3=100.0, f4=0.0)
    keyed(lamp("Hidden"), "hide_render", f1=True, f2=False, f3=True)
    keyed(lamp("Far", place=(500.0, 0.0, 4.0)), "location", f1=(500, 0, 4), f4=(1, 0, 4))
    lamp("Dark", energy=0.0)
    lamp("Shadowless").data.use_shadow = False
    lamp("Off").hide_render = True
    expected = ["Far", "Hidden", "Key", "Torch"]
    scene.frame_set(2)
    assert names_of(scene, (1, 2, 3, 4, 9)) == [f"Soft Shadow {name}" for name in expected]
    assert scene.frame_current == 2


def test_a_fog_that_fades_and_settings_that_change(scene):
    world = scene.world = bpy.data.worlds.new("World")
    fog = world.node_tree.nodes.new("ShaderNodeVolumeScatter")
    output = world.node_tree.nodes["World Output"]
    world.node_tree.links.new(fog.outputs["Volume"], output.inputs["Volume"])
    density = fog.inputs["Density"]
    for frame, value in ((1, 0.0), (2, 0.0), (3, 0.1), (4, 0.0)):
        density.default_value = value
        density.keyframe_insert("default_value", frame=frame)
    assert names_of(scene, (1, 3)) == ["Soft Shadow Key", "Volumetric Key", "Transmittance"]
    scene.strata.toon.enabled = True
    scene.strata.toon.keyframe_insert("enabled", frame=3)
    scene.strata.toon.enabled = False
    scene.strata.toon.keyframe_insert("enabled", frame=1)
    scene.strata.toon.keyframe_insert("enabled", frame=4)
    assert "Toon" in names_of(scene, (1, 3))


def test_looking_ends_as_soon_as_everything_is_found(scene):
    keyed(lamp("Torch").data, "energy", f1=0.0, f3000=100.0)
    lamp("Dark", energy=0.0)
    scene.frame_end = 4000
    shares = []
    sequence_layers(scene, scene.view_layers[0], options_of, (1,), show=lambda s, _: shares.append(s))
    assert len(shares) == 2  # frame 1, and the last


def test_looking_can_be_interrupted(scene):
    keyed(lamp("Torch").data, "energy", f1=0.0, f2=0.0)
    scene.frame_end = 4000

    def show(share, stage):
        if share > 0.001:
            raise KeyboardInterrupt

    scene.frame_set(3)
    with pytest.raises(KeyboardInterrupt):
        sequence_layers(scene, scene.view_layers[0], options_of, (1,), show=show)
    assert scene.frame_current == 3


def test_markers_switch_the_camera_while_looking(scene):
    """Only the second camera sees a lamp's crate."""
    box("Lonely", 1, (100, 0, 0))
    lamp("Remote", "SPOT", (100, 0, 4))
    away = bpy.data.objects.new("Away", bpy.data.cameras.new("Away"))
    away.location = (100.3, 0, 12)
    scene.collection.objects.link(away)
    box("Plate", 8, (100, 0, -5))
    scene.timeline_markers.new("Here", frame=1).camera = first = scene.camera
    assert names_of(scene) == ["Soft Shadow Key"]
    scene.timeline_markers.new("There", frame=3).camera = away
    assert names_of(scene, (1, 3)) == ["Soft Shadow Key", "Soft Shadow Remote"]
    assert scene.camera == first


def lamp_on_faces(scene):
    bpy.data.objects["Crate"].instance_type = "FACES"
    bpy.data.objects["Key"].parent = bpy.data.objects["Crate"]


def nodes_with(node: str, socket: str, value):
    tree = bpy.data.node_groups.new("Tree", "GeometryNodeTree")
    tree.nodes.new(node).inputs[socket].default_value = value
    bpy.data.objects["Crate"].modifiers.new("Nodes", "NODES").node_group = tree


def lamp_in_nodes(scene):
    nodes_with("GeometryNodeObjectInfo", "Object", bpy.data.objects["Key"])


def collection_in_nodes(scene):
    inner, outer = bpy.data.collections.new("Inner"), bpy.data.collections.new("Outer")
    inner.objects.link(bpy.data.objects["Key"])
    outer.children.link(inner)
    nodes_with("GeometryNodeCollectionInfo", "Collection", outer)


def lamp_of_particles(scene):
    settings = (
        bpy.data.objects["Crate"].modifiers.new("Particles", "PARTICLE_SYSTEM").particle_system.settings
    )
    settings.render_type, settings.instance_object = "OBJECT", bpy.data.objects["Key"]


@pytest.mark.parametrize("make", [lamp_on_faces, lamp_in_nodes, collection_in_nodes, lamp_of_particles])
def test_lamps_that_only_an_evaluation_shows_are_expected(scene, make):
    nodes_with("GeometryNodeObjectInfo", "Object", bpy.data.objects["Floor"])
    assert not may_make_lamps()
    make(scene)
    assert may_make_lamps()
