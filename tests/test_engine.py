"""The render engine in background: Blender's own output holds the bake's layers, bit for bit."""

from __future__ import annotations

import time

import bpy
import numpy as np
import pytest
import strata
from conftest import SAMPLES
from exr_layers import read_layers
from render_passes import read_passes, write_multilayer
from strata.addon.bake import Options, read_scene
from strata.addon.bake import BakeJob
from strata.addon.core.errors import Cancelled
from strata.addon.engine import compatible_panels, material_preview
from strata.addon.engine.engine import StrataRenderEngine
from strata.addon.scene.open import choose, open_blend
from strata.ops.cli import main

# 0.2 s is the promise; five times that where others use the same cores.
SECONDS_TO_STOP = 1.0


@pytest.fixture(scope="module", autouse=True)
def registered():
    strata.register()
    yield
    strata.unregister()


@pytest.fixture
def scene():
    """A scene that moves, small, with the engine chosen."""
    open_blend(SAMPLES / "animated.blend")
    scene = bpy.context.scene
    scene.render.engine = "STRATA"
    scene.render.resolution_x, scene.render.resolution_y = 160, 90
    scene.render.resolution_percentage = 50
    scene.render.use_compositing = False
    scene.strata.backend, scene.strata.samples, scene.strata.probes = "cpu", 2, 0
    return scene


def baked_by_the_command(tmp_path, frames="1", *words) -> dict[int, dict[str, np.ndarray]]:
    """Layers by `<view layer>.<pass>`, by frame, of the open scene as `strata bake` makes them."""
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    output = tmp_path / "bake_####.exr"
    assert main(["bake", str(blend), "-o", str(output), "--frames", frames, "-q", *words]) == 0
    found = {}
    for path in sorted(tmp_path.glob("bake_*.exr")):
        layers = read_layers(path)
        found[int(path.stem[-4:])] = {f"{layers.view_layer}.{a.name}": a.pixels for a in layers.layers}
        path.unlink()
    return found


def assert_same_passes(rendered: dict[str, np.ndarray], baked: dict[str, np.ndarray]) -> None:
    combined = {name for name in rendered if name.endswith(".Combined")}
    assert set(rendered) - combined == set(baked)
    for name, pixels in baked.items():
        np.testing.assert_array_equal(rendered[name].view(np.uint32), pixels.view(np.uint32), name)


def test_animation_writes_the_bakes_layers_bit_for_bit(scene, tmp_path):
    scene.frame_start, scene.frame_end, scene.frame_step = 1, 13, 12
    write_multilayer(scene, tmp_path / "render_####.exr")
    bpy.ops.render.render(animation=True)
    rendered = {n: read_passes(tmp_path / f"render_{n:04d}.exr") for n in (1, 13)}
    baked = baked_by_the_command(tmp_path, "1,13")
    assert len(baked[1]) >= 2
    for frame in (1, 13):
        assert_same_passes(rendered[frame], baked[frame])
    moved = [name for name in baked[1] if (baked[1][name] != baked[13][name]).any()]
    assert moved, "the frames do not differ"
