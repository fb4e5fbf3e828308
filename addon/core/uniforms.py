"""Uniform blocks, declared once: what a shader is told in numbers, by name on both sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import Self, get_args, get_type_hints

import numpy as np

Two = tuple[float, float]
Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
_GLSL = {1: "float", 2: "vec2", 4: "vec4"}


@dataclass(frozen=True)
class Uniforms:
    """Base of a block: a frozen dataclass whose fields are float, Two, Three or Four.

    It packs itself and writes its GLSL by std140 (OpenGL 4.5, 7.6.2.2): a vec2 begins at a multiple of two
    numbers, a vec4 at one of four. Three numbers are a vec4, whose last is 0: drivers disagree on what may
    follow a vec3.
    """

    @classmethod
    @cache
    def members(cls) -> tuple[tuple[str, int, int], ...]:
        """Of each field its name, how many numbers it has, and the place of the first."""
        hints, found, place = get_type_hints(cls), [], 0
        for each in fields(cls):
            count = len(get_args(hints[each.name])) or 1
            taken = 4 if count == 3 else count
            place = -(-place // taken) * taken
            found.append((each.name, count, place))
            place += taken
        return tuple(found)

    @classmethod
    def glsl(cls) -> str:
        """The members of a struct."""
        return " ".join(f"{_GLSL[4 if count == 3 else count]} {name};" for name, count, _ in cls.members())

    @classmethod
    def of(cls, numbers: Sequence[float]) -> Self:
        """From one number after the other; what is left over is not looked at."""
        values, start = [], 0
        for _, count, _ in cls.members():
            values.append(numbers[start] if count == 1 else tuple(numbers[start : start + count]))
            start += count
        return cls(*values)

    def numbers(self) -> list[float]:
        """One after the other, as kernels take them."""
        found: list[float] = []
        for name, count, _ in self.members():
            value = getattr(self, name)
            found += [float(value)] if count == 1 else map(float, value)
        return found

    def packed(self) -> np.ndarray:
        """(N, 4) float32; what single precision does not hold is infinite."""
        members = self.members()
        _, count, place = members[-1]
        values = np.zeros(4 * -(-(place + count) // 4), np.float32)
        with np.errstate(over="ignore"):
            for name, count, place in members:
                values[place : place + count] = getattr(self, name)
        return values.reshape(-1, 4)
