"""Lights as toon shading sees them: where they are, and how much they count beside each other."""

from __future__ import annotations

import math

import numpy as np

from ...core.emitter import EmitterKind
from ...core.outline import Light

LUMINANCE = (0.2126, 0.7152, 0.0722)
POINT, AREA, SUN = 0.0, 1.0, 2.0
SHARPEST = 1e6  # the blend of a hard cone
EVERYWHERE = -2.0  # cosine of a cone that is none


def luminance(light: Light) -> float:
    """Of its intensity; a negative light counts as dark."""
    return max(sum(w * c for w, c in zip(LUMINANCE, light.intensity, strict=True)), 0.0)


def packed_lights(lights: list[Light], eye) -> np.ndarray:
    """(L, 12) float32, a light: centre relative to `eye`, weight, direction it shines in, kind, cosine of the
    cone, 1 / width of its blend, cotangent of the half spread, 0. kernels/src/toon/facing.rs and
    facing.glsl read it."""
    rows = np.zeros((len(lights), 12), np.float64)
    for row, light in zip(rows, lights, strict=True):
        emitter = light.emitter
        kind = POINT
        if emitter.kind == EmitterKind.DISTANT_DISK:
            kind = SUN
        elif emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
            kind = AREA
        row[:3] = np.array(emitter.centre) - np.array(eye)
        row[3] = luminance(light)
        row[4:7] = emitter.forward
        row[7] = kind
        row[8], row[9] = EVERYWHERE, SHARPEST
        if emitter.cos_cone > -1.0:
            width = (1.0 - emitter.cos_cone) * emitter.blend
            row[8], row[9] = emitter.cos_cone, min(1.0 / max(width, 1e-9), SHARPEST)
        if math.isfinite(emitter.tan_half_spread):
            row[10] = 1.0 / max(emitter.tan_half_spread, 1e-6)
    largest = rows[:, 3].max(initial=0.0)
    rows[:, 3] /= largest if largest > 0.0 else 1.0
    return rows.astype(np.float32)
