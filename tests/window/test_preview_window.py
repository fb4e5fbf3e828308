"""The preview in a real Blender window, under Xvfb, where BLENDER names a Blender program; CI makes one."""

from __future__ import annotations

import json
import os
import shutil
import subprocess

import pytest
from strata.tests.support.places import ROOT, SAMPLES

# What the CPU has made is drawn as what a GPU has.
SESSIONS = [("opengl", "cpu"), ("opengl", "gpu"), ("vulkan", "gpu")]


def check_preview(gpu_backend, backend, source, screen, tmp_path):
    scene, result = tmp_path / "stacked.blend", tmp_path / "result.json"
    shutil.copy(SAMPLES / "stacked.blend", scene)
    words = ["--factory-startup", "--gpu-backend", gpu_backend]
    words += ["--python", ROOT / "scripts" / "in_blender.py", "--", "strata.tests.window.preview_drive"]
    words += [source, scene, backend, result, tmp_path]
    env = {**os.environ, "DISPLAY": screen, "BLENDER_USER_RESOURCES": str(tmp_path / "home")}
    command = list(map(str, (os.environ["BLENDER"], *words)))
    run = subprocess.run(command, env=env, capture_output=True, text=True, timeout=600)
    said = run.stdout + run.stderr
    assert result.exists(), said
    found = json.loads(result.read_text())
    assert "failure" not in found, found["failure"] + said
    assert "Traceback" not in said
    assert found["available"] == ""
    # The frame is where Blender shows it, and as Blender would save it. Not to the last digit: the table of
    # the view transform is interpolated, and the window has 8 bits.
    assert found["changed outside"] < 0.002
    assert abs(found["pixel"] - 1.0) < 0.01
    assert found["smooth"] > 0.3
    mean, most = found["brightness"]
    assert mean < 2 / 255
    assert most < 6 / 255
    assert found["noise map"] < 2 / 255
    assert found["noise map colours"] > 20
    maps = {"layered_depth": 1, "soft_shadow/prepare": 1}
    lit = {"soft_shadow/backproject": 1, "soft_shadow/visibility": 1, "composite": 1}
    assert found["idle"] == {}
    assert found["light"] == {**maps, **lit, "soft_shadow/raised": 1, "irradiance": 1}
    assert found["traced frames"] == 1
    assert found["traced stages"] == ["Blender", "Redraw", "Refining"]
    assert found["light"].keys() <= set(found["traced steps"])
    assert maps.keys().isdisjoint(found["camera"])
    assert found["camera"]["surface"] == 1
    assert found["slider"] == lit
    everything, local, again, hidden = found["instances"]
    assert local < everything == again
    assert hidden == everything - 1
    assert abs(found["undone"] - 1.0) < 1e-4
    assert found["quad"] == 4
    assert found["windows"] == 2
    assert found["windows after"] == 1
    assert found["left"] == [0, 0, 0]
    assert not found["running"]
    assert not found["on after load"]


if "BLENDER" in os.environ:

    @pytest.mark.parametrize(("gpu_backend", "backend"), SESSIONS)
    def test_preview_in_a_window(gpu_backend, backend, archive, display, tmp_path):
        check_preview(gpu_backend, backend, archive, display, tmp_path)
