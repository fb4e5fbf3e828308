"""What a panel is told of a scene without asking: read from what the viewport shows, when there is time."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import pytest
from strata.addon.scene.open import open_blend
from strata.addon.ui import scene_plan, watching
from strata.addon.ui.scene_plan import ScenePlan
from strata.addon.ui.state import STATE
from strata.ops import bake
from strata.tests.support.places import SAMPLES


@pytest.fixture
def scene():
    open_blend(SAMPLES / "stacked.blend")
    scene = bpy.context.scene
    assert bpy.context.window.scene == scene
    yield scene
    STATE.clear()


@pytest.fixture
def scans(monkeypatch) -> list:
    """Gets one longer with each whole reading of a scene."""
    made = []

    def scan(*arguments):
        made.append(arguments)
        return original(*arguments)

    original = scene_plan.scan
    monkeypatch.setattr(scene_plan, "scan", scan)
    return made


def depsgraph():
    return bpy.context.evaluated_depsgraph_get()


def noted(plan: ScenePlan, edit) -> None:
    """Makes an edit, and tells of it as Blender does."""

    def note(_scene, found):
        plan.note(found)

    bpy.app.handlers.depsgraph_update_post.append(note)
    try:
        edit()
        bpy.context.view_layer.update()
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(note)


def rows(scene) -> dict[str, str]:
    """What there is a layer of, and why not of the rest."""
    return {row.what: row.reason for row in STATE.plans[scene.session_uid]}


def lamp(kind: str = "LIGHT"):
    return next(thing for thing in bpy.context.scene.objects if thing.type == kind)


def test_it_is_what_a_bake_would_plan_and_no_render_is_started(scene):
    renders = []
    bpy.app.handlers.render_init.append(lambda *_: renders.append(1))
    try:
        ScenePlan().make(depsgraph())
    finally:
        bpy.app.handlers.render_init.pop()
    assert not renders
    own = rows(scene)
    assert bpy.ops.strata.plan() == {"FINISHED"}
    assert own == rows(scene)
    assert "Soft Shadow Panel" in own
    assert STATE.memory[scene.session_uid].sentence
    assert STATE.expected_s[scene.session_uid] > 0.0


def test_the_expected_time_is_made_anew_after_a_bake_and_knows_what_it_took(scene):
    """Of as many samples as the last bake needed, whoever asks."""
    scene.strata.save_to, scene.strata.backend = "IMAGES", "cpu"
    scene.strata.target_error, scene.strata.most_samples = 1e-3, 16  # more than is expected of nothing known
    STATE.expected_s[scene.session_uid] = 1e6
    assert bpy.ops.strata.bake() == {"FINISHED"}
    after = STATE.expected_s[scene.session_uid]
    assert 0.0 < after < 1e3
    assert bpy.ops.strata.plan() == {"FINISHED"}
    # The bake's own plan is closer, and boxes alone may keep what it leaves out.
    assert STATE.expected_s[scene.session_uid] == pytest.approx(after, rel=0.5)
    scene.strata.audit = True
    assert bpy.ops.strata.plan() == {"FINISHED"}
    assert STATE.expected_s[scene.session_uid] > after


def test_it_is_asked_for_again_only_where_something_counts(scene):
    plan = ScenePlan()
    asked = plan.asked(depsgraph())
    noted(plan, lambda: None)
    assert plan.asked(depsgraph()) == asked
    for edit in (
        lambda: setattr(lamp().data, "energy", 3.0),
        lambda: setattr(scene.render, "resolution_x", 77),
        lambda: setattr(scene.camera.location, "x", 3.0),
        lambda: setattr(scene.strata.soft_shadow, "layers", 5),
        lambda: setattr(lamp("MESH"), "hide_render", True),
        lambda: lamp("MESH").hide_set(True),
        lambda: setattr(lamp("MESH"), "shadow_terminator_geometry_offset", 0.75),
    ):
        noted(plan, edit)
        before, asked = asked, plan.asked(depsgraph())
        assert asked != before


def test_a_light_or_a_setting_alone_reads_nothing_else_again(scene, scans):
    plan = ScenePlan()
    plan.make(depsgraph())
    assert len(scans) == 1
    noted(plan, lambda: setattr(lamp().data, "energy", 0.0))
    plan.make(depsgraph())
    assert "Soft Shadow Panel" not in rows(scene)
    noted(plan, lambda: setattr(lamp().data, "energy", 9.0))
    scene.strata.soft_shadow.enabled = False
    plan.make(depsgraph())
    assert not any(name.startswith("Soft Shadow") for name in rows(scene))
    assert len(scans) == 1
    noted(plan, lambda: lamp("MESH").data.materials.clear())
    plan.make(depsgraph())
    assert len(scans) == 2


def test_switches_of_rendering_count_and_what_only_a_bake_shows_is_told(scene):
    light = lamp()
    light.hide_render = True
    ScenePlan().make(depsgraph())
    assert STATE.idle_reason(scene.session_uid, "soft_shadow") == "the scene has no lights"
    assert STATE.warnings[scene.session_uid] == ()
    light.hide_render = False
    light.hide_set(True)
    ScenePlan().make(depsgraph())
    assert STATE.warnings[scene.session_uid] == ("hidden in the viewport, and baked: 'Panel'",)
    hidden = bpy.data.collections.new("Hidden")
    scene.collection.children.link(hidden)
    for collection in light.users_collection:
        collection.objects.unlink(light)
    hidden.objects.link(light)
    hidden.hide_render = True
    ScenePlan().make(depsgraph())
    assert STATE.warnings[scene.session_uid] == ()  # nor is it baked


def test_an_effect_that_does_nothing_says_why(scene):
    ScenePlan().make(depsgraph())
    uid = scene.session_uid
    assert STATE.idle_reason(uid, "soft_shadow") == ""
    assert STATE.idle_reason(uid, "volumetric_light").startswith("no fog (")
    scene.strata.volumetric_light.use_scene_medium = False
    ScenePlan().make(depsgraph())
    assert STATE.idle_reason(uid, "volumetric_light") == ""
    assert STATE.idle_reason(uid + 1, "volumetric_light") == ""  # of another scene nothing is known


def test_the_worlds_light_and_glowing_materials_are_told_once(scene):
    def others():
        ScenePlan().make(depsgraph())
        return [row.what for row in STATE.plans[scene.session_uid] if not (row.kept or row.effect)]

    world = scene.world = bpy.data.worlds.new("Firmament")
    background = next(n for n in world.node_tree.nodes if n.bl_idname == "ShaderNodeBackground")
    background.inputs["Strength"].default_value = 0.0
    glowing = [thing for thing in scene.objects if thing.type == "MESH"][:5]
    for number, thing in enumerate(glowing):
        material = bpy.data.materials.new(f"Glow {number}")
        shader = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeBsdfPrincipled")
        shader.inputs["Emission Strength"].default_value = 2.0
        thing.data = thing.data.copy()
        thing.data.materials.clear()
        thing.data.materials.append(material)
    (told,) = others()
    assert told.startswith("light of materials 'Glow 0', ")
    assert told.endswith(" and 2 more")
    background.inputs["Strength"].default_value = 0.5
    assert others() == ["world 'Firmament'", told]
    background.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    assert others() == [told]


def test_simulations_without_a_cache_and_what_is_not_read_are_told_before_a_bake(scene):
    lamp("MESH").modifiers.new("Cloth", "CLOTH")
    material = lamp("MESH").data.materials[0]
    tree = material.node_tree
    glass = tree.nodes.new("ShaderNodeBsdfGlass")
    tree.links.new(glass.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    scene.frame_set(5)
    ScenePlan().make(depsgraph())
    told = STATE.warnings[scene.session_uid]
    assert any("its cloth is not baked" in warning for warning in told)
    assert any(f"material '{material.name}'" in warning for warning in told)
    bpy.ops.strata.plan()
    assert set(told) == set(STATE.warnings[scene.session_uid])


def test_what_keeps_it_from_a_plan_is_told_until_it_is_gone(scene):
    plan, camera = ScenePlan(), scene.camera
    scene.camera = None
    plan.make(depsgraph())
    assert STATE.warnings[scene.session_uid] == (f"scene '{scene.name}' has no camera",)
    assert STATE.plans[scene.session_uid] == ()
    scene.camera = camera
    plan.make(depsgraph())
    assert STATE.warnings[scene.session_uid] == ()
    assert STATE.plans[scene.session_uid]


# When


def look(watched: watching._Watched) -> bool:
    """Long after the last edit."""
    assert not watched.look(bpy.context.window)
    watched.touched_at -= 1e6
    return watched.look(bpy.context.window)


def test_nothing_is_read_before_a_pause_or_twice(scene, scans):
    watched = watching._Watched()
    assert not watched.look(bpy.context.window)
    assert look(watched)
    assert scene.session_uid in STATE.plans
    assert not look(watched)
    watched.touch()
    assert not look(watched)  # nothing has changed
    assert len(scans) == 1
    scene.render.resolution_x = 99
    assert not watched.look(bpy.context.window)
    look(watched)
    assert len(scans) == 1


def test_the_dearer_a_plan_the_longer_it_waits_and_the_dearest_wait_to_be_asked(scene):
    watched = watching._Watched()
    look(watched)
    watched.plan.seconds = 0.5
    assert watched.pause == 5.0
    watched.plan.seconds = 2.0
    before = STATE.plans[scene.session_uid]
    lamp().data.energy = 0.0
    watched.plan.forget()
    watched.touch()
    assert look(watched)
    assert scene.session_uid in STATE.outdated
    assert STATE.plans[scene.session_uid] is before
    bpy.ops.strata.plan()
    assert scene.session_uid not in STATE.outdated
    assert "Soft Shadow Panel" not in rows(scene)


@pytest.mark.parametrize("is_quick", [True, False])
def test_a_scene_that_is_quick_when_asked_for_is_read_unasked_again(scene, monkeypatch, is_quick):
    watched = watching._watched[scene.session_uid] = watching._Watched()
    try:
        look(watched)
        watched.plan.seconds, watched.plan.is_too_long = 2.0, True
        if not is_quick:
            monkeypatch.setattr(watching, "LONGEST_SECONDS", 0.0)
        bpy.ops.strata.plan()
        assert watched.is_heavy != is_quick
        watched.look(bpy.context.window)  # before the next edit
        lamp().data.energy = 0.0
        watched.plan.forget()
        watched.touch()
        assert look(watched)
        assert ("Soft Shadow Panel" not in rows(scene)) == is_quick
        assert (scene.session_uid in STATE.outdated) != is_quick
    finally:
        watching._watched.clear()


def test_a_scene_that_takes_long_is_not_read_to_its_end(scene, monkeypatch):
    monkeypatch.setattr(scene_plan, "MOST_SECONDS", 0.0)
    watched = watching._Watched()
    assert look(watched)
    assert STATE.warnings[scene.session_uid] == (f"scene '{scene.name}' takes long to read",)
    assert scene.session_uid in STATE.outdated  # there is a button for it
    watched.touch()
    assert not look(watched)


def test_a_bakes_own_plan_stays_until_the_scene_changes(scene):
    watched = watching._Watched()
    look(watched)
    scene.render.resolution_x, scene.render.resolution_y, scene.strata.samples = 32, 18, 1
    scene.strata.probes, scene.strata.save_to = 0, "IMAGES"
    watched.begin_bake(bpy.context.window)
    assert bpy.ops.strata.bake() == {"FINISHED"}
    baked = STATE.plans[scene.session_uid]
    watched.touch()
    assert not look(watched)
    assert STATE.plans[scene.session_uid] is baked
    watched.begin_bake(bpy.context.window)
    lamp().data.energy = 0.0  # while it bakes
    watched.plan.forget()
    assert bpy.ops.strata.bake() == {"CANCELLED"}
    watched.touch()
    look(watched)
    assert STATE.plans[scene.session_uid] is not baked


def test_while_blender_renders_or_bakes_nothing_is_evaluated(scene, monkeypatch):
    watched = watching._watched[scene.session_uid] = watching._Watched()
    monkeypatch.setattr(watching, "_is_seen", lambda window: True)
    look(watched)
    evaluated = []
    bpy.app.handlers.depsgraph_update_post.append(lambda *_: evaluated.append(1))
    try:
        lamp().location.x += 1.0  # evaluated as soon as somebody asks
        with monkeypatch.context() as running:
            running.setattr(watching, "_is_job_running", lambda: True)
            watched.touched_at -= 1e6
            watching._look()
            assert not evaluated
        depsgraph()
        assert evaluated
    finally:
        bpy.app.handlers.depsgraph_update_post.pop()
        watching._watched.clear()
    bpy.ops.strata.plan()  # as a render leaves one behind
    watched.plan.forget()  # edited while it ran
    before = STATE.plans[scene.session_uid]
    watched.touch()
    look(watched)
    assert STATE.plans[scene.session_uid] is not before


def test_while_a_job_locks_the_interface_nothing_is_touched(monkeypatch):
    locked = SimpleNamespace(is_interface_locked=True)
    monkeypatch.setattr(watching, "bpy", SimpleNamespace(context=SimpleNamespace(window_manager=locked)))
    watching._look()
    locked.is_interface_locked = False
    with pytest.raises(AttributeError):
        watching._look()


def test_panels_in_sidebars_and_in_the_render_tab_are_drawn_again():
    """While baking too, in whichever of them the progress stands."""
    drawn = []

    def area(kind: str, context: str = "") -> SimpleNamespace:
        regions = [
            SimpleNamespace(type=region, tag_redraw=lambda r=region: drawn.append((kind, context, r)))
            for region in ("HEADER", "UI", "WINDOW")
        ]
        spaces = SimpleNamespace(active=SimpleNamespace(context=context))
        return SimpleNamespace(type=kind, regions=regions, spaces=spaces)

    areas = [area("VIEW_3D"), area("PROPERTIES", "RENDER"), area("PROPERTIES", "MATERIAL"), area("OUTLINER")]
    window = SimpleNamespace(screen=SimpleNamespace(areas=areas))
    with_progress = SimpleNamespace(
        window_manager=SimpleNamespace(windows=[window]),
        workspace=SimpleNamespace(status_text_set=lambda text: None),
    )
    operator = SimpleNamespace(
        _runner=SimpleNamespace(job=SimpleNamespace(progress=0.5, stage="Baking", seconds_left=3.0))
    )
    bake.STRATA_OT_bake._show(operator, with_progress)
    assert drawn == [("VIEW_3D", "", "UI"), ("PROPERTIES", "RENDER", "WINDOW")]
