"""What lamps are called in passes: one rule for a bake, the render engine and compositor nodes."""

from __future__ import annotations

import math
import random

import bpy
import pytest
import strata
from strata.addon.core.naming import LONGEST, LONGEST_TITLE, layer_name, named_some, some_frames
from strata.addon.core.roles import Subject
from strata.addon.effects.registry import EFFECTS
from strata.addon.engine import passes
from strata.addon.layers.shadow_nodes import GROUP_NAME
from strata.addon.scene.lamp_names import LampNames
from strata.addon.scene.render_depsgraph import with_render_depsgraph
from strata.addon.scene.scan import scan
from strata.ops.cli import main
from strata.tests.support.exr_layers import read_layers
from strata.tests.support.render_passes import read_passes, write_multilayer
from strata.tests.support.scan_scenes import empty_scene


@pytest.fixture(scope="module", autouse=True)
def registered():
    strata.register()
    yield
    strata.unregister()


def lamp(name: str, collection=None, place=(0.0, 0.0, 4.0), energy=100.0):
    made = bpy.data.objects.new(name, bpy.data.lights.new(name, "POINT"))
    assert made.name == name
    made.location, made.data.energy, made.data.shadow_soft_size = place, energy, 0.1
    (collection or bpy.context.scene.collection).objects.link(made)
    return made


def plane(name: str, side: float, height: float, collection=None):
    mesh, h = bpy.data.meshes.new(name), side / 2
    mesh.from_pydata([(-h, -h, 0), (h, -h, 0), (h, h, 0), (-h, h, 0)], [], [(0, 1, 2, 3)])
    made = bpy.data.objects.new(name, mesh)
    made.location = (0, 0, height)
    (collection or bpy.context.scene.collection).objects.link(made)
    return made


def collection_instance(name: str, of, collection=None):
    made = bpy.data.objects.new(name, None)
    made.instance_type, made.instance_collection = "COLLECTION", of
    (collection or bpy.context.scene.collection).objects.link(made)
    return made


@pytest.fixture
def scene():
    """A box over a floor, looked at from above beside it, small."""
    scene = empty_scene()
    scene.camera.location = (0, 0, 12)
    plane("Floor", 8, 0)
    plane("Roof", 1, 1)
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.strata.backend, scene.strata.samples, scene.strata.probes = "cpu", 1, 0
    scene.strata.volumetric_light.enabled, scene.strata.soft_shadow.resolution = False, 128
    return scene


def scanned(scene, frame=None) -> dict[str, str]:
    """Pass names by name for people."""

    def look(depsgraph):
        return [(light.name, light.pass_name) for light in scan(depsgraph).outline.lights]

    found = with_render_depsgraph(scene, scene.view_layers[0], look, frame)
    assert len({name for _, name in found}) == len(found)
    return dict(found)


def odd_names() -> list[str]:
    long = "Straßenlaterne mit einem sehr langen Namen über der alten Brücke am Fluß, Nummer 10000"
    return [
        "Key.001",
        "Key_001",
        "灯" * 60,
        long + "1",
        long + "2",
        "tab\there",
        "a/b:c",
        "-",
        "Rim-",
        "Rim_",
    ]


def test_odd_names_are_safe_short_and_apart(scene):
    for name in odd_names():
        lamp(name)
    found = scanned(scene)
    assert set(found) == set(odd_names())
    for name in found.values():
        assert "." not in name
        assert not name.endswith("-")
        assert name.isprintable()
        assert len(layer_name("T" * LONGEST_TITLE, name).encode()) <= LONGEST
    assert (found["Key_001"], found["Rim_"], found["a/b:c"]) == ("Key_001", "Rim_", "a/b:c")
    assert found["Key.001"].startswith("Key_001 ")


def test_titles_leave_room_and_are_not_taken_for_one_another():
    titles = [kind.title for effect in EFFECTS for kind in effect.layers]
    of_lamps = [kind.title for effect in EFFECTS for kind in effect.layers if kind.of is Subject.LAMP]
    assert all(len(title.encode()) <= LONGEST_TITLE for title in of_lamps)
    assert not [(a, b) for a in of_lamps for b in titles if b.startswith(f"{a} ")]


def test_names_depend_on_no_order_power_visibility_or_frame(scene):
    """The same lamps, made in another order, some of them hidden or without power at another frame."""
    names = odd_names()
    for name in names:
        lamp(name)
    first = scanned(scene)
    for name in names:
        bpy.data.objects.remove(bpy.data.objects[name])
    random.Random(1).shuffle(names)
    for name in names:
        made = lamp(name)
        made.hide_render = name in names[:3]
        made.keyframe_insert("hide_render", frame=1)
        made.hide_render = False
        made.keyframe_insert("hide_render", frame=2)
        made.data.energy = 0.0
    scene.frame_end = 2
    assert len(scanned(scene, 1)) == len(names) - 3
    assert scanned(scene, 2) == first
    assert scanned(scene, 1).items() <= first.items()


def test_equal_names_from_two_libraries_and_the_file(scene, tmp_path):
    def found_with(libraries) -> set[str]:
        for name in libraries:
            with bpy.data.libraries.load(str(tmp_path / f"{name}.blend"), link=True) as (_, ours):
                ours.objects = ["Lamp"]
            scene.collection.objects.link(ours.objects[0])
        bpy.context.view_layer.update()
        names = LampNames()
        return {n.key: n.pass_name for n in names.standing(scene.view_layers[0])}

    for name in ("a", "b"):
        made = lamp("Lamp")
        bpy.data.libraries.write(str(tmp_path / f"{name}.blend"), {made})
        bpy.data.objects.remove(made)
    alone = found_with("a")
    assert alone == {"Lamp [a.blend]": "Lamp"}
    both = found_with("b")
    assert len(set(both.values())) == 2
    assert "Lamp" not in both.values()
    lamp("Lamp")
    three = found_with("")
    assert three["Lamp"] == "Lamp"
    assert both.items() <= three.items()
    assert dict(scanned_pairs(scene)) == three


def scanned_pairs(scene):
    def look(depsgraph):
        return [(light.key, light.pass_name) for light in scan(depsgraph).outline.lights]

    return with_render_depsgraph(scene, scene.view_layers[0], look)


def street(scene):
    """Lamps by nested collection instances, geometry nodes' faces and by themselves."""
    post = bpy.data.collections.new("Post")
    lamp("Bulb", post, (0.5, 0, 3))
    lamp("Glow", post, (-0.5, 0, 3))
    row = bpy.data.collections.new("Row")
    for x in (-1, 1):
        collection_instance(f"Post {x}", post, row).location = (x, 0, 0)
    for name, y in (("North", 1.0), ("South", -1.0)):
        collection_instance(name, row).location = (0, y, 0)
    lamp("Bulb North")  # as an instance of "Bulb" by "North" would be called
    collection_instance("North.001", post)
    holder = plane("Faces", 2, 2)
    holder.instance_type, holder.show_instancer_for_render = "FACES", False
    lamp("Candle", place=(0, 0, 3)).parent = holder
    mesh = holder.data
    mesh.clear_geometry()
    mesh.from_pydata([(x, y, 0) for y in (0, 1) for x in (0, 1, 2)], [], [(0, 1, 4, 3), (1, 2, 5, 4)])


def test_instanced_lamps_have_names_of_their_own(scene):
    street(scene)
    pairs = scanned_pairs(scene)
    names = [name for _, name in pairs]
    assert len(set(names)) == len(names) == 2 * 2 * 2 + 1 + 2 + 2
    assert "Bulb Post 1 North" in names
    assert "Bulb North" in names
    assert "Bulb North_001" in names
    assert sum(name.startswith("Candle Faces ") for name in names) == 2
    bpy.data.objects["Post -1"].hide_render = True
    fewer = [name for _, name in scanned_pairs(scene)]
    assert set(fewer) == {name for name in names if "Post -1" not in name}


def test_engine_and_command_agree_on_names(scene, tmp_path):
    street(scene)
    for name in ("Lamp.001", "Lamp_001", "Long " * 12):
        lamp(name)
    lamp("Dark", energy=0.0)
    lamp("Hidden").hide_render = True
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    assert main(["bake", str(blend), "-o", str(tmp_path / "baked.exr"), "-q"]) == 0
    layers = read_layers(tmp_path / "baked.exr").layers
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    scene = bpy.context.scene
    standing = {kind.name for kind in passes.registered(scene, scene.view_layers[0])}
    baked = {layer.name for layer in layers}
    assert baked - standing == {n for n in baked if "Candle" in n}
    assert standing - baked == {"Soft Shadow Dark", "Soft Shadow Candle"}  # the candle itself is not shown
    originals = {layer.name: layer.light for layer in layers}
    assert originals["Soft Shadow Lamp_001"] == "Lamp_001"
    assert {"Lamp.001", "Bulb Post 1 North"} <= set(originals.values())
    scene.render.engine, scene.render.use_compositing = "STRATA", False
    write_multilayer(scene, tmp_path / "render.exr")
    bpy.ops.render.render(write_still=True)
    rendered = read_passes(tmp_path / "render.exr")
    assert set(rendered) == {f"ViewLayer.{name}" for name in {"Combined"} | baked | standing}
    for layer in layers:
        assert (rendered[f"ViewLayer.{layer.name}"] == layer.pixels).all(), layer.name
    for name in standing - baked:
        assert (rendered[f"ViewLayer.{name}"] == 1.0).all()


def test_compositor_finds_every_lamp_and_names_the_others(scene, tmp_path, capfd):
    """Lamps of instances share a light group with others, whichever object is put into it."""
    street(scene)
    for name in ("Lamp.001", "Lamp_001"):
        lamp(name)
    path = tmp_path / "baked.exr"
    scene.strata.save_to, scene.strata.output = "FILE", str(path)
    assert bpy.ops.strata.bake() == {"FINISHED"}
    scene.render.engine = "CYCLES"
    capfd.readouterr()
    assert bpy.ops.strata.build_compositor() == {"FINISHED"}
    names = {layer.name for layer in read_layers(path).layers}

    def joined() -> set[str]:
        links = bpy.data.node_groups[GROUP_NAME].links
        return {link.from_socket.name for link in links if link.from_node.type == "IMAGE"}

    def told() -> dict[str, str]:
        lines = [line.split(": ") for line in capfd.readouterr().out.splitlines()]
        return {line[2]: line[3] for line in lines if line[1] == "Not joined"}

    (hashed,) = (name for name in names if name.startswith("Soft Shadow Lamp_001 "))
    assert joined() == {"Soft Shadow Bulb North", "Soft Shadow Lamp_001", hashed}
    alone = "no object that shows it alone can be put into a light group"
    assert told() == dict.fromkeys(names - joined(), alone)
    bpy.data.objects["Lamp.001"].name = "Other"
    bpy.ops.strata.build_compositor()
    assert told()[hashed] == "no lamp that renders has it"
    assert joined() == {"Soft Shadow Bulb North", "Soft Shadow Lamp_001"}


def test_an_instancer_that_shows_one_lamp_gives_it_its_light_group(scene, tmp_path, capfd):
    """A street of lanterns, instances of one collection. A surface that shines would be in the group too."""
    lantern = bpy.data.collections.new("Lantern")
    bulb = lamp("Bulb", lantern, (0, 0, 3))
    bulb.data.type = "SPOT"
    for name, x in (("West", -1.0), ("East", 1.0), ("Upwards", 2.0)):
        collection_instance(name, lantern).location = (x, 0, 0)
    bpy.data.objects["Upwards"].rotation_euler = (math.pi, 0, 0)
    bpy.data.objects["Upwards"].location.z = 30.0
    scene.render.resolution_x = scene.render.resolution_y = 96  # a look of one pixel rules no lamp out
    scene.strata.save_to, scene.strata.output = "FILE", str(tmp_path / "baked.exr")
    bpy.ops.strata.bake()
    scene.render.engine = "CYCLES"
    bpy.ops.strata.build_compositor()
    instancers = [bpy.data.objects[name] for name in ("West", "East", "Upwards")]
    assert [thing.lightgroup for thing in instancers] == ["Bulb West", "Bulb East", ""]
    assert (bulb.lightgroup, bulb.data.use_shadow) == ("", False)
    bpy.ops.strata.restore_shadows()
    assert bulb.data.use_shadow
    glass = plane("Glass", 0.1, 3.2, lantern)
    glow = bpy.data.materials.new("Glow")
    glow.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 1.0
    glass.data.materials.append(glow)
    with pytest.raises(RuntimeError, match="it shares light group 'Bulb East' with 'East'"):
        bpy.ops.strata.build_compositor()
    assert bulb.data.use_shadow


def test_many_are_told_by_the_first():
    assert named_some(["a", "b", "c"]) == "'a', 'b', 'c'"
    assert named_some(["a", "b", "c", "d", "e"]) == "'a', 'b', 'c' and 2 more"
    assert some_frames(range(1, 11)) == "1, 2, 3, 4, 5, 6, 7, 8, 9, 10"
    assert some_frames(range(1, 12)) == "1, 2, 3, 4, 5, 6, 7, 8, 9, 10, ..."
