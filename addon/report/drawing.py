"""Lines, disks and words, as SVG and as pixels: what plots are made of."""

from __future__ import annotations

import html
from dataclasses import dataclass, field

import numpy as np

Point = tuple[float, float]


@dataclass(frozen=True)
class Line:
    """Through `points`; colour as #rrggbb."""

    points: tuple[Point, ...]
    colour: str
    width: float = 1.0
    is_dashed: bool = False


@dataclass(frozen=True)
class Disk:
    """`is_hollow`: its inside is white."""

    at: Point
    radius: float
    colour: str
    is_hollow: bool = False


@dataclass(frozen=True)
class Words:
    """`anchor` is what of the text is `at`: start, middle or end."""

    at: Point
    text: str
    anchor: str = "start"
    colour: str = "#333333"
    size: float = 12.0


@dataclass
class Drawing:
    """`parts` lie over one another as they come. Places are in pixels from the top left."""

    width: int
    height: int
    parts: list[Line | Disk | Words] = field(default_factory=list)

    def svg(self) -> str:
        """An element for a page."""
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" '
            f'width="{self.width}" height="{self.height}" font-family="sans-serif">'
            f'<rect width="{self.width}" height="{self.height}" fill="#ffffff"/>'
            + "".join(map(_svg, self.parts))
            + "</svg>"
        )

    def pixels(self) -> np.ndarray:
        """(height, width, 3) display colours in [0, 1], row 0 at the bottom."""
        image = np.ones((self.height, self.width, 3), np.float32)
        for part in self.parts:
            if isinstance(part, Line):
                for start, end in zip(part.points, part.points[1:], strict=False):
                    _stroke(image, start, end, part)
            elif isinstance(part, Disk):
                _fill(image, part.at, part.radius, part.colour)
                if part.is_hollow:
                    _fill(image, part.at, part.radius - 1.6, "#ffffff")
        return self._with_words(image[::-1])

    def _with_words(self, image: np.ndarray) -> np.ndarray:
        """By Blender's own letters."""
        import blf
        import imbuf

        buffer = imbuf.new((self.width, self.height))
        with buffer.with_buffer(write=True) as memory:
            view = np.asarray(memory)
            view[..., :3] = np.clip(image * 255.0 + 0.5, 0, 255)
            view[..., 3] = 255
        with blf.bind_imbuf(0, buffer):
            for part in (part for part in self.parts if isinstance(part, Words)):
                blf.size(0, part.size)
                blf.color(0, *_rgb(part.colour), 1.0)
                across = (
                    blf.dimensions(0, part.text)[0] * {"start": 0.0, "middle": 0.5, "end": 1.0}[part.anchor]
                )
                blf.position(0, part.at[0] - across, self.height - part.at[1], 0.0)
                blf.draw_buffer(0, part.text)
        with buffer.with_buffer() as memory:
            found = np.array(memory)[..., :3].astype(np.float32) / 255.0
        buffer.free()
        return found


def _svg(part: Line | Disk | Words) -> str:
    if isinstance(part, Line):
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in part.points)
        dashes = ' stroke-dasharray="5 4"' if part.is_dashed else ""
        return (
            f'<polyline points="{points}" fill="none" stroke="{part.colour}" stroke-width="{part.width:g}"'
            f"{dashes}/>"
        )
    if isinstance(part, Disk):
        inside = "#ffffff" if part.is_hollow else part.colour
        return (
            f'<circle cx="{part.at[0]:.1f}" cy="{part.at[1]:.1f}" r="{part.radius:g}" fill="{inside}" '
            f'stroke="{part.colour}" stroke-width="1.6"/>'
        )
    return (
        f'<text x="{part.at[0]:.1f}" y="{part.at[1]:.1f}" text-anchor="{part.anchor}" fill="{part.colour}" '
        f'font-size="{part.size:g}">{html.escape(part.text)}</text>'
    )


def _rgb(colour: str) -> tuple[float, ...]:
    return tuple(int(colour[start : start + 2], 16) / 255.0 for start in (1, 3, 5))


def _stroke(image: np.ndarray, start: Point, end: Point, line: Line) -> None:
    x, y, near = _around(image, (min(start[0], end[0]), min(start[1], end[1])),
                         (max(start[0], end[0]), max(start[1], end[1])), line.width)  # fmt: skip
    along = np.subtract(end, start)
    length = float(np.hypot(*along))
    share = ((x - start[0]) * along[0] + (y - start[1]) * along[1]) / max(length**2, 1e-9)
    clipped = np.clip(share, 0.0, 1.0)
    distance = np.hypot(x - start[0] - clipped * along[0], y - start[1] - clipped * along[1])
    cover = np.clip(0.5 * line.width + 0.5 - distance, 0.0, 1.0)
    if line.is_dashed:
        cover *= (clipped * length) % 9.0 < 5.0
    _mix(image, near, cover, line.colour)


def _fill(image: np.ndarray, at: Point, radius: float, colour: str) -> None:
    x, y, near = _around(image, at, at, radius)
    _mix(image, near, np.clip(radius + 0.5 - np.hypot(x - at[0], y - at[1]), 0.0, 1.0), colour)


def _around(image: np.ndarray, low: Point, high: Point, margin: float):
    """Centres of the pixels around a box, and their slices."""
    spans = []
    for least, most, size in zip(low, high, image.shape[1::-1], strict=True):
        first, last = int(np.floor(least - margin - 1)), int(np.ceil(most + margin + 2))
        spans.append(slice(min(max(first, 0), size), max(min(last, size), 0)))
    columns, rows = spans
    y, x = np.mgrid[rows, columns].astype(np.float32) + 0.5
    return x, y, (rows, columns)


def _mix(image: np.ndarray, near: tuple[slice, slice], cover: np.ndarray, colour: str) -> None:
    part = image[near]
    part += cover[..., None] * (np.array(_rgb(colour), np.float32) - part)
