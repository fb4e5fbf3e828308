"""What a report bakes a scene with: declared parameters and samples, one after the other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import Any

from ..core.effect import Effect
from ..core.params import Params, ParamSpec, plain

OURS = "strata"
BASE_SAMPLES = 8
"""Of a pixel, where a parameter is swept."""
SAMPLES = (1, 2, 4, 8, 16, 32, 64)
FACTORS = (0.25, 0.5, 2.0, 4.0)
"""Of a parameter's own value."""


@dataclass(frozen=True)
class Setting:
    """One point of a curve. `who` makes it: `OURS` or a rival's id; `curve` is in words what is alike of all
    its points, `step` the number of `counted` that differs; `values` go over the scene's own, by effect and
    parameter."""

    who: str
    curve: str
    samples: int
    step: float
    values: tuple[tuple[str, str, Any], ...] = ()
    counted: str = "samples"

    @property
    def key(self) -> str:
        return f"{self.who}: {self.curve}: {self.counted} {self.step:g}"

    def nested(self) -> dict[str, dict[str, Any]]:
        found: dict[str, dict[str, Any]] = {}
        for effect, name, value in self.values:
            found.setdefault(effect, {})[name] = value
        return found


def sweep(chosen: Mapping[Effect, Params], samples: Sequence[int] = SAMPLES) -> list[Setting]:
    """Of the chosen effects, with nothing left automatic: samples at the scene's own settings, samples with
    each other choice that trades time for error, then numbers that do and count there, at `BASE_SAMPLES`."""
    found = [Setting(OURS, "as the scene has it", each, each) for each in samples]
    numbers: list[Setting] = []
    for effect, params in chosen.items():
        for spec in (spec for spec in effect.params.specs() if spec.trades_time):
            if not spec.used_when.holds(partial(getattr, params)):
                continue
            if issubclass(spec.kind, Enum):
                found += _choices(effect, spec, getattr(params, spec.name), samples)
            else:
                numbers += _numbers(effect, spec, getattr(params, spec.name))
    return [*found, *numbers]


def _choices(effect: Effect, spec: ParamSpec, own: Any, samples: Iterable[int]) -> list[Setting]:
    found = []
    automatic = plain(spec.default) if spec.automatic else None
    for choice in (choice for choice in spec.choices if choice not in (plain(own), automatic)):
        curve = f"{effect.id}.{spec.name}={choice}"
        values = ((effect.id, spec.name, choice),)
        found += [Setting(OURS, curve, each, each, values) for each in samples]
    return found


def _numbers(effect: Effect, spec: ParamSpec, own: float) -> list[Setting]:
    low, high = spec.hard or spec.soft or (own, own)
    values = {spec.kind(min(max(own * factor, low), high)) for factor in (*FACTORS, 1.0)}
    curve = f"{effect.id}.{spec.name}"
    return [
        Setting(OURS, curve, BASE_SAMPLES, value, ((effect.id, spec.name, value),), spec.name)
        for value in sorted(values)
        if len(values) > 1
    ]
