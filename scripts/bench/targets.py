"""Section "Targets": whether layers that were baked to a target error are there, and what that costs.

What was found of each scene is kept in docs/data/targets.jsonl (kept.py), one line a layer and target.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from strata.addon.bake import bake
from strata.addon.core.slices import finished
from strata.addon.measure.footprint import Probed
from strata.addon.measuring import Measuring
from strata.addon.planning import Options

from . import intervals
from .document import ROOT, table
from .kept import kept_lines
from .scenes import open_sample

SAMPLES = ("courtyard", "comic", "plain", "dandelion", "stacked")
LARGE, SMALL = (480, 270), (72, 48)
RANDOM_SCENES = 200
TARGETS = 0.01, 0.02, 0.05
MOST_SAMPLES = 64
VIEWS = {LARGE: 8, SMALL: 32}
"""View rays of each half of every pixel, for its error."""
PIXELS_AT_ONCE = 8192
SEED = 4321
KEPT = ROOT / "docs" / "data" / "targets.jsonl"
ALLOWED = 1.1
GOOD = 0.8, 1.0


@dataclass(frozen=True)
class Reached:
    """A layer baked to a `target`: its error by all pixels, what those that decided said, and that with the
    fewest samples. `seconds`: CPU seconds of the whole bake, without reports, `watching` those of deciding,
    `plain` those of a bake of 8 samples."""

    scene: str
    layer: str
    target: float
    samples: int
    true: float
    seen: float
    coarsest: float
    reached: bool
    seconds: float
    watching: float
    plain: float


def true_error(probed: Probed, views: int) -> float:
    """Of all pixels, without the rays' noise, which another half has otherwise."""
    work = probed.layer.kind.score._measuring(probed, 0, SEED)
    work.scale = finished(work._found_scale())
    total = count = 0.0
    for start in range(0, work.pixels, PIXELS_AT_ONCE):
        pixels = np.arange(start, min(start + PIXELS_AT_ONCE, work.pixels))
        found = finished(work._told(pixels, views, 2, SEED + start, 2))
        total, count = total + float(found.squares.sum()), count + float(found.has_light.sum())
    return math.sqrt(max(total, 0.0) / count) if count else 0.0


def baked_to(name: str, options: Options, size: tuple[int, int]) -> Iterator[Reached]:
    """Each layer of the open scene, for each target."""
    where, plain = (bpy.context.scene, bpy.context.view_layer), replace(options, samples=8)
    started = time.process_time()
    bake(*where, plain, size=size)
    plain_seconds = time.process_time() - started
    own_errors, own_watch = Measuring.errors, Measuring.watch
    for target in TARGETS:
        truths: dict[str, float] = {}
        coarsest: dict[str, float] = {}
        apart = watching = 0.0

        def errors(self, graph, truths=truths):
            nonlocal apart
            begun = time.process_time()
            for layer in (layer for layer in graph.layers if layer.kind.score):
                truths[layer.name] = true_error(self._probed(layer), VIEWS[size])
            apart += time.process_time() - begun
            yield
            return {}

        def watch(self, layer, samples, coarsest=coarsest):
            nonlocal watching
            begun = time.process_time()
            found = yield from own_watch(self, layer, samples)
            watching += time.process_time() - begun
            coarsest.setdefault(layer.name, self.watched_error(layer, found))
            return found

        Measuring.errors, Measuring.watch = errors, watch
        begun = time.process_time()
        try:
            aimed = replace(options, most_samples=MOST_SAMPLES, target_error=target, probes=1)
            report = bake(*where, aimed, size=size).report
        finally:
            Measuring.errors, Measuring.watch = own_errors, own_watch
        seconds = time.process_time() - begun - apart
        for layer in (layer for layer in report.layers if layer.target):
            figures = truths[layer.name], layer.target.seen, coarsest[layer.name], layer.target.reached
            costs = seconds, watching, plain_seconds
            yield Reached(name, layer.name, target, layer.samples, *figures, *costs)


def reached_in(name: str) -> Iterator[Reached]:
    """Of a sample scene, or of a random one by its number."""
    options, size = Options(effects=("soft_shadow",), backend="cpu", probes=0), LARGE
    if name.isdigit():
        options, size = replace(options, seed=intervals.build(int(name)).seed), SMALL
    else:
        open_sample(name)
    return baked_to(name, options, size)


def all_reached(names: Sequence[str], kept: Path = KEPT) -> list[Reached]:
    lines = kept_lines(names, kept, lambda name: map(asdict, reached_in(name)))
    return [Reached(**line) for line in lines]


def section(quick: bool) -> str:
    """All scenes, as a part of the document."""
    if quick:
        return document_of(all_reached(["plain"], ROOT / "out" / "targets_quick.jsonl"))
    return document_of(all_reached([*SAMPLES, *map(str, range(RANDOM_SCENES))]))


def document_of(found: list[Reached]) -> str:
    """The same of what was found."""
    rows = [_row(each) for each in found if not each.scene.isdigit()]
    summary = []
    for target in TARGETS:
        for is_random in (False, True):
            part = [each for each in found if each.target == target and each.scene.isdigit() == is_random]
            if part:
                summary.append(_summary(part, target, is_random))
    random = {each.scene for each in found if each.scene.isdigit()}
    views = {size: 2 * count for size, count in VIEWS.items()}
    header = ["scene", "layer", "target", "samples", "error over it", "CPU s", "deciding", "8 samples"]
    titles = ["scenes", "target", "layers", "over 1.1", "worst", "went on", ".8 to 1", "CPU over 8 samples'"]
    return "\n\n".join(
        [
            "### Targets",
            f"Soft shadows by rays, {LARGE[0]}x{LARGE[1]}, at most {MOST_SAMPLES} samples, default settings. "
            f"The error is that of every pixel, by {views[LARGE]} view rays each. CPU seconds are of whole "
            "bakes without a report, of all lamps; deciding is rays for the pixels that are watched, and "
            "their tree where the method needs none.",
            table(header, rows),
            f"The same beside {len(random)} of {RANDOM_SCENES} random scenes, those of the intervals without "
            f"fog, {SMALL[0]}x{SMALL[1]}, {views[SMALL]} view rays. Layers whose error with 4 samples is "
            "above the target went on; of those that say they reached it, how many are at .8 to 1 of it.",
            table(titles, summary),
        ]
    )


def _row(each: Reached) -> list[str]:
    over = f"{each.true / each.target:.2f}" + ("" if each.reached else ", not reached")
    costs = (f"{number:.1f}" for number in (each.seconds, each.watching, each.plain))
    return [each.scene, each.layer, f"{each.target:g}", str(each.samples), over, *costs]


def _summary(part: list[Reached], target: float, is_random: bool) -> list[str]:
    reached = [each.true / each.target for each in part if each.reached]
    went_on = [each for each in part if each.coarsest > each.target and each.reached]
    good = [each for each in went_on if GOOD[0] <= each.true / each.target <= GOOD[1]]
    bakes = {each.scene: each.seconds / each.plain for each in part}
    return [
        "random" if is_random else "samples",
        f"{target:g}",
        f"{len(part)}, {len(reached)} reached it",
        str(sum(each > ALLOWED for each in reached)),
        f"{max(reached, default=0.0):.2f}",
        str(len(went_on)),
        f"{len(good)} of {len(went_on)}",
        f"{np.median(list(bakes.values())):.2f}",
    ]
