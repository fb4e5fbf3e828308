"""Section "Many lamps": memory and time where lamps are worked off in groups and where all are at once, and
of few and many lamps."""

from __future__ import annotations

import json
import random
import resource
import subprocess
import sys
from dataclasses import dataclass

import bpy
from strata.addon.bake import bake
from strata.addon.planning import Options

from .document import significant, table, times

EFFECTS = ("soft_shadow", "volumetric_light")
ALL_AT_ONCE = 1 << 50
BUDGETS = {"all at once": ALL_AT_ONCE, "automatic": 0}
MEBIBYTES_OF_A_GIGABYTE = 1e9 / 2**20


@dataclass(frozen=True)
class Street:
    """So many lamps, baked at `size` with `samples` a pixel."""

    lamps: int
    size: tuple[int, int]
    samples: int


STREETS = (Street(5, (320, 180), 1),)
FEW_AND_MANY = Street(2, (1920, 1080), 1), Street(60, (1920, 1080), 1)
QUICK = (Street(2, (96, 54), 1),)


def build(lamps: int) -> bpy.types.Scene:
    """Houses on a plain under point lamps."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, chance = bpy.context.scene, random.Random(1)
    bpy.ops.mesh.primitive_plane_add(size=60.0)
    for _ in range(40):
        place = chance.uniform(-25.0, 25.0), chance.uniform(-20.0, 25.0), 1.5
        bpy.ops.mesh.primitive_cube_add(size=3.0, location=place)
    for _ in range(lamps):
        data = bpy.data.lights.new("Lamp", "POINT")
        data.energy, data.shadow_soft_size = 100.0, 0.2
        lamp = bpy.data.objects.new("Lamp", data)
        lamp.location = chance.uniform(-25.0, 25.0), chance.uniform(-20.0, 25.0), 4.0
        scene.collection.objects.link(lamp)
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.location, scene.camera.rotation_euler = (0.0, -30.0, 18.0), (1.03, 0.0, 0.0)
    scene.collection.objects.link(scene.camera)
    return scene


def bake_here(street: Street, budget: int) -> dict:
    """The report of a bake in this process, and its CPU seconds."""
    scene = build(street.lamps)
    options = Options(
        effects=EFFECTS,
        backend="cpu",
        samples=street.samples,
        values={"volumetric_light": {"use_scene_medium": False}},
        memory_bytes=budget,
    )
    before = _cpu_seconds()
    report = bake(scene, scene.view_layers[0], options, size=street.size).layers.report
    return report | {"cpu_seconds": _cpu_seconds() - before}


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def bake_apart(street: Street, budget: int) -> dict:
    """The same in a process of its own, whose peak is that of nothing else."""
    code = (
        "import json\n"
        "from strata.scripts.bench.lamps import Street, bake_here\n"
        f"print(json.dumps(bake_here({street!r}, {budget})))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def tables(streets: tuple[Street, ...]) -> str:
    """Of each street, one bake a budget, one after the other."""
    rows = []
    for street in streets:
        first = None
        for name, budget in BUDGETS.items():
            report = bake_apart(street, budget)
            told, seconds = report["memory"], report["seconds"] / street.lamps
            first = first or seconds
            peak = _peak_gb(report)
            rows.append(
                (
                    street.lamps,
                    f"{street.size[0]}x{street.size[1]}",
                    name,
                    told["groups"],
                    f"{told['bytes'] / 1e9:.2f}",
                    f"{peak:.2f}",
                    f"{peak - told['layers_bytes'] / 1e9:.2f}",
                    significant(seconds),
                    "" if budget == ALL_AT_ONCE else times(seconds / first),
                )
            )
    header = ["lamps", "image", "memory", "groups", "told, GB", "peak, GB", "peak less layers, GB"]
    return table([*header, "s a lamp", "over all at once"], rows)


def _peak_gb(report: dict) -> float:
    return report["peak_mb"] / MEBIBYTES_OF_A_GIGABYTE


def few_and_many(streets: tuple[Street, ...]) -> str:
    """Of each street, one bake with an automatic budget."""
    rows = []
    for street in streets:
        report = bake_apart(street, BUDGETS["automatic"])
        told, peak = report["memory"], _peak_gb(report)
        layers_gb = told["layers_bytes"] / 1e9
        rows.append(
            (
                street.lamps,
                len(report["layers"]),
                f"{layers_gb:.2f}",
                f"{told['bytes'] / 1e9:.2f}",
                f"{peak:.2f}",
                f"{peak - layers_gb:.2f}",
                significant(report["cpu_seconds"] / street.lamps, 3),
            )
        )
    header = ["lamps", "layers", "layers, GB", "told, GB", "peak, GB", "peak less layers, GB", "CPU s a lamp"]
    return table(header, rows)
