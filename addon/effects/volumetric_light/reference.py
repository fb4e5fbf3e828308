"""The truth that volumetric light is scored against: samples along each ray, a shadow ray to a random point
of the light from each, float64. It shares only the intersection of rays with triangles with the effect."""

from __future__ import annotations

import math

import numpy as np

from ...core.device import RayCaster
from ...core.emitter import Emitter, EmitterKind
from ...core.graph import PlannedLayer
from ...core.outline import Outline, emitter_measure
from ...core.view_rays import ViewRays
from .media import Fill, fill_of

SAMPLES = 512
"""Along each ray, for each of the two estimates."""

CELLS = 64
"""Of each ray, that samples are shared out to by how brightly the light shines there."""

EVEN = 0.1
"""Of the samples, shared out evenly."""

THICK = 4.0
"""Optical depth until the light is near from which on samples are placed by transmittance."""

LOOKS = 8
"""Places on the light, if it has a size, that a cell's brightness is the mean of."""

PLASTIC = 1.324717957244746
SPREAD = np.array([1.0 / PLASTIC, 1.0 / PLASTIC**2])
"""The R2 sequence (Roberts 2018), for places on the light."""

MOST_CROSSINGS = 32
LIFT = 1e-6


def transmitted(
    rays: RayCaster, outline: Outline, layer: PlannedLayer, view_rays: ViewRays, seed: int
) -> np.ndarray:
    """(1, N, 3) float64, exact but for rounding."""
    fill, _ = fill_of(outline, layer.params)
    starts, ends = _limits(view_rays)
    extinction = np.array(fill.medium.extinction)
    crossings = _camera_crossings(rays, outline, fill, view_rays)
    metres = _inside(crossings, starts, ends)[:, None]
    with np.errstate(invalid="ignore"):
        depth = np.where(extinction > 0.0, metres * extinction, 0.0)
    return np.exp(-depth)[None]


def scattered(
    rays: RayCaster, outline: Outline, layer: PlannedLayer, view_rays: ViewRays, seed: int
) -> np.ndarray:
    """(2, N, 3) float64: two independent estimates of the radiance scattered towards the eye."""
    fill, _ = fill_of(outline, layer.params)
    light = outline.lights[layer.of.index]
    generator = np.random.Generator(np.random.PCG64(seed))
    casters = np.zeros(len(outline.instances), np.uint8)
    casters[sorted(layer.casters)] = 1
    starts, ends = _limits(view_rays)
    crossings = _camera_crossings(rays, outline, fill, view_rays)
    ends = np.maximum(ends, starts)
    if fill.instances is not None:
        # Nothing is scattered beyond the last exit.
        last = np.where(np.isfinite(crossings), crossings, -np.inf).max(axis=1, initial=-np.inf)
        first = crossings.min(axis=1, initial=np.inf)
        inside = np.isfinite(crossings).sum(axis=1) % 2 == 1
        starts = np.where(inside, starts, np.maximum(starts, np.where(np.isfinite(first), first, starts)))
        ends = np.maximum(np.minimum(ends, last), starts)
    halves = _estimates(
        rays, light.emitter, fill, view_rays, starts, ends, crossings, casters, outline, generator
    )
    measure = emitter_measure(light.emitter)
    unit = np.array(light.intensity) / (measure if measure > 0.0 else 1.0)
    return np.array(halves) * unit


def _limits(view_rays: ViewRays) -> tuple[np.ndarray, np.ndarray]:
    """Where each ray begins, at the near plane as in Cycles, and ends, (N,) metres."""
    view = view_rays.shot.view
    along = view_rays.directions @ np.array(view.forward)
    return view.near / along, view_rays.distances


def _camera_crossings(rays, outline: Outline, fill: Fill, view_rays: ViewRays) -> np.ndarray | None:
    if fill.instances is None:
        return None
    far = np.full(len(view_rays), 1e9)
    return _crossings(rays, outline, fill, view_rays.origins, view_rays.directions, far)


def _crossings(rays, outline: Outline, fill: Fill, origins, directions, t_max) -> np.ndarray:
    """(N, C) ascending distances of the medium's surface, infinite where there are no more."""
    mask = np.zeros(len(outline.instances), np.uint8)
    mask[sorted(fill.instances)] = 1
    count, found = len(origins), []
    reached = np.zeros(count)
    relative = origins - rays.origin
    for _ in range(MOST_CROSSINGS):
        begin = (relative + reached[:, None] * directions).astype(np.float32)
        room = np.maximum(t_max - reached, 0.0).astype(np.float32)
        distance, instance, _ = rays.nearest(mask, begin, np.ascontiguousarray(directions, np.float32), room)
        hit = instance >= 0
        if not hit.any():
            break
        at = np.where(hit, reached + distance, np.inf)
        found.append(at)
        reached = np.where(hit, at + LIFT * (1.0 + np.abs(at)), t_max)
    return np.array(found).T if found else np.full((count, 1), np.inf)


def _inside(crossings: np.ndarray | None, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(N,) metres between `starts` and `ends` that lie inside the medium whose surface is crossed there; None
    for a medium that is everywhere."""
    if crossings is None:
        return np.maximum(ends - starts, 0.0)
    inside = np.isfinite(crossings).sum(axis=1) % 2 == 1
    edges = np.concatenate([np.zeros((len(crossings), 1)), crossings], axis=1)
    edges = np.concatenate([edges, np.full((len(crossings), 1), np.inf)], axis=1)
    total = np.zeros(len(crossings))
    for k in range(edges.shape[1] - 1):
        low, high = np.maximum(edges[:, k], starts), np.minimum(edges[:, k + 1], ends)
        part = inside & (high > low)
        total[part] += high[part] - low[part]
        inside = inside ^ np.isfinite(edges[:, k + 1])
    return total


def _estimates(rays, emitter, fill, view_rays, starts, ends, crossings, casters, outline, generator):
    """Two, whose samples are shared out by the same look at how brightly the light shines."""
    medium = fill.medium
    count = len(view_rays)
    extinction = np.array(medium.extinction)
    origins, directions = view_rays.origins, view_rays.directions
    closest = np.einsum("nc,nc->n", np.array(emitter.centre) - origins, directions)
    foot = origins + closest[:, None] * directions - np.array(emitter.centre)
    height = np.maximum(np.linalg.norm(foot, axis=1), 0.25 * emitter.half_width + 1e-6)
    distant = emitter.kind == EmitterKind.DISTANT_DISK

    def placed(uniform):
        return _places(uniform, starts, ends, closest, height, float(extinction.mean()), distant)

    def unshadowed(t, square):
        points = origins[:, None] + t[..., None] * directions[:, None]
        to_light, far, weight = _towards(emitter, points.reshape(-1, 3), square.reshape(-1, 2))
        # The angle is the one between where light goes and where the eye is.
        cosine = np.einsum("nsc,nc->ns", to_light.reshape(*t.shape, 3), directions)
        g = medium.anisotropy
        phase = (1.0 - g * g) / (4.0 * math.pi * np.maximum(1.0 + g * g - 2.0 * g * cosine, 1e-300) ** 1.5)
        return points, to_light, far, phase * weight.reshape(t.shape)

    # Where the light, seen from several places on it, shines brightly, samples are close together.
    looks = 1 if distant or emitter.half_width == 0.0 else LOOKS
    middles = np.broadcast_to((np.arange(CELLS * looks) + 0.5) / (CELLS * looks), (count, CELLS * looks))
    t, density = placed(middles)
    turns = np.arange(CELLS * looks)[:, None] * SPREAD + generator.random((count, 1, 2))
    _, _, far, value = unshadowed(t, turns % 1.0)
    way = t - starts[:, None] + (0.0 if distant else far.reshape(t.shape))
    bright = value / density * np.exp(-way * extinction.min())
    bright = np.where(np.isfinite(bright), bright, 0.0).reshape(count, CELLS, looks).mean(axis=2)

    def estimate():
        uniform, chance = _warped(bright, generator)
        t, density = placed(uniform)
        density = density * chance
        turns = np.arange(SAMPLES)[:, None] * SPREAD + generator.random((count, 1, 2))
        points, to_light, far, value = unshadowed(t, turns % 1.0)
        begin = (points.reshape(-1, 3) - rays.origin).astype(np.float32)
        lit = rays.transmittance(
            casters, begin, to_light.astype(np.float32), (far * (1.0 - 1e-6)).astype(np.float32)
        )
        if fill.instances is None:
            travelled = t - starts[:, None] + (0.0 if distant else far.reshape(count, SAMPLES))
            within = np.ones_like(t, bool)
        else:
            repeated = np.repeat(crossings, SAMPLES, axis=0)
            before = _inside(repeated, np.repeat(starts, SAMPLES), t.reshape(-1))
            within = _is_inside(repeated, t.reshape(-1)).reshape(t.shape)
            reach = np.where(np.isfinite(far), far, 1e9)
            way = _crossings(rays, outline, fill, points.reshape(-1, 3), to_light, reach)
            after = np.where(
                np.isfinite(way).any(axis=1),
                _inside(way, np.zeros(len(way)), reach),
                np.where(within.reshape(-1), reach, 0.0),
            )
            travelled = (before + after).reshape(t.shape)
        value = value * lit.reshape(t.shape) * within / density
        value = np.where(np.isfinite(value), value, 0.0)[..., None] * np.exp(
            -travelled[..., None] * extinction
        )
        return value.mean(axis=1) * np.array(medium.scattering)

    return [estimate() for _ in range(2)]


def _warped(bright: np.ndarray, generator) -> tuple[np.ndarray, np.ndarray]:
    """(N, SAMPLES) stratified numbers from 0 to 1 and their densities, by the brightness (N, CELLS) of equal
    cells and their neighbours; a part is even, so that nothing that a cell's middle missed is lost."""
    wide = np.pad(bright, ((0, 0), (1, 1)), mode="edge")
    wide = np.maximum(np.maximum(wide[:, :-2], wide[:, 2:]), wide[:, 1:-1])
    mean = wide.mean(axis=1, keepdims=True)
    share = np.where(mean > 0.0, wide / np.maximum(mean, 1e-300), 1.0)
    share = (1.0 - EVEN) * share + EVEN
    reached = np.cumsum(share, axis=1) / CELLS
    reached /= reached[:, -1:]
    uniform = (np.arange(SAMPLES) + generator.random((len(bright), SAMPLES))) / SAMPLES
    # Each ray's numbers are sorted, and so are all together once shifted by the ray's own number.
    shift = np.arange(len(bright))[:, None]
    cell = np.searchsorted((reached + shift).ravel(), (uniform + shift).ravel()).reshape(uniform.shape)
    cell = np.clip(cell - CELLS * shift, 0, CELLS - 1)
    before = np.take_along_axis(np.pad(reached, ((0, 0), (1, 0)))[:, :-1], cell, 1)
    chance = np.take_along_axis(share, cell, 1)
    inside = np.clip((uniform - before) * CELLS / chance, 0.0, 1.0)
    return (cell + inside) / CELLS, chance


def _is_inside(crossings: np.ndarray, t: np.ndarray) -> np.ndarray:
    behind = (crossings <= t[:, None]).sum(axis=1)
    return (np.isfinite(crossings).sum(axis=1) - behind) % 2 == 1


def _places(uniform, starts, ends, closest, height, extinction, distant):
    """Distances (N, S) along the rays and their densities, for numbers from 0 to 1 and in their order: even
    in the angle at the light, or by transmittance for a sun and where the medium is thick before the light
    is near."""
    low, high = starts[:, None], np.minimum(ends, 1e9)[:, None]
    h, c = height[:, None], closest[:, None]
    room = np.maximum(high - low, 1e-300)
    if extinction > 0.0:
        opaque = -np.expm1(-extinction * room)
        thinned = np.minimum(-np.log1p(-uniform * opaque) / extinction, room)
        by_way = extinction * np.exp(-extinction * thinned) / opaque
    else:
        thinned, by_way = uniform * room, 1.0 / room
    if distant:
        t, density = low + thinned, by_way
    else:
        first, sweep = np.arctan((low - c) / h), np.arctan2(h * room, h * h + (low - c) * (high - c))
        tangent = np.tan(first + uniform * sweep)
        by_angle = 1.0 / (h * (1.0 + tangent * tangent) * np.maximum(sweep, 1e-300))
        thick = extinction * np.minimum(room, np.hypot(h, low - c)) > THICK
        t = np.where(thick, low + thinned, np.clip(c + h * tangent, low, high))
        density = np.where(thick, by_way, by_angle)
    return t, np.where(high > low, density, np.inf)


def _towards(emitter: Emitter, points: np.ndarray, square: np.ndarray):
    """For each point (N, 3): a direction to a random point of the light, its distance, and the irradiance
    that a facing surface gets there per unit of radiance (of intensity, for a light of no size), over the
    density. `square` (N, 2): random numbers from 0 to 1."""
    if emitter.kind == EmitterKind.DISTANT_DISK:
        filled = 1.0 - 1.0 / math.hypot(1.0, emitter.half_width)
        axis = -np.array(emitter.forward)[None]  # the same for all points
        direction, _ = _within(axis, filled, square)
        solid = 2.0 * math.pi * filled if emitter.half_width > 0.0 else 1.0
        return direction, np.full(len(points), np.inf), np.full(len(points), solid)
    to_centre = np.array(emitter.centre) - points
    if emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
        plan = 2.0 * square - 1.0
        if emitter.kind == EmitterKind.ELLIPSE:
            radius, turn = np.sqrt(square[:, :1]), 2.0 * math.pi * square[:, 1:]
            plan = np.concatenate([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
        plan = plan * [emitter.half_width, emitter.half_height]
        towards = to_centre + plan @ np.array([emitter.right, emitter.up])
        distance = np.maximum(np.linalg.norm(towards, axis=1), 1e-30)
        direction = towards / distance[:, None]
        facing = np.maximum(-direction @ np.array(emitter.forward), 0.0)
        weight = facing / distance**2 * (emitter_measure(emitter) or 1.0)
        return direction, distance, weight * _profile(emitter, direction)
    away = np.maximum(np.linalg.norm(to_centre, axis=1), 1e-30)
    axis = to_centre / away[:, None]
    if emitter.half_width == 0.0:
        return axis, away, _profile(emitter, axis) / away**2
    return _round(emitter, axis, away, square)


def _round(emitter: Emitter, axis: np.ndarray, away: np.ndarray, square: np.ndarray):
    """The same of a sphere, or of a disk that faces every point, `away` along `axis`: even over the solid
    angle that it fills, so that no point nearby gets rare bright samples."""
    radius = emitter.half_width
    if emitter.kind == EmitterKind.SPHERE:
        sine2 = np.minimum((radius / away) ** 2, 1.0)
        outside = away > radius
        filled = np.where(outside, sine2 / (1.0 + np.sqrt(1.0 - sine2)), 2.0)
    else:
        slant = np.hypot(away, radius)
        filled = radius**2 / (slant * (slant + away))
    direction, cosine = _within(axis, filled, square)
    if emitter.kind == EmitterKind.SPHERE:
        chord = np.sqrt(np.maximum(radius**2 - away**2 * (1.0 - cosine**2), 0.0))
        distance = np.maximum(away * cosine + np.where(outside, -chord, chord), 0.0)
    else:
        distance = away / cosine
    return direction, distance, 2.0 * math.pi * filled * _profile(emitter, direction)


def _within(axis: np.ndarray, filled, square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 3) spread evenly over a cone around each `axis`, and their cosines to it; `filled` is
    1 - cos of the cone's half angle."""
    cosine = 1.0 - filled * square[:, 0]
    across = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    helper = np.where(np.abs(axis[:, :1]) > 0.7, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axis, first)
    turn = 2.0 * math.pi * square[:, 1:]
    tilt = np.cos(turn) * first + np.sin(turn) * second
    return cosine[:, None] * axis + across[:, None] * tilt, cosine


def _profile(emitter: Emitter, direction: np.ndarray) -> np.ndarray:
    """Relative radiance (N,) towards points whose `direction` to the light is given; core/emitter.py."""
    axis = np.array(emitter.forward)
    cosine = -direction @ axis
    result = np.ones(len(direction))
    if math.isfinite(emitter.tan_half_spread):
        sine = np.linalg.norm(np.cross(direction, axis), axis=1)
        slope = np.where(cosine > 0.0, sine / np.maximum(cosine, 1e-30), np.inf)
        spread = emitter.tan_half_spread
        result *= np.maximum(spread - slope, 0.0) / (spread - math.atan(spread))
    if emitter.cos_cone > -1.0:
        width = max((1.0 - emitter.cos_cone) * emitter.blend, 1e-12)
        x = np.clip((cosine - emitter.cos_cone) / width, 0.0, 1.0)
        result *= x * x * (3.0 - 2.0 * x)
    return result
