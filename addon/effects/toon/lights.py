"""Lights as toon shading sees them: where they are, and how much they count beside each other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...core.emitter import EmitterKind
from ...core.outline import Light
from ...core.uniforms import Three, Uniforms

LUMINANCE = (0.2126, 0.7152, 0.0722)
POINT, AREA, SUN = 0.0, 1.0, 2.0
SHARPEST = 1e6  # the blend of a hard cone
EVERYWHERE = -2.0  # cosine of a cone that is none


def luminance(light: Light) -> float:
    """Of its intensity; a negative light counts as dark."""
    return max(sum(w * c for w, c in zip(LUMINANCE, light.intensity, strict=True)), 0.0)


@dataclass(frozen=True)
class ToonLight(Uniforms):
    """What facing.glsl and kernels/src/effects/toon/facing.rs are told of a light: `centre` relative to the
    eye; `forward`, where it shines; `kind`; `cone_sharpness`: 1 / width of the cone's blend;
    `spread_cotangent`, of the half spread, 0 without one."""

    centre: Three
    weight: float
    forward: Three
    kind: float
    cone_cosine: float = EVERYWHERE
    cone_sharpness: float = SHARPEST
    spread_cotangent: float = 0.0


def packed_lights(lights: list[Light], eye) -> np.ndarray:
    """(L, 12) float32, a ToonLight a row, and a 0."""
    largest = max(map(luminance, lights), default=0.0)
    rows = np.zeros((len(lights), 12), np.float64)
    for row, light in zip(rows, lights, strict=True):
        emitter = light.emitter
        kind = POINT
        if emitter.kind == EmitterKind.DISTANT_DISK:
            kind = SUN
        elif emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
            kind = AREA
        more = {}
        if emitter.cos_cone > -1.0:
            width = (1.0 - emitter.cos_cone) * emitter.blend
            more["cone_cosine"] = emitter.cos_cone
            more["cone_sharpness"] = min(1.0 / max(width, 1e-9), SHARPEST)
        if math.isfinite(emitter.tan_half_spread):
            more["spread_cotangent"] = 1.0 / max(emitter.tan_half_spread, 1e-6)
        centre = tuple(np.array(emitter.centre) - np.array(eye))
        weight = luminance(light) / (largest or 1.0)
        row[:-1] = ToonLight(centre, weight, emitter.forward, kind, **more).numbers()
    return rows.astype(np.float32)
