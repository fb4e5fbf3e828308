"""Scenes to measure, opened as F12 sees them."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from strata.addon.core.arrays import Arrays
from strata.addon.core.graph import Graph
from strata.addon.core.outline import Light, Outline
from strata.addon.core.params import Params
from strata.addon.core.recorder import plan
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.registry import EFFECTS
from strata.addon.effects.shared.coarse_picture import seen_boxes
from strata.addon.scene.extract import extract
from strata.addon.scene.render_depsgraph import with_render_depsgraph
from strata.addon.scene.scan import ScanOptions, scan

from .document import ROOT

SAMPLES = ROOT / "sample_blends"
SOFT_SHADOW = EFFECTS.named("soft_shadow")


def open_sample(name: str) -> bpy.types.Scene:
    """One of the sample scenes."""
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLES / f"{name}.blend"))
    return bpy.context.scene


def open_bench(folder: Path) -> bpy.types.Scene:
    """The benchmark scene, built anew into `folder`: 276,482 triangles under one square light."""
    path = folder / "bench.blend"
    build = "import sys, _scenes; _scenes.bench_scene(sys.argv[1])"
    subprocess.run(
        [sys.executable, "-c", build, str(path)], cwd=SAMPLES, check=True, stdout=subprocess.DEVNULL
    )
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene


@dataclass(frozen=True, eq=False)
class Case:
    """A scene read and ready to bake on the CPU. `graph` is the plan of soft shadows from maps, otherwise at
    default settings, `arrays` what it reads."""

    outline: Outline
    arrays: Arrays
    graph: Graph
    device: CpuDevice

    @property
    def eye(self) -> np.ndarray:
        return np.array(self.graph.shot.origin)

    def light(self, name: str) -> Light:
        return next(light for light in self.outline.lights if light.name == name)

    def planned_closely(self, geometry, values: dict) -> Graph:
        """The plan after a coarse picture, as a bake makes it, with these settings."""
        visible = self.graph.surface.params["visible"]
        seen = seen_boxes(self.device, geometry, self.outline, self.graph.shot, visible)
        outline = replace(self.outline, distance_m=self.device.distance_m)
        shot = replace(self.graph.shot, seen=seen)
        return plan(outline, shot, {SOFT_SHADOW: with_maps(values)})


def with_maps(values: dict) -> Params:
    """Parameters of soft shadows, from maps unless they say something else."""
    return SOFT_SHADOW.params.checked("soft_shadow", {"method": "bitmask"} | values)


def read(scene: bpy.types.Scene, size: tuple[int, int] | None = None) -> Case:
    """Scans, plans and extracts."""

    def look(depsgraph) -> Case:
        found = scan(depsgraph, ScanOptions(size=size, camera=None))
        graph = plan(found.outline, found.shot, {SOFT_SHADOW: with_maps({})})
        arrays = extract(found, graph.wants, graph.instances)
        device = CpuDevice()
        device.set_scene(found.outline, arrays)
        return Case(found.outline, arrays, graph, device)

    return with_render_depsgraph(scene, scene.view_layers[0], look)
