"""Registering that may be asked twice, and undone in reverse."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from types import FunctionType

import bpy

from ..core.errors import one_line

_DRAWN = ("draw", "draw_header", "draw_header_preset")


class Classes:
    """A module's Blender classes: `register` and `unregister` to be bound as the module's own."""

    def __init__(self, *classes: type):
        self._classes = classes
        self._registered: list[type] = []

    def register(self) -> None:
        for cls in self._classes:
            if cls not in self._registered:
                if issubclass(cls, (bpy.types.Panel, bpy.types.Menu)):
                    _make_safe(cls)
                bpy.utils.register_class(cls)
                self._registered.append(cls)

    def unregister(self) -> None:
        while self._registered:
            bpy.utils.unregister_class(self._registered.pop())


def _make_safe(cls: type) -> None:
    """Panels and menus say in one line what they cannot draw: raised, it would be printed at each redraw."""
    for name in _DRAWN:
        draw = getattr(cls, name, None)
        if isinstance(draw, FunctionType) and not hasattr(draw, "__wrapped__"):
            setattr(cls, name, _safe(draw))


def _safe(draw: Callable) -> Callable:
    @wraps(draw)
    def drawn(self, context):
        try:
            draw(self, context)
        except BaseException as error:
            self.layout.label(text=one_line(error), icon="ERROR")

    return drawn
