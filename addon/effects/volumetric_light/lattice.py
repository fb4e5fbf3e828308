"""The camera's rays through one tile and sample: one a pixel, or one a block of pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.surface import Chunk
from ...core.view import View


@dataclass(frozen=True)
class Lattice:
    """Ray (x, y), from the bottom left, goes through slope (orthographic: metre) first + (x, y) step of the
    view's plane. Twin of kernels/src/volumetric_light/rays.rs."""

    view: View
    first: tuple[float, float]
    step: tuple[float, float]
    width: int
    height: int

    def packed(self) -> np.ndarray:
        """(18,) float64: eye, right, up, forward, first, step, near, orthographic."""
        view = self.view
        axes = (*view.eye, *view.right, *view.up, *view.forward)
        return np.array([*axes, *self.first, *self.step, view.near, float(view.orthographic)], np.float64)

    def lengths(self) -> np.ndarray:
        """(height, width) float32: metres along each ray for each metre of depth."""
        if self.view.orthographic:
            return np.ones((self.height, self.width), np.float32)
        x = self.first[0] + np.arange(self.width) * self.step[0]
        y = self.first[1] + np.arange(self.height) * self.step[1]
        return np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2).astype(np.float32)

    def seen(self) -> View:
        """The view whose pixel centres are these rays."""
        left, bottom = (f - 0.5 * s for f, s in zip(self.first, self.step, strict=True))
        window = (left, left + self.width * self.step[0], bottom, bottom + self.height * self.step[1])
        return replace(self.view, window=window)


def offset_of(side: int, stride: int) -> int:
    """Which pixel of a block stands for it, along a side of so many pixels."""
    return min(stride // 2, side - 1)


def lattice_of(view: View, chunk: Chunk, stride: int = 1) -> Lattice:
    """The rays of a tile's pixels, or of every `stride`th."""
    left, right, bottom, top = view.window
    step = (right - left) / chunk.width, (top - bottom) / chunk.height
    rows = chunk.y1 - chunk.y0
    dx, dy = offset_of(chunk.width, stride), offset_of(rows, stride)
    first = (
        left + (0.5 + chunk.jitter[0] + dx) * step[0],
        bottom + (0.5 + chunk.jitter[1] + chunk.y0 + dy) * step[1],
    )
    width, height = len(range(dx, chunk.width, stride)), len(range(dy, rows, stride))
    return Lattice(view, first, (step[0] * stride, step[1] * stride), width, height)
