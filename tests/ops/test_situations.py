"""What shells, disks and files do to a command: each ends whole, or in one line, with nothing left behind."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys

import bpy
import pytest
from strata.addon.effects.registry import EFFECTS
from strata.ops.cli import main
from strata.tests.bake.random_scene_check import problems_of_file
from strata.tests.support.exr_layers import read_layers
from strata.tests.support.places import SAMPLES, scene_files

SCENE = str(SAMPLES / "stacked.blend")
QUICK = (
    "--backend",
    "cpu",
    "--size",
    "32x18",
    "--samples",
    "1",
    "--probes",
    "16",
    "--effects",
    "soft_shadow",
)
COARSE = ("soft_shadow.resolution=256", "volumetric_light.resolution=128", "volumetric_light.light_samples=2")
EVERYTHING = (
    "--effects",
    ",".join(effect.id for effect in EFFECTS),
    *(w for c in COARSE for w in ("--set", c)),
)


def shell(line: str) -> subprocess.CompletedProcess:
    """`strata` in a shell's line is the command."""
    line = line.replace("strata", f"{sys.executable} -m strata", 1)
    return subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=300)


def saved(path) -> str:
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return str(path)


# Every file


@pytest.mark.parametrize("path", scene_files(), ids=lambda path: path.stem)
def test_every_file_bakes_by_the_command_with_everything_on(path, backend, tmp_path, capfd):
    out = tmp_path / "out.exr"
    words = ["--quiet", "--size", "64x36", "--samples", "2", "--probes", "64", "--backend", backend]
    code = main(["bake", str(path), "-o", str(out), *words, *EVERYTHING])
    told = capfd.readouterr().err.splitlines()
    assert (code, len(told)) in {(0, 0), (2, 1)}, told
    assert code == 0 or "Strata failed" not in told[0]
    assert os.listdir(tmp_path) in ([], ["out.exr"])
    if out.exists():
        assert problems_of_file(out) == []


# Scenes


def startup_file():
    bpy.ops.wm.read_factory_settings()


def no_lamp():
    startup_file()
    bpy.data.objects.remove(bpy.data.objects["Light"])


def no_mesh():
    startup_file()
    bpy.data.objects.remove(bpy.data.objects["Cube"])


def nothing_but_a_camera():
    no_lamp()
    bpy.data.objects.remove(bpy.data.objects["Cube"])


def all_excluded():
    startup_file()
    bpy.context.view_layer.layer_collection.children[0].exclude = True


def view_layer_off():
    startup_file()
    bpy.context.view_layer.use = False


def two_eyes():
    startup_file()
    bpy.context.scene.render.use_multiview = True


def blurred():
    startup_file()
    bpy.context.scene.render.use_motion_blur = True
    bpy.context.scene.render.film_transparent = True
    bpy.context.scene.render.use_simplify = True


def lamp_in_the_mesh():
    startup_file()
    bpy.data.objects["Light"].location = (0, 0, 0)


def camera_in_the_mesh():
    startup_file()
    bpy.data.objects["Camera"].location = (0, 0, 0)


def odd_names():
    startup_file()
    bpy.data.objects["Light"].name = "Ünïcode . 灯 \n \t % {} /"
    bpy.context.view_layer.name = "a.b\nc"
    bpy.context.scene.name = "x" * 60


SCENES = [
    startup_file, no_lamp, no_mesh, nothing_but_a_camera, all_excluded, view_layer_off, two_eyes, blurred,
    lamp_in_the_mesh, camera_in_the_mesh, odd_names,
]  # fmt: skip


@pytest.mark.parametrize("make", SCENES, ids=lambda make: make.__name__)
def test_scenes_of_every_beginner(make, tmp_path, capfd):
    make()
    scene, out = saved(tmp_path / "scene.blend"), tmp_path / "out.exr"
    capfd.readouterr()
    code = main(["bake", scene, "-o", str(out), *QUICK[:-2], *EVERYTHING])
    _, err = capfd.readouterr()
    assert code == 0, err
    assert out.exists() or "nothing to bake" in err
    if out.exists():
        assert problems_of_file(out) == []


def test_no_camera_and_a_file_of_tomorrow_are_refused(tmp_path, capfd):
    startup_file()
    bpy.data.objects.remove(bpy.data.objects["Camera"])
    blind = saved(tmp_path / "blind.blend")
    bpy.context.preferences.filepaths.use_file_compression = False
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "now.blend"), compress=False)
    data = (tmp_path / "now.blend").read_bytes()
    tomorrow = tmp_path / "tomorrow.blend"
    assert data[:11] == b"BLENDER17-0"
    tomorrow.write_bytes(data[:13] + b"9999" + data[17:])
    for path in (blind, str(tomorrow)):
        capfd.readouterr()
        assert main(["bake", path, "-o", str(tmp_path / "x.exr"), *QUICK]) == 2
        out, err = capfd.readouterr()
        assert (out, len(err.splitlines())) == ("", 1)
        assert not (tmp_path / "x.exr").exists()


# Shells and disks


def test_closed_streams_cost_nothing(tmp_path):
    for closed in (">&-", "2>&-", "<&- >&- 2>&-"):
        out = tmp_path / "out.exr"
        result = shell(f"strata bake {SCENE} -o {out} --quiet {' '.join(QUICK)} {closed}")
        assert (result.returncode, result.stderr) == (0, ""), closed
        assert read_layers(out).layers
        out.unlink()


def test_a_full_standard_output_is_one_line():
    result = shell("strata effects > /dev/full")
    assert (result.returncode, len(result.stderr.splitlines())) == (2, 1)
    assert result.stderr == "strata: cannot write to standard output: No space left on device\n"


def test_a_disk_that_fills_up_is_one_line_and_leaves_nothing(tmp_path, capfd):
    """A limit on the size of files stands in for the disk's end."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # as Python has it; Blender's module takes that back
    target = tmp_path / "out.exr"
    target.write_bytes(b"what was there")
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024, before[1]))
        code = main(["bake", SCENE, "-o", str(target), *QUICK])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    err = capfd.readouterr().err
    assert (code, len(err.splitlines())) == (2, 1)
    assert f"cannot write {target}: File too large" in err
    assert os.listdir(tmp_path) == ["out.exr"]
    assert target.read_bytes() == b"what was there"


@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_what_is_no_file_is_refused_at_once(kind, tmp_path, capfd):
    path = {"device": "/dev/zero", "folder": str(tmp_path)}.get(kind, str(tmp_path / "pipe"))
    if kind == "pipe":
        os.mkfifo(path)
    assert main(["bake", path, "-o", str(tmp_path / "x.exr"), *QUICK]) == 2
    assert capfd.readouterr().err == f"strata: cannot read '{path}': it is not a file\n"


@pytest.mark.parametrize("name", ["a" * 300 + ".exr", "/proc/out.exr"])
def test_outputs_that_cannot_be_are_one_line(name, tmp_path, capfd):
    assert main(["bake", SCENE, "-o", str(tmp_path / name), *QUICK]) == 2
    err = capfd.readouterr().err
    assert len(err.splitlines()) == 1
    assert err.startswith("strata: cannot write ")


def test_names_that_are_no_text_are_written_all_the_same(tmp_path, capfd):
    scene = tmp_path / "s\udcff.blend"
    scene.write_bytes((SAMPLES / "stacked.blend").read_bytes())
    out, report = tmp_path / "f\udcff" / "o\udcff.exr", tmp_path / "o\udcff.json"
    code = main(["bake", str(scene), "-o", str(out), "--report", str(report), *QUICK])
    assert code == 0, capfd.readouterr().err
    assert out.exists()
    assert report.read_text(encoding="utf-8")


@pytest.mark.parametrize("size", ["1x1", "4096x1", "1x4096"])
def test_sizes_of_one_pixel(size, tmp_path, capfd):
    out = tmp_path / "out.exr"
    assert main(["bake", SCENE, "-o", str(out), *QUICK, "--size", size]) == 0, capfd.readouterr().err
    assert problems_of_file(out) == []
