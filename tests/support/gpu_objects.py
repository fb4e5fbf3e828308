"""Counts what is held of the GPU. Needs nothing but Blender, for extension_check.py."""

from __future__ import annotations

import gc
import sys
from typing import Any

TYPES = (
    "GPUTexture",
    "GPUOffScreen",
    "GPUFrameBuffer",
    "GPUUniformBuf",
    "GPUVertBuf",
    "GPUIndexBuf",
    "GPUBatch",
)


class GpuObjects:
    """Watches Blender's gpu module make objects, in a with statement. Nothing can refer to those weakly,
    so each is kept here, and counts as held where anybody else refers to it too."""

    def __init__(self):
        self.made = 0
        self._objects: list[Any] = []
        self._patched: list[tuple[Any, str, Any]] = []

    def __enter__(self) -> GpuObjects:
        import gpu

        places = [(gpu.types, name) for name in TYPES] + [(gpu.shader, "create_from_info")]
        for place, name in places:
            maker = getattr(place, name)
            self._patched.append((place, name, maker))
            setattr(place, name, self._recording(maker))
        return self

    def __exit__(self, *_error) -> None:
        for place, name, maker in self._patched:
            setattr(place, name, maker)

    def _recording(self, maker):
        def made(*positional, **named):
            value = maker(*positional, **named)
            self.made += 1
            self._objects.append(value)
            return value

        return made

    def held(self) -> list[str]:
        """Types of what somebody holds still, one word an object."""
        gc.collect()
        before = -1
        while len(self._objects) != before:  # a batch holds its vertices
            before = len(self._objects)
            alone = _references([object()], 0)
            self._objects = [self._objects[i] for i in range(before) if _references(self._objects, i) > alone]
        return sorted(type(value).__name__ for value in self._objects)


def _references(values: list[Any], index: int) -> int:
    return sys.getrefcount(values[index])
