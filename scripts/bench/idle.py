"""Section "Only what the scene needs": a scene with and without what cannot matter."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from strata.addon.bake import Baked, bake
from strata.addon.planning import Options

from .document import significant, table, times
from .machine import interleaved
from .scenes import open_sample

USELESS_SIDE = 707  # quads along each side of a grid: about a million triangles
DARK_LIGHTS = 12


def add_useless(scene: bpy.types.Scene) -> list[str]:
    """A grid of a million triangles far below everything, and lights without power; their names."""
    line = np.linspace(-1.0, 1.0, USELESS_SIDE + 1, dtype=np.float32)
    x, y = np.meshgrid(line, line)
    positions = np.stack([x, y, 0.05 * np.sin(9.0 * x) * np.cos(7.0 * y)], axis=2).reshape(-1, 3)
    corner = np.arange(USELESS_SIDE)[:, None] * (USELESS_SIDE + 1) + np.arange(USELESS_SIDE)
    quads = corner.reshape(-1, 1) + np.array([0, 1, USELESS_SIDE + 2, USELESS_SIDE + 1])
    mesh = bpy.data.meshes.new("Useless")
    mesh.vertices.add(len(positions))
    mesh.vertices.foreach_set("co", positions.ravel())
    mesh.loops.add(quads.size)
    mesh.loops.foreach_set("vertex_index", quads.ravel().astype(np.int32))
    mesh.polygons.add(len(quads))
    mesh.polygons.foreach_set("loop_start", np.arange(0, quads.size, 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    made = [bpy.data.objects.new("Useless", mesh)]
    made[0].location.z = -200.0
    kinds = ("POINT", "SUN", "SPOT", "AREA")
    for number in range(DARK_LIGHTS):
        light = bpy.data.lights.new(f"Dark {number}", kinds[number % len(kinds)])
        light.energy = 0.0
        lamp = bpy.data.objects.new(light.name, light)
        lamp.location = (0.3 * number, 0.0, 4.0)
        made.append(lamp)
    for item in made:
        scene.collection.objects.link(item)
    return [item.name for item in made]


@dataclass(frozen=True)
class Idle:
    """`same`: all layers have the same names and the same bits; `left_out`: the plan names everything that
    was added; `seconds` and `with_useless` of whole bakes."""

    same: bool
    left_out: bool
    seconds: float
    with_useless: float


def _same(first: Baked, second: Baked) -> bool:
    names = [[layer.name for layer in baked.layers.layers] for baked in (first, second)]
    pairs = zip(first.layers.layers, second.layers.layers, strict=False)
    return names[0] == names[1] and all(np.array_equal(a.pixels, b.pixels) for a, b in pairs)


def run(name: str = "courtyard", size=None, repeats: int = 3, options: Options | None = None) -> Idle:
    """Bakes a sample scene both ways; the scene is left with what was added, hidden."""
    scene = open_sample(name)
    options = options or Options(backend="cpu", samples=1, probes=0)
    view_layer = scene.view_layers[0]
    baked: dict[bool, Baked] = {}
    added = [scene.objects[item] for item in add_useless(scene)]

    def shown(useless: bool):
        def run() -> dict[str, float]:
            for item in added:
                item.hide_render = not useless
            baked[useless] = bake(scene, view_layer, options, size=size)
            return {"total": baked[useless].report.seconds}

        return run

    seconds = interleaved({False: shown(False), True: shown(True)}, repeats)
    words = " ".join(f"{entry['what']}" for entry in baked[True].layers.report["left_out"])
    left_out = all(item.name in words for item in added)
    return Idle(_same(baked[False], baked[True]), left_out, seconds[False]["total"], seconds[True]["total"])


def tables(found: Idle) -> str:
    """Markdown."""
    yes = {True: "yes", False: "no"}
    rows = [
        ["layers are the same bits", "yes", yes[found.same]],
        ["the plan says that it left all of it out", "yes", yes[found.left_out]],
        [
            f"time of a bake, {significant(found.seconds, 3)} s without",
            "1.3x at most",
            times(found.with_useless / found.seconds),
        ],
    ]
    return table(["", "goal", "measured"], rows)
