"""The truth that a lamp's visibility is scored against: many rays to stratified light samples, in float64.

Written independently of the kernels (kernels/src/emitter, kernels/src/rays): it has its own sampling of
lights and its own sums, and shares only the intersection of rays with triangles. Tested against closed
forms in tests/effects/shared/test_visibility_truth.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...core.device import RayCaster
from ...core.emitter import Emitter, EmitterKind
from ...core.surface import SurfacePoints
from ...measure.in_use import InUseScore
from . import light_truth, spot_part

# Points are lifted off their surface by this share of their distance to the eye, more than float32 rounds
# them by; a pixel is some hundred times larger.
LIFT = 2.0**-17
RAYS_AT_ONCE = 1 << 16  # bounds the memory of the arrays and keeps them in the cache


def evaluate(
    rays: RayCaster,
    emitter: Emitter,
    casters: np.ndarray | None,
    points: SurfacePoints,
    samples: int = 128,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Two independent estimates of V, (N, 2) float64, and the weight of each point, (N,) float64.

    V = integral of T * L * cos+ * G dA / integral of L * cos+ * G dA (docs/accuracy.md), T what gets through
    on the way: directions at or below the geometric horizon are in shadow, unless rays begin above the
    surface (`points.lifts`), the cosine is the shading normal's, V is 1 where no light could arrive. The
    weight is the unshadowed irradiance at radiance 1. Each estimate takes `samples` rays, best a product of
    two similar numbers; half the mean square of their difference is the variance of one.
    `casters` (instances,) uint8 can shadow it, None: everything.
    """
    generator = np.random.Generator(np.random.PCG64(seed))
    count = len(points.position)
    halves, weights = np.ones((count, 2)), np.zeros(count)
    step = max(1, RAYS_AT_ONCE // (2 * samples))
    for start in range(0, count, step):
        part = slice(start, start + step)
        halves[part], weights[part] = _evaluate(rays, emitter, casters, points, part, samples, generator)
    return halves, weights


def screened(
    rays: RayCaster, emitter: Emitter, casters: np.ndarray, points: SurfacePoints, seed: int
) -> np.ndarray:
    """(N, 2) uint8: two independent estimates of each point's visibility by one ray each, 0 or 1. By a
    kernel, since many points are looked at so."""
    return rays.kernels.ray_screen(
        rays.accel,
        casters,
        emitter.packed(),
        points.eye,
        points.position,
        points.geometric_normal,
        points.shading_normal,
        seed,
        lifts=points.lifts,
        cancel=rays.cancel_flag,
    )


def truth(rays, outline, layer, layers, casters, view_rays, samples, seed):
    """Of an InUseScore: V of the layer's lamp along view rays, by `samples` rays of each of two estimates,
    and the light that it multiplies. One estimate for one ray, 0 or 1, and ones for none."""
    light = light_truth.before(rays, outline, layer, layers, view_rays, seed)
    values, lit = np.ones((2 if samples > 1 else 1, len(view_rays), 1)), np.flatnonzero(light.any(axis=1))
    if len(lit) and samples:
        points, emitter = (
            light_truth.points_of(outline, view_rays, lit),
            outline.lights[layer.of.index].emitter,
        )
        if samples == 1:
            values[0, lit, 0] = screened(rays, emitter, casters, points, seed)[:, 0]
        else:
            values[:, lit, 0] = evaluate(rays, emitter, casters, points, samples, seed)[0].T
    return values, light


SCORE = InUseScore(truth, is_binary=True, reference_name="ray traced")
"""Of every layer that is a lamp's visibility."""


# Below one column is a point: numbers of rays are (2 samples, N), their vectors (3, 2 samples, N), so that
# numpy's inner loops run over many points, not over a few samples or three coordinates.


def _evaluate(rays, emitter, casters, points, part, samples, generator):
    count = len(points.position[part])
    halves = [_stratified(count, samples, generator) for _ in range(2)]
    # First half, then second half.
    laid = laid_out(emitter, points, part, np.concatenate(halves, 1), rays.origin)
    through = rays.transmittance(casters, laid.origins, laid.directions, laid.reach)
    weight = laid.weight
    arrives = weight * laid.traced * through.reshape(count, 2 * samples).T
    arrives, total = (each.reshape(2, samples, -1).sum(1) for each in (arrives, weight))
    lit = total > 0.0
    return np.where(lit, arrives / np.where(lit, total, 1.0), 1.0).T, total.sum(0) / (2 * samples)


@dataclass(frozen=True)
class Laid:
    """S rays from each of N points to a light. `weight` (S, N) float64: the irradiance that comes along them
    where nothing is between, at radiance 1, times S; `traced` (S, N) bool: not those that begin below the
    surface; `origins`, `directions` (N S, 3) and `reach` (N S,) float32, the parameter where they end, 0
    where they are not traced: those of a point one after the other."""

    weight: np.ndarray
    traced: np.ndarray
    origins: np.ndarray
    directions: np.ndarray
    reach: np.ndarray


def laid_out(
    emitter: Emitter, points: SurfacePoints, part: slice, squares: np.ndarray, origin: np.ndarray
) -> Laid:
    """Rays from a part of `points` to the places `squares` (2, S, N) in [0, 1) on the light; origins are
    relative to `origin` (3,), metres."""
    vectors = [each[part] for each in (points.position, points.geometric_normal, points.shading_normal)]
    vectors = np.array(vectors, np.float64).transpose(0, 2, 1).copy()
    valid = np.isfinite(vectors).all((0, 1))
    vectors[..., ~valid] = 0.0
    position, geometric_normal, shading_normal = vectors

    position += LIFT * np.abs(position).max(0) * geometric_normal
    world = position + _column(points.eye)
    direction, distance, measure = _SAMPLERS[emitter.kind](emitter, world, squares)
    weight = measure * np.maximum(_dot(direction, shading_normal), 0.0)
    if (radiance := _relative_radiance(emitter, direction)) is not None:
        weight *= radiance
    weight = np.where(valid & np.isfinite(weight), weight, 0.0)

    above = _dot(direction, geometric_normal)
    traced = (above > 0.0) & (weight > 0.0)
    origins = np.repeat(_by_point(world.T - origin), squares.shape[1], axis=0)
    if points.lifts is not None:
        lift = away(points.lifts[part], above, _dot(direction, shading_normal))
        traced = (traced | lift.any(0)) & (weight > 0.0)
        origins = origins + _by_point(lift.T).reshape(-1, 3)
        is_near = np.isfinite(distance)
        spoke = direction * np.where(is_near, distance, 1.0) - np.where(is_near, lift, 0.0)
        length = np.maximum(_length(spoke), 1e-30)
        direction, distance = spoke / length, np.where(is_near, length, distance)
    directions = _by_point(direction.T).reshape(-1, 3)
    reach = _by_point(np.where(traced, distance, 0.0).T).reshape(-1)
    return Laid(weight, traced, origins, directions, reach)


def away(lifts: np.ndarray, above: np.ndarray, lit: np.ndarray) -> np.ndarray:
    """(3, 2 S, N): how far from points with these `lifts` (N, 4) rays begin, by the cosines (2 S, N) to the
    geometric and to the shading normal, as in Cycles: all of the way below the geometric horizon, less and
    less above."""
    way, offset = lifts[:, :3].T.astype(np.float64), lifts[:, 3].astype(np.float64)
    there = (offset > 0.0) & np.isfinite(way).all(0)
    offset = np.where(there, offset, 1.0)
    steep = 1.0 - above / offset
    grazing = 2.0 - (above + lit) / offset
    share = np.where(lit < offset, grazing, steep).clip(0.0, 1.0)
    return np.where(there, way, 0.0)[:, None] * share


def _by_point(values: np.ndarray) -> np.ndarray:
    """Rows of points one after the other, as rays of one origin are fastest."""
    return np.ascontiguousarray(values, np.float32)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of vectors whose coordinates are first."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(_dot(vectors, vectors))


def _stratified(count: int, samples: int, generator: np.random.Generator) -> np.ndarray:
    """(2, samples, count) in [0, 1): one sample in each cell of a grid of rows x columns = samples."""
    rows = next(r for r in range(math.isqrt(samples), 0, -1) if samples % r == 0)
    columns = samples // rows
    jitter = generator.random((count, samples, 2)).transpose(2, 1, 0).copy()
    row, column = np.divmod(np.arange(samples), columns)
    return (jitter + np.stack([column, row])[..., None]) / np.array([columns, rows]).reshape(2, 1, 1)


def _on_disk(square: np.ndarray) -> np.ndarray:
    """Uniform on the unit disk, in polar coordinates: u is the angle, v the area inside."""
    radius, angle = np.sqrt(square[1]), 2.0 * np.pi * square[0]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)])


def _column(vector) -> np.ndarray:
    """(3, 1): the same for all points."""
    return np.array(vector, np.float64)[:, None]


def _to_plane(to_centre, plan, right, up, normal, area):
    """Directions, distances and cos dA / distance^2 at the light of samples `plan` (2, S, N), metres from the
    centre along right and up. `right`, `up`, `normal`, `to_centre` (3, N); `area` (N,), square metres."""
    x, y = plan
    spoke = np.stack([to_centre[k] + x * right[k] + y * up[k] for k in range(3)])
    distance = _length(spoke)
    direction = spoke / np.maximum(distance, 1e-30)
    facing = np.maximum(-_dot(direction, normal), 0.0)
    return direction, distance, facing / np.maximum(distance, 1e-15) ** 2 * area


def _side(half: float) -> float:
    """Length of a side; a side of no length counts as 1 (a line, or a point of unit intensity)."""
    return 2.0 * half if half > 0.0 else 1.0


def _sample_area(emitter, world, square):
    """One-sided; with spread, only the part of the light that can shine on the point is sampled."""
    right, up, normal = (_column(v) for v in (emitter.right, emitter.up, emitter.forward))
    to_centre = _column(emitter.centre) - world
    halves = np.array([[emitter.half_width], [emitter.half_height]])
    is_ellipse = emitter.kind == EmitterKind.ELLIPSE
    if is_ellipse and not math.isfinite(emitter.tan_half_spread):
        shape = np.pi / 4.0 if halves.any() else 1.0
        area = shape * _side(emitter.half_width) * _side(emitter.half_height)
        return _to_plane(to_centre, _on_disk(square) * halves[..., None], right, up, normal, area)
    foot = np.stack([-_dot(to_centre, v) for v in (right, up)])
    reach = -_dot(to_centre, normal) * emitter.tan_half_spread
    reach = np.where(reach > 0.0, reach, np.inf)
    low = np.clip(foot - reach, -halves, halves)
    high = np.clip(foot + reach, -halves, halves)
    plan = low[:, None] + (high - low)[:, None] * square
    sides = np.where(halves > 0.0, high - low, 1.0)
    direction, distance, measure = _to_plane(to_centre, plan, right, up, normal, sides.prod(0))
    if is_ellipse and halves.all():
        measure = np.where(np.square(plan / halves[..., None]).sum(0) <= 1.0, measure, 0.0)
    return direction, distance, measure


def _sample_facing_disk(emitter, world, square):
    """Of a spot's, only what can shine on the point is sampled (spot_part.py)."""
    to_centre = _column(emitter.centre) - world
    distance = np.maximum(_length(to_centre), 1e-30)
    towards = to_centre / distance
    right, up = spot_part.across(towards)
    radius = emitter.half_width
    area = np.full(distance.shape, np.pi * radius**2 if radius > 0.0 else 1.0)
    plan = _on_disk(square)
    if emitter.cos_cone > -1.0 and radius > 0.0:
        part = spot_part.of_disk(emitter, towards, distance)
        right, up = np.where(part.is_cut, part.right, right), np.where(part.is_cut, part.up, up)
        plan = np.where(part.is_cut, part.inside(square), plan)
        area = np.where(part.is_cut, radius**2 * part.area, area)
    direction, far, measure = _to_plane(to_centre, plan * radius, right, up, -towards, area)
    return direction, far, np.where(np.square(plan).sum(0) <= 1.0 + 1e-9, measure, 0.0)


def _sample_sphere(emitter, world, square):
    """Uniform in solid angle over the cap in sight, from inside over all directions; up to its surface. Of a
    spot's, only what can shine on the point is sampled (spot_part.py)."""
    to_centre = _column(emitter.centre) - world
    distance = np.maximum(_length(to_centre), 1e-30)
    axis = to_centre / distance
    radius = emitter.half_width
    if radius <= 0.0:
        shape = square.shape[1:]
        direction = np.broadcast_to(axis[:, None], (3, *shape))
        far = np.broadcast_to(distance, shape)
        return direction, far, 1.0 / far**2
    sine = radius / distance
    inside = sine >= 1.0
    # 1 - cos of the cap's half angle, by half-angle formulas: 2 sin(a / 2)^2.
    height = np.where(inside, 2.0, 2.0 * np.sin(0.5 * np.arcsin(np.minimum(sine, 1.0))) ** 2)
    right, up = spot_part.across(axis)
    plan, area = _on_disk(square), np.full(distance.shape, np.pi)
    if emitter.cos_cone > -1.0:
        part = spot_part.of_cap(emitter, axis, height)
        right, up = np.where(part.is_cut, part.right, right), np.where(part.is_cut, part.up, up)
        plan = np.where(part.is_cut, part.inside(square), plan)
        area = np.where(part.is_cut, part.area, area)
    share = np.square(plan).sum(0)
    below = height * np.minimum(share, 1.0)
    cosine = 1.0 - below
    x, y = plan * np.sqrt(height * (2.0 - below))
    across = np.sqrt(below * (2.0 - below))
    direction = np.stack([cosine * axis[k] + x * right[k] + y * up[k] for k in range(3)])
    chord = np.sqrt(np.maximum(radius**2 - (distance * across) ** 2, 0.0))
    far = distance * cosine + np.where(inside, chord, -chord)
    return direction, far, np.where(share <= 1.0 + 1e-9, 2.0 * height * area, 0.0)


def _sample_distant_disk(emitter, world, square):
    """Uniform radiance over the directions; a disk one metre away has cos^3 of its area as solid angle."""
    tangent = emitter.half_width
    x, y = _on_disk(square) * tangent
    axes = zip(emitter.forward, emitter.right, emitter.up, strict=True)
    spoke = np.stack([-forward + x * right + y * up for forward, right, up in axes])
    length = _length(spoke)
    measure = (np.pi * tangent**2 if tangent > 0.0 else 1.0) / length**3
    return spoke / length, np.full(length.shape, np.inf), measure


_SAMPLERS = {
    EmitterKind.RECTANGLE: _sample_area,
    EmitterKind.ELLIPSE: _sample_area,
    EmitterKind.SPHERE: _sample_sphere,
    EmitterKind.FACING_DISK: _sample_facing_disk,
    EmitterKind.DISTANT_DISK: _sample_distant_disk,
}


def _relative_radiance(emitter: Emitter, direction: np.ndarray) -> np.ndarray | None:
    """Towards the points, for directions (3, S, N) to the light, None: 1 throughout; core/emitter.py has the
    formulas."""
    tangent, cone = emitter.tan_half_spread, emitter.cos_cone
    if math.isinf(tangent) and cone <= -1.0:
        return None
    # sin by the cross product: exact for small angles, where 1 - cos^2 cancels.
    (x, y, z), (a, b, c) = direction, emitter.forward
    cosine = -_dot(direction, emitter.forward)
    sine = _length((y * c - z * b, z * a - x * c, x * b - y * a))
    radiance = np.ones_like(cosine)
    if not math.isinf(tangent):
        slope = np.where(cosine > 0.0, sine / np.maximum(cosine, 1e-30), np.inf)
        scale = tangent - math.atan(tangent)
        radiance = np.maximum(tangent - slope, 0.0) / scale if scale > 0.0 else np.zeros_like(cosine)
    if cone > -1.0:
        width = max((1.0 - cone) * emitter.blend, 1e-12)
        x = np.clip((cosine - cone) / width, 0.0, 1.0)
        radiance = radiance * x * x * (3.0 - 2.0 * x)
    return radiance
