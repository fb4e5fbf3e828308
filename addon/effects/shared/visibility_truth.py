"""The truth that a lamp's visibility is scored against: many rays to stratified light samples, in float64.

Written independently of the kernels (kernels/src/emitter, kernels/src/rays): it has its own sampling of
lights and its own sums, and shares only the intersection of rays with triangles. Tested against closed
forms in tests/effects/shared/test_visibility_truth.py.
"""

from __future__ import annotations

import math

import numpy as np

from ...core.device import RayCaster
from ...core.emitter import Emitter, EmitterKind
from ...core.surface import SurfacePoints
from ...measure.visibility import VisibilityScore

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

    V = integral of visible * L * cos+ * G dA / integral of L * cos+ * G dA (docs/accuracy.md): directions at
    or below the geometric horizon are in shadow, the cosine is the shading normal's, V is 1 where no light
    could arrive. The weight is the unshadowed irradiance at radiance 1. Each estimate takes `samples` rays,
    best a product of two similar numbers; half the mean square of their difference is the variance of one.
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
        cancel=rays.cancel_flag,
    )


def unshadowed(rays: RayCaster, emitter: Emitter, points: SurfacePoints) -> np.ndarray:
    """(N,) float32: what each point gets at radiance 1 if nothing is in the way."""
    position, normal = points.position[None], points.shading_normal[None]
    return rays.kernels.irradiance(position, normal, points.eye, emitter.packed())[0]


SCORE = VisibilityScore(evaluate, screened, unshadowed)
"""Of every layer that is a lamp's visibility."""


def _evaluate(rays, emitter, casters, points, part, samples, generator):
    position = points.position[part].astype(np.float64)
    geometric_normal = points.geometric_normal[part].astype(np.float64)
    shading_normal = points.shading_normal[part].astype(np.float64)
    valid = np.isfinite(position).all(1) & np.isfinite(geometric_normal).all(1)
    valid &= np.isfinite(shading_normal).all(1)
    position = np.where(valid[:, None], position, 0.0)
    geometric_normal = np.where(valid[:, None], geometric_normal, 0.0)
    shading_normal = np.where(valid[:, None], shading_normal, 0.0)

    position += LIFT * np.abs(position).max(1, keepdims=True) * geometric_normal
    world = position + points.eye
    sample = _SAMPLERS[emitter.kind]
    unit_square = np.concatenate([_stratified(len(world), samples, generator) for _ in range(2)], 1)
    # (N, 2 * samples): from here on one row a point, first half, then second half.
    direction, distance, measure = sample(emitter, world, unit_square)
    cosine = np.maximum(np.einsum("nsc,nc->ns", direction, shading_normal), 0.0)
    weight = measure * cosine * _relative_radiance(emitter, direction)
    weight = np.where(valid[:, None] & np.isfinite(weight), weight, 0.0)

    leaves = np.einsum("nsc,nc->ns", direction, geometric_normal) > 0.0
    traced = leaves & (weight > 0.0)
    origins = np.repeat((world - rays.origin).astype(np.float32), 2 * samples, axis=0)
    occluded = rays.occluded(
        casters,
        origins,
        np.ascontiguousarray(direction.reshape(-1, 3), np.float32),
        np.where(traced, distance, 0.0).astype(np.float32).reshape(-1),
    )
    arrives = weight * (traced & ~occluded.reshape(traced.shape))
    arrives = arrives.reshape(-1, 2, samples).sum(2)
    total = weight.reshape(-1, 2, samples).sum(2)
    lit = total > 0.0
    return np.where(lit, arrives / np.where(lit, total, 1.0), 1.0), total.sum(1) / (2 * samples)


def _stratified(count: int, samples: int, generator: np.random.Generator) -> np.ndarray:
    """(count, samples, 2) in [0, 1): one sample in each cell of a grid of rows x columns = samples."""
    rows = next(r for r in range(math.isqrt(samples), 0, -1) if samples % r == 0)
    columns = samples // rows
    jitter = generator.random((count, samples, 2))
    row, column = np.divmod(np.arange(samples), columns)
    return (jitter + np.stack([column, row], 1)) / np.array([columns, rows])


def _on_disk(square: np.ndarray) -> np.ndarray:
    """Uniform on the unit disk, in polar coordinates: u is the angle, v the area inside."""
    radius, angle = np.sqrt(square[..., 1]), 2.0 * np.pi * square[..., 0]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)


def _across(axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (N, 3) perpendicular to unit `axes` (N, 3) and to each other."""
    helper = np.where(np.abs(axes[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(axes, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(axes, first)


def _to_plane(to_centre, plan, right, up, normal, area):
    """Directions, distances and cos dA / distance^2 at the light of samples `plan` (N, S, 2), metres from the
    centre along right and up. `right`, `up`, `normal`, `to_centre` (N, 3); `area` (N, 1), square metres."""
    spoke = to_centre[:, None] + plan[..., :1] * right[:, None] + plan[..., 1:] * up[:, None]
    distance = np.sqrt(np.einsum("nsc,nsc->ns", spoke, spoke))
    direction = spoke / np.maximum(distance, 1e-30)[..., None]
    facing = np.maximum(-np.einsum("nsc,nc->ns", direction, normal), 0.0)
    return direction, distance, facing / np.maximum(distance, 1e-15) ** 2 * area


def _side(half: float) -> float:
    """Length of a side; a side of no length counts as 1 (a line, or a point of unit intensity)."""
    return 2.0 * half if half > 0.0 else 1.0


def _sample_area(emitter, world, square):
    """One-sided; with spread, only the part of the light that can shine on the point is sampled."""
    count = len(world)
    right, up, normal = (np.tile(v, (count, 1)) for v in (emitter.right, emitter.up, emitter.forward))
    to_centre = np.array(emitter.centre) - world
    halves = np.array([emitter.half_width, emitter.half_height])
    is_ellipse = emitter.kind == EmitterKind.ELLIPSE
    if is_ellipse and not math.isfinite(emitter.tan_half_spread):
        shape = np.pi / 4.0 if halves.any() else 1.0
        area = np.full((count, 1), shape * _side(halves[0]) * _side(halves[1]))
        return _to_plane(to_centre, _on_disk(square) * halves, right, up, normal, area)
    foot = np.stack([-np.einsum("nc,nc->n", to_centre, v) for v in (right, up)], 1)
    reach = -np.einsum("nc,nc->n", to_centre, normal)[:, None] * emitter.tan_half_spread
    reach = np.where(reach > 0.0, reach, np.inf)
    low = np.clip(foot - reach, -halves, halves)
    high = np.clip(foot + reach, -halves, halves)
    plan = low[:, None] + (high - low)[:, None] * square
    sides = np.where(halves > 0.0, high - low, 1.0)
    direction, distance, measure = _to_plane(to_centre, plan, right, up, normal, sides.prod(1, keepdims=True))
    if is_ellipse and halves.all():
        measure = np.where(np.square(plan / halves).sum(-1) <= 1.0, measure, 0.0)
    return direction, distance, measure


def _sample_facing_disk(emitter, world, square):
    to_centre = np.array(emitter.centre) - world
    towards = to_centre / np.maximum(np.linalg.norm(to_centre, axis=1, keepdims=True), 1e-30)
    right, up = _across(towards)
    radius = emitter.half_width
    area = np.full((len(world), 1), np.pi * radius**2 if radius > 0.0 else 1.0)
    return _to_plane(to_centre, _on_disk(square) * radius, right, up, -towards, area)


def _sample_sphere(emitter, world, square):
    """Uniform in solid angle over the cap in sight, from inside over all directions; up to its surface."""
    to_centre = np.array(emitter.centre) - world
    distance = np.maximum(np.linalg.norm(to_centre, axis=1), 1e-30)
    axis = to_centre / distance[:, None]
    radius = emitter.half_width
    if radius <= 0.0:
        shape = square.shape[:2]
        direction = np.broadcast_to(axis[:, None], (*shape, 3))
        far = np.broadcast_to(distance[:, None], shape)
        return direction, far, 1.0 / far**2
    sine = radius / distance
    inside = sine >= 1.0
    # 1 - cos of the cap's half angle, by half-angle formulas: 2 sin(a / 2)^2.
    height = np.where(inside, 2.0, 2.0 * np.sin(0.5 * np.arcsin(np.minimum(sine, 1.0))) ** 2)
    below = height[:, None] * square[..., 1]
    cosine, across = 1.0 - below, np.sqrt(below * (2.0 - below))
    angle = 2.0 * np.pi * square[..., 0]
    right, up = _across(axis)
    direction = (
        cosine[..., None] * axis[:, None]
        + (across * np.cos(angle))[..., None] * right[:, None]
        + (across * np.sin(angle))[..., None] * up[:, None]
    )
    chord = np.sqrt(np.maximum(radius**2 - (distance[:, None] * across) ** 2, 0.0))
    far = distance[:, None] * cosine + np.where(inside[:, None], chord, -chord)
    return direction, far, np.broadcast_to(2.0 * np.pi * height[:, None], far.shape)


def _sample_distant_disk(emitter, world, square):
    """Uniform radiance over the directions; a disk one metre away has cos^3 of its area as solid angle."""
    tangent = emitter.half_width
    plan = _on_disk(square) * tangent
    spoke = -np.array(emitter.forward) + plan[..., :1] * emitter.right + plan[..., 1:] * emitter.up
    length = np.linalg.norm(spoke, axis=-1)
    measure = (np.pi * tangent**2 if tangent > 0.0 else 1.0) / length**3
    return spoke / length[..., None], np.full(length.shape, np.inf), measure


_SAMPLERS = {
    EmitterKind.RECTANGLE: _sample_area,
    EmitterKind.ELLIPSE: _sample_area,
    EmitterKind.SPHERE: _sample_sphere,
    EmitterKind.FACING_DISK: _sample_facing_disk,
    EmitterKind.DISTANT_DISK: _sample_distant_disk,
}


def _relative_radiance(emitter: Emitter, direction: np.ndarray) -> np.ndarray | float:
    """Towards the points, for directions (N, S, 3) to the light; core/emitter.py has the formulas."""
    tangent, cone = emitter.tan_half_spread, emitter.cos_cone
    if math.isinf(tangent) and cone <= -1.0:
        return 1.0
    # sin by the cross product: exact for small angles, where 1 - cos^2 cancels.
    axis = np.array(emitter.forward, np.float64)
    cosine = -direction @ axis
    sine = np.linalg.norm(np.cross(direction, axis), axis=-1)
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
