"""The GPU of a whole Blender program on Vulkan, where BLENDER names one; CI makes one. The other tests use
OpenGL, the only backend of bpy as a module."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import strata_kernels
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.placement import Places
from strata.addon.core.shot import PixelFilter
from strata.addon.core.surface import Chunk
from strata.addon.core.view import View
from strata.addon.effects.shared.steps import LAYERED_DEPTH, SURFACE
from strata.addon.effects.soft_shadow.steps import BACKPROJECT, PREPARE
from strata.tests.support.gpu_scenes import bumpy_sheet, on_both, scene_of, share_beyond, triangle_mesh
from strata.tests.support.places import ROOT

SIZE = (54, 96)
DOWN = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
CAMERA = View((0.1, 0.2, 6.0), *DOWN, (-0.4, 0.4, -0.225, 0.225), 0.1, 99.0)
LIGHT = View((0.5, -0.5, 5.0), *DOWN, (-0.7, 0.6, -0.6, 0.7), 0.5, 99.0)
EMITTER = Emitter(EmitterKind.RECTANGLE, LIGHT.eye, *DOWN, 0.4, 0.3)


def sheet_over_ground() -> np.ndarray:
    """(T, 3, 3) float32."""
    sheet = bumpy_sheet(np.random.default_rng(4), 8)
    starts = sheet.face_starts
    fans = [
        [sheet.corner_vertices[start], sheet.corner_vertices[i], sheet.corner_vertices[i + 1]]
        for start, end in pairwise(starts)
        for i in range(start + 1, end - 1)
    ]
    ground = np.array([[-9, -9, 0.1], [9, -9, -0.2], [9, 9, 0.15], [-9, 9, 0.3]])[[[0, 1, 2], [0, 2, 3]]]
    return np.concatenate([sheet.positions[fans] + (0, 0, 1.5), ground]).astype(np.float32)


def expected(mesh) -> dict[str, np.ndarray]:
    """What the kernels make of it."""
    (cpu, geometry), _ = on_both(*scene_of([mesh]))
    chunk = Chunk(SIZE[1], SIZE[0], 0, SIZE[0], 0, (0.0, 0.0))
    attributes = frozenset({"position", "geometric_normal", "shading_normal", "depth", "triangle"})
    surface = SURFACE.cpu(cpu, geometry, CAMERA, frozenset({0}), chunk, attributes)
    depths = LAYERED_DEPTH.cpu(cpu, geometry, LIGHT, frozenset({0}), 4, 96, 96)
    own = replace(chunk, places=Places(7, PixelFilter()))
    scattered = SURFACE.cpu(cpu, geometry, CAMERA, frozenset({0}), own, attributes)
    found = {**surface, "depths": depths, **{f"own {name}": each for name, each in scattered.items()}}
    prepared = PREPARE.cpu(cpu, depths, LIGHT, 1.0, 1e9)
    settings = {"eye": CAMERA.eye, "emitter": EMITTER, "maps": 1, "max_samples": 512, "refinements": 2}
    settings["spacing"] = 1
    for method in ("bitmask", "area"):
        found[method] = BACKPROJECT.cpu(cpu, surface, prepared, method=method, **settings)["visibility"]
    return found


def blender(module: str, *words) -> str:
    command = [os.environ["BLENDER"], "-b", "--factory-startup", "--gpu-backend", "vulkan"]
    command += ["--python-exit-code", "1", "--python", str(ROOT / "scripts" / "in_blender.py")]
    command += ["--", module, *map(str, words)]
    env = {
        name: value for name, value in os.environ.items() if name != "OCIO"
    }  # bpy's own, set by importing it
    run = subprocess.run(command, env=env, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


def check_every_program_compiles():
    assert "VULKAN" in blender("strata.scripts.build.compile_shaders")


def check_steps_agree_with_the_kernels(tmp_path):
    mesh = triangle_mesh(sheet_over_ground())
    inputs, outputs = tmp_path / "inputs.npz", tmp_path / "outputs.npz"
    np.savez(
        inputs,
        positions=mesh.positions,
        corners=mesh.corner_vertices,
        starts=mesh.face_starts,
        camera=CAMERA.packed(),
        light_view=LIGHT.packed(),
        emitter=EMITTER.packed(),
        size=SIZE,
    )
    shutil.copytree(Path(strata_kernels.__file__).parent, tmp_path / "strata_kernels")
    blender("strata.tests.devices.gpu_blender_check", inputs, outputs, tmp_path)
    found = np.load(outputs)
    assert "VULKAN" in str(found["description"])
    # Whole chains: silhouettes move by 1/256 pixel, and a light sample more or less is 1/256.
    for name, wanted in expected(mesh).items():
        tolerance = 0.02 if name in ("bitmask", "area") else 1e-4
        assert found[name].shape == wanted.shape
        assert share_beyond(found[name], wanted, tolerance) < 5e-3, name


if "BLENDER" in os.environ:
    test_every_program_compiles = check_every_program_compiles
    test_steps_agree_with_the_kernels = check_steps_agree_with_the_kernels
