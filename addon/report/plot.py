"""Errors against seconds, both axes logarithmic, a colour each curve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from .drawing import Disk, Drawing, Line, Words

WIDTH, HEIGHT = 900, 480
LEFT, RIGHT, TOP, BOTTOM = 70, 330, 40, 50
# Okabe and Ito's colours, told apart by colour-blind people too, and darker ones of Tol's.
COLOURS = ("#000000", "#e69f00", "#56b4e9", "#009e73", "#0072b2", "#d55e00", "#cc79a7", "#8c6d1f",
           "#882255", "#44aa99", "#999933", "#661100")  # fmt: skip
LEAST_SPREAD = 4.0
GRID, AXIS = "#dddddd", "#333333"


@dataclass(frozen=True)
class Mark:
    """A point: seconds with the spread of repeats, error with its interval, `is_best`: on Pareto's front."""

    seconds: float
    error: float
    seconds_range: tuple[float, float]
    error_range: tuple[float, float]
    is_best: bool = False


def log_log(title: str, across: str, up: str, curves: Sequence[tuple[str, Sequence[Mark]]]) -> Drawing:
    """A drawing; `curves` are names and points. Best points are filled, others hollow."""
    drawing = Drawing(WIDTH, HEIGHT)
    marks = [mark for _, points in curves for mark in points]
    x = _Axis([mark.seconds for mark in marks], LEFT, WIDTH - RIGHT)
    y = _Axis([mark.error for mark in marks], HEIGHT - BOTTOM, TOP)
    drawing.parts += [Words((LEFT, 22), title, size=15)]
    for axis, is_across in ((x, True), (y, False)):
        for value, label in axis.ticks():
            at = axis.place(value)
            ends = ((at, TOP), (at, HEIGHT - BOTTOM)) if is_across else ((LEFT, at), (WIDTH - RIGHT, at))
            drawing.parts.append(Line(ends, GRID))
            if label:
                place = (at, HEIGHT - BOTTOM + 17) if is_across else (LEFT - 6, at + 4)
                drawing.parts.append(Words(place, label, "middle" if is_across else "end"))
    corner = ((LEFT, TOP), (LEFT, HEIGHT - BOTTOM), (WIDTH - RIGHT, HEIGHT - BOTTOM))
    drawing.parts.append(Line(corner, AXIS))
    drawing.parts.append(Words((0.5 * (LEFT + WIDTH - RIGHT), HEIGHT - 12), across, "middle"))
    drawing.parts.append(Words((8, TOP - 6), up))
    for number, (name, points) in enumerate(curves):
        colour = COLOURS[number % len(COLOURS)]
        is_dashed = number >= len(COLOURS)
        line = tuple((x.place(mark.seconds), y.place(mark.error)) for mark in points)
        if len(line) > 1:
            drawing.parts.append(Line(line, colour, 1.5, is_dashed))
        for mark, at in zip(points, line, strict=True):
            low, high = (y.place(each) for each in mark.error_range)
            drawing.parts.append(Line(((at[0], low), (at[0], high)), colour))
            low, high = (x.place(each) for each in mark.seconds_range)
            drawing.parts.append(Line(((low, at[1]), (high, at[1])), colour))
            drawing.parts.append(Disk(at, 4.0, colour, not mark.is_best))
        row = TOP + 10 + 17 * number
        if row < HEIGHT - 8:
            drawing.parts.append(Disk((WIDTH - RIGHT + 22, row - 4), 4.0, colour))
            drawing.parts.append(Words((WIDTH - RIGHT + 32, row), name[:48]))
    return drawing


class _Axis:
    """A logarithmic axis, from `first` to `last` in pixels."""

    def __init__(self, values: Sequence[float], first: float, last: float):
        known = [value for value in values if value > 0.0]
        low, high = (min(known), max(known)) if known else (0.1, 1.0)
        middle, spread = math.sqrt(low * high), max(math.sqrt(high / low) * 1.15, LEAST_SPREAD**0.5)
        self._low, self._high = middle / spread, middle * spread
        self._first, self._last = first, last

    def place(self, value: float) -> float:
        """What lies outside is at the end."""
        value = min(max(value, self._low), self._high)
        share = math.log(value / self._low) / math.log(self._high / self._low)
        return self._first + share * (self._last - self._first)

    def ticks(self) -> list[tuple[float, str]]:
        """Values and labels: every power of ten, with 2 and 5 labelled where there is room."""
        found = []
        decades = math.log10(self._high / self._low)
        for power in range(math.floor(math.log10(self._low)), math.ceil(math.log10(self._high)) + 1):
            for digit in range(1, 10):
                value = digit * 10.0**power
                if self._low <= value <= self._high:
                    is_told = digit == 1 or (digit in (2, 5) and decades < 3.0)
                    found.append((value, f"{value:g}" if is_told else ""))
        return [tick for tick in found if tick[1] or decades < 2.0]
