"""Where shading points come from, and how they are sampled: an eye and its frame, apart from the scene."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from .errors import StrataError
from .outline import Outline
from .view import Vector, View

LARGEST_SIDE = 32_768  # pixels; the rasteriser counts 1/256 pixels in 32 bits


@dataclass(frozen=True)
class Camera:
    """Blender's camera, before it is fitted to an image.

    `sensor_fit` is 'AUTO', 'HORIZONTAL' or 'VERTICAL'; `lens` and the sensor sizes are millimetres,
    `orthographic_scale` metres, `shift_x` and `shift_y` fractions of the fitted side. Axes are orthonormal
    (a camera's scale does not count in Blender).
    """

    name: str
    eye: Vector
    right: Vector
    up: Vector
    forward: Vector
    orthographic: bool = False
    lens: float = 50.0
    orthographic_scale: float = 6.0
    sensor_fit: str = "AUTO"
    sensor_width: float = 36.0
    sensor_height: float = 24.0
    shift_x: float = 0.0
    shift_y: float = 0.0
    near: float = 0.1
    far: float = 1000.0

    def view(self, width: int, height: int, pixel_aspect: tuple[float, float] = (1.0, 1.0)) -> View:
        """The eye of a whole frame of `width` x `height` pixels whose shape is `pixel_aspect`."""
        extent_x, extent_y = width * pixel_aspect[0], height * pixel_aspect[1]
        horizontal = self.sensor_fit == "HORIZONTAL" or (self.sensor_fit == "AUTO" and extent_x >= extent_y)
        # AUTO fits the sensor's width to the longer side; only VERTICAL reads the sensor's height.
        sensor = self.sensor_height if self.sensor_fit == "VERTICAL" else self.sensor_width
        fitted = self.orthographic_scale if self.orthographic else sensor / self.lens
        pixel = fitted / (extent_x if horizontal else extent_y)
        half_x, half_y = 0.5 * extent_x * pixel, 0.5 * extent_y * pixel
        shift_x, shift_y = self.shift_x * fitted, self.shift_y * fitted
        window = (shift_x - half_x, shift_x + half_x, shift_y - half_y, shift_y + half_y)
        return View(
            self.eye, self.right, self.up, self.forward, window, self.near, self.far, self.orthographic
        )


@dataclass(frozen=True)
class PixelFilter:
    """The render's own: `kind` is 'BOX', 'GAUSSIAN' or 'BLACKMAN_HARRIS', which ends `radius` pixels away; 0:
    nothing is filtered."""

    kind: str = "BLACKMAN_HARRIS"
    radius: float = 1.5


@dataclass(frozen=True)
class Raster:
    """What a camera sees, pixel by pixel. `frame_size` is the whole frame in pixels (resolution percentage
    applied) and `pixel_aspect` a pixel's width and height; `region`, in pixels x0, y0, x1, y1 from the bottom
    left, is the part of the frame that is computed, None for all, and `crop`: the image shows no more than
    that ("Crop to Render Region")."""

    camera: Camera
    frame_size: tuple[int, int]
    pixel_aspect: tuple[float, float] = (1.0, 1.0)
    region: tuple[int, int, int, int] | None = None
    crop: bool = False

    def __post_init__(self):
        if min(self.size) < 1:
            raise StrataError("the image has no pixels")
        if max(self.frame_size) > LARGEST_SIDE:
            raise StrataError(f"an image of {max(self.frame_size)} pixels a side: at most {LARGEST_SIDE}")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image in pixels."""
        return self.computed_size if self.crop else self.frame_size

    @property
    def computed_size(self) -> tuple[int, int]:
        """Width and height in pixels of what is computed: the render region, cropped to or not."""
        if self.region:
            return self.region[2] - self.region[0], self.region[3] - self.region[1]
        return self.frame_size

    @cached_property
    def view(self) -> View:
        """The camera's eye of what is computed."""
        view = self.camera.view(*self.frame_size, self.pixel_aspect)
        if not self.region:
            return view
        left, right, bottom, top = view.window
        x0, y0, x1, y1 = self.region
        step_x, step_y = (right - left) / self.frame_size[0], (top - bottom) / self.frame_size[1]
        window = (left + x0 * step_x, left + x1 * step_x, bottom + y0 * step_y, bottom + y1 * step_y)
        return replace(view, window=window)

    def framed(self, image: np.ndarray, outside: float = 0.0) -> np.ndarray:
        """A computed image (h, w[, channels]) in its place in the frame; `outside` around it."""
        if image.shape[1::-1] == self.size:
            return image
        x0, y0, x1, y1 = self.region
        frame = np.full((self.size[1], self.size[0], *image.shape[2:]), outside, image.dtype)
        frame[y0:y1, x0:x1] = image
        return frame

    def computed(self, image: np.ndarray) -> np.ndarray:
        """Of an image (height, width[, channels]) of the frame what was computed."""
        if image.shape[1::-1] == self.computed_size:
            return image
        x0, y0, x1, y1 = self.region
        return image[y0:y1, x0:x1]


@dataclass(frozen=True)
class Chart:
    """An object's surface, laid out over the unit square by its render UV map: `size` texels wide and high.
    No eye looks at it: depth is 0 and normals face outward. `instances` are the object's in the outline;
    positions are relative to `origin`. Where UVs overlap the first instance and triangle is seen."""

    object: str
    instances: frozenset[int]
    origin: Vector
    size: tuple[int, int]

    pixel_aspect = 1.0, 1.0
    region = None
    crop = False

    @classmethod
    def of(cls, outline: Outline, name: str, size: tuple[int, int]) -> Chart:
        """Of the object that is called so. Raises StrataError where there is none."""
        found = [index for index, each in enumerate(outline.instances) if each.name == name]
        if not found:
            raise StrataError(f"no object '{name}' has a surface")
        if not 1 <= min(size) <= max(size) <= LARGEST_SIDE:
            raise StrataError(f"a chart of {size[0]} x {size[1]} texels: 1 to {LARGEST_SIDE} a side")
        return cls(name, frozenset(found), outline.instances[found[0]].bounds.centre, size)

    @property
    def computed_size(self) -> tuple[int, int]:
        return self.size

    def framed(self, image: np.ndarray, outside: float = 0.0) -> np.ndarray:
        """The image itself: all of a chart is computed."""
        return image


@dataclass(frozen=True)
class Shot:
    """One picture of a scene. `source` says where its shading points are; each pixel's samples are spread as
    `pixel_filter` says and drawn by `seed`. `seen`: boxes (M, 2, 3) float64 around what a coarse picture
    shows, once somebody has taken one."""

    name: str
    source: Raster | Chart
    pixel_filter: PixelFilter = PixelFilter()
    seed: int = 0
    seen: np.ndarray | None = field(default=None, compare=False)

    @property
    def has_eye(self) -> bool:
        """Whether somebody looks at its points: not so on a chart, which has no `view`."""
        return isinstance(self.source, Raster)

    @property
    def view(self) -> View:
        """The eye of what is computed."""
        return self.source.view

    @property
    def origin(self) -> Vector:
        """World position that the positions of shading points are relative to: the eye, if there is one."""
        return self.source.view.eye if self.has_eye else self.source.origin

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image in pixels."""
        return self.source.size

    @property
    def computed_size(self) -> tuple[int, int]:
        """Width and height in pixels of what of it is computed."""
        return self.source.computed_size
