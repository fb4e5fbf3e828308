"""Colour ramps as Blender has them, as a kind of parameter: stops, and words for what is between them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

import numpy as np

from .errors import StrataError

RGBA = tuple[float, float, float, float]
MOST_STOPS = 32  # Blender's MAXCOLORBAND


class RampInterpolation(Enum):
    """Blender's `ColorRamp.interpolation`."""

    EASE = "ease"
    CARDINAL = "cardinal"
    LINEAR = "linear"
    B_SPLINE = "b_spline"
    CONSTANT = "constant"


class RampMode(Enum):
    """Blender's `ColorRamp.color_mode`; HSV and HSL know no interpolation but linear."""

    RGB = "rgb"
    HSV = "hsv"
    HSL = "hsl"


class HuePath(Enum):
    """Blender's `ColorRamp.hue_interpolation`: which way round the circle."""

    NEAR = "near"
    FAR = "far"
    CW = "cw"
    CCW = "ccw"


@dataclass(frozen=True)
class Ramp:
    """Stops are (position in 0 to 1, linear RGBA), in ascending order."""

    stops: tuple[tuple[float, RGBA], ...]
    interpolation: RampInterpolation = RampInterpolation.LINEAR
    mode: RampMode = RampMode.RGB
    hue: HuePath = HuePath.NEAR

    def __post_init__(self):
        if not 1 <= len(self.stops) <= MOST_STOPS:
            raise StrataError(f"a ramp has 1 to {MOST_STOPS} stops, not {len(self.stops)}")
        positions = [position for position, _ in self.stops]
        if not all(0.0 <= position <= 1.0 for position in positions) or positions != sorted(positions):
            raise StrataError("a ramp's stops lie between 0 and 1, in ascending order")
        if not np.isfinite([colour for _, colour in self.stops]).all():
            raise StrataError("a ramp's colours are finite")

    @classmethod
    def parse(cls, text: str) -> Ramp:
        """From `0:#202020,0.5:#ffffff` and, after a semicolon each, any of the words of interpolation, mode
        and hue path: `...;constant`, `...;hsv;far`. Colours are sRGB, as a colour picker writes them.
        Raises StrataError."""
        stops_text, *words = (part.strip().lower() for part in text.split(";"))
        stops = []
        for part in stops_text.split(","):
            position_text, _, code = part.partition(":")
            try:
                position, colour = float(position_text), srgb_colour(code.strip())
            except ValueError:
                position, colour = -1.0, ()
            if not 0.0 <= position <= 1.0:
                raise StrataError(f"'{part.strip()}' is not a stop like 0.5:#ffffff")
            stops.append((position, (*colour, 1.0)[:4]))
        chosen: dict[type, Enum] = {}
        for word in words:
            kind = next(
                (k for k in (RampInterpolation, RampMode, HuePath) if word in {e.value for e in k}), None
            )
            if kind is None or kind in chosen:
                raise StrataError(f"'{word}' is not a way to interpolate a ramp")
            chosen[kind] = kind(word)
        return cls(
            tuple(sorted(stops, key=lambda stop: stop[0])),
            chosen.get(RampInterpolation, RampInterpolation.LINEAR),
            chosen.get(RampMode, RampMode.RGB),
            chosen.get(HuePath, HuePath.NEAR),
        )

    def __str__(self) -> str:
        """What `parse` reads, colours rounded to 8 bits."""
        stops = ",".join(f"{position:g}:{srgb_code(colour)}" for position, colour in self.stops)
        words = [self.interpolation.value]
        if self.mode != RampMode.RGB:
            words += [self.mode.value, self.hue.value]
        return ";".join([stops, *words])


def srgb_colour(code: str) -> tuple[float, ...]:
    """Linear RGB of `#rrggbb`, and alpha of `#rrggbbaa`. Raises ValueError."""
    if not re.fullmatch("#([0-9a-fA-F]{6}|[0-9a-fA-F]{8})", code):
        raise ValueError(f"'{code}' is not a colour")
    numbers = [int(code[i : i + 2], 16) / 255.0 for i in range(1, len(code), 2)]
    # IEC 61966-2-1; alpha is linear.
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in numbers[:3]]
    return (*linear, *numbers[3:])


def srgb_code(colour) -> str:
    """`#rrggbb` of linear RGB, or `#rrggbbaa` of RGBA that is not opaque, rounded and cut to 8 bits."""
    rgb = np.clip(colour[:3], 0.0, 1.0)
    encoded = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * np.maximum(rgb, 1e-9) ** (1 / 2.4) - 0.055)
    numbers = [*encoded, *(alpha for alpha in colour[3:] if alpha < 1.0)]
    return "#" + "".join(f"{round(255.0 * float(np.clip(x, 0.0, 1.0))):02x}" for x in numbers)
