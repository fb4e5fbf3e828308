"""Asks Cycles what a bake's layers should be at some of their pixels, and adds to its report how far off they
are: what Strata read wrong of a scene shows here, which its own rays cannot see."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..baked import Baked
from ..core.errors import Cancelled, one_line
from ..core.graph import Graph, PlannedLayer
from ..core.outline import Outline
from ..core.roles import Role
from ..core.working_space import luminance_of
from ..layers.exr_pixels import read_pixels
from .grid import grid_of
from .other_blender import Scene, request_of, run_program
from .score import Audit, audit_of, of_added, of_multiplied

SAMPLES = 128
"""Of Cycles at a pixel, in each of two halves with noise of their own."""

SEEDS = (1, 2)
PROGRAM = Path(__file__).with_name("program.py")

_OF = {Role.VISIBILITY: "surface", Role.SCATTERING: "airlight"}
"""What Cycles renders for layers of a lamp, by their role; others are not audited."""

_PASSES = {"surface": ("Diffuse Direct", "Diffuse Color"), "airlight": ("Volume Direct",)}
_SHADOWS = {"surface": (False, True), "airlight": (True,)}


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
    request = {**request_of(scene, outline, graph, grid), "samples": SAMPLES, "renders": renders}
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


def _rendered(scene: Scene, request: dict, is_cancelled, show) -> list[np.ndarray]:
    """(height, width, 3) float64 of each render."""
    count = len(request["renders"])
    paths = [Path(scene.folder.name) / f"{number}.exr" for number in range(count)]

    def look() -> None:
        show(sum(path.exists() for path in paths) / count)

    run_program(scene, PROGRAM, request, paths, is_cancelled, look)
    images = []
    for path, render in zip(paths, request["renders"], strict=True):
        planes = read_pixels(path)
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
