"""Section "What a sample may err": whole bakes by method, their error in use against many rays, CPU time."""

from __future__ import annotations

import os
import time
from pathlib import Path

import bpy
import numpy as np
from strata.addon.bake import Baked, bake
from strata.addon.core.metrics import mean_brightness
from strata.addon.planning import Options

from . import machine
from .document import significant, table
from .scenes import open_sample

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
TRUTH = {"method": "rays", "sample_rays": 4}
WAYS = {
    "bitmask": {"method": "bitmask"},
    "bitmask, 512²": {"method": "bitmask", "resolution": 512, "max_samples": 256},
    "hybrid, 16": {"method": "hybrid", "rays": 16},
    "rays, 2": {"method": "rays", "sample_rays": 2},
    "rays, 4 (default)": {},
    "rays, 16": {"method": "rays", "sample_rays": 16},
}
SAMPLES = ("courtyard", "mist", "comic")
TEAPOTS = "armory_render_voxelao_teapots"
"""A sun on 280,000 triangles, in the folder of others' scenes that STRATA_SCENES names."""


def run(quick: bool) -> str:
    """A table of all scenes and ways."""
    size, samples, most, rounds = ((96, 54), 2, 4, 1) if quick else ((240, 135), 8, 128, 2)
    rows = []
    for name in SAMPLES[-1:] if quick else (*SAMPLES, TEAPOTS):
        scene = _opened(name)
        if scene is None:
            continue
        truth, _ = baked(scene, TRUTH, most, size, lit=True)
        errors, seconds = {}, {way: [] for way in WAYS}
        for _ in range(rounds):
            for way, values in WAYS.items():
                found, taken = baked(scene, values, samples, size)
                errors[way] = in_use(found, truth)
                seconds[way].append(taken)
        for way, of_lamp in errors.items():
            told = ", ".join(f"{lamp} {error:.4f}" for lamp, error in of_lamp.items())
            rows.append([name, way, f"{max(of_lamp.values()):.4f}", told, significant(min(seconds[way]))])
    text = (
        f"Soft shadow layers alone at {size[0]}x{size[1]} with {samples} samples a pixel, nothing measured. "
        f"Error in use ([accuracy.md](accuracy.md)) against {most} samples of {TRUTH['sample_rays']} rays: "
        "what all rays get wrong of a scene is not in it. CPU seconds, of all cores, of a whole bake with "
        f"reading, the lower of {rounds}. {machine.description()}."
    )
    return f"{text}\n\n{table(['scene', 'method', 'worst lamp', 'error in use', 'CPU s'], rows)}"


def _opened(name: str) -> bpy.types.Scene | None:
    if name in SAMPLES:
        return open_sample(name)
    path = Path(os.environ.get("STRATA_SCENES", "")) / f"{name}.blend"
    if not path.is_file():
        return None
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene


def baked(scene, values: dict, samples: int, size: tuple[int, int], lit=False, **more) -> tuple[Baked, float]:
    """And the CPU seconds; `more` is what Options takes besides."""
    options = Options(
        ("soft_shadow",), "cpu", samples=samples, probes=0, values={"soft_shadow": values}, lit=lit, **more
    )
    started = time.process_time()
    return bake(scene, scene.view_layers[0], options, size=size), time.process_time() - started


def in_use(found: Baked, truth: Baked) -> dict[str, float]:
    """By lamp: RMS of what a layer is off by, times the lamp's unshadowed light, over that and its mean."""
    true_layers = {layer.name: layer for layer in truth.layers.layers}
    errors = {}
    for layer in found.layers.layers:
        light = truth.lit[layer.of.index][..., :3].astype(np.float64) @ LUMINANCE
        where = light > 0.0
        light, off = light[where], (layer.pixels - true_layers[layer.name].pixels)[where]
        errors[layer.light] = float(np.sqrt(np.mean((off * light / (light + mean_brightness(light))) ** 2)))
    return errors
