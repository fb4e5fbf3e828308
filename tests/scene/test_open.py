"""Opening files and choosing what to bake: a refusal is a StrataError of one line, and nothing is printed."""

from __future__ import annotations

import os

import bpy
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.scene.open import choose, open_blend


@pytest.fixture(scope="module")
def two_scenes(tmp_path_factory):
    """A file with scenes 'Scene' and 'Second' (active, frames 5..9), its first view layer switched off."""
    bpy.ops.wm.read_factory_settings()
    second = bpy.data.scenes.new("Second")
    second.frame_start, second.frame_end, second.frame_current = 5, 9, 7
    second.view_layers[0].use = False
    second.view_layers.new("Used")
    second.camera = bpy.data.objects["Camera"]
    bpy.data.scenes.new("Blind")
    bpy.context.window.scene = second
    path = tmp_path_factory.mktemp("open") / "two.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=False)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return path


def test_defaults(two_scenes):
    open_blend(two_scenes)
    chosen = choose()
    assert (chosen.scene.name, chosen.view_layer.name) == ("Second", "Used")
    assert (chosen.camera, chosen.frames) == (None, (7,))
    chosen = choose(scene="Scene", view_layer="ViewLayer", camera="Camera", frames=[1, 3])
    assert (chosen.scene.name, chosen.camera, chosen.frames) == ("Scene", "Camera", (1, 3))


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"scene": "Nope"}, "no scene 'Nope'"),
        ({"view_layer": "Nope"}, "no view layer 'Nope'"),
        ({"camera": "Nope"}, "no camera 'Nope'"),
        ({"camera": "Cube"}, "'Cube' is not a camera"),
        ({"scene": "Blind"}, "has no camera; --scene: 'Scene', 'Second' have one"),
    ],
)
def test_refusals(two_scenes, asked, message):
    open_blend(two_scenes)
    with pytest.raises(StrataError, match=message) as caught:
        choose(**asked)
    assert "\n" not in str(caught.value)


def _bad_files(good: bytes) -> dict[str, bytes]:
    return {
        "empty": b"",
        "text": b"not a scene at all\n" * 20,
        "truncated": good[: len(good) // 2],
        "garbage after the header": good[:17] + bytes(range(256)) * 40,
        "garbage after an old header": b"BLENDER-v278" + bytes(range(256)),
        "garbage, compressed": b"\x28\xb5\x2f\xfd" + bytes(range(256)),
    }


@pytest.mark.parametrize("name", _bad_files(b""))
def test_bad_files_leave_one_line(two_scenes, tmp_path, capfd, name):
    path = tmp_path / "bad.blend"
    path.write_bytes(_bad_files(two_scenes.read_bytes())[name])
    open_blend(two_scenes)
    capfd.readouterr()
    with pytest.raises(StrataError) as caught:
        open_blend(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    assert capfd.readouterr() == ("", "")
    assert "Second" in bpy.data.scenes


def test_missing_file_and_folder(tmp_path):
    for path in (tmp_path / "missing.blend", tmp_path):
        with pytest.raises(StrataError, match="cannot read"):
            open_blend(path)


def test_opening_is_silent_and_runs_no_scripts(two_scenes, tmp_path, capfd):
    text = bpy.data.texts.new("run.py")
    marker = tmp_path / "ran"
    text.write(f"open({str(marker)!r}, 'w').close()")
    text.use_module = True
    path = tmp_path / "script.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    capfd.readouterr()
    open_blend(path)
    assert capfd.readouterr() == ("", "")
    assert not os.path.exists(marker)
    open_blend(two_scenes)
    os.write(1, b"back\n")
    assert capfd.readouterr().out == "back\n"


def test_frames_outside_the_range_are_told(two_scenes):
    open_blend(two_scenes)
    chosen = choose(frames=[6, 10])
    assert chosen.frames == (6, 10)
    assert chosen.outside([6]) is None
    assert "frame 10 is outside scene 'Second', which runs from 5 to 9" in chosen.outside(chosen.frames)
    assert "2 frames from 4 are outside" in chosen.outside([4, 7, 10])
