"""The render's pixel filter as a density: offsets from a pixel's centre are drawn from it."""

from __future__ import annotations

from functools import cache

import numpy as np

from .shot import PixelFilter

TABLE_LENGTH = 4096
SUBPIXELS = 256
"""To a pixel: places are whole ones, as corners of triangles are for the rasteriser (raster/grid.rs)."""


def filter_weight(pixel_filter: PixelFilter, x: np.ndarray) -> np.ndarray:
    """The filter's weight `x` pixels from the centre along one axis (the filters are separable). Same shapes
    as Cycles', so that a layer multiplies onto its image without fringes. Float64."""
    t = np.abs(np.asarray(x, np.float64)) / pixel_filter.radius
    if pixel_filter.kind == "BOX":
        weight = np.ones_like(t)
    elif pixel_filter.kind == "GAUSSIAN":
        weight = np.exp(-2.0 * (3.0 * t) ** 2)
    else:  # Blackman-Harris, four terms
        phase = np.pi * (t + 1.0)
        weight = 0.35875 - 0.48829 * np.cos(phase) + 0.14128 * np.cos(2 * phase) - 0.01168 * np.cos(3 * phase)
    return np.where(t <= 1.0, weight, 0.0)


def quantiles(pixel_filter: PixelFilter, uniform: np.ndarray) -> np.ndarray:
    """Offsets along each axis that the shares `uniform` of the filter lie below."""
    if pixel_filter.radius == 0.0:
        return np.zeros_like(uniform)
    return np.interp(uniform, *distribution(pixel_filter))


@cache
def distribution(pixel_filter: PixelFilter) -> tuple[np.ndarray, np.ndarray]:
    """Shares of the filter (TABLE_LENGTH + 1,) that lie below offsets (TABLE_LENGTH + 1,) along an axis."""
    edges = np.linspace(-pixel_filter.radius, pixel_filter.radius, TABLE_LENGTH + 1)
    weights = filter_weight(pixel_filter, 0.5 * (edges[1:] + edges[:-1]))
    below = np.concatenate([[0.0], np.cumsum(weights)])
    return below / below[-1], edges


@cache
def whole_quantiles(pixel_filter: PixelFilter) -> np.ndarray:
    """(TABLE_LENGTH,) int16: the middle of each of so many equal shares of the filter along an axis, rounded
    to 1/SUBPIXELS of a pixel. Not to be written to."""
    middles = quantiles(pixel_filter, (np.arange(TABLE_LENGTH) + 0.5) / TABLE_LENGTH)
    table = np.rint(middles * SUBPIXELS).astype(np.int16)
    table.flags.writeable = False
    return table
