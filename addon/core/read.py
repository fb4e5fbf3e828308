"""How materials are read (scene/exact)."""

from __future__ import annotations

from enum import Enum

TEXELS = 1024
"""Most that what is baked of a mesh has a side, unless its faces need more."""

MOST_TEXELS = 4096


class Read(Enum):
    """`doc` says it in a few words."""

    FAST = "fast", "By their nodes alone; what is not read of them counts as opaque, in its viewport colour"
    EXACT = "exact", "What is not read of their nodes (procedural textures, scripts) Blender bakes, and keeps"

    def __new__(cls, value: str, doc: str):
        made = object.__new__(cls)
        made._value_, made.doc = value, doc
        return made
