"""An artist's first ten minutes with Strata, in a real Blender window; BLENDER names a Blender program."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from strata.tests.window.window import PHOTOGRAPHS, in_a_window

DRIVER = "story"
LAYER = "Soft Shadow Light"
# Out of 1: the preview refines anew in Edit Mode, over Blender's own picture of it.
MOST_APART = 0.01


def check_the_story(backend, archive, display, tmp_path):
    photographs = PHOTOGRAPHS / f"{backend} story"
    folder = tmp_path / "work"
    folder.mkdir()
    found = in_a_window(photographs, backend, archive, display, tmp_path, DRIVER, "first", folder)
    assert found["tab"] == "Strata"
    assert found["first bake"] == [[LAYER], [LAYER]]
    assert found["second bake"] == [LAYER]
    assert found["darkest"] < 0.05  # the cube's shadow on the ground
    for name in ("plain", "subdivided"):
        object_mode, edit_mode = (
            in_frame(photographs / f"3 {name} {mode} mode.png", found["frame"]) for mode in ("object", "edit")
        )
        assert np.abs(object_mode - edit_mode).mean() < MOST_APART, name
    assert found["renders until Esc"]
    assert found["layers"] == found["layers after"] == found["last images"] == [LAYER]
    assert found["own shadow is off"]
    assert found["own shadow is back"]
    own, composited = found["own and composited"]
    assert abs(own - composited) < 0.02 * own
    assert found["modified images"] == []
    assert not found["quit asks"]


def check_an_imported_scene(backend, archive, display, tmp_path):
    photographs = PHOTOGRAPHS / f"{backend} imported"
    folder = tmp_path / "work"
    folder.mkdir()
    write = [sys.executable, "-m", "strata.tests.window.imported_scene", folder]
    subprocess.run(write, check=True, stdout=subprocess.DEVNULL)
    scene = folder / "imported.blend"
    found = in_a_window(
        photographs, backend, archive, display, tmp_path, DRIVER, "imported", folder, scene=scene
    )
    assert found["layers"] == ["Soft Shadow Key", "Soft Shadow Sun"]
    assert any("Transmission" in warning for warning in found["warnings"])
    assert found["spread"] > 0.05  # a picture


def in_frame(photograph, frame) -> np.ndarray:
    """What is in the camera's frame but for the right end, where the sidebar may be; 0 to 1."""
    left, top, right, bottom = (round(edge) for edge in frame)
    image = np.asarray(Image.open(photograph).convert("L"), np.float64) / 255.0
    return image[top:bottom, left : left + round(0.6 * (right - left))]


if "BLENDER" in os.environ:
    test_the_story = pytest.mark.parametrize("backend", ["opengl", "vulkan"])(check_the_story)
    test_an_imported_scene = pytest.mark.parametrize("backend", ["opengl"])(check_an_imported_scene)
