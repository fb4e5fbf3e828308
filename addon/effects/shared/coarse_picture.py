"""A first, coarse picture of the scene: where the surfaces in view really are."""

from __future__ import annotations

from collections.abc import Generator
from itertools import product

import numpy as np

from ...core.culling import around, boxes_of, partly_opaque
from ...core.outline import Outline
from ...core.shot import Shot
from ...core.slices import finished
from ...core.surface import Chunk
from .steps import SURFACE

COARSER = 4
"""Pixels of the image, across and up, to one of the coarse picture."""

TILE = 8
"""The coarse picture's pixels, across and up, that share a box."""

DRAWS = 4
"""Pictures of a scene of which something is partly opaque to the camera: what is there by chance in one is
not in another."""

MARGIN, REACH = 0.25, 2.0
"""A box grows on each side by this share of itself and by so many of its pixels."""


STRIP_PIXELS = 1 << 17
"""Of the coarse picture, rasterised between two yields: a few hundredths of a second. Every strip sets all
triangles up again."""


NONE: frozenset[int] = frozenset()


def seen_boxes(
    device, geometry, outline: Outline, shot: Shot, visible: frozenset[int], holdouts: frozenset[int] = NONE
) -> np.ndarray:
    """`take_coarse_picture`, to its end."""
    return finished(take_coarse_picture(device, geometry, outline, shot, visible, holdouts))


def take_coarse_picture(
    device, geometry, outline: Outline, shot: Shot, visible: frozenset[int], holdouts: frozenset[int] = NONE
) -> Generator[None, None, np.ndarray]:
    """(M, 2, 3) float64 boxes, world space, around the points of the instances `visible` that the camera
    sees, but for `holdouts` among them, a tile of the image each; and the boxes of instances that the picture
    shows nowhere, since they may be too thin for it, unless they are larger than all that was hit: those are
    hidden. `device` is the CPU, `geometry` its handle. Yields between strips of the picture."""
    width, height = (-(-side // COARSER) for side in shot.computed_size)
    attributes = frozenset({"position", "depth", "instance"})
    rows = max(STRIP_PIXELS // width // TILE, 1) * TILE
    boxes, is_hit = [], np.zeros(len(outline.instances) + 1, bool)
    draws = DRAWS if partly_opaque(outline, visible, "seen") else 1
    for y0, draw in product(range(0, height, rows), range(draws)):
        chunk = Chunk(width, height, y0, min(y0 + rows, height), draw, (0.0, 0.0), draws)
        surface = SURFACE.cpu(
            device, geometry, shot.view, visible, chunk=chunk, attributes=attributes, holdouts=holdouts
        )
        boxes.append(_boxes(surface, shot, width))
        is_hit[surface["instance"].reshape(-1)] = True  # -1, where nothing is, is the last place
        yield
    boxes = np.concatenate(boxes)
    if not len(boxes):
        return boxes
    missed = sorted(visible - holdouts - frozenset(np.flatnonzero(is_hit[:-1]).tolist()))
    thin = boxes_of(outline)[missed]
    size = np.ptp(around(boxes), axis=0).max()
    return np.concatenate([boxes, thin[np.ptp(thin, axis=1).max(axis=1) <= size]])


def _boxes(surface: dict[str, np.ndarray], shot: Shot, width: int) -> np.ndarray:
    """(N, 2, 3) float64 around the points of each tile of a strip that has any, low and high corners in world
    space."""
    hit = (surface["instance"] >= 0)[..., None]
    low = _by_tile(np.minimum, np.where(hit, surface["position"], np.float32(np.inf)), np.inf)
    high = _by_tile(np.maximum, np.where(hit, surface["position"], np.float32(-np.inf)), -np.inf)
    shown = np.isfinite(low[:, 0])
    low, high = low[shown].astype(np.float64), high[shown].astype(np.float64)
    # What falls between the coarse picture's pixels, or a filter's width beside them.
    left, right, _, _ = shot.view.window
    scale = np.ones(len(low))
    if not shot.view.orthographic:
        depth = np.where(hit, surface["depth"][..., None], np.float32(0.0))
        scale = _by_tile(np.maximum, depth, 0.0)[shown, 0].astype(np.float64)
    margin = MARGIN * (high - low) + (REACH * (right - left) / width * scale)[:, None]
    eye = np.array(shot.view.eye)
    return np.stack([eye + low - margin, eye + high + margin], axis=1)


def _by_tile(ufunc: np.ufunc, image: np.ndarray, nothing: float) -> np.ndarray:
    """(tiles, channels), least or greatest of an image (h, w, channels) in each, which `nothing` does not
    change. Whole rows come first: numpy is slow at short ones."""
    rows, columns = (-(-side // TILE) for side in image.shape[:2])
    spare = ((0, rows * TILE - image.shape[0]), (0, columns * TILE - image.shape[1]), (0, 0))
    image = np.pad(image, spare, constant_values=nothing).reshape(rows, TILE, -1)
    across = ufunc.reduce(image, axis=1).reshape(rows * columns, TILE, -1)
    return ufunc.reduce(across, axis=1)
