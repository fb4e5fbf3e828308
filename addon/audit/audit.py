"""Asks Cycles what a bake's layers should be at some of their pixels, and adds to its report how far off they
are: what Strata read wrong of a scene shows here, which its own rays cannot see."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..baked import Baked
from ..core.errors import Cancelled, StrataError, one_line
from ..core.graph import Graph, PlannedLayer
from ..core.outline import Outline
from ..core.roles import Role
from ..core.working_space import luminance_of
from ..layers.exr_pixels import read_plain
from .grid import STRETCH, Grid, grid_of
from .score import Audit, audit_of, of_added, of_multiplied

SAMPLES = 128
"""Of Cycles at a pixel, in each of two halves with noise of their own."""

SEEDS = (1, 2)
POLL_SECONDS = 0.05
PROGRAM = Path(__file__).with_name("program.py")

_OF = {Role.VISIBILITY: "surface", Role.SCATTERING: "airlight"}
"""What Cycles renders for layers of a lamp, by their role; others are not audited."""

_PASSES = {"surface": ("Diffuse Direct", "Diffuse Color"), "airlight": ("Volume Direct",)}
_SHADOWS = {"surface": (False, True), "airlight": (True,)}


@dataclass(frozen=True)
class Scene:
    """What is open, for another Blender to open: `file` holds it as it is now, `folder` is to be written to;
    `scene` by its name with its library; `camera` is who was asked for in place of the scene's own. Made on
    the main thread, by `kept_scene`."""

    file: Path
    folder: tempfile.TemporaryDirectory
    scene: str
    view_layer: str
    camera: str | None
    program: tuple[str, ...]
    runs_scripts: bool

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *_) -> None:
        self.folder.cleanup()


def kept_scene(
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    camera: str | None = None,
    is_untouched: bool = False,
    runs_scripts: bool | None = None,
) -> Scene:
    """Saves a copy, unless what is open `is_untouched` since it was read (Blender does not know of what
    Python did). Its folder is gone with it. `runs_scripts`: whether the other Blender may, None for what this
    one's preferences say. Raises StrataError where nothing can be saved."""
    file = Path(bpy.data.filepath)
    try:
        folder = tempfile.TemporaryDirectory(prefix="strata_audit_")
        if not is_untouched:
            file = Path(folder.name) / "scene.blend"
            bpy.ops.wm.save_as_mainfile(filepath=str(file), copy=True, compress=False)
    except (OSError, RuntimeError) as error:
        raise StrataError(f"no copy of the scene can be saved ({' '.join(str(error).split())})") from None
    if runs_scripts is None:
        runs_scripts = bpy.context.preferences.filepaths.use_scripts_auto_execute
    blender = bpy.app.binary_path
    program = (blender, "--background", "--factory-startup", "--python", str(PROGRAM), "--")
    if not blender:  # Blender as a Python module
        program = (sys.executable, str(PROGRAM))
    return Scene(file, folder, scene.name_full, view_layer.name, camera, program, runs_scripts)


def audited(
    baked: Baked,
    scene: Scene,
    outline: Outline,
    graph: Graph,
    is_cancelled: Callable[[], bool] = lambda: False,
    show: Callable[[float], None] = lambda share: None,
) -> Baked:
    """The same bake with audits in its report, or with a warning that says why there are none: it never costs
    a layer. Any thread may call it. `show` is told the share that is done. Raises Cancelled."""
    try:
        return _told(baked, *_audits(baked, scene, outline, graph, is_cancelled, show))
    except (Cancelled, KeyboardInterrupt):
        raise
    except Exception as error:
        return not_audited(baked, error)


def not_audited(baked: Baked, error: Exception) -> Baked:
    """With a warning that says why."""
    return _told(baked, {}, [f"not held against Cycles: {one_line(error)}"])


def _audits(baked, scene, outline, graph, is_cancelled, show) -> tuple[dict[str, Audit], list[str]]:
    shot = graph.shot
    if shot.pixel_filter.kind not in STRETCH or shot.pixel_filter.radius <= 0.0:
        raise StrataError("its pixel filter is a box, whose width Cycles does not let anyone set")
    shown = Counter(light.lamp for light in outline.lights)
    layers, warnings = [], []
    for layer in graph.layers:
        if not (layer.effect and layer.of.is_lamp and layer.role in _OF):
            continue
        light = outline.lights[layer.of.index]
        if not light.lamp or shown[light.lamp] > 1 or light.key != light.lamp:
            warnings.append(f"{layer.name} is not held against Cycles: instances show its lamp")
        else:
            layers.append(layer)
    if not layers:
        return {}, warnings
    grid, started = grid_of(shot.computed_size), time.perf_counter()
    renders = _renders(layers, outline)
    request = _request(scene, outline, graph, grid, renders)
    images = _rendered(scene, request, is_cancelled, show)
    seconds = (time.perf_counter() - started) / len(layers)
    finished = {layer.name: layer.pixels for layer in baked.layers.layers}
    audits = {}
    for layer in layers:
        of, lamp = _OF[layer.role], outline.lights[layer.of.index].lamp
        found = [
            np.stack([images[renders.index(_render(of, lamp, shadow, seed))] for seed in SEEDS])
            for shadow in _SHADOWS[of]
        ]
        pixels = shot.source.computed(finished[layer.name])[grid.slices]
        if of == "surface":
            errors = of_multiplied(pixels, *found, luminance_of(outline.working_space))
        else:
            errors = of_added(pixels, *found)
        if errors is None:
            warnings.append(f"{layer.name} is not held against Cycles: nothing of its light is there")
        elif not np.isfinite(errors).all():
            warnings.append(f"{layer.name} is not held against Cycles: it is not finite everywhere")
        else:
            audits[layer.name] = audit_of(errors, len(SEEDS) * SAMPLES, seconds)
    return audits, warnings


def _render(of: str, lamp: str, shadow: bool, seed: int) -> dict[str, Any]:
    return {"of": of, "lamp": lamp, "shadow": shadow, "seed": seed}


def _renders(layers: list[PlannedLayer], outline: Outline) -> list[dict[str, Any]]:
    """Surfaces first: between the two, the scene's media come and go."""
    wanted = {(_OF[layer.role], outline.lights[layer.of.index].lamp): None for layer in layers}
    return [
        _render(of, lamp, shadow, seed)
        for of, lamp in sorted(wanted, key=lambda each: each[0] != "surface")
        for shadow in _SHADOWS[of]
        for seed in SEEDS
    ]


def _request(scene: Scene, outline: Outline, graph: Graph, grid: Grid, renders: list) -> dict[str, Any]:
    raster, pixel_filter = graph.shot.source, graph.shot.pixel_filter
    return {
        "file": str(scene.file),
        "folder": scene.folder.name,
        "scripts": scene.runs_scripts,
        "scene": scene.scene,
        "view_layer": scene.view_layer,
        "frame": outline.frame,
        "camera": {"asked": scene.camera, "name": raster.camera.name, "window": grid.window(raster)},
        "size": grid.count,
        "pixel_aspect": raster.pixel_aspect,
        "filter": {"kind": pixel_filter.kind, "width": grid.filter_width(pixel_filter)},
        "dicing": 1.0 / grid.step,
        "media": sorted({instance.name for instance in outline.instances if instance.medium is not None}),
        "samples": SAMPLES,
        "renders": renders,
    }


def _rendered(scene: Scene, request: dict, is_cancelled, show) -> list[np.ndarray]:
    """(height, width, 3) float64 of each render."""
    folder, count = Path(scene.folder.name), len(request["renders"])
    path = folder / "request.json"
    path.write_text(json.dumps(request), encoding="utf-8")
    log = folder / "log.txt"
    with open(log, "wb") as out:
        process = subprocess.Popen(
            [*scene.program, str(path)],
            stdout=out,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        )
        try:
            while process.poll() is None:
                if is_cancelled():
                    raise Cancelled
                show(sum((folder / f"{number}.exr").exists() for number in range(count)) / count)
                time.sleep(POLL_SECONDS)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
    missing = [number for number in range(count) if not (folder / f"{number}.exr").exists()]
    if process.returncode or missing:
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        raise StrataError(f"Cycles rendered nothing ({lines[-1][:200] if lines else 'without a word'})")
    images = []
    for number, render in enumerate(request["renders"]):
        planes = read_plain(folder / f"{number}.exr")
        passes = [_pass(planes, f"{request['view_layer']}.{name}") for name in _PASSES[render["of"]]]
        images.append(np.prod(passes, axis=0))
    return images


def _pass(planes: dict[str, np.ndarray], name: str) -> np.ndarray:
    return np.stack([planes[f"{name}.{channel}"] for channel in "RGB"], axis=-1).astype(np.float64)


def _told(baked: Baked, audits: dict[str, Audit], warnings: list[str]) -> Baked:
    layers = tuple(
        replace(layer, audit=audits[layer.name]) if layer.name in audits else layer
        for layer in baked.report.layers
    )
    report = replace(baked.report, layers=layers, warnings=(*baked.report.warnings, *warnings))
    return replace(baked, report=report, layers=replace(baked.layers, report=report.to_json()))
