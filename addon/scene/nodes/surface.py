"""The surface of a material, as cameras and shadow rays meet it from either side."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from . import readers  # noqa: F401 (what reads its nodes)
from .closures import Closure, closure_at
from .graph import Graph, Leaves, Situation


@dataclass(frozen=True, eq=False)
class Surface:
    """Closures of the front and the back: `seen` by cameras, and as it `casts` shadows. `tints` and
    `lacking`: see Graph."""

    seen: tuple[Closure, Closure]
    casts: tuple[Closure, Closure]
    warnings: tuple[str, ...]
    tints: tuple[str, ...] = ()
    lacking: frozenset[str] = frozenset()

    @property
    def shown(self) -> Closure:
        """Whose colours are the material's: the front's, if there is anything to see of it."""
        front, back = self.seen
        return back if front.is_clear else front


def surface_at(socket: bpy.types.NodeSocket, leaves: Leaves | None = None) -> Surface:
    """Of the shader at the input of a material's output. `leaves`: see Graph."""
    asked: set[str] = set()
    warnings: dict[str, None] = {}
    tints: dict[str, None] = {}
    lacking: dict[str, None] = {}
    closures: dict[Situation, Closure] = {}

    def closure(is_shadow: bool, is_back: bool) -> Closure:
        situation = Situation(is_shadow and "ray" in asked, is_back and "side" in asked)
        if situation not in closures:
            graph = Graph(situation, asked, warnings, tints, leaves, lacking)
            closures[situation] = closure_at(graph, socket)
        return closures[situation]

    front = closure(False, False)
    if not asked:
        return Surface((front, front), (front, front), tuple(warnings), tuple(tints), frozenset(lacking))
    # What one asks, the others may answer differently: until none asks anything new.
    while True:
        before = len(asked)
        found = [[closure(is_shadow, is_back) for is_back in (False, True)] for is_shadow in (False, True)]
        if len(asked) == before:
            break
    seen, casts = (tuple(each) for each in found)
    return Surface(seen, casts, tuple(warnings), tuple(tints), frozenset(lacking))
