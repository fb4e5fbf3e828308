"""How long a bake will take, told before it begins: of its plan, of what is known of this machine, and of the
scene's last bake."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .core.execution import Execution
from .core.graph import Graph
from .core.outline import Outline
from .core.progress import Forecast
from .core.sampling import FIRST_PASSES
from .effects.shared.steps import ray_accelerator
from .measure.budget import ImagesOutlook, MeasuringOutlook
from .measure.watch import watching_seconds
from .passes import Passes, samples_for
from .planning import Options, sampling_of
from .speeds import recall_speeds

READING_SECONDS, READING_SECONDS_A_TRIANGLE = 0.05, 0.4e-6
"""Scan, extraction and whatever else is no step, on an ordinary machine."""

STARTING_SECONDS, LAMP_AUDITED_SECONDS = 0.3, 0.9
"""Of an audit: another Blender's start, and Cycles' renders of one lamp."""

WATCHED = 0.35
"""Of the seconds of as many probes, what pixels that are watched take: measured with shadows of two lamps."""


def expected_seconds(
    outline: Outline,
    graph: Graph,
    options: Options,
    report: Mapping[str, Any] | None = None,
    is_audited: bool = False,
) -> float:
    """Of the whole bake, with measuring and images of errors; and its audit, if it `is_audited`. `report`:
    that of the scene's last bake, if there was one, which tells how far layers were with how many samples."""
    if not graph.layers:
        return 0.0
    device = recall_speeds(options.backend)
    sampling, parts, watching = sampling_of(graph, options), [], 0.0
    pixels, tiles = sampling.width * sampling.height, sampling.chunk_count // sampling.samples
    targets = {layer.name: target for layer in graph.layers if (target := options.target_of(layer))}
    if sampling.passes:
        passes = Passes(None, None, options)
        if options.time_budget_s and not options.aim:
            passes.expect({layer.name: sampling.samples for layer in graph.layers})
        passes.expect(_known_samples(report or {}, targets))
        parts, counts = passes.parts([graph], sampling), passes.counts(graph, sampling)
        doublings = (1 + int(math.log2(max(counts[name] / sampling.passes[0], 1.0))) for name in targets)
        watching = sum(doublings) * WATCHED * watching_seconds(pixels)
    parts = [(part, samples * tiles) for part, samples in parts or [(graph, sampling.samples)]]
    forecast = Forecast(parts, pixels / tiles, Execution(), outline, device)
    slower = forecast.usually_slower()
    apart = READING_SECONDS + READING_SECONDS_A_TRIANGLE * outline.triangles + watching
    seconds = forecast.seconds_left() + slower * apart
    outlook = MeasuringOutlook(graph, outline, ray_accelerator(outline, graph.shot), options.probes)
    if options.probes != 0:
        seconds += outlook.seconds_left(seconds, slower)
    elif targets:
        seconds += slower * outlook.tree_seconds
    seconds = min(seconds, options.time_budget_s or math.inf)
    if options.error_images and options.probes != 0:  # no part of the time that was set
        seconds += ImagesOutlook(graph, pixels).seconds_left(slower)
    return seconds + slower * is_audited * _auditing_seconds(outline, graph)


def _auditing_seconds(outline: Outline, graph: Graph) -> float:
    """What another Blender takes, on an ordinary machine."""
    lamps = {layer.of for layer in graph.layers if layer.kind.score and layer.of.is_lamp}
    reading = READING_SECONDS_A_TRIANGLE * outline.triangles
    return bool(lamps) * (STARTING_SECONDS + reading) + len(lamps) * LAMP_AUDITED_SECONDS


def _known_samples(report: Mapping[str, Any], targets: Mapping[str, float]) -> dict[str, float]:
    """By layer's name, where the report tells how far it was."""
    rows = {each["name"]: each for each in report.get("layers", ()) if each.get("target")}
    return {
        name: rows[name]["samples"]
        if rows[name]["target"]["error"] == float(f"{target:.4g}")
        else max(samples_for(target, rows[name]["samples"], rows[name]["target"]["seen"]), FIRST_PASSES[0])
        for name, target in targets.items()
        if name in rows
    }


def about_seconds(seconds: float) -> str:
    """For a person, who is to rely on no more than its size: `about 3 s`, `about 4 min`."""
    if seconds < 1.0:
        return "about a second or less"
    if seconds < 90.0:
        return f"about {float(f'{seconds:.1g}') if seconds < 10.0 else 5 * round(seconds / 5.0):g} s"
    minutes = seconds / 60.0
    return f"about {minutes:.0f} min" if minutes < 90.0 else f"about {minutes / 60.0:.0f} h"
