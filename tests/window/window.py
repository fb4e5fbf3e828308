"""Starts a real Blender with the extension in a window, and a driver inside it that uses it as a person."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

from strata.tests.support.places import ROOT, SAMPLES

PHOTOGRAPHS = ROOT / "out" / "interface"
SECONDS = 400  # that a session may take


def courtyard_window(
    photographs: Path, backend: str, archive: Path, display: str, folder: Path, *words
) -> dict:
    """`in_a_window` with a copy of courtyard.blend open."""
    scene = folder / "courtyard.blend"
    shutil.copy(SAMPLES / "courtyard.blend", scene)
    return in_a_window(photographs, backend, archive, display, folder, *words, scene=scene)


def in_a_window(
    photographs: Path,
    backend: str,
    archive: Path,
    display: str,
    folder: Path,
    driver: str,
    *words,
    scene: Path | None = None,
) -> dict:
    """What a driver writes down, with `scene` open, or Blender's startup file; `words` are its arguments but
    the last two: the folder of photographs, emptied, and the file it writes to."""
    result = folder / "result.json"
    shutil.rmtree(photographs, ignore_errors=True)
    photographs.mkdir(parents=True)
    env = {**os.environ, "DISPLAY": display, "BLENDER_USER_RESOURCES": str(folder / "home")}
    # Mesa maps its cache of shaders into memory: another process that trims it ends this one with SIGBUS.
    env["MESA_SHADER_CACHE_DIR"] = str(folder / "shaders")

    def blender(*words) -> str:
        command = list(map(str, (os.environ["BLENDER"], *words)))
        run = subprocess.run(command, env=env, capture_output=True, text=True, timeout=SECONDS)
        assert run.returncode == 0, run.stdout + run.stderr
        return run.stdout + run.stderr

    said = blender("--command", "extension", "install-file", "-r", "user_default", "-e", archive)
    window = ("--window-geometry", 0, 0, 1400, 900, "--gpu-backend", backend)
    opened = [scene] if scene else []
    program = ("--python", ROOT / "scripts" / "in_blender.py", "--", f"strata.tests.window.{driver}")
    said += blender(*window, *opened, *program, *words, photographs, result)
    assert result.exists(), said
    found = json.loads(result.read_text())
    assert "failure" not in found, found["failure"] + said
    assert "Traceback" not in said, said  # a panel that fails to draw says so there
    return found
