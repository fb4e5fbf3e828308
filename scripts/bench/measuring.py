"""Section "Measuring": what it adds to a bake, how well the bake knew how long it would still take."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import bpy
import numpy as np
from strata.addon.bake import read_job
from strata.addon.ui import properties
from strata.addon.ui.properties import options_of

from .document import significant, table
from .scenes import open_sample

SAMPLES = ("courtyard", "mist", "comic", "stacked", "animated", "dandelion")
LARGE = 10.0
"""Million triangles of a mesh, beside the samples."""

FIRST_SHARE = 0.1
"""Of a bake's time; what is said before does not count."""

SLICE_SECONDS = 0.05
ALLOWED_FACTOR = 2.0


def bake_here(scene_name: str) -> dict:
    """A sample scene, or so many million triangles, baked as the file has it."""
    if scene_name in SAMPLES:
        properties.register()
        scene = open_sample(scene_name)
    else:
        scene = a_large_mesh(float(scene_name))
        properties.register()
    job = read_job(scene, scene.view_layers[0], options_of)
    started, told = time.perf_counter(), []
    while not job.advance(SLICE_SECONDS):
        passed = time.perf_counter() - started
        if job.seconds_left is not None:
            told.append((passed, job.seconds_left))
    whole = time.perf_counter() - started
    report = job.result().layers.report
    errors = [layer["error"] for layer in report["layers"] if layer.get("error")]
    probes = [error["probes"] for error in errors if "probes" in error]
    return {
        "seconds": report["seconds"],
        "measuring": sum(error.get("seconds", 0.0) for error in errors),
        "probes": [min(probes, default=0), max(probes, default=0)],
        "factor": max(factors(told, whole), default=1.0),
        "often": float(np.mean([each > ALLOWED_FACTOR for each in factors(told, whole)] or [0.0])),
    }


def factors(told: list[tuple[float, float]], whole: float) -> list[float]:
    """How far off each was. `told`: after how many seconds it said that how many were left. The last slice is
    not judged."""
    found = []
    for passed, left in told:
        really = whole - passed
        if passed >= FIRST_SHARE * whole and really > 2.0 * SLICE_SECONDS:
            found.append(max(left / really, really / max(left, 1e-6)))
    return found


def a_large_mesh(millions: float) -> bpy.types.Scene:
    """Waves of so many million triangles under a sun, in the scene at hand."""
    side = round((0.5e6 * millions) ** 0.5)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    at = np.linspace(-5.0, 5.0, side + 1, dtype=np.float32)
    x, y = np.meshgrid(at, at)
    z = 0.3 * np.sin(3.0 * x) * np.cos(2.0 * y)
    mesh = bpy.data.meshes.new("Waves")
    mesh.vertices.add(x.size)
    mesh.vertices.foreach_set("co", np.stack([x, y, z], -1).ravel())
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    corners = np.stack([first, first + 1, first + side + 2, first + side + 1], -1)
    mesh.loops.add(corners.size)
    mesh.loops.foreach_set("vertex_index", corners.astype(np.int32).ravel())
    mesh.polygons.add(len(corners))
    mesh.polygons.foreach_set("loop_start", np.arange(0, corners.size, 4, dtype=np.int32))
    mesh.update()
    scene.collection.objects.link(bpy.data.objects.new("Waves", mesh))
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.angle, sun.rotation_euler = 0.05, (1.0, 0.3, 0.0)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, -9.0, 5.0), (1.1, 0.0, 0.0)
    for thing in (sun, camera):
        scene.collection.objects.link(thing)
    scene.camera = camera
    return scene


def bake_apart(scene_name: str) -> dict:
    """The same in a process of its own, which has learnt nothing yet."""
    code = (
        "import json\n"
        "from strata.scripts.bench.measuring import bake_here\n"
        f"print(json.dumps(bake_here({scene_name!r})))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def tables(quick: bool) -> str:
    """One bake of each scene."""
    rows = []
    for name in ("stacked", "0.1") if quick else (*SAMPLES, f"{LARGE:g}"):
        found = bake_apart(name)
        few, many = found["probes"]
        rows.append(
            (
                name if name in SAMPLES else f"{name} million triangles",
                significant(found["seconds"]),
                significant(found["measuring"]),
                f"{100.0 * found['measuring'] / found['seconds']:.0f}%",
                f"{few} to {many}",
                f"{significant(found['factor'])}x",
                f"{100.0 * found['often']:.0f}%",
            )
        )
    header = [
        "scene",
        "bake, s",
        "of that measuring, s",
        "share",
        "pixels a layer",
        "time left, worst factor",
        "off by more than 2x",
    ]
    return table(header, rows)
