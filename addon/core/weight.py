"""What the samples of a pixel weigh in layers that multiply (effects/shared/weights.py)."""

from __future__ import annotations

from enum import Enum


class Weight(Enum):
    """`doc` says it in a few words."""

    RADIANCE = "radiance", "The light that the surface would send back; metals send none back"
    IRRADIANCE = "irradiance", "The light that would arrive there, whatever the surface's colour"
    NONE = "none", "All the same: plain means"

    def __new__(cls, value: str, doc: str):
        made = object.__new__(cls)
        made._value_, made.doc = value, doc
        return made
