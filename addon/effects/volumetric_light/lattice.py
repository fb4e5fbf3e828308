"""The camera's rays through one tile and sample: one a pixel, or one a block of pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.surface import Chunk
from ...core.view import View


@dataclass(frozen=True)
class Lattice:
    """Ray (x, y), from the bottom left, goes through slope (orthographic: metre) first + (origin + (x, y))
    step of the view's plane, counted from the image's own ray. `shown`: the tile's pixel that ray (0, 0) goes
    through. Twin of kernels/src/effects/volumetric_light/rays.rs."""

    view: View
    first: tuple[float, float]
    step: tuple[float, float]
    width: int
    height: int
    origin: tuple[int, int] = (0, 0)
    shown: tuple[int, int] = (0, 0)

    def packed(self) -> np.ndarray:
        """(18,) float64: eye, right, up, forward, first, step, near, orthographic."""
        view = self.view
        axes = (*view.eye, *view.right, *view.up, *view.forward)
        places = zip(self.first, self.origin, self.step, strict=True)
        first = (first + origin * step for first, origin, step in places)
        return np.array([*axes, *first, *self.step, view.near, float(view.orthographic)], np.float64)

    def lengths(self, offsets: np.ndarray | None = None) -> np.ndarray:
        """(height, width) float32: metres along each ray for each metre of depth. `offsets` (height, width,
        2) in steps: each ray's own."""
        if self.view.orthographic:
            return np.ones((self.height, self.width), np.float32)
        x = (self.origin[0] + np.arange(self.width))[None, :]
        y = (self.origin[1] + np.arange(self.height))[:, None]
        if offsets is not None:
            x, y = x + offsets[..., 0], y + offsets[..., 1]
        x, y = self.first[0] + x * self.step[0], self.first[1] + y * self.step[1]
        return np.sqrt(1.0 + x**2 + y**2).astype(np.float32)

    def seen(self) -> View:
        """The view whose pixel centres are these rays."""
        left, bottom = (
            first + (origin - 0.5) * step
            for first, origin, step in zip(self.first, self.origin, self.step, strict=True)
        )
        window = (left, left + self.width * self.step[0], bottom, bottom + self.height * self.step[1])
        return replace(self.view, window=window)

    def of_image(self, chunk: Chunk, stride: int) -> Lattice:
        """All rays of the image."""
        whole = replace(chunk, x0=0, x1=chunk.width, y0=0, y1=chunk.height)
        found = lattice_of(self.view, whole, stride)
        return replace(found, width=max(found.width, 1), height=max(found.height, 1))


def lattice_of(view: View, chunk: Chunk, stride: int = 1) -> Lattice:
    """The rays of a chunk's pixels, or of every `stride`th: in the middle of each block of the image's."""
    left, right, bottom, top = view.window
    step = (right - left) / chunk.width, (top - bottom) / chunk.height
    middle = stride // 2
    first = (
        left + (0.5 + chunk.jitter[0] + middle) * step[0],
        bottom + (0.5 + chunk.jitter[1] + middle) * step[1],
    )
    starts, ends = (chunk.x0, chunk.y0), (chunk.x1, chunk.y1)
    origin = tuple(-((middle - start) // stride) for start in starts)
    width, height = (-((middle - end) // stride) - begin for end, begin in zip(ends, origin, strict=True))
    shown = tuple(begin * stride + middle - start for begin, start in zip(origin, starts, strict=True))
    return Lattice(view, first, (step[0] * stride, step[1] * stride), width, height, origin, shown)
