"""Whatever goes wrong is one line for a person, on every face, and costs nothing that did not go wrong."""

from __future__ import annotations

import os
from types import SimpleNamespace

import bpy
import pytest
import strata
from strata.addon.core.errors import TRACEBACK_FILE, StrataError, one_line, told_once
from strata.addon.preview import control
from strata.addon.scene import scan
from strata.addon.scene.open import open_blend
from strata.addon.ui.registration import Classes
from strata.ops.cli import main
from strata.tests.support.places import SAMPLES

QUICK = ("--backend", "cpu", "--size", "32x18", "--samples", "1", "--probes", "0")


def broken(*_args, **_kwargs):
    raise ValueError("something\nnobody   foresaw")


def raised(function) -> BaseException:
    try:
        function()
    except BaseException as error:
        return error
    raise AssertionError("nothing was raised")


# What the line says


def test_a_foreseen_error_is_its_message():
    assert one_line(StrataError("no camera\nhere")) == "no camera here"


def test_an_unforeseen_error_says_what_and_where():
    error = raised(lambda: scan.scan(None))
    line = one_line(error)
    assert line.startswith(f"Strata failed: {type(error).__name__}: ")
    assert "(addon/scene/scan.py:" in line
    assert "\n" not in line


def test_an_error_without_words_and_one_outside_strata_have_a_line_too():
    assert one_line(ValueError()) == "Strata failed: ValueError: no reason given (unknown place)"
    assert "(test_failures.py:" in one_line(raised(broken))


def test_the_traceback_is_kept_where_it_is_asked_for(monkeypatch, tmp_path):
    monkeypatch.setenv(TRACEBACK_FILE, str(tmp_path / "log.txt"))
    one_line(raised(broken))
    one_line(StrataError("foreseen"))
    one_line(raised(broken))
    text = (tmp_path / "log.txt").read_text()
    assert text.count("Traceback (most recent call last)") == 2
    assert "in broken" in text
    monkeypatch.setenv(TRACEBACK_FILE, str(tmp_path))  # a folder: no reason to fail once more
    assert one_line(raised(broken))


# The command line


@pytest.fixture
def sometimes_panoramic(tmp_path):
    """A file of frames 1 to 4, whose camera is a panorama, which no bake can make, at frame 2."""
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLES / "plain.blend"))
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 4
    camera = scene.camera.data
    for frame, kind in ((1, "PERSP"), (2, "PANO"), (3, "PERSP")):
        camera.type = kind
        camera.keyframe_insert("type", frame=frame)
    path = tmp_path / "sometimes.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def test_a_frame_that_fails_does_not_cost_the_others(sometimes_panoramic, tmp_path, capfd):
    out = tmp_path / "out"
    out.mkdir()
    words = ["bake", str(sometimes_panoramic), "-o", str(out / "f#.exr"), *QUICK, "--effects", "toon"]
    assert main([*words, "--frames", "1-4", "--quiet"]) == 2
    told = capfd.readouterr().err.splitlines()
    assert sorted(os.listdir(out)) == ["f1.exr", "f3.exr", "f4.exr"]
    assert len(told) == 2
    assert told[0].startswith("strata: frame 2: ")
    assert told[1] == "strata: 1 of 4 frames failed: 2"


def test_the_command_line_tells_unforeseen_errors_in_one_line(monkeypatch, tmp_path, capfd):
    from strata.addon import bake

    monkeypatch.setattr(bake, "plan_scene", broken)
    assert main(["bake", str(SAMPLES / "plain.blend"), "-o", str(tmp_path / "x.exr"), *QUICK]) == 2
    out, err = capfd.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert err.startswith("strata: Strata failed: ValueError: something nobody foresaw (addon/bake.py:")
    assert os.listdir(tmp_path) == []


# Inside Blender


@pytest.fixture
def scene():
    strata.register()
    open_blend(SAMPLES / "plain.blend")
    bpy.context.scene.strata.backend = "cpu"
    yield bpy.context.scene
    strata.unregister()


def only_line(function) -> str:
    """What Blender makes of an operator's report."""
    (line,) = str(raised(function)).strip().splitlines()
    return line


def test_operators_report_unforeseen_errors(scene, monkeypatch, capfd):
    from strata.ops import bake, compositor

    monkeypatch.setattr(bake, "read_job", broken)
    monkeypatch.setattr(bake, "read_plan", broken)
    monkeypatch.setattr(compositor, "unfit_file", broken)
    scene.strata.save_to, scene.strata.output = "IMAGES", "/tmp/x.exr"
    for operator in (bpy.ops.strata.bake, bpy.ops.strata.plan, bpy.ops.strata.build_compositor):
        line = only_line(operator)
        assert line.startswith("Error: Strata failed: ValueError: something nobody foresaw (")
        assert "ops/" in line
    assert "Traceback" not in capfd.readouterr().err


def test_the_engine_reports_unforeseen_errors(scene, monkeypatch, capfd):
    from strata.addon.engine import engine

    monkeypatch.setattr(engine, "read_depsgraph", broken)
    scene.render.engine = "STRATA"
    line = only_line(bpy.ops.render.render)
    assert line.startswith("Error: Strata failed: ValueError: something nobody foresaw (addon/engine/")
    monkeypatch.setattr(engine.passes, "registered", broken)
    for view_layer in scene.view_layers:
        view_layer.update_render_passes()
        view_layer.update_render_passes()
    err = capfd.readouterr().err
    assert "Traceback" not in err
    assert err.count("something nobody foresaw") == 1  # of passes, each time in vain


def test_handlers_tell_once_and_never_raise(capsys):
    @told_once
    def handler(*arguments):
        broken()

    assert handler(1, 2) is None
    assert handler() is None
    assert capsys.readouterr().err.count("something nobody foresaw") == 1


def test_panels_say_what_they_cannot_draw():
    class STRATA_PT_broken(bpy.types.Panel):
        bl_label, bl_space_type, bl_region_type = "Broken", "VIEW_3D", "UI"

        def draw(self, context):
            broken()

    classes = Classes(STRATA_PT_broken)
    classes.register()
    classes.unregister()
    classes.register()
    classes.unregister()
    labels = []
    layout = SimpleNamespace(label=lambda text, icon: labels.append(text))
    STRATA_PT_broken.draw(SimpleNamespace(layout=layout), None)
    (line,) = labels
    assert line.startswith("Strata failed: ValueError: something nobody foresaw (")


def test_a_failing_preview_says_so_and_tries_again_when_something_changes(scene, monkeypatch):
    tried = []

    def fails(*_arguments):
        tried.append(1)
        broken()

    monkeypatch.setattr(control, "_picture", fails)
    window = bpy.context.window_manager.windows[0]
    area = window.screen.areas[0]
    area.type = "VIEW_3D"
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        for _redraw in range(3):
            control.draw(bpy.context)
        assert len(tried) == 1
        assert control.failure().startswith("Strata failed: ValueError: something nobody foresaw (")
        assert control.state_of(region).message == control.failure()
        control._depsgraph_updated(scene, bpy.context.evaluated_depsgraph_get())
        control.draw(bpy.context)
        assert len(tried) == 2
        monkeypatch.setattr(control, "_picture", lambda *_arguments: None)
        control._everything_changed()
        control.draw(bpy.context)
    assert control.failure() == ""
    control.unregister()
    control._stop()
