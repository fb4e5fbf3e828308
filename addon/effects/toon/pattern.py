"""The halftone pattern in numbers, as both devices take it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...core.outline import Outline
from ...core.sampling import footprint_side
from ...core.shot import PixelFilter, Raster, Shot
from ...core.surface import Chunk
from ...core.uniforms import Three, Two, Uniforms
from ...core.view import View
from .params import NO_FADE, Anchor, ToonParams

ANCHOR_NUMBERS = {Anchor.SCREEN.value: 0.0, Anchor.OBJECT.value: 1.0, Anchor.SURFACE.value: 2.0}


def settings(params: ToonParams, shot: Shot) -> dict:
    """What the halftone step is recorded with, besides its anchors."""
    raster, on_surface = shot.source, params.halftone_anchor == Anchor.SURFACE
    cell = params.halftone_cell_m if on_surface else raster.frame_size[1] / params.halftone_repeat
    return {
        "anchor": params.halftone_anchor.value,
        "origin": raster.region[:2] if raster.region else (0, 0),
        "turn": (math.cos(params.halftone_angle) / cell, math.sin(params.halftone_angle) / cell),
        "dot": (params.halftone_scale, params.halftone_cutoff, params.halftone_opacity),
        "fade": _fade(params.halftone_fade_start_m, params.halftone_fade_end_m),
        "view": raster.view,
        "pixel_filter": shot.pixel_filter,
    }


def _fade(start: float, end: float) -> tuple[float, float]:
    """Scale and end such that (distance - end) * scale is 1 at `start` and 0 at `end`; scale 0 for no fade.
    Where both are one, or the wrong way round, dots end at once."""
    if end >= NO_FADE:
        return 0.0, 0.0
    return (1.0 / (start - end) if start < end else -1e9), end


@dataclass(frozen=True)
class Pattern(Uniforms):
    """What halftone.glsl is told, and after the anchor kernels/src/effects/toon/halftone.rs. `first`: frame
    position of the tile's first pixel; `turn`: cosine and sine of the pattern's, over the length of a cell;
    `fade_scale` and `fade_end`: see `_fade`; `half_footprint` in pixels; `right` and `up`: steps of a pixel
    in window units along world axes; `orthographic`: 1 or 0."""

    first: Two
    turn: Two
    scale: float
    cutoff: float
    fade_scale: float
    fade_end: float
    opacity: float
    half_footprint: float
    right: Three
    up: Three
    forward: Three
    orthographic: float


def packed_pattern(chunk: Chunk, anchor, **settings) -> list[float]:
    """The anchor and the Pattern, as the kernel takes them."""
    return [ANCHOR_NUMBERS[anchor], *pattern_of(chunk, anchor, **settings).numbers()]


def pattern_of(
    chunk: Chunk, anchor, origin, turn, dot, fade, view: View, pixel_filter: PixelFilter
) -> Pattern:
    """One sample alone is filtered as much as the render filters. Several are spread as that filter is, so
    that each need only bridge the gap around it; so are those that each pixel places by itself.
    """
    left, right, bottom, top = view.window
    step = (right - left) / chunk.width, (top - bottom) / chunk.height
    first = origin[0] + chunk.x0 + 0.5 + chunk.jitter[0], origin[1] + chunk.y0 + 0.5 + chunk.jitter[1]
    offset = None if chunk.places else chunk.jitter
    scale, cutoff, opacity = dot
    return Pattern(
        first=first,
        turn=turn,
        scale=scale,
        cutoff=cutoff,
        fade_scale=fade[0],
        fade_end=fade[1],
        opacity=opacity,
        half_footprint=0.5 * footprint_side(pixel_filter, offset, chunk.samples),
        right=tuple(np.array(view.right) * step[0]),
        up=tuple(np.array(view.up) * step[1]),
        forward=view.forward,
        orthographic=float(view.orthographic),
    )


def anchors(params: ToonParams, outline: Outline, raster: Raster) -> np.ndarray:
    """(instances, 12) float32: the origin of each in the frame, pixels, where the anchor is OBJECT; three
    rows that take positions relative to the eye to its axes, in metres, where it is SURFACE."""
    table = np.zeros((len(outline.instances), 12), np.float64)
    view = raster.view
    if len(table) and params.halftone_anchor == Anchor.OBJECT:
        origins = np.array([[row[3] for row in instance.matrix[:3]] for instance in outline.instances])
        x, y, depth = view.to_view(origins).T
        depth = np.ones_like(depth) if view.orthographic else np.maximum(depth, view.near)
        left, right, bottom, top = view.window
        width, height = raster.computed_size
        start = raster.region[:2] if raster.region else (0, 0)
        table[:, 0] = start[0] + (x / depth - left) / (right - left) * width
        table[:, 1] = start[1] + (y / depth - bottom) / (top - bottom) * height
    elif len(table) and params.halftone_anchor == Anchor.SURFACE:
        matrices = outline.instances.matrices
        linear, moved = matrices[:, :3, :3], matrices[:, :3, 3]
        scale = np.cbrt(np.abs(np.linalg.det(linear)))
        inverse = np.linalg.inv(linear) * scale[:, None, None]
        shift = np.einsum("nij,nj->ni", inverse, np.array(view.eye) - moved)
        table[:] = np.concatenate([inverse, shift[:, :, None]], axis=2).reshape(-1, 12)
    return np.nan_to_num(table).astype(np.float32)
