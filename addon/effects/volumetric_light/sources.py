"""Lights as the airlight integral knows them, and the few points that cast their shadows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np

from ...core.emitter import Emitter, EmitterKind
from ...core.outline import Light
from ...core.view import Vector, View

GOLDEN = 0.5 * (1.0 + math.sqrt(5.0))
PLASTIC = 1.324717957244746  # of the R2 sequence (Roberts 2018)


class SourceKind(IntEnum):
    """DISTANT light comes along `axis`; the others spread from `position`."""

    DISTANT = 0
    UNIFORM = 1
    SPOT = 2
    AREA = 3


@dataclass(frozen=True)
class Source:
    """World space, metres. `radius` softens the inverse square nearby, as a disk (or, `is_sphere`, a sphere)
    of that size does; `share` of the light's intensity or fluence comes from here. Its shadows are the mean
    of those of the points `eyes`. Twin of kernels/src/effects/volumetric_light/source.rs."""

    kind: SourceKind
    position: Vector
    axis: Vector
    share: float
    radius: float = 0.0
    is_sphere: bool = False
    cos_cone: float = -1.0
    blend: float = 0.0
    tan_half_spread: float = math.inf
    eyes: tuple[Vector, ...] = ()

    def packed(self) -> np.ndarray:
        """(13,) float64: kind, position, axis, radius, is_sphere, cos_cone, blend, tan_half_spread, 0."""
        shape = (self.radius, float(self.is_sphere), self.cos_cone, self.blend, self.tan_half_spread, 0.0)
        return np.array([float(self.kind), *self.position, *self.axis, *shape], np.float64)


@lru_cache(maxsize=1024)
def share_in_cone(source: Source, view: View, columns: int = 16, rows: int = 9) -> float:
    """The share of a view's rays that come into a source's cone, as if no surface ended them; of so many."""
    left, right, bottom, top = view.window
    across = left + (right - left) * (np.arange(columns) + 0.5) / columns
    upwards = bottom + (top - bottom) * (np.arange(rows) + 0.5) / rows
    aside = (across[None, :, None] * view.right + upwards[:, None, None] * np.array(view.up)).reshape(-1, 3)
    origin = np.array(view.eye) - source.position
    origins, directions = (
        (origin + aside, view.forward) if view.orthographic else (origin, view.forward + aside)
    )
    origins, directions = np.broadcast_arrays(origins, directions)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    axis, squares = np.array(source.axis), np.maximum((origins**2).sum(axis=1), 1e-30)
    ahead, along, closing = origins @ axis, directions @ axis, (origins * directions).sum(axis=1)
    # The cosine to the axis, (ahead + t along) / |origin + t direction|, is highest at the eye, at the ray's
    # end or between, where its slope is 0.
    slope = ahead - along * closing
    with np.errstate(divide="ignore", invalid="ignore"):
        best = (along * squares - ahead * closing) / slope
        between = (ahead + best * along) / np.sqrt(squares + best * (2.0 * closing + best))
    highest = np.maximum(ahead / np.sqrt(squares), along)
    highest = np.fmax(highest, np.where((best > 0.0) & np.isfinite(best), between, -1.0))
    return float((highest >= source.cos_cone).mean())


def sources_of(light: Light, count: int) -> tuple[Source, ...]:
    """`light` with at most `count` points that cast shadows, a sun twice as many; one where it has no size. A
    sun and an area light shine from each of them with equal shares, others from the centre with the shadows
    of all."""
    emitter = light.emitter
    if emitter.kind == EmitterKind.DISTANT_DISK:
        return _distant(emitter, 2 * count)
    if emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
        return _area(emitter, count)
    return _round(emitter, count)


def _vector(array) -> Vector:
    return tuple(float(x) for x in array)


def _distant(emitter: Emitter, count: int) -> tuple[Source, ...]:
    """Directions on a spiral over the disk. A medium sees all of a sun's light, a facing surface its cosine:
    the fluence is 2 / (1 + cos) of the irradiance."""
    cosine = 1.0 / math.hypot(1.0, emitter.half_width)
    fluence = 2.0 / (1.0 + cosine)
    if emitter.half_width == 0.0:
        count = 1
    index = np.arange(count)
    # Even in solid angle, which goes with 1 - cos; a single direction is the middle.
    heights = 1.0 - (1.0 - cosine) * (index + 0.5) / count if count > 1 else np.ones(1)
    turns = 2.0 * math.pi * index / GOLDEN**2
    across = np.sqrt(np.maximum(1.0 - heights**2, 0.0))[:, None]
    axes = heights[:, None] * np.array(emitter.forward) + across * (
        np.cos(turns)[:, None] * emitter.right + np.sin(turns)[:, None] * emitter.up
    )
    origin = (0.0, 0.0, 0.0)
    return tuple(
        Source(SourceKind.DISTANT, origin, _vector(axis), fluence / count, eyes=(origin,)) for axis in axes
    )


def _area(emitter: Emitter, count: int) -> tuple[Source, ...]:
    halves = np.array([emitter.half_width, emitter.half_height])
    plan = np.zeros((1, 2))
    if count > 1 and halves.any():
        index = np.arange(1, count + 1)[:, None]
        square = (0.5 + index * [1.0 / PLASTIC, 1.0 / PLASTIC**2]) % 1.0
        plan = 2.0 * square - 1.0
        if emitter.kind == EmitterKind.ELLIPSE:
            radius, angle = np.sqrt(square[:, 0]), 2.0 * np.pi * square[:, 1]
            plan = np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)
        plan = plan - plan.mean(axis=0)  # the centre of light stays where it is
    points = np.array(emitter.centre) + (plan * halves) @ np.array([emitter.right, emitter.up])
    area = 4.0 * halves.prod() * (1.0 if emitter.kind == EmitterKind.RECTANGLE else 0.25 * math.pi)
    radius = math.sqrt(area / (math.pi * len(points)))
    return tuple(
        Source(
            SourceKind.AREA,
            _vector(point),
            emitter.forward,
            1.0 / len(points),
            radius,
            tan_half_spread=emitter.tan_half_spread,
            eyes=(_vector(point),),
        )
        for point in points
    )


def _round(emitter: Emitter, count: int) -> tuple[Source, ...]:
    """Points and spots. They shine from the centre: the integral knows how large a disk they look like from
    each place. A ball whose density at radius R goes as 1 / sqrt(r^2 - R^2) looks like an even disk from
    everywhere too (Abel's transform), and it has fixed points: those cast the shadows."""
    if emitter.half_width == 0.0:
        count = 1
    offsets = np.zeros((1, 3))
    if count > 1:
        index = np.arange(count)
        heights = 1.0 - 2.0 * (index + 0.5) / count
        turns = 2.0 * math.pi * index / GOLDEN
        across = np.sqrt(1.0 - heights**2)
        directions = np.stack([across * np.cos(turns), across * np.sin(turns), heights], 1)
        # R = r sin(p), where 2 / pi (p - sin p cos p) is the share within.
        table = np.linspace(0.0, 0.5 * math.pi, 1025)
        within = (table - np.sin(table) * np.cos(table)) * 2.0 / math.pi
        shares = ((index * GOLDEN) % 1.0 + 0.5 / count) % 1.0
        radii = emitter.half_width * np.sin(np.interp(shares, within, table))
        offsets = directions * radii[:, None]
        offsets = offsets - offsets.mean(axis=0)
    kind = SourceKind.SPOT if emitter.cos_cone > -1.0 else SourceKind.UNIFORM
    source = Source(
        kind,
        emitter.centre,
        emitter.forward,
        1.0,
        emitter.half_width,
        emitter.kind == EmitterKind.SPHERE,
        emitter.cos_cone,
        emitter.blend,
        eyes=tuple(_vector(np.array(emitter.centre) + offset) for offset in offsets),
    )
    return (source,)
