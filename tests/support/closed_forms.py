"""Soft shadows of flat plates in closed form, float64: what the approximations are judged by.

Light of radiance 1 arriving from a region of directions gives a surface the irradiance

    E = integral of max(n . d, 0) over the region = 1/2 closed integral of n . (x cross dx) over its edge

(Stokes; for a polygon this is Lambert's formula of 1760, a sum over the edges of angle times the edge's
normal.) Every region here is bounded by great circles (planes through the shading point: edges of
polygons, the horizon) and at most one small circle (a spherical or distant light), and the integral over an
arc of either is elementary. The integral is a sum over arcs, so they need not be put in order: each circle
is cut where it crosses the others, and the pieces inside all other bounds are added up.

V = E(visible part of the light) / E(light), which is the project's definition for uniform radiance: the
integrals of cos G dA over the light and of cos over its directions are the same.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from strata.addon.core.emitter import Emitter, EmitterKind

ELLIPSE_SIDES = 512
"""An ellipse is taken as a polygon of equal area; with this many sides E is off by less than 1e-8."""

SAME_PLANE = 1e-9
"""Planes of two polygons closer than this bound the region together: their common arc counts once."""


def _tangents(axes):
    """Two unit vectors (N, 3) with first cross second = axis."""
    helper = np.where(np.abs(axes[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(axes, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(axes, first)


def _pieces(constant, cosine, sine, waived):
    """Cuts a circle where constant + cosine * cos f + sine * sin f changes sign for any bound (N, B).

    Returns start and end angle (N, P) of the pieces and whether each is inside every bound not `waived`.
    """
    amplitude = np.hypot(cosine, sine)
    with np.errstate(invalid="ignore", divide="ignore"):
        half = np.arccos(-constant / amplitude)
    middle = np.arctan2(sine, cosine)
    cuts = np.concatenate([middle - half, middle + half], 1)
    cuts = np.where(np.isnan(cuts), np.pi, (cuts + np.pi) % (2.0 * np.pi) - np.pi)
    ends = np.full((len(cuts), 1), np.pi)
    cuts = np.sort(np.concatenate([-ends, cuts, ends], 1), 1)
    start, end = cuts[:, :-1], cuts[:, 1:]
    f = 0.5 * (start + end)[:, None, :]
    value = constant[..., None] + cosine[..., None] * np.cos(f) + sine[..., None] * np.sin(f)
    return start, end, np.all((value >= 0.0) | waived[..., None], 1)


def irradiance_of_region(normals, planes, cap_axes=None, cap_cosines=None):
    """Irradiance (N,) from a convex region of directions at radiance 1, above the horizon only.

    `normals` (N, 3) unit; `planes` (N, K, 3) unit: the region is where plane . d >= 0 for every k;
    `cap_axes` (N, 3) unit and `cap_cosines` (N,): and where axis . d >= cosine.
    """
    normals = np.asarray(normals, np.float64)
    planes = np.concatenate([np.asarray(planes, np.float64), normals[:, None, :]], 1)
    total = np.zeros(len(normals))
    for k in range(planes.shape[1]):
        others = np.delete(planes, k, 1)
        # The circle runs with the region on its left: first cross second = plane.
        first, second = _tangents(planes[:, k])
        cosine, sine = np.einsum("nkc,nc->nk", others, first), np.einsum("nkc,nc->nk", others, second)
        constant = np.zeros_like(cosine)
        same = np.linalg.norm(others - planes[:, k, None], axis=2) < SAME_PLANE
        counted_before = same[:, :k].any(1)
        if cap_axes is not None:
            cosine = np.column_stack([cosine, np.einsum("nc,nc->n", cap_axes, first)])
            sine = np.column_stack([sine, np.einsum("nc,nc->n", cap_axes, second)])
            constant = np.column_stack([constant, -np.asarray(cap_cosines)])
            same = np.column_stack([same, np.zeros(len(same), bool)])
        start, end, inside = _pieces(constant, cosine, sine, same)
        length = np.where(inside & ~counted_before[:, None], end - start, 0.0).sum(1)
        total += 0.5 * length * np.einsum("nc,nc->n", normals, planes[:, k])
    if cap_axes is None:
        return total

    axes, cap_cosines = np.asarray(cap_axes, np.float64), np.asarray(cap_cosines, np.float64)
    cap_sines = np.sqrt(1.0 - cap_cosines**2)
    first, second = _tangents(axes)
    constant = cap_cosines[:, None] * np.einsum("nkc,nc->nk", planes, axes)
    cosine = cap_sines[:, None] * np.einsum("nkc,nc->nk", planes, first)
    sine = cap_sines[:, None] * np.einsum("nkc,nc->nk", planes, second)
    start, end, inside = _pieces(constant, cosine, sine, np.zeros(constant.shape, bool))
    # x = cos(cap) axis + sin(cap) (cos f first + sin f second); x cross dx, integrated from start to end.
    turn = np.where(inside, end - start, 0.0).sum(1)
    along_first = np.where(inside, np.sin(end) - np.sin(start), 0.0).sum(1)
    along_second = np.where(inside, np.cos(start) - np.cos(end), 0.0).sum(1)
    inner = along_first[:, None] * first + along_second[:, None] * second
    vector = (cap_sines**2 * turn)[:, None] * axes - (cap_cosines * cap_sines)[:, None] * inner
    return total + 0.5 * np.einsum("nc,nc->n", normals, vector)


def cone_of_polygon(points, polygon):
    """Inward unit normals (N, K, 3) of the planes through each point (N, 3) and each edge of a convex
    polygon (K, 3), whichever way round it is listed. Points must not lie in the polygon's plane."""
    spokes = np.asarray(polygon, np.float64)[None] - np.asarray(points, np.float64)[:, None]
    normals = np.cross(spokes, np.roll(spokes, -1, 1))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    towards = np.einsum("nc,nc->n", normals[:, 0], spokes.mean(1))
    return normals * np.sign(towards)[:, None, None]


def light_polygon(emitter: Emitter) -> np.ndarray:
    """Corners (K, 3) of a RECTANGLE, or the equal-area polygon that stands in for an ELLIPSE."""
    centre, right, up = (np.array(v, np.float64) for v in (emitter.centre, emitter.right, emitter.up))
    if emitter.kind == EmitterKind.RECTANGLE:
        plan = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float64)
    else:
        angle = 2.0 * np.pi * np.arange(ELLIPSE_SIDES) / ELLIPSE_SIDES
        area = 0.5 * ELLIPSE_SIDES * np.sin(2.0 * np.pi / ELLIPSE_SIDES)
        plan = np.stack([np.cos(angle), np.sin(angle)], 1) * np.sqrt(np.pi / area)
    return centre + plan[:, :1] * emitter.half_width * right + plan[:, 1:] * emitter.half_height * up


def irradiance_of_polygon(point, normal, polygon, planes=()) -> float:
    """E of a convex polygon (K, 3) at radiance 1 by Lambert's formula, cut by planes (unit normals of
    half-spaces through the point) and by the horizon: for more sides than `irradiance_of_region` can bear."""
    corners = np.asarray(polygon, np.float64) - point
    for plane in [*planes, normal]:
        height = corners @ plane
        next_corners, next_height = np.roll(corners, -1, 0), np.roll(height, -1)
        crosses = (height >= 0.0) != (next_height >= 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            cut = corners + (height / (height - next_height))[:, None] * (next_corners - corners)
        pairs = np.stack([corners, cut], 1).reshape(-1, 3)
        corners = pairs[np.stack([height >= 0.0, crosses], 1).ravel()]
        if len(corners) < 3:
            return 0.0
    unit = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    next_unit = np.roll(unit, -1, 0)
    product = np.cross(unit, next_unit)
    sine = np.linalg.norm(product, axis=1)
    angle = np.arctan2(sine, np.einsum("kc,kc->k", unit, next_unit))
    turned = sine > 0.0
    vector = (product[turned] * (angle[turned] / sine[turned])[:, None]).sum(0)
    return 0.5 * abs(float(vector @ normal))


def visibility(emitter: Emitter, points, normals, plates=()):
    """V (N,) and the unshadowed irradiance (N,) at radiance 1 of a light behind opaque convex plates.

    `points` (N, 3) metres and unit `normals` (N, 3), world space; `plates` polygons (K, 3), flat and convex,
    wholly between every point and the light; they may overlap (inclusion and exclusion). Radiance is
    uniform: no spread, no spot. V is 1 where the irradiance is 0. Points lie outside a SPHERE.
    """
    points, normals = np.asarray(points, np.float64), np.asarray(normals, np.float64)
    kind, count = emitter.kind, len(points)
    nothing = np.empty((count, 0, 3))
    in_front = np.ones(count, bool)
    if kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
        polygon = light_polygon(emitter)
        in_front = (points - np.array(emitter.centre)) @ np.array(emitter.forward) > 0.0
        if kind == EmitterKind.RECTANGLE:
            light = cone_of_polygon(points, polygon)

            def irradiance(cones):
                return irradiance_of_region(normals, np.concatenate([light, *cones], 1))
        else:

            def irradiance(cones):
                triples = zip(points, normals, np.concatenate([nothing, *cones], 1), strict=True)
                return np.array([irradiance_of_polygon(p, n, polygon, planes) for p, n, planes in triples])
    else:
        if kind == EmitterKind.DISTANT_DISK:
            axes = np.tile(-np.array(emitter.forward, np.float64), (count, 1))
            cosines = np.full(count, 1.0 / np.hypot(1.0, emitter.half_width))
        else:
            to_centre = np.array(emitter.centre) - points
            distances = np.linalg.norm(to_centre, axis=1)
            axes = to_centre / distances[:, None]
            if kind == EmitterKind.SPHERE:
                cosines = np.sqrt(1.0 - (emitter.half_width / distances) ** 2)
            else:  # a disk that faces the point is seen as a circular cone
                cosines = distances / np.hypot(distances, emitter.half_width)

        def irradiance(cones):
            return irradiance_of_region(normals, np.concatenate([nothing, *cones], 1), axes, cosines)

    whole = np.where(in_front, irradiance([]), 0.0)
    visible = whole.copy()
    cones = [cone_of_polygon(points, plate) for plate in plates]
    for size in range(1, len(cones) + 1):
        for chosen in combinations(cones, size):
            visible += (-1.0) ** size * irradiance(chosen)
    lit = whole > 0.0
    return np.where(lit, visible / np.where(lit, whole, 1.0), 1.0), whole


def irradiance_of_parallel_disk(height, offset, radius):
    """E at radiance 1 of a disk in a plane parallel to the surface, `height` above it, its centre `offset`
    to the side (Howell, A Catalog of Radiation Heat Transfer
    Configuration Factors: element to disk in a parallel plane)."""
    height, offset, radius = (np.asarray(x, np.float64) for x in (height, offset, radius))
    difference = height**2 + offset**2 - radius**2
    total = height**2 + offset**2 + radius**2
    return 0.5 * np.pi * (1.0 - difference / np.sqrt(total**2 - 4.0 * offset**2 * radius**2))


def irradiance_of_sphere(distance, cosine, radius):
    """E at radiance 1 of a sphere wholly above the horizon: pi r^2 / d^2 cos."""
    return np.pi * (np.asarray(radius) / distance) ** 2 * cosine


def disk_share_beyond_edge(offset):
    """Share of a unit disk beyond a straight edge at a signed distance `offset` from its centre: the
    penumbra of a sun over an edge, as long as the sun is small."""
    x = np.clip(np.asarray(offset, np.float64), -1.0, 1.0)
    return (np.arccos(x) - x * np.sqrt(1.0 - x**2)) / np.pi
