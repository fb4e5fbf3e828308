"""Extreme inputs of an effect, measured on both devices: `rows` of the `extremes` in its folder of tests."""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib import import_module


@dataclass(frozen=True)
class Row:
    """One extreme input. `errors` by device name: how wrong the result is, NaN where it is not a number.
    `bound`: what is allowed. `refused`: the message of an input that is refused instead."""

    extreme: str
    truth: str
    errors: dict[str, float]
    bound: float
    refused: str = ""

    def cell(self, device: str) -> str:
        """For the table: the error, marked where it is beyond the bound."""
        if self.refused:
            return f"refused: {self.refused}"
        error = self.errors.get(device)
        if error is None:
            return "no device"
        if math.isnan(error):
            return "**NaN**"
        return f"{error:.1e}" if error <= self.bound else f"**{error:.1e}**"


def rows_of(effect: str, devices) -> list[Row]:
    """Every extreme of an effect, by its id in the registry, on each of `devices`."""
    return list(import_module(f"strata.tests.effects.{effect}.extremes").rows(devices))
