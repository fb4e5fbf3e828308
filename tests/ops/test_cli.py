"""The command line, as a shell and a farm see it."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
from argparse import ArgumentTypeError

import bpy
import numpy as np
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.effects.registry import EFFECTS
from strata.ops.arguments import build_parser, frames, names, read_outputs, setting, size
from strata.ops.cli import main
from strata.ops.terminal import Progress, time_left
from strata.tests.effects.extremes import Row
from strata.tests.support.exr_layers import read_layers
from strata.tests.support.places import SAMPLES
from strata.tests.support.procedural import card, clear_by, floor_scene, noise

QUICK = ("--backend", "cpu", "--size", "96x54", "--samples", "1", "--probes", "64")


def strata(*words, check: int = 0, env: dict[str, str] | None = None) -> subprocess.CompletedProcess:
    """Runs the command in a process of its own, as it is used."""
    command = [sys.executable, "-m", "strata", *map(str, words)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, env=env)
    assert result.returncode == check, result.stderr
    return result


# Words


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("5", (5,)),
        ("1-4", (1, 2, 3, 4)),
        ("7,1-2,2", (7, 1, 2)),
        ("-3--1", (-3, -2, -1)),
        ("-2", (-2,)),
        ("1-7x3", (1, 4, 7)),
        ("-4-1x2,0", (-4, -2, 0)),
        ("-4--1x2", (-4, -2)),
    ],
)
def test_frames(text, expected):
    assert frames(text) == expected


@pytest.mark.parametrize(
    "text", ["", "1-", "a", "3-1", "1..4", "1,,2", "0-999999", "99999999", "1-4x0", "3x2", "1-4x"]
)
def test_bad_frames(text):
    with pytest.raises(ArgumentTypeError):
        frames(text)


def test_other_words():
    assert size("960x540") == (960, 540)
    assert names("a, b,a") == ("a", "b")
    assert setting("soft_shadow.layers = 3") == ("soft_shadow", "layers", "3")
    for parse, text in ((size, "960"), (size, "0x5"), (size, "-1x5"), (names, " ,"), (setting, "layers=3")):
        with pytest.raises(ArgumentTypeError):
            parse(text)


def test_scripts_run_where_they_are_trusted(tmp_path):
    """A shell gets the file's scripts and drivers by a word of its own."""
    path = tmp_path / "driven.blend"
    make = (
        "import bpy, sys\n"
        "curve = bpy.data.objects['Cube'].driver_add('location', 2)\n"
        "curve.driver.type, curve.driver.expression = 'SCRIPTED', 'len(str(5))'\n"
        "bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])\n"
    )
    subprocess.run([sys.executable, "-c", make, str(path)], check=True, capture_output=True)
    plans = [json.loads(strata("plan", path, "--json", *more).stdout) for more in ((), ("--trust-scripts",))]
    assert [any("did not run" in line for line in plan["warnings"]) for plan in plans] == [True, False]


# Complaints: exit code 2, one line on stderr, nothing on stdout, no file


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("", "bake"),
        ("paint", "invalid choice"),
        ("bake SCENE", "-o"),
        ("bake SCENE -o=", "no file"),
        ("bake SCENE -o SCENE/x.exr", "is not a folder"),
        ("bake SCENE -o OUT/x.exr --lights Nope", "no lamp 'Nope'"),
        ("bake SCENE -o OUT/x.exr --backend tpu", "tpu"),
        ("bake SCENE -o OUT/x.exr --size 5", "960x540"),
        ("bake SCENE -o OUT/x.exr --samples 0", "1 to 4096"),
        ("bake SCENE -o OUT/x.exr --probes -1", "probes"),
        ("bake SCENE -o OUT/x.exr --effects toonish", "no effect 'toonish'"),
        ("bake SCENE -o OUT/x.exr --effects ,", "no name"),
        ("bake SCENE -o OUT/x.exr --set soft_shadow.layers=99", "outside 1 to 8"),
        ("bake SCENE -o OUT/x.exr --set soft_shadow.layers=x", "not a whole number"),
        ("bake SCENE -o OUT/x.exr --set soft_shadow.colour=1", "no parameter 'colour'"),
        ("bake SCENE -o OUT/x.exr --set soft_shadow.method=best", "area, bitmask"),
        ("bake SCENE -o OUT/x.exr --set fog.layers=1", "no effect 'fog'"),
        ("bake SCENE -o OUT/x.exr --set layers=1", "effect.parameter=value"),
        ("bake SCENE -o OUT/x.exr --frames 2-1", "backwards"),
        ("bake SCENE -o OUT/x.exr --frames 1-2", "####"),
        ("bake SCENE -o OUT/#.exr --frames 1-2 --report OUT/x.json", "####"),
        ("bake SCENE -o OUT/x.exr --report OUT/x.exr", "another file"),
        ("bake SCENE -o OUT/x.exr --report SCENE", "another file"),
        ("bake SCENE -o OUT/x.exr --report SCENE/x.json", "is not a folder"),
        ("bake SCENE -o OUT/#.exr --frames 1-2 --trace OUT/x.json", "--trace: several frames need ####"),
        ("bake SCENE -o OUT/x.exr --report OUT/x.json --trace OUT/x.json", "--trace: "),
        ("bake SCENE -o OUT/x.exr --trace SCENE/x.json", "is not a folder"),
        ("bake OUT/none.blend -o OUT/x.exr", "cannot read"),
        ("bake OUT -o OUT/x.exr", "cannot read"),
        ("bake SCENE -o OUT/x.exr --scene Other", "no scene 'Other'"),
        ("bake SCENE -o OUT/x.exr --view-layer Other", "no view layer 'Other'"),
        ("bake SCENE -o OUT/x.exr --camera Other", "no camera 'Other'"),
        ("plan OUT/none.blend", "cannot read"),
        ("stability --effects fog", "no effect 'fog'"),
        ("plan SCENE --set soft_shadow.layers=99", "outside 1 to 8"),
    ],
)
def test_complaints_are_one_line(words, complaint, tmp_path, capfd):
    scene = str(SAMPLES / "plain.blend")
    replaced = [word.replace("SCENE", scene).replace("OUT", str(tmp_path)) for word in words.split()]
    assert main(replaced) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert complaint in err
    assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_no_output_goes_over_the_open_blend_or_another(tmp_path):
    """As in `blender -b S.blend --command strata`, where no word names the scene."""
    blend = tmp_path / "shot_2.blend"
    blend.touch()
    (tmp_path / "link.exr").symlink_to(blend)
    for words in (
        f"-o {tmp_path}/x.exr --report {blend}",
        f"-o {tmp_path}/x.exr --report //../{tmp_path.name}/shot_2.blend",
        f"-o {tmp_path}/x_#.exr --report {tmp_path}/shot_#.blend",
        f"-o {tmp_path}/link.exr",
        f"-o {tmp_path}/x_#.exr --report {tmp_path}/x_#.exr",
    ):
        arguments = build_parser(needs_scene=False).parse_args(["bake", *words.split()])
        with pytest.raises(StrataError, match="another file"):
            read_outputs(arguments, (1, 2) if "#" in words else (1,), blend)


@pytest.mark.parametrize(("error", "code"), [(0.1, 0), (0.3, 1), (float("nan"), 1)])
def test_stability_ends_with_1_where_a_cell_is_beyond_its_bound(error, code, capfd, monkeypatch):
    rows = [Row("a lamp of no size", "closed form", {"cpu": error}, 0.2)]
    monkeypatch.setattr("strata.scripts.bench.stability.rows_of", lambda effect, devices: rows)
    monkeypatch.setattr("strata.scripts.bench.stability.devices", list)
    assert main(["stability", "--effects", "toon"]) == code
    out, err = capfd.readouterr()
    assert "## toon" in out
    assert "| a lamp of no size | 0.2 |" in out
    assert err == ""


def test_an_installed_extension_says_that_it_has_no_extremes(capfd, monkeypatch):
    monkeypatch.setattr("strata.ops.stability.CHECKOUT", "bl_ext.user_default.strata")
    assert main(["stability"]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert "only a checkout of its source has" in line


def test_help_is_on_stdout(capfd):
    assert main(["bake", "--help"]) == 0
    out, err = capfd.readouterr()
    assert "--probes" in out
    assert err == ""


# strata effects


def test_effects_tell_every_parameter(capfd):
    assert main(["effects", "--json"]) == 0
    described = json.loads(capfd.readouterr().out)
    assert [entry["id"] for entry in described] == [effect.id for effect in EFFECTS]
    for entry, effect in zip(described, EFFECTS, strict=True):
        assert [p["name"] for p in entry["params"]] == [spec.name for spec in effect.params.specs()]
        assert [layer["title"] for layer in entry["layers"]] == [kind.title for kind in effect.layers]
        defaults = {p["name"]: p["default"] for p in entry["params"]}
        assert effect.params.checked(effect.id, defaults) == effect.params()
    assert main(["effects"]) == 0
    text = capfd.readouterr().out
    assert "soft_shadow (on by default)" in text
    assert "toon (off by default)" in text
    assert all(f"{effect.id}.{spec.name} =" in text for effect in EFFECTS for spec in effect.params.specs())


def test_a_reader_that_leaves_is_no_error():
    shell = f"{sys.executable} -m strata effects --json | head -c 1; echo ${{PIPESTATUS[0]}}"
    result = subprocess.run(["bash", "-c", shell], capture_output=True, text=True)
    assert (result.stdout, result.stderr) == ("[0\n", "")


# strata plan


def test_plan_is_clean_json():
    plan = json.loads(strata("plan", SAMPLES / "courtyard.blend", "--json").stdout)
    assert {layer["light"] for layer in plan["layers"]} >= {"Sun"}
    assert all(layer["steps"] for layer in plan["layers"])
    assert all(layer["joins"] and layer["role"] == "visibility" for layer in plan["layers"])
    assert all(layer["name"] == f"Soft Shadow {layer['pass_name']}" for layer in plan["layers"])
    assert all(entry["reason"] for entry in plan["left_out"])
    assert plan["expected_seconds"] > 0.0
    more = strata("plan", SAMPLES / "courtyard.blend", "--json", "--samples", "1000").stdout
    assert json.loads(more)["expected_seconds"] > 20.0 * plan["expected_seconds"]
    text = strata("plan", SAMPLES / "courtyard.blend", "--size", "64x64").stdout
    assert f"{plan['layers'][0]['name']}: {' > '.join(plan['layers'][0]['steps'])}" in text


def test_materials_are_read_exactly_where_that_is_asked_for(tmp_path):
    """And what Blender bakes for it is told, and kept from one command to the next."""
    floor_scene()
    card(clear_by("Card", noise))
    blend, report = tmp_path / "scene.blend", tmp_path / "report.json"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    before, env = blend.read_bytes(), {**os.environ, "STRATA_CACHE": str(tmp_path / "cache")}
    words = (*QUICK, "--read", "exact", "--report", report, "-o", tmp_path / "out.exr")

    def baked() -> tuple[str, list[str]]:
        strata("bake", blend, *words, env=env)
        told = json.loads(report.read_text())
        return told["baked"], told["warnings"]

    plan = strata("plan", blend, "--size", "96x54", "--read", "exact", env=env).stdout
    assert "material 'Card': opacity to be baked by Blender at 128 texels a side, about 0." in plan
    (line,), warnings = baked()
    assert line.startswith("material 'Card': opacity baked by Blender at 128 texels a side, in 0.")
    assert not warnings
    assert baked()[0] == ["material 'Card': opacity baked by Blender at 128 texels a side, kept from before"]
    assert blend.read_bytes() == before
    assert "invalid choice: 'best'" in strata("plan", blend, "--read", "best", check=2).stderr
    fast = strata("plan", blend, "--size", "96x54", env=env).stdout
    assert "node 'Noise Texture' is not read for opacity" in fast


def test_nothing_to_bake_writes_no_file_and_says_so(tmp_path):
    outputs = ("-o", tmp_path / "x.exr", "--report", tmp_path / "x.json")
    result = strata("bake", SAMPLES / "plain.blend", *outputs, "--effects", "soft_shadow")
    assert "nothing to bake, no file written" in result.stderr
    assert list(tmp_path.iterdir()) == []


# strata bake


def test_bake_writes_layers_and_report(tmp_path):
    out, report = tmp_path / "out.exr", tmp_path / "out.json"
    words = (*QUICK, "--set", "soft_shadow.layers=2", "--set", "soft_shadow.resolution=256")
    words += ("--effects", "soft_shadow")
    result = strata("bake", SAMPLES / "courtyard.blend", "-o", out, "--report", report, *words)
    assert sorted(os.listdir(tmp_path)) == ["out.exr", "out.json"]
    layers, told = read_layers(out), json.loads(report.read_text())
    assert (layers.width, layers.height) == (96, 54)
    assert layers.report == told
    assert [layer.name for layer in layers.layers] == [layer["name"] for layer in told["layers"]]
    for layer in layers.layers:
        assert (layer.settings["layers"], layer.settings["resolution"]) == (2, 256)
        assert layer.error["probes"] > 0
        assert 0.0 <= layer.pixels.min() < layer.pixels.max() <= 1.0
        assert layer.name in result.stdout
    assert (told["backend"], told["size"]) == ("cpu", [96, 54])
    assert str(out) in result.stdout


def test_each_frame_has_a_trace(tmp_path):
    words = ("--frames", "1,3", "-o", tmp_path / "f_##.exr", "--trace", tmp_path / "f_##.json", *QUICK)
    result = strata("bake", SAMPLES / "animated.blend", *words)
    assert sorted(os.listdir(tmp_path)) == ["f_01.exr", "f_01.json", "f_03.exr", "f_03.json"]
    for frame in (1, 3):
        told = json.loads((tmp_path / f"f_0{frame}.json").read_text())
        assert told["otherData"]["frame"] == frame
        stages = [event["name"] for event in told["traceEvents"] if event.get("cat") == "stage"]
        before = ["Opening", "Looking through frames"] if frame == 1 else []
        reading = ["Evaluating", "Scanning", "Planning", "Extracting"]
        assert stages == [*before, *reading, "Starting", "Baking", "Measuring", "Done", "Writing"]
    assert "bound by" in result.stdout
    assert "soft_shadow/rays_alone" in result.stdout


def test_a_trace_that_cannot_be_written_costs_no_bake(tmp_path, capfd):
    trace = "/proc/trace.json"  # a folder that says it is writable and takes nothing
    words = (str(SAMPLES / "animated.blend"), "-o", str(tmp_path / "x.exr"), "--trace", trace, *QUICK)
    assert main(["bake", *words]) == 2
    out, err = capfd.readouterr()
    assert f"wrote {tmp_path / 'x.exr'}" in out
    assert err.splitlines()[-1].startswith(f"strata: cannot write {trace}: ")
    assert read_layers(tmp_path / "x.exr").layers
    assert os.listdir(tmp_path) == ["x.exr"]


def test_frames_each_have_their_file(tmp_path):
    words = ("--frames", "1,3", "--quiet", *QUICK)
    result = strata("bake", SAMPLES / "animated.blend", "-o", tmp_path / "f_##.exr", *words)
    assert sorted(os.listdir(tmp_path)) == ["f_01.exr", "f_03.exr"]
    assert (result.stdout, result.stderr) == ("", "")
    assert [read_layers(tmp_path / f"f_0{n}.exr").report["frame"] for n in (1, 3)] == [1, 3]


def test_what_is_set_and_changes_nothing_is_told_in_a_line(tmp_path):
    words = (
        "--size",
        "32x18",
        "--backend",
        "cpu",
        "--effects",
        "soft_shadow",
        "--set",
        "soft_shadow.layers=5",
    )
    out = (SAMPLES / "animated.blend", "-o", tmp_path / "f_#.exr", "--samples", "1", "--probes", "0")
    told = "--set soft_shadow.layers changes nothing: it counts where method is area or bitmask or hybrid"
    result = strata("bake", *out, "--frames", "1,2", *words)
    assert result.stderr.count(f"strata: {told}") == 1
    assert told not in strata("bake", *out, *words, "--set", "soft_shadow.method=bitmask").stderr
    assert told in strata("plan", SAMPLES / "animated.blend", *words[:2], *words[4:]).stdout
    idle = strata("bake", *out, *words[:-2], "--set", "toon.target_error=.1").stderr
    assert "strata: --set of toon changes nothing: it makes no layer here" in idle


def test_frames_have_the_same_samples_and_so_may_others(tmp_path):
    """Or their noise would flicker; what was chosen is taken again from a file or a report."""
    words = ("--quiet", "--size", "96x54", "--backend", "cpu", "--effects", "soft_shadow", "--probes", "0")
    blend, report = SAMPLES / "animated.blend", tmp_path / "f_##.json"
    aimed = ("--frames", "1,12", "--target-error", ".003", "--report", report)
    strata("bake", blend, "-o", tmp_path / "f_##.exr", *words, *aimed, "--probes", "32")
    first, last = (json.loads((tmp_path / f"f_{n}.json").read_text()) for n in ("01", "12"))
    chosen = [[layer["samples"] for layer in told["layers"]] for told in (first, last)]
    assert chosen[0] == chosen[1]
    assert max(chosen[0]) > 4
    assert first["layers"][0]["target"]["error"] == 0.003
    for source in ("f_01.exr", "f_01.json"):
        again = ("--frames", "12", "--settings-from", tmp_path / source)
        strata("bake", blend, "-o", tmp_path / "again.exr", *again, *words)
        pairs = [read_layers(tmp_path / name).layers for name in ("f_12.exr", "again.exr")]
        assert all(np.array_equal(a.pixels, b.pixels) for a, b in zip(*pairs, strict=True))
    nowhere = ("--settings-from", "nowhere.exr")
    assert "cannot read" in strata("bake", blend, "-o", tmp_path / "x.exr", *nowhere, check=2).stderr
    both = ("--settings-from", tmp_path / "f_01.json", "--samples", "8")
    assert "--samples: " in strata("bake", blend, "-o", tmp_path / "x.exr", *both, check=2).stderr
    both = (*both[:2], "--set", "soft_shadow.target_error=.1")
    assert "target_error: " in strata("bake", blend, "-o", tmp_path / "x.exr", *both, check=2).stderr


def test_frames_that_show_nothing_choose_nothing(tmp_path):
    scene = tmp_path / "turns.blend"
    program = (
        "import sys, bpy\n"
        "bpy.ops.wm.open_mainfile(filepath=sys.argv[1])\n"
        "bpy.context.scene.frame_end = 3\n"
        "camera = bpy.context.scene.camera\n"
        "for frame, turn in ((2, 0.0), (1, 3.0)):\n"  # away from everything
        "    camera.rotation_euler.x += turn\n"
        "    camera.keyframe_insert('rotation_euler', frame=frame)\n"
        "bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2])\n"
    )
    subprocess.run(
        [sys.executable, "-c", program, SAMPLES / "stacked.blend", scene],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    words = ("--frames", "1-3", "--size", "48x27", "--backend", "cpu", "--effects", "soft_shadow")
    aimed = ("--target-error", ".01", "--report", tmp_path / "f_##.json", "--probes", "32")
    strata("bake", scene, "-o", tmp_path / "f_##.exr", *words, *aimed)
    told = [json.loads(path.read_text())["layers"] for path in sorted(tmp_path.glob("f_*.json"))]
    assert told[-1][0]["target"]["error"] == 0.01
    assert told[-2][0]["samples"] == told[-1][0]["samples"] > 4


def test_the_scene_keeps_its_own_choices(tmp_path):
    """Effects that the file has switched off stay off, and its values count, until a flag says otherwise."""
    scene = tmp_path / "choices.blend"
    program = (
        "import sys, bpy\n"
        "from strata.addon.ui import properties\n"
        "properties.register()\n"
        "bpy.ops.wm.open_mainfile(filepath=sys.argv[1])\n"
        "settings = bpy.context.scene.strata\n"
        "settings.soft_shadow.enabled = settings.volumetric_light.enabled = False\n"
        "settings.soft_shadow.layers = 5\n"
        "settings.samples = 1\n"
        "bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2])\n"
    )
    subprocess.run(
        [sys.executable, "-c", program, str(SAMPLES / "animated.blend"), str(scene)],
        check=True, capture_output=True,
    )  # fmt: skip
    assert "no effect is switched on" in strata("bake", scene, "-o", tmp_path / "x.exr").stderr
    words = ("--effects", "soft_shadow", "--size", "32x32", "--probes", "0", "--backend", "cpu")
    strata("bake", scene, "-o", tmp_path / "x.exr", *words)
    layer = read_layers(tmp_path / "x.exr").layers[0]
    assert (layer.settings["layers"], layer.error) == (5, {})


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupt_leaves_no_file(tmp_path, number):
    """Sent while the kernels work, at a size that takes minutes."""
    out = tmp_path / "out.exr"
    words = ["bake", SAMPLES / "courtyard.blend", "-o", out, "--samples", "4096", "--backend", "cpu"]
    command = [sys.executable, "-m", "strata", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert "frame" in process.stderr.readline()  # the first line of progress
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "strata: interrupted"
    assert "Traceback" not in err
    assert os.listdir(tmp_path) == []


# Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_bar_on_a_terminal_is_drawn_over_and_cleared(monkeypatch):
    clock = iter([0.0, 1.0, 1.05, 2.0])
    monkeypatch.setattr("strata.ops.terminal.time.monotonic", lambda: next(clock))
    stream = Terminal()
    progress = Progress(stream, "frame 1")
    progress.show(0.1, "Baking", 9.0)
    progress.show(0.2, "Baking", 8.0)  # 0.05 s later: too soon to draw again
    progress.show(0.5, "Measuring", None)
    progress.clear()
    drawn = stream.getvalue().split("\r\x1b[K")
    assert [line[:7] for line in drawn] == ["", "frame 1", "frame 1", ""]
    assert "9 s left" in drawn[1]
    assert "50%" in drawn[2]
    assert "left" not in drawn[2]
    assert "\n" not in stream.getvalue()


def test_lines_elsewhere_and_silence_when_quiet(monkeypatch):
    clock = iter([0.0, 1.0, 3.0, 0.0, 9.0])
    monkeypatch.setattr("strata.ops.terminal.time.monotonic", lambda: next(clock))
    stream = io.StringIO()
    progress = Progress(stream, "frame 1")
    progress.show(0.1, "Baking", 9.0)  # too soon for a line
    progress.show(0.5, "Baking", 3.0)
    progress.clear()
    assert stream.getvalue() == "frame 1:  50%, 3 s left, Baking\n"
    quiet = io.StringIO()
    Progress(quiet, "frame 1", quiet=True).show(0.5, "Baking")
    assert quiet.getvalue() == ""


def test_time_left():
    assert time_left(10.0) == "10 s left"
    assert time_left(540.0) == "9 min left"
    assert time_left(None) == ""
