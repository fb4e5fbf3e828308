"""Which nodes are read. Each entry says for docs/reading.md how, and what is assumed where it falls short."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Reading:
    """`read(at, output)` gives a Value for an output of a node, or `read(at)` a Closure."""

    read: Callable[..., Any]
    how: str
    instead: str = ""


VALUES: dict[str, Reading] = {}
SHADERS: dict[str, Reading] = {}


def value_of(*kinds: str, how: str, instead: str = ""):
    """A reader of nodes whose outputs are numbers: `kinds` are their `bl_idname`."""
    return _entered(VALUES, kinds, how, instead)


def shader_of(*kinds: str, how: str, instead: str = ""):
    """A reader of shaders of surfaces."""
    return _entered(SHADERS, kinds, how, instead)


def _entered(table: dict[str, Reading], kinds: tuple[str, ...], how: str, instead: str):
    def enter(read: Callable[..., Any]) -> Callable[..., Any]:
        for kind in kinds:
            table[kind] = Reading(read, how, instead)
        return read

    return enter
