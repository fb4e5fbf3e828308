"""Which part of a spot's disk or sphere can shine on a point, for the truth's samples.

Near the rim of a wide spot's light that is a sliver of it. A few samples of all of it would miss the sliver,
and the visibility of what none of them has seen is not known. Written independently of the kernels
(kernels/src/emitter/cone.rs).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.emitter import Emitter

GUARD = 1e-4
"""Of the radius: wider by this than the cone."""
LARGEST_PART = 3.0
"""Of a larger area, all of the disk is sampled."""


@dataclass(frozen=True)
class Part:
    """Boxes on the unit disk, of N points: `low`, `high` (2, N) along `right`, `up` (3, N); `is_cut` (N,):
    the box is worth it."""

    low: np.ndarray
    high: np.ndarray
    right: np.ndarray
    up: np.ndarray

    @property
    def area(self) -> np.ndarray:
        return (self.high - self.low).prod(0)

    @property
    def is_cut(self) -> np.ndarray:
        return self.area <= LARGEST_PART

    def inside(self, squares: np.ndarray) -> np.ndarray:
        """(2, S, N) of `squares` in [0, 1)."""
        return self.low[:, None] + (self.high - self.low)[:, None] * squares


def of_disk(emitter: Emitter, towards: np.ndarray, distance: np.ndarray) -> Part:
    """Of a disk that faces each point: `towards` (3, N), unit, from the point to the middle, `distance` (N,)
    metres away. Places lie along where the spot looks, seen across the way to the point."""
    angle, cone, aside, up = _seen(emitter, towards)
    radii = distance / emitter.half_width
    # Along the axis, the edges of the cone from the point back to the disk's plane; across it, a chord of the
    # disk that is as near to the middle as any of them.
    low, high = -_tangent(cone + angle), _tangent(cone - angle)
    low = np.clip(radii * low - GUARD, -1.0, 1.0)
    high = np.clip(radii * high + GUARD, low, 1.0)
    nearest = np.where((low < 0.0) & (high > 0.0), 0.0, np.minimum(np.abs(low), np.abs(high)))
    half = np.sqrt(np.maximum(1.0 - nearest**2, 0.0))
    # A cone about an axis towards the point is a circle there; about one aside, no wider than the hull of it.
    widest = radii / np.maximum(np.cos(np.minimum(angle + cone, 0.5 * np.pi)), 1e-9) * np.sin(cone)
    half = np.minimum(half, widest + GUARD)
    return Part(np.stack([low, -half]), np.stack([high, half]), aside, up)


def of_cap(emitter: Emitter, towards: np.ndarray, height: np.ndarray) -> Part:
    """Of the cap of a sphere: 1 - cosine of its half angle is `height` (N,). A direction at an angle t from
    the middle is sin(t / 2) / sin(cap / 2) from the middle of the unit disk."""
    angle, cone, aside, up = _seen(emitter, towards)
    scale = 1.0 / np.sqrt(0.5 * height)
    is_round = angle + cone >= np.pi
    outer = np.where(is_round, 1.0, np.minimum(np.sin(0.5 * (angle + cone)) * scale + GUARD, 1.0))
    inner = np.clip(np.sin(0.5 * np.maximum(angle - cone, 0.0)) * scale - GUARD, 0.0, outer)
    is_round = is_round | (angle <= cone)
    turn = np.arcsin(np.clip(np.sin(cone) / np.maximum(np.sin(angle), 1e-12), 0.0, 1.0))
    left = np.where(is_round, -outer, inner * np.cos(turn))
    half = np.where(is_round, outer, np.minimum(outer * np.sin(turn) + GUARD, 1.0))
    return Part(np.stack([left, -half]), np.stack([outer, half]), -aside, -up)


def _seen(emitter: Emitter, towards: np.ndarray):
    """The angle (N,) between the spot's axis and the way from its middle to the point, half the cone's angle,
    and unit vectors across that way: towards where the axis leads, and perpendicular to both."""
    forward = np.array(emitter.forward, np.float64)[:, None]
    cosine = -(forward * towards).sum(0)
    aside = forward + cosine * towards
    sine = np.sqrt(np.square(aside).sum(0))
    aside = np.where(sine > 1e-9, aside, across(towards)[0])
    aside = aside / np.sqrt(np.square(aside).sum(0))
    up = np.cross(towards, aside, axis=0)
    return np.arctan2(sine, cosine), np.arccos(min(max(emitter.cos_cone, -1.0), 1.0)), aside, up


def across(axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (3, N) perpendicular to unit `axes` (3, N) and to each other."""
    helper = np.where(np.abs(axes[0]) < 0.6, [[1.0], [0.0], [0.0]], [[0.0], [1.0], [0.0]])
    first = np.cross(axes, helper, axis=0)
    first /= np.sqrt(np.square(first).sum(0))
    return first, np.cross(axes, first, axis=0)


def _tangent(angle: np.ndarray) -> np.ndarray:
    """Infinite from a right angle on."""
    within = np.abs(angle) < 0.5 * np.pi
    return np.where(within, np.tan(np.where(within, angle, 0.0)), np.sign(angle) * 1e30)
