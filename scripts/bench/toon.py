"""Toon: what the comic costs at 1080p."""

from __future__ import annotations

import time
from statistics import median

from strata.addon.bake import BakeJob, read_scene
from strata.addon.planning import Options

from .document import milliseconds, table

SIZE = (1920, 1080)


SHADOWS = {
    "no cast shadows": {"shadows": False},
    "crisp": {"shadow_edge": "crisp"},
    "soft": {"shadow_edge": "soft"},
}


def speed(scene, quick: bool) -> str:
    """Time of each step of one sample, without cast shadows, and with each kind of them."""
    repeats, size = (1, (320, 180)) if quick else (9, SIZE)
    runs: dict[str, dict[str, list[float]]] = {}
    for kind in tuple(SHADOWS) * repeats:
        options = Options(("toon",), "cpu", 1, 0, {"toon": SHADOWS[kind]})
        *read, _ = read_scene(scene, scene.view_layers[0], options, size=size)
        started = time.perf_counter()
        report = BakeJob(*read, options).result().report
        whole = time.perf_counter() - started
        taken: dict[str, float] = {}
        for step in report.steps:
            taken[step.name] = taken.get(step.name, 0.0) + step.seconds
        taken["all"] = whole
        for name, seconds in taken.items():
            runs.setdefault(name, {each: [] for each in SHADOWS})[kind].append(seconds)
    rows = [
        [name, *(milliseconds(median(found)) if found else "" for found in columns.values())]
        for name, columns in sorted(runs.items(), key=lambda item: item[0] == "all")
    ]
    title = f"`comic` at {size[0]}x{size[1]}, one sample, from arrays to layers, median of {repeats}."
    return f"{title}\n\n{table(['step', *(f'{kind}, ms' for kind in SHADOWS)], rows)}"
