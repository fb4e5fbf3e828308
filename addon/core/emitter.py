"""A light reduced to what shadows need: a shape, and how its radiance varies with direction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from .view import Vector

PACKED_LENGTH = 18


class EmitterKind(IntEnum):
    """RECTANGLE and ELLIPSE shine one-sided along `forward`. SPHERE is seen as a sphere. FACING_DISK is a
    disk through `centre` that turns to every shading point (Blender's soft falloff). DISTANT_DISK is a
    disk of directions (a sun)."""

    RECTANGLE = 0
    ELLIPSE = 1
    SPHERE = 2
    FACING_DISK = 3
    DISTANT_DISK = 4


@dataclass(frozen=True)
class Emitter:
    """Lengths in metres, directions unit, world space. Twin of kernels/src/emitter/shape.rs.

    `half_width` and `half_height` lie along `right` and `up`; both are the radius of a SPHERE or a
    FACING_DISK, and tan(angle / 2) of a DISTANT_DISK. Relative radiance towards a direction d (from the
    light to the point), with a the angle between d and `forward`:

    - area: max(tan_half_spread - tan a, 0) / (tan_half_spread - half_spread); 1 if tan_half_spread is inf
    - spot: smoothstep of (cos a - cos_cone) / ((1 - cos_cone) * blend); 1 if cos_cone is -1 or less
    """

    kind: EmitterKind
    centre: Vector
    right: Vector
    up: Vector
    forward: Vector
    half_width: float
    half_height: float
    tan_half_spread: float = math.inf
    cos_cone: float = -1.0
    blend: float = 0.0

    def packed(self) -> np.ndarray:
        """(18,) float64: kind, centre, right, up, forward, half_width, half_height, tan_half_spread,
        cos_cone, blend."""
        axes = (*self.centre, *self.right, *self.up, *self.forward)
        sizes = (self.half_width, self.half_height, self.tan_half_spread, self.cos_cone, self.blend)
        return np.array([float(self.kind), *axes, *sizes], np.float64)
