"""The samples of a sequence with a target error: the same in all frames, on whichever machine."""

from __future__ import annotations

import json

import bpy
import pytest
from strata.addon import sequence_samples as looking
from strata.addon.sequence_samples import looked_at, sequence_samples
from strata.addon.ui.properties import options_of
from strata.ops.cli import main
from strata.tests.bake.sequence_scenes import box, keyed, lamp, still_scene

pytestmark = pytest.mark.usefixtures("registered")

SIZE = 48, 36
AIM = {"effects": ("soft_shadow",), "backend": "cpu", "target_error": 0.01}


def comes_later():
    """Crates that stand under the floor in frame 1, and in the torch's light from frame 3 on."""
    scene = still_scene()
    torch = lamp("Torch", place=(1.0, 0.0, 3.0), energy=200.0)
    torch.data.shadow_soft_size = 0.3
    for n in range(12):
        crate = box(f"Crate{n}", 0.4, (0, 0, -20))
        place = (n % 4 - 1.5, n // 4 - 1.0, 0.5)
        keyed(crate, "location", f1=(*place[:2], -20.0), f3=place)
    return scene


def samples_of(scene, frames, **options) -> dict[str, int]:
    given = AIM | options
    return sequence_samples(scene, scene.view_layers[0], lambda s: options_of(s, **given), frames, size=SIZE)


def test_frames_that_are_looked_at():
    assert looked_at(1, 250) == [1, 125, 250]
    assert looked_at(3, 4) == [3, 4]
    assert looked_at(-2, 1) == [-2, -1, 1]


def test_what_comes_into_view_later_has_its_samples_in_all_frames():
    scene = comes_later()
    chosen = samples_of(scene, (1, 2))
    assert chosen == samples_of(scene, (3, 4))  # another machine's chunk
    scene.frame_end = 2  # they never come
    assert samples_of(scene, (1, 2))["Soft Shadow Torch"] <= 0.5 * chosen["Soft Shadow Torch"]
    assert scene.frame_current == 1


def test_where_the_first_frame_may_choose_nobody_looks():
    scene = comes_later()
    assert samples_of(scene, (2,)) == {}
    assert samples_of(scene, (1, 2), time_budget_s=5.0) == {}
    assert samples_of(scene, (1, 2), samples=8, target_error=None) == {}
    assert samples_of(still_scene(), (1, 2)) == {}


def test_a_frame_that_cannot_be_baked_chooses_nothing():
    scene = comes_later()
    keyed(scene.camera.data, "clip_end", f1=100.0, f4=0.1)
    scene.camera.data.clip_start = 0.1
    assert samples_of(scene, (1, 2))


def told(tmp_path, capsys, *words):
    blend = tmp_path / "later.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    words = ("--size", "48x36", "--backend", "cpu", "--effects", "soft_shadow", *words)
    report = ("--report", str(tmp_path / "f_#.json"))
    assert main(["bake", str(blend), "-o", str(tmp_path / "f_#.exr"), *report, *words]) == 0
    reports = [json.loads(path.read_text())["layers"] for path in sorted(tmp_path.glob("f_*.json"))]
    return reports, capsys.readouterr().err


def test_the_command_line_bakes_with_them_and_tells_what_was_missed(tmp_path, capsys):
    comes_later()
    (first, last), errors = told(
        tmp_path, capsys, "--frames", "1,4", "--target-error", ".01", "--probes", "64"
    )
    samples = [{layer["name"]: layer["samples"] for layer in layers} for layers in (first, last)]
    assert samples[0] == samples[1]
    assert samples[0]["Soft Shadow Torch"] > 4
    assert "the target error is not reached" not in errors


def test_frames_that_miss_their_target_are_told_in_one_line(tmp_path, capsys):
    comes_later()
    words = ("--frames", "1-4", "--target-error", ".001", "--samples", "4", "--probes", "256")
    _, errors = told(tmp_path, capsys, *words)
    lines = [line for line in errors.splitlines() if "the target error is not reached" in line]
    assert len(lines) == 1
    assert lines[0].endswith("in 4 frames (1, 2, 3, 4): Soft Shadow Key, Soft Shadow Torch")


def test_they_are_told_where_nothing_is_measured_too(tmp_path, capsys):
    comes_later()
    words = ("--frames", "1-4", "--target-error", ".001", "--samples", "4", "--probes", "0")
    _, errors = told(tmp_path, capsys, *words)
    assert errors.count("the target error is not reached in") == 1


def test_a_frame_that_cannot_be_looked_at_is_told(tmp_path, capsys, monkeypatch):
    comes_later()
    own = looking.read_job

    def broken(scene, view_layer, options_of, frame, *more):
        if frame == 4:
            raise MemoryError("too large")
        return own(scene, view_layer, options_of, frame, *more)

    monkeypatch.setattr(looking, "read_job", broken)
    reports, errors = told(tmp_path, capsys, "--frames", "1,2", "--target-error", ".05", "--probes", "0")
    assert len(reports) == 2
    assert "no samples are chosen by frame 4: " in errors
