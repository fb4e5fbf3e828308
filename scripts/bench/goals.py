"""Section "Other goals": layered depth, large meshes, the GPU, memory."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import dataclass

import numpy as np
import strata_kernels
from strata.addon.core.errors import StrataError
from strata.addon.devices.start import start_devices
from strata.addon.scene.extract import extract
from strata.addon.scene.render_depsgraph import with_render_depsgraph
from strata.addon.scene.scan import ScanOptions, scan

from .document import ROOT, milliseconds, significant, table, times
from .machine import interleaved
from .scenes import SAMPLES, Case, read

MANY_TORI = 109  # of 9,216 triangles each: just over a million
MAP_SIDE = 1024

MEMORY_SCRIPT = """
import sys, bpy
from strata.addon.bake import bake
from strata.addon.planning import Options
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
scene = bpy.context.scene
size = (int(sys.argv[2]), int(sys.argv[3]))
bake(scene, scene.view_layers[0], Options(backend="cpu", samples=1, probes=0), size=size)
status = dict(line.split(":", 1) for line in open("/proc/self/status") if ":" in line)
print("peak kB", status["VmHWM"].split()[0])
"""


@dataclass(frozen=True)
class Goal:
    """A row: what, the goal and the figure in words, whether it is met (None: could not be measured)."""

    what: str
    goal: str
    measured: str
    met: bool | None


def layered_depth(case: Case, repeats: int) -> Goal:
    """Eight layers against one, on the benchmark scene's light."""
    geometry = case.device.geometry()
    (layer,) = case.graph.layers
    casters = case.device.instance_mask(layer.casters)
    node = next(node for node in case.graph.nodes() if node.step.name == "layered_depth")
    view = node.params["view"].packed()

    def timed(layers: int):
        def run() -> dict[str, float]:
            started = time.perf_counter()
            strata_kernels.layered_depth(geometry, casters, view, layers, MAP_SIDE, MAP_SIDE)
            return {"total": time.perf_counter() - started}

        return run

    seconds = interleaved({k: timed(k) for k in (1, 8)}, 2 * repeats + 1)
    one, eight = seconds[1]["total"], seconds[8]["total"]
    return Goal(
        f"layered depth of k = 8 over k = 1, {MAP_SIDE}² ({milliseconds(one)} ms)",
        "2.5x",
        times(eight / one),
        eight <= 2.5 * one,
    )


def a_million_triangles(scene) -> None:
    """Fills the benchmark scene with more of its tori."""
    tori = [item for item in scene.objects if item.name.startswith("Torus")]
    random = np.random.default_rng(5)
    for number in range(MANY_TORI - len(tori)):
        copy = tori[number % len(tori)].copy()
        copy.data = copy.data.copy()
        copy.location = random.uniform((-4, -3, 0.7), (4, 3, 2.2))
        copy.rotation_euler = random.uniform(0, 6.28, 3)
        scene.collection.objects.link(copy)


def large_meshes(scene, repeats: int, size=(1920, 1080)) -> list[Goal]:
    """Extraction and camera surface of a million triangles."""
    a_million_triangles(scene)

    def reading() -> dict[str, float]:
        def look(depsgraph) -> float:
            found = scan(depsgraph, ScanOptions(size=size, camera=None))
            started = time.perf_counter()
            extract(found, frozenset(("corner_normals",)), None)
            return time.perf_counter() - started

        return {"total": with_render_depsgraph(scene, scene.view_layers[0], look)}

    case = read(scene, size)
    geometry = case.device.geometry()
    everything = np.ones(len(case.outline.instances), np.uint8)
    names = ["position", "geometric_normal", "shading_normal"]

    def rasterising() -> dict[str, float]:
        started = time.perf_counter()
        strata_kernels.raster_surface(
            geometry, everything, case.graph.shot.view.packed(), *size, attributes=names
        )
        return {"total": time.perf_counter() - started}

    seconds = interleaved({"extract": reading, "surface": rasterising}, 2 * repeats + 1)
    extracting, surface = seconds["extract"]["total"], seconds["surface"]["total"]
    count = f"{case.outline.triangles:,} triangles"
    return [
        Goal(
            f"extraction of {count}, with normals",
            "150 ms",
            f"{milliseconds(extracting)} ms",
            extracting <= 0.15,
        ),
        Goal(
            f"camera surface of {count}, {size[0]}x{size[1]}",
            "0.5 s",
            f"{significant(surface)} s",
            surface <= 0.5,
        ),
    ]


def gpu_and_cpu(scene, repeats: int) -> Goal:
    """A whole bake on Blender's GPU module (in software, here) and on the kernels."""
    from strata.addon.bake import bake
    from strata.addon.planning import Options

    what, goal = "bake on the GPU module over the CPU kernels", "5x"
    try:
        description = start_devices("gpu").primary.description
    except StrataError as reason:
        return Goal(what, goal, str(reason), None)

    def baking(backend: str):
        def run() -> dict[str, float]:
            options = Options(backend=backend, samples=1, probes=0)
            report = bake(scene, scene.view_layers[0], options).report
            return {"total": report.seconds - report.compile_seconds}

        return run

    seconds = interleaved({name: baking(name) for name in ("cpu", "gpu")}, repeats)
    cpu, gpu = seconds["cpu"]["total"], seconds["gpu"]["total"]
    return Goal(
        f"{what} ({description}; {significant(cpu)} s on the CPU)", goal, times(gpu / cpu), gpu <= 5 * cpu
    )


def memory(name: str = "courtyard", size=(3840, 2160)) -> Goal:
    """Peak of a fresh process that bakes a large image, Blender included."""
    words = [sys.executable, "-c", MEMORY_SCRIPT, str(SAMPLES / f"{name}.blend"), *map(str, size)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    what = f"peak memory of a {size[0]}x{size[1]} bake of {name}, Blender included"
    line = next((line for line in done.stdout.splitlines() if line.startswith("peak kB")), None)
    if done.returncode or line is None:
        return Goal(what, "2 GB", f"failed: {done.stderr.strip().splitlines()[-1:]}", None)
    gigabytes = int(line.split()[-1]) * 1024 / 1e9
    return Goal(what, "2 GB", f"{significant(gigabytes)} GB", gigabytes < 2.0)


def tables(goals: list[Goal]) -> str:
    """Markdown."""
    verdict = {True: "met", False: "missed", None: "not measured"}
    rows = [[goal.what, goal.goal, goal.measured, verdict[goal.met]] for goal in goals]
    return table(["", "goal, at most", "measured", ""], rows)
