"""When a parameter counts: declared beside it, for panels, which grey it, and for docs, which say so."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

type Values = Callable[[str], Any]
"""The value of a parameter by its name; of a choice the word or the Enum."""


@dataclass(frozen=True)
class When:
    """That the parameter `name` is one of `values`, or else that it lies above `above` and below `below`."""

    name: str
    values: tuple[Any, ...] = ()
    above: float = -math.inf
    below: float = math.inf

    def holds(self, value_of: Values) -> bool:
        value = value_of(self.name)
        if self.values:
            return _word(value) in map(_word, self.values)
        return self.above < value < self.below

    def words(self, called: Callable[[str], str] = str) -> str:
        """`called` gives a parameter's name for whoever reads it."""
        name = called(self.name)
        if self.values in ((True,), (False,)):
            return f"{name} is {'on' if self.values[0] else 'off'}"
        if self.values:
            return f"{name} is {' or '.join(str(_word(value)).replace('_', ' ') for value in self.values)}"
        limits = [(self.above, "above"), (self.below, "below")]
        return f"{name} is " + " and ".join(
            f"{word} {limit:g}" for limit, word in limits if abs(limit) < math.inf
        )


@dataclass(frozen=True)
class All:
    """That all of `parts` hold; without any it always does."""

    parts: tuple[Condition, ...] = ()

    def holds(self, value_of: Values) -> bool:
        return all(part.holds(value_of) for part in self.parts)

    def words(self, called: Callable[[str], str] = str) -> str:
        parts = (
            f"({part.words(called)})" if isinstance(part, OneOf) else part.words(called)
            for part in self.parts
        )
        return " and ".join(parts)


@dataclass(frozen=True)
class OneOf:
    """That one of `parts` holds."""

    parts: tuple[Condition, ...]

    def holds(self, value_of: Values) -> bool:
        return any(part.holds(value_of) for part in self.parts)

    def words(self, called: Callable[[str], str] = str) -> str:
        return " or ".join(part.words(called) for part in self.parts)


type Condition = When | All | OneOf
ALWAYS = All()


def both(*conditions: Condition) -> Condition:
    """One condition of several, each part once."""
    parts: dict[Condition, None] = {}
    for condition in conditions:
        parts.update(dict.fromkeys(condition.parts if isinstance(condition, All) else (condition,)))
    return next(iter(parts)) if len(parts) == 1 else All(tuple(parts))


def _word(value: Any) -> Any:
    return value.value if isinstance(value, Enum) else value
