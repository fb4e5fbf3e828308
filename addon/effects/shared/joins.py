"""How layers and light come together in the composite."""

from __future__ import annotations

from enum import Enum


class Join(Enum):
    """What the composite's step does with an image, in turn."""

    LIGHT = "light"
    """What a lamp sends, times the layers that scale it, on the surface's colour."""
    MULTIPLY = "multiply"
    ADD = "add"
    OVER = "over"
    """By its alpha, premultiplied."""
