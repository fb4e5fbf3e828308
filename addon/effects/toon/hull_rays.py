"""Which of a hull's triangles a line of sight meets first, in float64: the outline's truth.

Written apart from the rasteriser. Triangles are sorted into grids over the image by the lower corner of their
box, each into the grid whose cells are as large as the box; a line of sight looks at its own cell and the one
before it, in every grid. So a pixel asks for what is near it, however many triangles there are.
"""

from __future__ import annotations

import numpy as np

from ...core.view import View

TRIANGLES_AT_ONCE = 1 << 17  # bounds the memory of boxes
MARGIN_PIXELS = 64.0  # around the image, more than a pixel filter reaches
LEVELS = 16  # grids, with cells of 1, 2, 4, ... pixels; what is larger is asked by every pixel


class HullRays:
    """`triangles`: corners (3 T, 3) float32 relative to the eye, by instance; `size` of the image, pixels."""

    def __init__(self, triangles: dict[int, np.ndarray], view: View, size: tuple[int, int]):
        self._view, self._size = view, size
        self._axes = np.array([view.right, view.up, view.forward]).T
        parts = [corners.reshape(-1, 3, 3) for corners in triangles.values()]
        self._corners = (
            parts[0] if len(parts) == 1 else np.concatenate([np.zeros((0, 3, 3), np.float32), *parts])
        )
        self._instances = np.array(list(triangles), np.int64)
        self._ends = np.cumsum([len(part) for part in parts])
        sides = [2.0**level for level in range(LEVELS)]
        # Two more columns: boxes that begin before the margin, and cells after the last.
        self._columns = np.array([int((size[0] + 2.0 * MARGIN_PIXELS) / side) + 3 for side in sides])
        rows = np.array([int((size[1] + 2.0 * MARGIN_PIXELS) / side) + 3 for side in sides])
        self._bases = np.concatenate([[0], np.cumsum(self._columns * rows)])
        keys = np.concatenate(
            [np.zeros(0, np.int64), *map(self._keys, range(0, len(self._corners), TRIANGLES_AT_ONCE))]
        )
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        kept = np.searchsorted(keys, 0)  # what is out of sight comes first
        self._order, self._sorted = order[kept:].astype(np.int32), keys[kept:]
        self._everywhere = self._order[np.searchsorted(self._sorted, self._bases[-1]) :]

    def first(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of lines of sight through `places` (N, 2), pixels of the image: depth (N,) of the first triangle,
        infinite for none, and its instance."""
        depths, owners = np.full(len(places), np.inf), np.full(len(places), -1)
        chosen = self._near(places.min(axis=0), places.max(axis=0))
        if not len(chosen) or not len(places):
            return depths, owners
        window = self._window(places)
        points = self._corners[chosen].astype(np.float64) @ self._axes
        low, high = self._boxes(points)
        inside = ((low <= places.max(axis=0)) & (high >= places.min(axis=0))).all(axis=1)
        if inside.any():
            depths, which = _depths(points[inside], window, self._view)
            owners = self._instances[np.searchsorted(self._ends, chosen[inside][which], side="right")]
        return depths, owners

    def _window(self, places: np.ndarray) -> np.ndarray:
        left, right, bottom, top = self._view.window
        steps = np.array([(right - left) / self._size[0], (top - bottom) / self._size[1]])
        return np.array([left, bottom]) + places * steps

    def _boxes(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Low and high corner (T, 2), pixels, of triangles (T, 3, 3) in view axes; infinite where one reaches
        the eye's plane."""
        left, right, bottom, top = self._view.window
        depth = np.ones_like(points[..., 2]) if self._view.orthographic else points[..., 2]
        scale = np.array([self._size[0] / (right - left), self._size[1] / (top - bottom)])
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            at = (points[..., :2] / depth[..., None] - np.array([left, bottom])) * scale
        lows = np.minimum(np.minimum(at[:, 0], at[:, 1]), at[:, 2])
        highs = np.maximum(np.maximum(at[:, 0], at[:, 1]), at[:, 2])
        cut = np.minimum(np.minimum(depth[:, 0], depth[:, 1]), depth[:, 2]) <= 1e-9
        lows[cut], highs[cut] = -np.inf, np.inf
        return lows, highs

    def _keys(self, start: int) -> np.ndarray:
        """Cells of some triangles: -1 for what is out of sight, the last of all for what every pixel asks."""
        points = self._corners[start : start + TRIANGLES_AT_ONCE].astype(np.float64) @ self._axes
        low, high = (each + MARGIN_PIXELS for each in self._boxes(points))
        reach = np.array(self._size) + 2.0 * MARGIN_PIXELS
        seen = ((high >= 0.0) & (low <= reach)).all(axis=1)
        keys = np.full(len(points), -1, np.int64)
        low, extent = low[seen], (high - low)[seen].max(axis=1)
        _, level = np.frexp(np.where(np.isfinite(extent), extent, 0.0))  # the extent is at most 2^level
        everywhere = ~np.isfinite(extent) | (level >= LEVELS)
        level = np.where(everywhere, 0, level).clip(0)
        low = np.where(everywhere[:, None], 0.0, low)
        cell = np.floor(np.ldexp(low, -level[:, None])).astype(np.int64) + 1
        found = self._bases[level] + cell[:, 1] * self._columns[level] + cell[:, 0]
        keys[seen] = np.where(everywhere, self._bases[-1], found)
        return keys

    def _near(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Triangles whose box may reach a rectangle of the image, pixels: all that do, and some more."""
        firsts, lasts = [], []
        for level in range(LEVELS):
            side = 2.0**level
            # A box that reaches a cell begins in it or in the one before.
            x0, y0 = (np.floor((low + MARGIN_PIXELS) / side).astype(int)).clip(0)
            x1, y1 = (np.floor((high + MARGIN_PIXELS) / side).astype(int) + 1).clip(0)
            rows = self._bases[level] + np.arange(y0, y1 + 1) * self._columns[level]
            firsts.append(rows + x0)
            lasts.append(rows + x1)
        begin = np.searchsorted(self._sorted, np.concatenate(firsts), side="left")
        end = np.searchsorted(self._sorted, np.concatenate(lasts), side="right")
        runs = [self._order[a:b] for a, b in zip(begin, end, strict=True) if b > a]
        return np.concatenate([self._everywhere, *runs])


def _depths(points: np.ndarray, window: np.ndarray, view) -> tuple[np.ndarray, np.ndarray]:
    """(N,) depth of the nearest triangle (T, 3, 3) along each line of sight, infinite for none, and which it
    is (Möller, Trumbore)."""
    if not len(points):
        return np.full(len(window), np.inf), np.zeros(len(window), int)
    flat = np.zeros((len(window), 1))
    if view.orthographic:
        origins, directions = (
            np.concatenate([window, flat], axis=1),
            np.concatenate([0 * window, flat + 1], axis=1),
        )
    else:
        origins, directions = np.zeros((len(window), 3)), np.concatenate([window, flat + 1.0], axis=1)
    first, second = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    across = np.cross(directions[:, None], second)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / np.einsum("ti,nti->nt", first, across)
        offset = origins[:, None] - points[None, :, 0]
        u = np.einsum("nti,nti->nt", offset, across) * inverse
        normal = np.cross(offset, first)
        v = np.einsum("ni,nti->nt", directions, normal) * inverse
        depth = np.einsum("ti,nti->nt", second, normal) * inverse
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (depth >= view.near) & (depth <= view.far)
    depth = np.where(hit, depth, np.inf)
    which = depth.argmin(axis=1)
    return np.take_along_axis(depth, which[:, None], axis=1)[:, 0], which
