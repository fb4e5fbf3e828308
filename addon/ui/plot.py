"""Errors against seconds as a small picture, for the panel: both axes logarithmic, a colour each layer."""

from __future__ import annotations

import math

import bpy
import bpy.utils.previews
import numpy as np

from .state import STATE, Mark

WIDTH, HEIGHT = 512, 512
# Okabe and Ito's colours, told apart by colour-blind people too, without black; display values.
COLOURS = ((0.34, 0.71, 0.91), (0.90, 0.62, 0.00), (0.00, 0.72, 0.55), (0.94, 0.89, 0.26),
           (0.84, 0.45, 0.10), (0.80, 0.47, 0.65), (0.25, 0.52, 0.85), (0.75, 0.75, 0.75))  # fmt: skip
_GROUND = (0.10, 0.10, 0.10)
_GRID = (0.24, 0.24, 0.24)
_MARGIN = 20  # pixels around the axes' ranges


def colour_of(number: int) -> tuple[float, float, float]:
    """Of the layer at this place in the report."""
    return COLOURS[number % len(COLOURS)]


def ranges(curves: list[list[Mark]]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Of seconds and of errors: least and greatest, at least a factor of four apart, as axes show them."""
    marks = [mark for curve in curves for mark in curve if _is_drawn(mark)]
    found = []
    for values in ([mark.seconds for mark in marks], [mark.error for mark in marks]):
        low, high = (min(values), max(values)) if values else (0.1, 1.0)
        middle, spread = math.sqrt(low * high), max(math.sqrt(high / low), 2.0)
        found.append((middle / spread, middle * spread))
    return found[0], found[1]


def _is_drawn(mark: Mark) -> bool:
    return mark.seconds > 0.0 and mark.error > 0.0


def draw(curves: list[list[Mark]]) -> np.ndarray:
    """(HEIGHT, WIDTH, 4) float32 display colours, row 0 at the bottom: error upwards, seconds to the right, a
    thin line where a power of ten is, the last mark of each curve as a larger disk."""
    image = np.ones((HEIGHT, WIDTH, 4), np.float32)
    image[:, :, :3] = _GROUND
    across, up = ranges(curves)
    for low, high, size, is_column in ((*across, WIDTH, True), (*up, HEIGHT, False)):
        for power in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1):
            at = round(_place(10.0**power, low, high, size))
            if 0 <= at < size:
                image[:, at - 1 : at + 1, :3] = _GRID if is_column else image[:, at - 1 : at + 1, :3]
                if not is_column:
                    image[at - 1 : at + 1, :, :3] = _GRID
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32) + 0.5
    for number, curve in enumerate(curves):
        colour = np.array(colour_of(number), np.float32)
        points = [
            (_place(mark.seconds, *across, WIDTH), _place(mark.error, *up, HEIGHT))
            for mark in curve
            if _is_drawn(mark)
        ]
        for start, end in zip(sorted(points), sorted(points)[1:], strict=False):
            _paint(image, _distance(x, y, start, end) - 2.0, colour * 0.7)
        for index, (at_x, at_y) in enumerate(points):
            radius = 11.0 if index == len(points) - 1 else 6.0
            _paint(image, np.hypot(x - at_x, y - at_y) - radius, colour)
    return image


def _place(value: float, low: float, high: float, size: int) -> float:
    """The pixel of a value on a logarithmic axis."""
    share = math.log(value / low) / math.log(high / low)
    return _MARGIN + share * (size - 2 * _MARGIN)


def _distance(x: np.ndarray, y: np.ndarray, start, end) -> np.ndarray:
    """Of every pixel from a line between two points."""
    along = np.array(end) - np.array(start)
    share = ((x - start[0]) * along[0] + (y - start[1]) * along[1]) / max(float(along @ along), 1e-9)
    share = np.clip(share, 0.0, 1.0)
    return np.hypot(x - start[0] - share * along[0], y - start[1] - share * along[1])


def _paint(image: np.ndarray, distance: np.ndarray, colour: np.ndarray) -> None:
    """Inside of where `distance` is below 0, with a pixel of soft edge."""
    cover = np.clip(0.5 - distance, 0.0, 1.0)[:, :, None]
    image[:, :, :3] += cover * (colour - image[:, :, :3])


# As icons

_previews: bpy.utils.previews.ImagePreviewCollection | None = None
_drawn: dict[str, int] = {}


def plot_icon(scene: int) -> int:
    """The icon of a scene's plot, by its session id; drawn again when there was another bake."""
    name = f"plot {scene}"
    if name not in _previews:
        _previews.new(name)
    if _drawn.get(name) != STATE.reports_shown:
        _drawn[name] = STATE.reports_shown
        _fill(_previews[name], draw(list(STATE.marks.get(scene, {}).values())))
    return _previews[name].icon_id


def dot_icon(number: int) -> int:
    """A disk in a layer's colour."""
    name = f"dot {number % len(COLOURS)}"
    if name not in _previews:
        y, x = np.mgrid[0:32, 0:32].astype(np.float32) - 15.5
        image = np.zeros((32, 32, 4), np.float32)
        image[:, :, :3] = colour_of(number)
        image[:, :, 3] = np.clip(9.5 - np.hypot(x, y), 0.0, 1.0)
        image[:, :, :3] *= image[:, :, 3:]  # premultiplied, as Blender draws icons
        _fill(_previews.new(name), image)
    return _previews[name].icon_id


def _fill(preview: bpy.types.ImagePreview, image: np.ndarray) -> None:
    height, width = image.shape[:2]
    for size, pixels in (("image_size", "image_pixels_float"), ("icon_size", "icon_pixels_float")):
        setattr(preview, size, (width, height))
        getattr(preview, pixels).foreach_set(np.ascontiguousarray(image).reshape(-1))


def register() -> None:
    global _previews
    if _previews is None:
        _previews = bpy.utils.previews.new()


def unregister() -> None:
    global _previews
    if _previews is not None:
        bpy.utils.previews.remove(_previews)
        _previews = None
    _drawn.clear()
