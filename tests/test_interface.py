"""The sidebar in a real Blender window, under Xvfb, where BLENDER names a Blender program; CI makes one."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from exr_layers import read_layers

TESTS = Path(__file__).resolve().parent


@pytest.fixture
def display():
    """A screen without a monitor; its number is chosen by the server."""
    readable, writable = os.pipe()
    command = ["Xvfb", "-displayfd", str(writable), "-screen", "0", "1400x900x24", "+extension", "GLX"]
    with subprocess.Popen(command, pass_fds=[writable], stderr=subprocess.DEVNULL) as server:
        os.close(writable)
        with open(readable) as told:
            number = told.readline().strip()
        assert number, "Xvfb did not start"
        yield f":{number}"
        server.terminate()


def check_bake_from_the_sidebar(backend, archive, display, tmp_path):
    scene, out, result = tmp_path / "courtyard.blend", tmp_path / "out.exr", tmp_path / "result.json"
    shutil.copy(TESTS.parent / "sample_blends" / "courtyard.blend", scene)
    words = ["--factory-startup", "--gpu-backend", backend, "--enable-event-simulate"]
    words += ["--python", TESTS / "interface_drive.py", "--", archive, scene, out, result]
    env = {**os.environ, "DISPLAY": display, "BLENDER_USER_RESOURCES": str(tmp_path / "home")}
    command = list(map(str, (os.environ["BLENDER"], *words)))
    run = subprocess.run(command, env=env, capture_output=True, text=True, timeout=300)
    assert result.exists(), run.stdout + run.stderr
    assert "Traceback" not in run.stdout + run.stderr  # a panel that fails to draw says so there
    found = json.loads(result.read_text())
    layers = read_layers(out)
    assert found["started"]
    assert found["plan"]
    assert "%" in found["drawn while baking"]
    # tests/test_job.py times the stop itself; here the window is drawn in software in between.
    assert found["seconds to cancel"] < 3.0
    assert found["images after cancel"] == []
    assert found["layers"] == [layer.name for layer in layers.layers]
    assert found["images"] == sorted(found["layers"])


if "BLENDER" in os.environ:
    test_bake_from_the_sidebar = pytest.mark.parametrize("backend", ["opengl", "vulkan"])(
        check_bake_from_the_sidebar
    )
