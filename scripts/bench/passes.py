"""Section "Passes": the work that each pass cannot avoid, and how far its time is from the machine's limit.

Counts are least ones, of the method and not of the code: every array that a pass is given is read once, every
result written once, caches are free; operations are single-precision additions, multiplications and
comparisons of the formulas below. Work that the code saves (runs of texels merged, blocks skipped) is counted
all the same, so a pass may beat its own limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import strata_kernels

from .document import milliseconds, significant, table
from .machine import Limits
from .methods import Surface
from .scenes import Case

TRIANGLE_BYTES = 3 * 12 + 3 * 4  # positions and indices
TRIANGLE_OPERATIONS = 3 * 18 + 20  # three points through a matrix, edges and plane
FRAGMENT_OPERATIONS = 3 * 4 + 4  # three edges and a depth
INSERT_OPERATIONS = 2  # a layer: compare, keep the smaller
PREPARE_OPERATIONS = 9  # a texel of a layer: midpoint, four slopes, two maxima, pyramid
TEXEL_OPERATIONS = 14  # thesis eq. 5.3: two tests of depth, a factor, four edges times it, four clamps
LIGHT_SAMPLES = 256  # weights of the light samples, one product and sum each, where partly lit
SURFACE_BYTES = 3 * 12  # position and two normals
COUNTED_POINTS = 400
MOST_LAYERS = 16


@dataclass(frozen=True)
class Work:
    """Of one pass over a whole frame."""

    count_bytes: float
    operations: float
    what: str


def fragments(case: Case, view, width: int, height: int) -> int:
    """Triangles over pixel centres, all depths (16 at most at one place)."""
    everything = np.ones(len(case.outline.instances), np.uint8)
    depths = strata_kernels.layered_depth(
        case.device.geometry(), everything, view.packed(), MOST_LAYERS, width, height
    )
    return int(np.isfinite(depths).sum())


def _rasterised(case: Case, view, width: int, height: int, layers: int, written: int) -> Work:
    triangles, covered = case.outline.triangles, fragments(case, view, width, height)
    operations = triangles * TRIANGLE_OPERATIONS + covered * (
        FRAGMENT_OPERATIONS + layers * INSERT_OPERATIONS
    )
    what = f"{triangles:,} triangles, {covered / (width * height):.1f} fragments a pixel"
    return Work(triangles * TRIANGLE_BYTES + width * height * written, operations, what)


def search_texels(case: Case, surface: Surface, weight: np.ndarray) -> tuple[float, float]:
    """Texels and layers a lit point has to look at (thesis eq. 5.1, half-width kr / 2, narrowed once by the
    nearest depth inside), the mean over some points: texels in the narrowed square, and those of all layers
    whose depth lies before the point."""
    node = next(node for node in case.graph.nodes() if node.step.name == "layered_depth")
    view, layers, side = node.params["view"], node.params["layers"], node.params["width"]
    casters = case.device.instance_mask(node.params["casters"])
    depths = strata_kernels.layered_depth(case.device.geometry(), casters, view.packed(), layers, side, side)
    (layer,) = case.graph.layers
    emitter = case.outline.lights[layer.of.index].emitter
    left, right, bottom, top = view.window
    texels_per_slope = side / (right - left)
    lit = np.flatnonzero(weight > 0.0)
    chosen = np.random.default_rng(9).choice(lit, min(COUNTED_POINTS, len(lit)), replace=False)
    local = view.to_view(surface.position[chosen].astype(np.float64) + case.eye)
    inside, before = [], []
    for x, y, z in local:
        column = (x / z - left) * texels_per_slope
        row = (y / z - bottom) * side / (top - bottom)
        nearest, square = view.near, np.zeros((0, 0))
        for _ in range(2):
            # A light of half width h spans 2 h (1 / nearest - 1 / z) of the map's slopes.
            half = emitter.half_width * max(1.0 / nearest - 1.0 / z, 0.0) * texels_per_slope + 0.5
            low_x, high_x = (int(np.clip(v, 0, side)) for v in (column - half, column + half + 1))
            low_y, high_y = (int(np.clip(v, 0, side)) for v in (row - half, row + half + 1))
            square = depths[:, low_y:high_y, low_x:high_x]
            if not square.size:
                break
            nearest = float(np.clip(square[0].min(), view.near, z))
        inside.append(square[0].size if square.size else 0)
        before.append(int((square < z).sum()))
    return float(np.mean(inside)), float(np.mean(before))


def works(case: Case, surface: Surface, weight: np.ndarray) -> dict[str, Work]:
    """By step name, at default settings."""
    width, height = case.graph.shot.size
    pixels, lit = width * height, int((weight > 0.0).sum())
    maps = [node for node in case.graph.nodes() if node.step.name == "layered_depth"]
    layers, side = maps[0].params["layers"], maps[0].params["width"]
    texels = side * side * len(maps)
    drawn = [_rasterised(case, node.params["view"], side, side, layers, 4 * layers) for node in maps]
    inside, before = search_texels(case, surface, weight)
    return {
        "surface": _rasterised(case, case.graph.shot.view, width, height, 1, SURFACE_BYTES),
        "layered_depth": Work(
            sum(work.count_bytes for work in drawn),
            sum(work.operations for work in drawn),
            f"{len(maps)} of {side}², {layers} layers, "
            + drawn[0].what.split(", ")[-1].replace("pixel", "texel"),
        ),
        "prepare": Work(
            texels * 4 * (2 * layers + 1), texels * layers * PREPARE_OPERATIONS, f"{texels * layers:,} depths"
        ),
        "backproject": Work(
            pixels * (SURFACE_BYTES + 5) + texels * 4 * layers,
            lit * (before * TEXEL_OPERATIONS + inside + 2 * LIGHT_SAMPLES),
            f"{inside:,.0f} texels in a lit point's search square, {before:,.0f} depths before it",
        ),
    }


def tables(case: Case, seconds: dict[str, float], counted: dict[str, Work], limits: Limits, rays: str) -> str:
    """Markdown. `seconds` by step; `rays`: a sentence about what is not counted."""
    pixels = case.graph.shot.size[0] * case.graph.shot.size[1]
    rows = []
    for name, work in counted.items():
        least = limits.seconds(work.count_bytes, work.operations)
        bound = "bytes" if work.count_bytes / limits.bandwidth >= least else "operations"
        rows.append(
            [
                name,
                milliseconds(seconds[name]),
                significant(work.count_bytes / pixels, 3),
                significant(work.operations / pixels, 3),
                f"{milliseconds(least)} ({bound})",
                f"{significant(seconds[name] / least)}x",
                work.what,
            ]
        )
    header = ["pass", "ms", "bytes a pixel", "operations a pixel", "least ms", "above it", "counted"]
    machine = (
        f"Limits measured in the same run: copying {significant(limits.bandwidth / 1e9)} GB/s, "
        f"multiplying and adding {significant(limits.operations / 1e9, 3)} G/s (single precision, all cores)."
    )
    return "\n\n".join([machine, table(header, rows), rays])
