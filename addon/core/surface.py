"""Shading points: what effects are evaluated at, and which part of them a node sees at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

# What a surface can carry, per point. Directions face the viewer; misses have depth +inf, ids -1 and the
# rest zero.
ATTRIBUTES = {
    "position": (np.float32, 3),  # metres, relative to the eye, world axes
    "geometric_normal": (np.float32, 3),
    "shading_normal": (np.float32, 3),
    "depth": (np.float32, 1),  # metres along the view's forward axis
    "uv": (np.float32, 2),
    "object_id": (np.int32, 1),
    "material": (np.int32, 1),
    "instance": (np.int32, 1),
    "triangle": (np.int32, 1),
}


@dataclass(frozen=True)
class Chunk:
    """Rows `y0` to `y1` (row 0 is the bottom) and columns `x0` to `x1` (all, if None) of a `width` x `height`
    image, with one jittered sample a pixel: the point at the pixel's centre plus `jitter`, in pixels.
    `samples`: how many a pixel gets. Rows and columns may lie beyond the image: its neighbours are as any
    other pixel's."""

    width: int
    height: int
    y0: int
    y1: int
    sample: int
    jitter: tuple[float, float]
    samples: int = 1
    x0: int = 0
    x1: int | None = None

    def __post_init__(self):
        if self.x1 is None:
            object.__setattr__(self, "x1", self.width)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.y1 - self.y0, self.x1 - self.x0

    @property
    def is_picture(self) -> bool:
        """Whether it is all there is to the image: every pixel and sample."""
        return self.shape == (self.height, self.width) and self.samples == 1

    def grown(self, margin: int) -> Chunk:
        """With so many more pixels at each side, also beyond the image."""
        x0, x1 = self.x0 - margin, self.x1 + margin
        return replace(self, y0=self.y0 - margin, y1=self.y1 + margin, x0=x0, x1=x1) if margin else self


@dataclass(frozen=True)
class SurfacePoints:
    """Some shading points. `position` (N, 3) float32 relative to `eye` (3,) float64, metres;
    `geometric_normal`, `shading_normal` (N, 3) float32, unit, facing the viewer."""

    position: np.ndarray
    geometric_normal: np.ndarray
    shading_normal: np.ndarray
    eye: np.ndarray
