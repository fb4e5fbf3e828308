"""A first, coarse look at the scene: where the surfaces in view really are."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ...core.culling import around, boxes_of
from ...core.outline import Outline
from ...core.slices import finished
from ...core.surface import Chunk
from .steps import SURFACE

COARSER = 4
"""Pixels of the image, across and up, to one of the look."""

TILE = 8
"""The look's pixels, across and up, that share a box."""

MARGIN, REACH = 0.25, 2.0
"""A box grows on each side by this share of itself and by so many of the look's pixels."""


STRIP_PIXELS = 1 << 15
"""Of the look, rasterised between two yields."""


def seen_boxes(device, geometry, outline: Outline, visible: frozenset[int]) -> np.ndarray:
    """`look`, to its end."""
    return finished(look(device, geometry, outline, visible))


def look(device, geometry, outline: Outline, visible: frozenset[int]) -> Generator[None, None, np.ndarray]:
    """(M, 2, 3) float64 boxes, world space, around the points of the instances `visible` that the camera
    sees, a tile of the image each; and the boxes of instances that the look hit nowhere, since they may be
    too thin for it, unless they are larger than all that was hit: those are hidden. `device` is the CPU,
    `geometry` its handle. Yields between strips of the picture."""
    width, height = (-(-side // COARSER) for side in outline.computed_size)
    attributes = frozenset({"position", "depth", "instance"})
    rows = max(STRIP_PIXELS // width // TILE, 1) * TILE
    boxes, hit_instances = [], set()
    for y0 in range(0, height, rows):
        chunk = Chunk(width, height, y0, min(y0 + rows, height), 0, (0.0, 0.0))
        surface = SURFACE.cpu(
            device, geometry, view=outline.view, visible=visible, chunk=chunk, attributes=attributes
        )
        boxes += _boxes(surface, outline, width)
        hit_instances.update(np.unique(surface["instance"]).tolist())
        yield
    if not boxes:
        return np.zeros((0, 2, 3))
    boxes = np.array(boxes, np.float64)
    missed = sorted(visible - hit_instances)
    thin = boxes_of(outline)[missed]
    size = np.ptp(around(boxes), axis=0).max()
    return np.concatenate([boxes, thin[np.ptp(thin, axis=1).max(axis=1) <= size]])


def _boxes(surface: dict[str, np.ndarray], outline: Outline, width: int) -> list[tuple]:
    """Around the points of each tile of a strip, low and high corners in world space."""
    left, right, _, _ = outline.view.window
    eye = np.array(outline.view.eye)
    boxes = []
    for y in range(0, len(surface["depth"]), TILE):
        for x in range(0, width, TILE):
            tile = np.s_[y : y + TILE, x : x + TILE]
            depth = surface["depth"][tile]
            hit = np.isfinite(depth)
            if hit.any():
                points = surface["position"][tile][hit].astype(np.float64)
                low, high = points.min(axis=0), points.max(axis=0)
                # What falls between the look's pixels, or a filter's width beside them.
                scale = 1.0 if outline.view.orthographic else float(depth[hit].max())
                margin = MARGIN * (high - low) + REACH * (right - left) / width * scale
                boxes.append((eye + low - margin, eye + high + margin))
    return boxes
