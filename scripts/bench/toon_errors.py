"""Toon: how wrong masks are at their edges, and how even lines are."""

from __future__ import annotations

import math

import numpy as np
from strata.addon.bake import read_scene
from strata.addon.measure.mask import SUPERSAMPLES
from strata.addon.planning import Options
from strata.tests.effects.toon.mask_errors import edge_errors
from strata.tests.effects.toon.outline_width import LINE, SHAPES, ring_of

from .document import table

TURNS = 24
PLACES = {"in the middle of the image": (0.0, 0.0, 0.0), "aside, 31 degrees": (3.0, 0.0, -2.0)}


def masks(scene, quick: bool) -> str:
    """Errors at edges, by the number of samples."""
    size, samples = ((160, 90), [8]) if quick else ((960, 540), [4, 8, 16, 32])
    options = Options(("toon",), samples=8, values={"toon": {"shadows": False}})
    *read, _ = read_scene(scene, scene.view_layers[0], options, size=size)
    rows = [
        [
            layer,
            count,
            f"{100 * found.edges:.1f}%",
            f"{100 * found.wrong:.2f}%",
            f"{100 * found.far_off:.2f}%",
            f"{found.mean:.4f}",
            f"{found.elsewhere:.3f}",
        ]
        for (layer, count), found in sorted(edge_errors(read, samples).items())
    ]
    header = [
        "layer",
        "samples",
        "edge pixels",
        "off by over 1/8",
        "over 1/4",
        "mean error",
        "most elsewhere",
    ]
    title = (
        f"`comic` at {size[0]}x{size[1]}, every pixel against {SUPERSAMPLES} samples. Edges are the pixels "
        f"whose {SUPERSAMPLES} samples are not all the same; the next three columns are of these."
    )
    return f"{title}\n\n{table(header, rows)}"


def evenness(quick: bool) -> str:
    """Width of a hull's ring over a turntable."""
    turns = 2 if quick else TURNS
    rows = []
    for name, make in SHAPES.items():
        shape = make()
        for where, place in PLACES.items():
            found = [ring_of(shape, 2.0 * math.pi * turn / turns + 0.05, place) for turn in range(turns)]
            least, most = np.array(found).T
            rows.append([name, where, f"{least.min():.2f}", f"{most.max():.2f}"])
    title = (
        f"A line of {LINE:g} pixels, {turns} views of a turntable: pixels from the object's outline to the "
        "nearest place without ink and to the farthest one with it, by rays at random places."
    )
    return f"{title}\n\n{table(['object', 'where', 'no ink from', 'ink up to'], rows)}"
