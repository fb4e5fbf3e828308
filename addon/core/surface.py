"""Shading points: what effects are evaluated at, and which part of them a node sees at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .placement import Places


@dataclass(frozen=True)
class Attribute:
    """Of each point: `channels` numbers of `dtype`, `miss` where there is no surface. `wants`: what the
    extraction has to bring for it (addon/scene/extract.py), if anything; `corners`: the table of corners that
    a GPU reads it from (core/device.py, GpuGeometry)."""

    dtype: type
    channels: int = 1
    miss: float = 0
    wants: str = ""
    corners: str = ""


# What a surface can carry. Directions face the viewer. Three find them, each by itself: the rasteriser
# (kernels/src/raster/shade.rs), a shader (effects/shared/surface.glsl) and rays (kernels/src/rays/look.rs).
ATTRIBUTES = {
    "position": Attribute(np.float32, 3),  # metres, relative to the eye, world axes
    "geometric_normal": Attribute(np.float32, 3),
    "shading_normal": Attribute(np.float32, 3, wants="corner_normals", corners="corner_normals"),
    # Metres, world axes: from a smooth triangle to the surface that its corners' normals tell of, on the side
    # of the geometric normal. Rays of shadows begin there near the terminator.
    "terminator_lift": Attribute(np.float32, 3, wants="corner_normals", corners="corner_normals"),
    "depth": Attribute(np.float32, miss=np.inf),  # metres along the view's forward axis
    "uv": Attribute(np.float32, 2, wants="uv", corners="corner_uvs"),
    "corner_colour": Attribute(np.float32, 3, wants="corner_colour", corners="corner_colours"),
    "object_id": Attribute(np.int32, miss=-1),
    "material": Attribute(np.int32, miss=-1),
    "instance": Attribute(np.int32, miss=-1),
    "triangle": Attribute(np.int32, miss=-1),  # of the instance's mesh
}


def with_holes(
    surface: dict[str, np.ndarray], holdouts: frozenset[int], attributes: frozenset[str]
) -> dict[str, np.ndarray]:
    """These `attributes` of some points, of which "instance" is known: where one of the instances `holdouts`
    is they are, but for depth, as where there is no surface. Written in place."""
    if not holdouts:
        return surface
    is_hole = np.isin(surface["instance"], sorted(holdouts))
    for name, values in surface.items():
        if name != "depth":
            values[is_hole] = ATTRIBUTES[name].miss
    return {name: surface[name] for name in attributes}


@dataclass(frozen=True)
class Chunk:
    """Rows `y0` to `y1` (row 0 is the bottom) and columns `x0` to `x1` (all, if None) of a `width` x `height`
    image, with one jittered sample a pixel: the point at the pixel's centre plus `jitter`, in pixels, or plus
    the pixel's own offset, where there are `places`.
    `samples`: how many a pixel gets, or has after this pass where more may follow. Rows and columns may lie
    beyond the image: its neighbours are as any other pixel's."""

    width: int
    height: int
    y0: int
    y1: int
    sample: int
    jitter: tuple[float, float]
    samples: int = 1
    x0: int = 0
    x1: int | None = None
    places: Places | None = None

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

    def numbers(self, index: np.ndarray) -> np.ndarray:
        """Of the chunk's pixels with these indices, row by row: uint32 that tell the image's pixels apart."""
        if (self.x0, self.x1) == (0, self.width):
            return (self.y0 * self.width + index).astype(np.uint32)
        rows, columns = np.divmod(index, self.shape[1])
        return ((self.y0 + rows) * self.width + self.x0 + columns).astype(np.uint32)

    def grown(self, margin: int) -> Chunk:
        """With so many more pixels at each side, also beyond the image."""
        x0, x1 = self.x0 - margin, self.x1 + margin
        return replace(self, y0=self.y0 - margin, y1=self.y1 + margin, x0=x0, x1=x1) if margin else self


@dataclass(frozen=True)
class SurfacePoints:
    """Some shading points. `position` (N, 3) float32 relative to `eye` (3,) float64, metres;
    `geometric_normal`, `shading_normal` (N, 3) float32, unit, facing the viewer; `lifts` (N, 4) float32 where
    rays of shadows begin (effects/shared/terminator.py), None: at the points."""

    position: np.ndarray
    geometric_normal: np.ndarray
    shading_normal: np.ndarray
    eye: np.ndarray
    lifts: np.ndarray | None = None
