"""Registering that may be asked twice, and undone in reverse."""

from __future__ import annotations

import bpy


class Classes:
    """A module's Blender classes: `register` and `unregister` to be bound as the module's own."""

    def __init__(self, *classes: type):
        self._classes = classes
        self._registered: list[type] = []

    def register(self) -> None:
        for cls in self._classes:
            if cls not in self._registered:
                bpy.utils.register_class(cls)
                self._registered.append(cls)

    def unregister(self) -> None:
        while self._registered:
            bpy.utils.unregister_class(self._registered.pop())
