"""Whether lights are as bright as in Cycles: unshadowed diffuse radiance of a white ground, lamp by lamp."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import strata_kernels
from strata.addon.core.outline import emitter_measure

from . import cycles
from .methods import surface_of
from .plates import LIGHTS, ground_under
from .scenes import read

SIZE = (96, 54)

LAMPS = LIGHTS | {
    "rectangle, spread 60°": ("AREA", {"shape": "RECTANGLE", "size": 0.8, "spread": math.radians(60.0)}),
    "rectangle, not normalised": ("AREA", {"shape": "SQUARE", "size": 0.8, "normalize": False}),
    "rectangle, exposure 2": ("AREA", {"shape": "SQUARE", "size": 0.8, "exposure": 2.0}),
    "rectangle, 3000 K": (
        "AREA",
        {"shape": "SQUARE", "size": 0.8, "use_temperature": True, "temperature": 3000.0},
    ),
    "point of no size": ("POINT", {"shadow_soft_size": 0.0}),
    "spot, blend 0.4": (
        "SPOT",
        {"spot_size": math.radians(70.0), "spot_blend": 0.4, "shadow_soft_size": 0.1},
    ),
    "sun of no size": ("SUN", {"angle": 0.0}),
}


@dataclass(frozen=True)
class Unit:
    """Cycles' radiance over Strata's: of the whole image, and the RMS deviation of pixels from that."""

    lamp: str
    ratio: float
    deviation: float


def measure(samples: int = 256) -> list[Unit]:
    """Every lamp."""
    found = []
    for name, (kind, settings) in LAMPS.items():
        scene = ground_under(kind, settings)
        case = read(scene, SIZE)
        surface, _ = surface_of(case)
        (light,) = case.outline.lights
        position, _, shading_normal = (part.reshape(SIZE[1], SIZE[0], 3) for part in surface.points)
        irradiance = strata_kernels.irradiance(position, shading_normal, case.eye, light.emitter.packed())
        brightness = light.radiance if emitter_measure(light.emitter) > 0.0 else light.intensity
        ours = irradiance.reshape(-1, 1) * np.array(brightness) / math.pi
        (lamp,) = cycles.lamps(scene)
        theirs = cycles.render(scene, lamp, samples, shadow=False, size=SIZE).image.reshape(-1, 3)
        ratio = float(theirs.sum() / ours.sum())
        deviation = float(np.sqrt(np.square(theirs - ratio * ours).mean()) / theirs.mean())
        found.append(Unit(name, ratio, deviation))
    return found
