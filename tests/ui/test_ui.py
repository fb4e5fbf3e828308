"""Properties, presets and panels without a window: what is set is kept, and what was registered goes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from strata.addon.bake import read_scene
from strata.addon.effects.registry import EFFECTS
from strata.addon.effects.toon.params import ToonParams
from strata.addon.planning import TARGET_ERROR, Options
from strata.addon.preview.control import preview_options
from strata.addon.scene.open import open_blend
from strata.addon.ui import migration, panels, preferences
from strata.addon.ui.preview_settings import frame_budget_ms_of
from strata.addon.ui.properties import options_of
from strata.tests.support.places import SAMPLES


def a_lamp() -> bpy.types.Object:
    return next(thing for thing in bpy.context.scene.objects if thing.type == "LIGHT")


def test_settings_of_scene_and_light_survive_saving_and_opening(scene, tmp_path):
    lamp = a_lamp()
    scene.strata.samples, scene.strata.save_to = 3, "FILE"
    scene.strata.soft_shadow.method = "hybrid"
    lamp.data.strata.use_own = True
    lamp.data.strata.soft_shadow.method, lamp.data.strata.soft_shadow.rays = "area", 17
    name, path = lamp.name, str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    settings, light = bpy.context.scene.strata, bpy.data.objects[name].data.strata
    assert (settings.samples, settings.save_to, settings.soft_shadow.method) == (3, "FILE", "hybrid")
    assert (light.use_own, light.soft_shadow.method, light.soft_shadow.rays) == (True, "area", 17)
    assert settings.version == migration.VERSION


def test_a_limit_is_switched_on_and_off_by_its_box(scene):
    toon = scene.strata.toon
    assert not toon.crease_angle_is_set
    toon.crease_angle_is_set = True
    assert 0.1 < toon.crease_angle < 3.0
    toon.crease_angle_is_set = False
    chosen = options_of(scene, effects=("toon",)).chosen()[EFFECTS.named("toon")]
    assert chosen.crease_angle == ToonParams().crease_angle


@pytest.mark.parametrize(
    ("kind", "owner"), [("MESH", "Object"), ("LIGHT", "Light"), ("EMPTY", None), ("CAMERA", None)]
)
def test_only_what_has_settings_of_its_own_shows_them(scene, kind, owner):
    scene.strata.toon.enabled = True
    bpy.ops.object.empty_add()
    thing = next(each for each in scene.objects if each.type == kind)
    context = SimpleNamespace(scene=scene, object=thing)
    assert panels.STRATA_PT_object.poll(context) == (owner is not None)
    if owner:
        assert panels.STRATA_PT_object._owner(context)[1] == owner
    material = SimpleNamespace(scene=scene, material=bpy.data.materials.new("Paint"))
    assert panels.STRATA_PT_material.poll(material)
    scene.strata.toon.enabled = False
    assert not panels.STRATA_PT_material.poll(material)


def test_settings_survive_appending(scene, tmp_path):
    scene.strata.soft_shadow.layers, a_lamp().data.strata.soft_shadow.layers = 5, 6
    a_lamp().data.strata.use_own = True
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path) as (there, taken):
        taken.scenes = there.scenes
    (appended,) = taken.scenes
    lamp = next(thing for thing in appended.objects if thing.type == "LIGHT")
    assert appended.strata.soft_shadow.layers == 5
    assert (lamp.data.strata.use_own, lamp.data.strata.soft_shadow.layers) == (True, 6)


def test_settings_can_be_undone(scene):
    scene.strata.samples = 5
    bpy.ops.ed.undo_push(message="before")
    scene.strata.samples = 7
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert bpy.context.scene.strata.samples == 5
    bpy.ops.ed.redo()
    assert bpy.context.scene.strata.samples == 7


def old_file(tmp_path, stored: dict, keeps_samples: bool = True) -> str:
    """A file that an earlier Strata saved: without a version, with the properties of its time."""
    scene = bpy.context.scene
    scene.strata.samples = 6
    scene.strata.soft_shadow.layers = 2
    properties = scene.bl_system_properties_get()["strata"]
    properties.pop("version", None)
    for name in ("target_error", *([] if keeps_samples else ["samples"])):
        properties.pop(name)
    for name, value in stored.items():
        group, _, name = name.rpartition(".")
        (properties[group] if group else properties)[name] = value
    path = str(tmp_path / "old.blend")
    migration.unregister()  # which would write a version
    bpy.ops.wm.save_as_mainfile(filepath=path)
    migration.register()
    bpy.ops.wm.read_homefile(use_empty=True)
    return path


@pytest.mark.parametrize(
    ("stored", "save_to"),
    [
        ({"make_images": 0}, "FILE"),
        ({"output": ""}, "IMAGES"),
        ({"make_images": 1, "output": "//x.exr"}, "BOTH"),
        ({}, "BOTH"),
    ],
)
def test_an_older_files_settings_are_brought_up_to_date(scene, tmp_path, stored, save_to):
    # 31 bits of zlib.crc32(b"hybrid"), which is what 0.1.0 kept before it had versions.
    path = old_file(tmp_path, {**stored, "soft_shadow.method": 421353523})
    bpy.ops.wm.open_mainfile(filepath=path)
    settings = bpy.context.scene.strata
    assert (settings.version, settings.save_to) == (migration.VERSION, save_to)
    assert settings.output == stored.get("output") or settings.output == "//strata_####.exr"
    assert (settings.soft_shadow.method, settings.soft_shadow.layers, settings.samples) == ("hybrid", 2, 6)
    assert (settings.target_error, options_of(bpy.context.scene).samples) == (0.0, 6)
    assert "make_images" not in bpy.context.scene.bl_system_properties_get()["strata"]


@pytest.mark.parametrize(("version", "method"), [(4, "bitmask"), (migration.VERSION, "automatic")])
def test_an_older_file_keeps_the_maps_that_somebody_has_set(scene, tmp_path, version, method):
    """`old_file` has set their layers."""
    bpy.ops.wm.open_mainfile(filepath=old_file(tmp_path, {"version": version}))
    assert bpy.context.scene.strata.soft_shadow.method == method


def test_who_says_how_long_and_not_how_close_gets_all_that_there_is_time_for(scene):
    assert options_of(scene).target_error > 0.0
    assert options_of(scene, time_budget_s=3.0).target_error == 0.0
    assert options_of(scene, time_budget_s=3.0, target_error=0.01).target_error == 0.01
    scene.strata.target_error = 0.04
    assert options_of(scene, time_budget_s=3.0).target_error == pytest.approx(0.04)


def test_an_older_files_key_light_is_found_by_its_name(scene, tmp_path, capfd):
    name = a_lamp().name
    for told, found in ((name, name), ("Nobody", None)):
        open_blend(SAMPLES / "plain.blend")
        path = old_file(tmp_path, {"toon.key_light": told})
        bpy.ops.wm.open_mainfile(filepath=path)
        key = bpy.context.scene.strata.toon.key_light
        assert (key.name if key else None) == found
        assert ("'Nobody' is no lamp" in capfd.readouterr().err) == (found is None)


@pytest.mark.parametrize(("told", "found"), [("Key.001", "Key.001"), ("Key", None), ("Within Rig", "Within")])
def test_an_older_scenes_key_light_is_one_of_its_own(scene, tmp_path, told, found):
    """Not of another scene; also one that a collection's instance shows."""
    a_lamp().name = "Key.001"
    elsewhere = bpy.data.scenes.new("Elsewhere")
    elsewhere.collection.objects.link(bpy.data.objects.new("Key", bpy.data.lights.new("Key", "POINT")))
    within = bpy.data.collections.new("Lamps")
    within.objects.link(bpy.data.objects.new("Within", bpy.data.lights.new("Within", "POINT")))
    rig = bpy.data.objects.new("Rig", None)
    rig.instance_type, rig.instance_collection = "COLLECTION", within
    scene.collection.objects.link(rig)
    name = scene.name
    bpy.ops.wm.open_mainfile(filepath=old_file(tmp_path, {"toon.key_light": told}))
    key = bpy.data.scenes[name].strata.toon.key_light
    assert (key.name if key else None) == found


def test_a_key_light_keeps_its_lamp_when_that_is_renamed(scene):
    lamp = a_lamp()
    toon = EFFECTS.named("toon")
    scene.strata.toon.enabled, scene.strata.toon.key_light = True, lamp
    assert options_of(scene).chosen()[toon].key_light == lamp.name
    lamp.name = "Renamed"
    assert options_of(scene).chosen()[toon].key_light == "Renamed"
    _, graph, _, _ = read_scene(scene, scene.view_layers[0], options_of(scene))
    assert not any("there is no light" in entry.reason for entry in graph.left_out)
    assert options_of(scene, values={"toon": {"key_light": "Other"}}).chosen()[toon].key_light == "Other"


def test_an_older_scene_is_brought_up_to_date_when_appended(scene, tmp_path):
    path = old_file(tmp_path, {"make_images": 0})
    with bpy.data.libraries.load(path) as (there, taken):
        taken.scenes = there.scenes
    (appended,) = taken.scenes
    assert (appended.strata.version, appended.strata.save_to) == (migration.VERSION, "FILE")


def test_a_later_files_version_is_left_alone(scene, tmp_path):
    path = old_file(tmp_path, {"version": migration.VERSION + 5, "make_images": 0})
    bpy.ops.wm.open_mainfile(filepath=path)
    assert bpy.context.scene.strata.version == migration.VERSION + 5
    assert bpy.context.scene.strata.save_to == "BOTH"


def test_every_choice_can_be_animated():
    """A curve keeps numbers as float32, and Blender adds a half to round them."""
    for effect in EFFECTS:
        properties = getattr(bpy.context.scene.strata, effect.id).bl_rna.properties
        for found in properties:
            if found.type == "ENUM":
                numbers = [item.value for item in found.enum_items]
                assert len(set(numbers)) == len(numbers)
                assert all(int(np.float32(n) + np.float32(0.5)) == n for n in numbers), found.identifier


@pytest.mark.parametrize("path", sorted(SAMPLES.glob("*.blend")), ids=lambda path: path.stem)
def test_sample_scenes_open_with_what_they_show(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))
    settings = bpy.context.scene.strata
    assert settings.preview.on_opening
    assert settings.toon.enabled == (path.stem == "comic")
    assert settings.soft_shadow.enabled
    assert settings.volumetric_light.enabled
    spaces = [area.spaces.active for screen in bpy.data.screens for area in screen.areas]
    views = [space for space in spaces if space.type == "VIEW_3D"]
    assert views
    assert all(view.region_3d.view_perspective == "CAMERA" and view.show_region_ui for view in views)


def test_scenes_take_the_preferences_device_and_budget_unless_they_have_their_own(scene, monkeypatch):
    assert (options_of(scene).backend, frame_budget_ms_of(scene)) == ("auto", 33.0)  # there are none here
    monkeypatch.setattr(preferences, "_own", lambda: SimpleNamespace(backend="cpu", frame_budget_ms=50.0))
    assert (options_of(scene).backend, frame_budget_ms_of(scene)) == ("cpu", 50.0)
    assert options_of(scene, backend="gpu").backend == "gpu"
    scene.strata.backend, scene.strata.preview.frame_budget_ms_is_set = "auto", True
    assert (options_of(scene).backend, frame_budget_ms_of(scene)) == ("auto", 33.0)
    scene.strata.preview.frame_budget_ms_is_set = False
    assert frame_budget_ms_of(scene) == 50.0


def test_a_number_of_samples_is_kept_unless_an_error_or_a_time_is_asked_for_too(scene):
    scene.strata.target_error, scene.strata.time_budget_s = 0.01, 5.0
    assert (options_of(scene).target_error, options_of(scene).own_targets) == (pytest.approx(0.01), None)
    alone = options_of(scene, samples=8)
    assert (alone.samples, alone.target_error, alone.time_budget_s) == (8, 0.0, 0.0)
    assert alone.own_targets == {}
    for asked in ({"target_error": 0.02}, {"time_budget_s": 1.0}):
        most = options_of(scene, samples=32, **asked)
        assert (most.most_samples, most.own_targets) == (32, {} if "target_error" in asked else None)
        assert most.target_error == asked.get("target_error", pytest.approx(0.01))
    own = options_of(scene, samples=32, values={"soft_shadow": {"target_error": ".02"}})
    assert (own.most_samples, own.own_targets, own.target_error) == (32, None, pytest.approx(0.01))
    none = options_of(scene, samples=8, values={"soft_shadow": {"target_error": "0"}})
    assert (none.samples, none.aim, none.time_budget_s, none.own_targets) == (8, 0.0, 0.0, {})


def test_a_target_error_is_the_default_until_somebody_sets_samples(scene):
    assert options_of(scene).aim == pytest.approx(TARGET_ERROR)
    assert Options().aim == TARGET_ERROR
    assert (Options(samples=8).aim, Options(time_budget_s=1.0).aim) == (0.0, 0.0)
    scene.strata.samples = 16
    assert (scene.strata.target_error, options_of(scene).aim, options_of(scene).set_samples) == (0.0, 0.0, 16)
    scene.strata.target_error = 0.01
    scene.strata.samples = 4
    assert options_of(scene).aim == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("stored", "target"),
    [({}, TARGET_ERROR), ({"samples": 8}, 0.0), ({"time_budget_s": 2.0}, 0.0), ({"target_error": 0.1}, 0.1)],
)
def test_files_that_set_samples_or_a_time_keep_them(scene, tmp_path, stored, target):
    stored = {"version": 4, **stored}
    path = old_file(tmp_path, stored, keeps_samples=False)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert options_of(bpy.context.scene).aim == pytest.approx(target)


def test_the_preview_has_samples_of_its_own_if_asked(scene):
    settings = scene.strata
    settings.samples = 6
    assert preview_options(scene).samples == 6
    settings.preview.samples_is_set = True
    assert settings.preview.samples > 0
    settings.preview.samples = 6
    # Nothing else differs, so that where the samples are equal the preview ends at the bake's picture.
    own = replace(preview_options(scene), most_samples=settings.most_samples, own_targets=None)
    assert own == options_of(scene, composite=True, probes=0)
    settings.preview.samples = 2
    assert (preview_options(scene).samples, options_of(scene).samples) == (2, 6)
