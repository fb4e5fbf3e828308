"""Strata in a real Blender window, used with a mouse and a keyboard; BLENDER names a Blender program."""

from __future__ import annotations

import os
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from strata.tests.support.exr_layers import read_layers
from strata.tests.window.window import PHOTOGRAPHS, courtyard_window

LAYER = "Soft Shadow Sky panel"  # as in drive.py
# 0.2 s is the promise, which test_job.py times without a window; here the window is drawn in software, and
# the driver looks again only after each drawing.
SECONDS_TO_CANCEL = 3.0
# A second or two on a machine that does nothing else; the scene has 8000 instances.
SECONDS_TO_PLAN = 10.0
# A GPU job is worked off on the main thread, and nothing interrupts a call of a GPU in software: 1.9 s were
# seen on a busy machine. A window that is frozen is so until the render's end.
SOFTWARE_CALL_SECONDS = 5.0
# Mean difference of parts, out of 1: pixels of preview and bake differ a little in size and sample edges
# elsewhere, and the window has 8 bits.
MOST_APART = 0.03
# Of squares that are all of one colour, out of 1.
MOST_COLOURS_APART = 0.01
# View transforms with edges and kinks between the levels at which the preview's table holds them: their
# squares agree on average. The rendered viewport is transformed by Blender itself.
STEEP = ("False Color", "Khronos PBR Neutral")
# A render on the CPU never calls what the window is drawn with.
SESSIONS_OF_RENDERS = [("opengl", "cpu"), ("opengl", "gpu"), ("vulkan", "gpu")]


def shown_and_baked(photograph: Path, file: Path, frame) -> tuple[np.ndarray, np.ndarray]:
    """(8, 7) means of a shadow over parts of the image: as on the screen, and as baked."""
    grey = brightness(photograph)
    left, top, right, bottom = (round(edge) for edge in frame)
    layer = next(layer for layer in read_layers(file).layers if layer.name == LAYER)
    return parts(grey[top:bottom, left:right]), parts(layer.pixels[::-1])


def brightness(photograph: Path) -> np.ndarray:
    """(height, width) 0 to 1, row 0 at the top."""
    return np.asarray(Image.open(photograph).convert("L"), np.float64) / 255.0


def parts(image: np.ndarray) -> np.ndarray:
    """Means over 8 x 12 parts of an image, and of them the left 7 columns: the sidebar covers the right."""
    rows, columns = (
        np.linspace(0, side, count + 1).astype(int) for side, count in zip(image.shape, (8, 12), strict=True)
    )
    means = [[image[y0:y1, x0:x1].mean() for x0, x1 in pairwise(columns)] for y0, y1 in pairwise(rows)]
    return np.array(means)[:, :7]


def check_a_session(backend, archive, display, tmp_path):
    photographs = PHOTOGRAPHS / backend
    out = tmp_path / "out.exr"
    found = courtyard_window(photographs, backend, archive, display, tmp_path, "drive", out)
    layers = [layer.name for layer in read_layers(out).layers]
    assert found["opens"] == ["CAMERA", True, True]
    assert found["tab"] == "Strata"
    assert {"strata.bake", "strata.target_error", "strata.samples"} <= set(found["buttons"])
    assert "strata.plan" not in found["buttons"]  # nobody has to ask
    assert found["seconds to plan"] < SECONDS_TO_PLAN
    assert set(found["lights listed"]) >= set(found["lights"])
    assert found["warned"] == ["hidden in the viewport, and baked: 'Sky panel'"]
    calm, warned = (brightness(photographs / f"1{name}.png") for name in (" panel", "a warned"))
    x, y = found["bake button"]
    around = slice(round(900 - y) - 20, round(900 - y) + 20), slice(round(x) - 60, round(x) + 60)
    assert calm[around].std() > 0.01
    np.testing.assert_array_equal(calm[around], warned[around])  # it has not moved
    check_texts(photographs)
    before, dragged = found["probes dragged"]
    assert dragged > before
    assert found["probes undone"] == before
    still = shown_and_baked(photographs / "2 preview.png", photographs / "before.exr", found["frame"])
    moved = shown_and_baked(photographs / "3 light moved.png", photographs / "after.exr", found["frame"])
    for shown, baked in (still, moved):
        assert np.abs(shown - baked).mean() < MOST_APART
    # The light has moved, and its shadow with it: the comparison can fail.
    assert found["light moved"] > 0.1
    assert np.abs(moved[0] - still[1]).mean() > 2.0 * np.abs(moved[0] - moved[1]).mean()
    left, top, right, bottom = (round(edge) for edge in found["frame"])
    plain, fog, toon = (
        brightness(photographs / f"2{name}.png")[top:bottom, left:right]
        for name in ("a composite", "b fog", "c toon")
    )
    for one, other in ((plain, fog), (fog, toon)):
        assert np.abs(one - other).mean() > 0.02
    assert found["preview is off"]
    assert found["light undone"] < 1e-5
    assert "%" in found["drawn while baking"]
    assert found["seconds to cancel"] < SECONDS_TO_CANCEL
    assert found["seconds to cancel by button"] < SECONDS_TO_CANCEL
    assert found["images after cancel"] == []
    assert found["renders until Esc"]
    assert found["seconds to cancel a render"] < SECONDS_TO_CANCEL
    assert found["left of the cancelled render"] == [[], []]
    assert len(layers) >= 3
    assert found["layers"] == layers == found["rendered"]
    assert found["images"] == sorted(layers)
    assert found["shown in a new window"] == [2, str(out)]
    layer, lamp = found["layer of a row"]
    assert layer == f"Soft Shadow {lamp}"
    x, y, width, height = found["editor"]
    shown, filled = (
        brightness(photographs / f"{name}.png")[900 - y - height : 900 - y, x : x + width]
        for name in ("5a shown", "5b filled anew")
    )
    assert (np.abs(shown - filled) > 0.2).sum() > 500  # of the image's 96 x 54
    assert "log.txt" in found["report stopped"]
    assert {"report.html", "report.json", "plots"} <= set(found["report"])
    assert found["images after more bakes"] == found["images"]
    assert found["unsaved images"] == []
    assert found["images after undo"] == []
    assert set(found["lights"]) >= {name.removeprefix("Soft Shadow ") for name in layers}
    assert found["is saved"]
    assert found["samples after opening"] == 7
    assert found["preview after opening"]
    assert found["images after opening"] == found["images"]
    assert found["is gone"]
    assert found["quits without a question"]
    assert len(list(photographs.glob("*.png"))) == 18


def check_texts(photographs: Path) -> None:
    """The preview's lines begin where Blender's end, or where those would begin."""
    shown = {
        name: brightness(photographs / f"3a text {name}.png")
        for name in ("none", "Blender", "both", "Strata")
    }

    def rows(name: str, other: str) -> np.ndarray:
        """Where two differ, in the viewport's left part, below its headers."""
        different = np.abs(shown[name] - shown[other])[70:500, 60:330].max(axis=1) > 0.2
        return np.flatnonzero(different)

    blenders, ours, alone = rows("Blender", "none"), rows("both", "Blender"), rows("Strata", "none")
    assert len(ours) > 10
    # A light is active, which has three rows of statistics less than a mesh: the room for those stays.
    assert blenders.max() < ours.min() < blenders.max() + 90
    assert abs(alone.min() - blenders.min()) < 5


def check_renders(backend, device, archive, display, tmp_path):
    photographs = PHOTOGRAPHS / f"{backend} renders {device}"
    found = courtyard_window(photographs, backend, archive, display, tmp_path, "render", device)
    one_call = SOFTWARE_CALL_SECONDS if device == "gpu" else 0.0
    for name in ("WINDOW", "NONE", "AREA", "SCREEN"):
        seen = found[name]
        assert seen["renders"], name
        assert seen["gap"] < 3.0 * seen["idle"] + 0.5 + one_call, (name, seen)
        assert seen["seconds to cancel"] < SECONDS_TO_CANCEL + one_call, (name, seen)
    if device == "cpu":  # a GPU in software may still be at its first sample
        middle = brightness(photographs / f"{device} SCREEN.png")[420:480, 640:760]
        assert middle.std() > 0.1  # no checkerboard, but the picture so far
    assert found["seconds to open a file"] < SECONDS_TO_CANCEL + one_call
    assert not found["renders after opening"]
    assert found["F12"] == found["script"] == [device, "asked for"]
    assert found["locked"][0] == "cpu"
    assert ("Lock Interface" in found["locked"][1]) == (device == "gpu")
    assert found["renders when it quits"]


def squares(photograph: Path, count: tuple[int, int], frame) -> np.ndarray:
    """(rows, columns, 3) 0 to 1, row 0 at the top: means of the middles of a chart's squares."""
    image = np.asarray(Image.open(photograph).convert("RGB"), np.float64) / 255.0
    left, top, right, bottom = frame
    xs, ys = (
        [round(start + (number + 0.5) * (end - start) / squares) for number in range(squares)]
        for start, end, squares in ((left, right, count[0]), (top, bottom, count[1]))
    )
    return np.array([[image[y - 5 : y + 5, x - 5 : x + 5].mean(axis=(0, 1)) for x in xs] for y in ys])


def check_colours(backend, archive, display, tmp_path):
    """The chart on the screen, as Blender saves the same render."""
    photographs = PHOTOGRAPHS / f"{backend} colours"
    found = courtyard_window(photographs, backend, archive, display, tmp_path, "colours")
    count = found["squares"]
    assert {"Standard", "AgX", "Filmic", "False Color", "Raw"} <= set(found["settings"])
    for name in found["settings"]:
        saved = squares(photographs / f"{name} F12.png", count, (0, 0, 20 * count[0], 20 * count[1]))
        assert saved.std() > 0.2, name
        for path in photographs.glob(f"{name} [MRS]*.png"):
            apart = np.abs(squares(path, count, found["frame"]) - saved)
            assert apart.mean() < MOST_COLOURS_APART, (path.name, apart.mean())
            if path.stem.endswith("RENDERED") or name not in STEEP:
                assert apart.max() < MOST_COLOURS_APART, (path.name, apart.max())


if "BLENDER" in os.environ:
    test_a_session = pytest.mark.parametrize("backend", ["opengl", "vulkan"])(check_a_session)

    test_colours = pytest.mark.parametrize("backend", ["opengl", "vulkan"])(check_colours)

    @pytest.mark.parametrize(("backend", "device"), SESSIONS_OF_RENDERS)
    def test_renders(backend, device, archive, display, tmp_path):
        check_renders(backend, device, archive, display, tmp_path)
