"""Properties, presets and panels without a window: what is set is kept, and what was registered goes."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import strata
from strata.addon.bake import Options, plan_scene, read_scene
from strata.addon.effects.registry import EFFECTS, effect_named
from strata.addon.effects.toon.params import ToonParams
from strata.addon.measure.report import LayerError, NotMeasured
from strata.addon.preview.control import preview_options
from strata.addon.scene.open import choose, open_blend
from strata.addon.ui import migration, panels, plot, preferences
from strata.addon.ui.preview_settings import frame_budget_ms_of
from strata.addon.ui.properties import options_of
from strata.addon.ui.state import STATE, Mark
from strata.scripts.build import effect_presets
from strata.tests.support.places import SAMPLES


@pytest.fixture(scope="module", autouse=True)
def registered():
    strata.register()
    yield
    strata.unregister()


@pytest.fixture
def scene():
    open_blend(SAMPLES / "plain.blend")
    return bpy.context.scene


def a_lamp() -> bpy.types.Object:
    return next(thing for thing in bpy.context.scene.objects if thing.type == "LIGHT")


# Settings


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
    chosen = options_of(scene, effects=("toon",)).chosen()[effect_named("toon")]
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


def old_file(tmp_path, stored: dict) -> str:
    """A file that an earlier Strata saved: without a version, with the properties of its time."""
    scene = bpy.context.scene
    scene.strata.samples = 6
    scene.strata.soft_shadow.layers = 2
    properties = scene.bl_system_properties_get()["strata"]
    properties.pop("version", None)
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
    assert "make_images" not in bpy.context.scene.bl_system_properties_get()["strata"]


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
    toon = effect_named("toon")
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


# Preferences


def test_scenes_take_the_preferences_device_and_budget_unless_they_have_their_own(scene, monkeypatch):
    assert (options_of(scene).backend, frame_budget_ms_of(scene)) == ("auto", 33.0)  # there are none here
    monkeypatch.setattr(preferences, "_own", lambda: SimpleNamespace(backend="cpu", frame_budget_ms=50.0))
    assert (options_of(scene).backend, frame_budget_ms_of(scene)) == ("cpu", 50.0)
    assert options_of(scene, backend="gpu").backend == "gpu"
    scene.strata.backend, scene.strata.preview.frame_budget_ms_is_set = "auto", True
    assert (options_of(scene).backend, frame_budget_ms_of(scene)) == ("auto", 33.0)
    scene.strata.preview.frame_budget_ms_is_set = False
    assert frame_budget_ms_of(scene) == 50.0


def test_the_preview_has_samples_of_its_own_if_asked(scene):
    settings = scene.strata
    settings.samples = 6
    assert preview_options(scene).samples == 6
    settings.preview.samples_is_set = True
    assert settings.preview.samples > 0
    settings.preview.samples = 6
    # Nothing else differs, so that where the samples are equal the preview ends at the bake's picture.
    assert preview_options(scene) == options_of(scene, composite=True, probes=0)
    settings.preview.samples = 2
    assert (preview_options(scene).samples, options_of(scene).samples) == (2, 6)


# A light's own settings


def own_resolutions(scene, frame: int) -> dict[str, int]:
    """By light, the side of its first map, as a render at the frame plans it."""
    _, graph, _, _ = read_scene(scene, scene.view_layers[0], Options(backend="cpu"), frame=frame)
    found = {}
    for layer in graph.layers:
        maps = [node for node in graph.nodes([layer.node]) if node.step.name == "layered_depth"]
        found[layer.light] = max(node.params["width"] for node in maps)
    return found


def test_a_lights_own_settings_go_over_the_scenes():
    open_blend(SAMPLES / "courtyard.blend")
    scene = bpy.context.scene
    first = own_resolutions(scene, 1)
    name, *others = first
    lamp = bpy.data.objects[name].data
    lamp.strata.soft_shadow.resolution = 256
    assert own_resolutions(scene, 1) == first
    lamp.strata.use_own = True
    assert own_resolutions(scene, 1) == {**first, name: 256}
    assert others


def test_a_lights_own_settings_can_be_animated_and_driven():
    open_blend(SAMPLES / "courtyard.blend")
    scene = bpy.context.scene
    first, second, *_ = own_resolutions(scene, 1)
    for name in (first, second):
        bpy.data.objects[name].data.strata.use_own = True
    animated = bpy.data.objects[first].data
    for frame, resolution in ((1, 200), (9, 400)):
        animated.strata.soft_shadow.resolution = resolution
        animated.keyframe_insert("strata.soft_shadow.resolution", frame=frame)
    driver = bpy.data.objects[second].data.driver_add("strata.soft_shadow.resolution").driver
    driver.expression = "300 + frame"
    for frame, resolution in ((1, 200), (9, 400)):
        found = own_resolutions(scene, frame)
        assert (found[first], found[second]) == (resolution, 300 + frame)


def test_layers_say_the_settings_that_they_were_made_with(tmp_path):
    from strata.ops.cli import main
    from strata.tests.support.exr_layers import read_layers

    open_blend(SAMPLES / "courtyard.blend")
    lamp = next(thing for thing in bpy.context.scene.objects if thing.type == "LIGHT")
    lamp.data.strata.use_own, lamp.data.strata.soft_shadow.layers = True, 1
    name, blend, output = lamp.name, tmp_path / "scene.blend", tmp_path / "layers.exr"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    words = [
        "bake",
        str(blend),
        "-o",
        str(output),
        "--size",
        "64x36",
        "--samples",
        "1",
        "--probes",
        "0",
        "-q",
    ]
    assert main(words) == 0
    layers = {layer.light: layer.settings["layers"] for layer in read_layers(output).layers}
    assert layers.pop(name) == 1
    assert set(layers.values()) == {3}


# Presets


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.id)
def test_presets_are_taken_by_blender(scene, effect, tmp_path):
    effect_presets.write(tmp_path)
    getattr(scene.strata, effect.id).enabled = True
    for name, values in effect.presets.items():
        path = tmp_path / "strata" / effect.id / f"{name}.py"
        assert bpy.ops.strata.take_preset(filepath=str(path)) == {"FINISHED"}
        expected = effect.params.checked(effect.id, values).as_dict()
        taken = options_of(scene).chosen()[effect].as_dict()
        assert taken.keys() == expected.keys()
        for name, value in expected.items():  # properties are float32
            close = isinstance(value, (float, list))
            assert taken[name] == (pytest.approx(value, rel=1e-6) if close else value), name


def test_a_preset_can_be_added_and_removed(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(bpy.utils, "user_resource", lambda *_, **__: str(tmp_path))
    scene.strata.soft_shadow.layers = 7
    bpy.ops.strata.soft_shadow_preset_add(name="Mine")
    assert "settings.layers = 7" in (tmp_path / "Mine.py").read_text()


def test_an_older_presets_settings_are_taken_but_those_that_are_gone(scene, tmp_path):
    name = a_lamp().name
    (tmp_path / "toon").mkdir()
    path = tmp_path / "toon" / "Mine.py"
    toon = scene.strata.toon
    for key, found in (("", None), (name, name), ("Nobody", name)):
        path.write_text(
            "import bpy\n\nsettings = bpy.context.scene.strata.toon\n\nsettings.exposure = 1.5\n"
            f"settings.key_light = {key!r}\nsettings.gone = 3\nsettings.light = 'no such'\n"
            f"settings.rim_color = [0.0, 0.5, 1.0]\nsettings.outline_width_px = {len(key)}.5\n"
        )
        assert bpy.ops.strata.take_preset(filepath=str(path)) == {"FINISHED"}
        assert (toon.key_light.name if toon.key_light else None) == found
        assert (toon.exposure, *toon.rim_color, toon.outline_width_px) == (1.5, 0.0, 0.5, 1.0, len(key) + 0.5)
    path.write_text("settings.exposure = ")
    with pytest.raises(RuntimeError, match="cannot be read"):
        bpy.ops.strata.take_preset(filepath=str(path))


def test_a_lists_presets_are_taken_by_stratas_operator():
    for effect in EFFECTS:
        assert getattr(bpy.types, f"STRATA_PT_{effect.id}_presets").preset_operator == "strata.take_preset"


# The plot


def test_plot_puts_less_error_lower_and_more_time_to_the_right():
    curve = [Mark(0.1, 0.1), Mark(1.0, 0.001)]
    image = plot.draw([curve])
    assert image.shape == (plot.HEIGHT, plot.WIDTH, 4)
    is_curve = np.abs(image[:, :, :3] - plot.colour_of(0)).max(axis=2) < 0.01
    rows, columns = np.nonzero(is_curve)
    left, right = columns < plot.WIDTH // 4, columns > 3 * plot.WIDTH // 4
    assert rows[left].min() > 3 * plot.HEIGHT // 4
    assert rows[right].max() < plot.HEIGHT // 4
    assert right.sum() > 2 * left.sum(), "the last bake is the larger disk"


def test_plot_of_nothing_is_empty():
    assert np.ptp(plot.draw([])[:, :, 0]) < 0.2
    assert np.isfinite(plot.draw([[Mark(0.0, 0.1), Mark(1.0, 0.0)]])).all()


def test_history_is_kept_by_scene_and_is_bounded():
    error = LayerError("weighted rmse", 0.5, (0.4, 0.6), 0.0, 0.9, 1.0, 64, "ray traced", 0.01, 0.1)
    layers = [
        {"name": "A", "seconds": 1.0, "error": error.to_json()},
        {"name": "B", "seconds": 1.0},
        {"name": "C", "seconds": 1.0, "error": NotMeasured("no memory").to_json()},
    ]
    report = {"layers": layers}
    try:
        for _ in range(1000):
            STATE.show_report(-1, report)
        assert set(STATE.marks[-1]) == {"A"}
        assert 1 < len(STATE.marks[-1]["A"]) < 100
    finally:
        STATE.clear()


def test_plan_is_shown_beside_what_it_is_about(scene):
    chosen = choose()
    outline, graph, _, _ = read_scene(chosen.scene, chosen.view_layer, Options())
    STATE.show_plan(-1, plan_scene(outline, graph.shot, Options()))
    rows = STATE.plans[-1]
    assert {row.light for row in rows if not row.kept} >= {entry.light for entry in graph.left_out}
    assert all(row.reason for row in rows if not row.kept)
    STATE.clear()
