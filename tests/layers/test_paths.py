"""What the text of an output means: folders, endings, templates, frame numbers; and what is done where none
can be written."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest
import strata
from strata.addon.core.errors import StrataError
from strata.addon.layers import files, paths
from strata.addon.layers.images import image_of
from strata.addon.layers.numbered import Placeholder
from strata.addon.layers.paths import expanded, exr_path, resolved
from strata.addon.scene.open import open_blend
from strata.addon.ui import asked as ui_asked
from strata.addon.ui import output as ui_output
from strata.addon.ui.output import default_output, output_of, waits_for_saving
from strata.addon.ui.state import STATE
from strata.ops import bake
from strata.ops.cli import main
from strata.tests.support.exr_layers import read_layers
from strata.tests.support.places import SAMPLES

QUICK = ("--backend", "cpu", "--size", "32x18", "--samples", "1", "--probes", "0")


@pytest.fixture
def scene(tmp_path):
    """A file of one lamp that casts a shadow, in a folder of its own."""
    strata.register()
    open_blend(SAMPLES / "stacked.blend")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.v2.blend"))
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 32, 18
    scene.strata.backend, scene.strata.samples, scene.strata.probes = "cpu", 1, 0
    yield scene
    strata.unregister()


def output(scene, given: str = "") -> str:
    return output_of(scene, scene.view_layers[0], given).text


@pytest.mark.parametrize(
    ("text", "frame", "expected"),
    [
        ("a/####.exr", 7, "a/0007.exr"),
        ("x##_#.exr", 12, "x##_12.exr"),
        ("x_###.exr", 12345, "x_12345.exr"),
        ("x_####.exr", -5, "x_-005.exr"),
        ("#/x.exr", 7, "#/x.exr"),
    ],
)
def test_frame_numbers_in_names(text, frame, expected):
    assert Placeholder(text).path(frame) == Path(expected)
    assert Placeholder(text).is_numbered == (Path(text) != Path(expected))


def test_every_text_is_the_path_of_an_openexr(tmp_path):
    (tmp_path / "there").mkdir()
    for text, expected in (
        ("out", "out.exr"),
        ("out.exr", "out.exr"),
        ("OUT.EXR", "OUT.EXR"),
        ("out.png", "out.exr"),
        ("out.JPEG", "out.exr"),
        ("####.tif", "####.exr"),
        ("shot.v2", "shot.v2.exr"),
        ("there", "there/name.exr"),
        ("new/", "new/name.exr"),
        ("there/../out", "out.exr"),
    ):
        assert exr_path(f"{tmp_path}/{text}", "name") == str(tmp_path / expected), text
    with pytest.raises(StrataError, match="no file"):
        exr_path("", "name")
    assert resolved("//a.exr", tmp_path) == str(tmp_path / "a.exr")
    assert resolved("/a.exr", None) == "/a.exr"


def test_endings_are_blenders():
    known = [e for e in bpy.path.extensions_image if paths._IMAGE_ENDING.fullmatch(e)]
    assert {*known, ".exr"} == bpy.path.extensions_image


@pytest.mark.parametrize(
    "text",
    [
        "{blend_name}_{scene_name}",
        "{blend_dir}/{camera_name}_####",
        "{resolution_x}x{resolution_y:#####}_{fps:###}_{fps:.##}_{fps:###.#}_{fps}",
        "{{a}}_{{{blend_name}}}",
        "plain",
    ],
)
def test_templates_are_blenders(scene, text):
    scene.name, scene.camera.name = "a/b: night", "Kamera ü"
    scene.render.resolution_percentage, scene.render.fps_base = 50, 1.001
    scene.render.filepath = scene.strata.output = f"/tmp/{text}"
    theirs = Path(scene.render.frame_path(frame=7)).with_suffix("")
    ours = output_of(scene, scene.view_layers[0]).path(7).with_suffix("")
    assert str(ours) == str(theirs).removesuffix("" if "#" in text.rpartition("_")[2] else "0007")


@pytest.mark.parametrize(
    "text", ["{", "a}b", "{no_such}", "{fps:}", "{fps:#.}", "{fps:3}", "{blend_name:##}"]
)
def test_templates_that_mean_nothing_are_told(scene, text):
    with pytest.raises(StrataError, match="'"):
        expanded(text, {"fps": 24.0, "blend_name": "x"})


def test_the_default_is_named_after_what_it_is_of(scene, tmp_path):
    assert output(scene) == str(tmp_path / "shot.v2_strata_####.exr")
    back = scene.view_layers.new("Back")
    bpy.data.scenes.new("Night")
    assert scene.strata.output == default_output(scene)  # as the field shows it
    assert output_of(scene, back).path(3) == tmp_path / "shot.v2_Stacked_Back_strata_0003.exr"
    scene.strata.output = "//renders/"
    assert output(scene) == str(tmp_path / "renders" / "shot.v2.exr")
    scene.strata.output = ""
    assert scene.strata.output == default_output(scene)
    # A script's path has no templates.
    assert output(scene, "//{x}.exr") == str(tmp_path / "{x}.exr")


def test_names_with_a_hash_get_no_frame_number(scene, tmp_path):
    scene.name, scene.camera.name = "Shot #2", "Cam #1"
    scene.strata.output = "//{scene_name} {camera_name}"
    assert output_of(scene, scene.view_layers[0]).path(72) == tmp_path / "Shot _2 Cam _1.exr"
    blend = tmp_path / "Take #3.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    scene.strata.output = f"{tmp_path}/"
    assert output_of(scene, scene.view_layers[0]).path(72) == tmp_path / "Take _3.exr"
    assert main(["bake", str(blend), "-o", f"{tmp_path}/", *QUICK, "--frames", "1-2", "-q"]) == 0
    assert sorted(path.name for path in tmp_path.glob("*.exr")) == ["Take _3_0001.exr", "Take _3_0002.exr"]


def test_the_folder_of_a_file_that_was_never_saved_is_nowhere(scene):
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    for text in ("//x.exr", "{blend_dir}/x.exr"):
        scene.strata.output, scene.strata.save_to = text, "BOTH"
        assert waits_for_saving(scene)
        with pytest.raises(StrataError, match="never saved"):
            output(scene)
        scene.strata.save_to = "FILE"
        assert not waits_for_saving(scene)
    scene.strata.output, scene.strata.save_to = "/tmp/{{blend_dir}}.exr", "BOTH"
    assert not waits_for_saving(scene)
    assert output(scene) == str(Path("/tmp/{blend_dir}.exr").absolute())


def test_a_bake_makes_folders_and_says_where_it_wrote(scene, tmp_path):
    scene.strata.output, scene.strata.save_to = "//new/deep/", "FILE"
    assert bpy.ops.strata.bake() == {"FINISHED"}
    assert read_layers(tmp_path / "new" / "deep" / "shot.v2.exr").layers
    assert bpy.ops.strata.bake(filepath=str(tmp_path / "x_##.png")) == {"FINISHED"}
    assert (tmp_path / f"x_{scene.frame_current:02d}.exr").is_file()


def test_no_bake_is_lost_where_its_file_cannot_be_written(scene, tmp_path, monkeypatch):
    def full(*_arguments, **_values):
        raise StrataError("cannot write x.exr: No space left on device")

    scene.strata.save_to = "FILE"
    with monkeypatch.context() as broken:
        broken.setattr(bake, "write_layers", full)
        with pytest.raises(RuntimeError, match=r"No space left on device\. The layers are in images"):
            bpy.ops.strata.bake()
    (name,) = [layer["name"] for layer in bake.STATE.reports[scene.session_uid]["layers"]]
    assert image_of(scene.name, "ViewLayer", name).size[:] == (32, 18)
    assert not list(tmp_path.glob("*.exr"))


def test_a_hopeless_output_is_told_before_the_work(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(bake, "read_job", None)  # would fail
    (tmp_path / "file").touch()
    for text, words in (("//file/x.exr", "not a folder"), ("//{nothing}.exr", "there is no {nothing}")):
        scene.strata.output = text
        with pytest.raises(RuntimeError, match=words) as told:
            bpy.ops.strata.bake()
        assert len(str(told.value).strip().splitlines()) == 1


def test_a_panel_asks_the_disk_once_a_second_and_never_while_baking(scene, tmp_path, monkeypatch):
    asked, clock = [], [100.0]
    slow = SimpleNamespace(monotonic=lambda: clock[0])

    def check(path):
        asked.append(path)
        clock[0] += takes

    monkeypatch.setattr(ui_output, "check_writable", check)
    monkeypatch.setattr(ui_asked, "time", slow)
    monkeypatch.setattr(ui_asked, "_answers", {})
    frame, takes = scene.frame_current, 0.01
    told = tmp_path / f"shot.v2_strata_{frame:04d}.exr", ""

    def drawn() -> int:
        """How often the disk was asked when it was drawn."""
        assert ui_output.told_output(scene, scene.view_layers[0]) == told
        return len(asked)

    assert [drawn() for _ in range(20)] == [1] * 20
    clock[0] += 1.5
    assert [drawn(), drawn()] == [2, 2]
    clock[0] += 1.5
    monkeypatch.setattr(STATE, "is_baking", True)
    assert drawn() == 2
    monkeypatch.setattr(STATE, "is_baking", False)
    takes = 2.0
    assert drawn() == 3
    clock[0] += 15.0
    assert drawn() == 3  # what is slow is asked less often
    scene.strata.output = "//other.exr"
    told = tmp_path / "other.exr", ""
    assert [drawn(), drawn()] == [4, 4]
    monkeypatch.setattr(STATE, "is_baking", True)
    scene.strata.output = "//yet another.exr"
    told = None, ""
    assert drawn() == 4


def test_a_disk_that_may_be_too_small_is_told_and_tried(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(files.shutil, "disk_usage", lambda _path: SimpleNamespace(free=100, total=200))
    assert main(["bake", str(SAMPLES / "stacked.blend"), "-o", f"{tmp_path}/", *QUICK]) == 0
    out, err = capfd.readouterr()
    assert "takes up to 0 MB, and the disk has 0 MB left" in err
    assert f"wrote {tmp_path / 'stacked.exr'}" in out


def test_the_command_line_takes_folders_and_other_endings(tmp_path):
    blend = str(SAMPLES / "stacked.blend")
    assert main(["bake", blend, "-o", f"{tmp_path}/new/", *QUICK, "--frames", "1-2", "-q"]) == 0
    assert main(["bake", blend, "-o", str(tmp_path), *QUICK, "-q"]) == 0
    assert main(["bake", blend, "-o", str(tmp_path / "a.png"), *QUICK, "-q"]) == 0
    found = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file())
    assert found == ["a.exr", "new/stacked_0001.exr", "new/stacked_0002.exr", "stacked.exr"]


def test_an_older_file_keeps_its_default(scene, tmp_path):
    from strata.addon.ui import migration

    stored = scene.bl_system_properties_get()["strata"]
    stored["version"] = 2
    other = bpy.data.scenes.new("Braces")
    other.strata.output = "//{a}.exr"
    other.bl_system_properties_get()["strata"]["version"] = 2
    fresh = bpy.data.scenes.new("Fresh")
    assert fresh.strata.output  # which makes a group without anything in it
    migration.migrate(bpy.data.scenes)
    assert output(scene) == str(tmp_path / "strata_####.exr")
    assert output(other) == str(tmp_path / "{a}.exr")
    assert output(fresh).endswith("shot.v2_Fresh_strata_####.exr")


def test_sample_scenes_have_settings_of_this_version(scene):
    for path in SAMPLES.glob("*.blend"):
        open_blend(path)
        assert output(bpy.context.scene) == str(SAMPLES / f"{path.stem}_strata_####.exr")
