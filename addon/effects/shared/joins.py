"""How layers and light come together in the composite."""

from __future__ import annotations

from enum import Enum


class Join(Enum):
    """What the composite's step does with its images, in turn. A join is a tuple: one of these values, and
    for LIGHT the light's colour and how many images scale it, for OVER_BY_DEPTH how many layers there are."""

    LIGHT = "light"
    """What a lamp sends, times the images that scale it, on the surface's colour."""
    MULTIPLY = "multiply"
    ADD = "add"
    OVER = "over"
    """By its alpha, premultiplied."""
    OVER_BY_DEPTH = "over by depth"
    """Each layer followed by its depths: the farthest first at each pixel, of equally far the earlier."""


def image_count(join: tuple) -> int:
    """How many images it takes."""
    kind, *details = join
    if kind == Join.LIGHT.value:
        return 1 + details[1]
    return 2 * details[0] if kind == Join.OVER_BY_DEPTH.value else 1
