"""Every N-th pixel of an image, as a picture of its own."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.shot import PixelFilter, Raster

PIXELS = 2000
"""How many to look at. Cycles takes about as long for each render before it begins."""

LEAST_WIDTH = 0.01  # pixels; of Cycles' pixel filter
LARGEST_STEP = 100  # pixels, so that a filter of more than a pixel is not narrower than that
STRETCH = {"GAUSSIAN": 1.5, "BLACKMAN_HARRIS": 1.0}
"""Radius of Cycles' filters over their Filter Width (addon/scene/cameras.py)."""


@dataclass(frozen=True)
class Grid:
    """Pixels `first` + i · `step` of an image, `count` of them in x and y, from its bottom left."""

    step: int
    first: tuple[int, int]
    count: tuple[int, int]

    @property
    def slices(self) -> tuple[slice, slice]:
        """Of an image's rows and columns."""
        return tuple(
            slice(first, first + self.step * count, self.step)
            for first, count in zip(self.first[::-1], self.count[::-1], strict=True)
        )

    def window(self, raster: Raster) -> tuple[float, float, float, float]:
        """Left, right, bottom, top of the picture of these pixels, each N times as wide, at unit depth (of an
        orthographic eye metres)."""
        window, size = raster.view.window, raster.computed_size
        found = []
        for axis in (0, 1):
            low, high = window[2 * axis : 2 * axis + 2]
            pixel = (high - low) / size[axis]
            start = low + pixel * (self.first[axis] + 0.5 - 0.5 * self.step)
            found += [start, start + pixel * self.step * self.count[axis]]
        return tuple(found)

    def filter_width(self, pixel_filter: PixelFilter) -> float:
        """Cycles' Filter Width, in pixels of the picture, that makes the render's own filter."""
        return max(pixel_filter.radius / STRETCH[pixel_filter.kind] / self.step, LEAST_WIDTH)


def grid_of(size: tuple[int, int], pixels: int = PIXELS) -> Grid:
    """About `pixels` of an image of `size`, in its middle."""
    width, height = size
    step = min(max(1, int((width * height / pixels) ** 0.5)), LARGEST_STEP)
    count = tuple((side - 1) // step + 1 for side in size)
    first = tuple((side - 1 - step * (n - 1)) // 2 for side, n in zip(size, count, strict=True))
    return Grid(step, first, count)
