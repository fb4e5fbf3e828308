"""Where a light's casters are rasterised from: one frustum, nested ones, or the cube faces that matter."""

from __future__ import annotations

import math

import numpy as np

from ...core.emitter import Emitter, EmitterKind
from ...core.view import Vector, View

WIDEST_SINGLE_TANGENT = 2.5
"""A window up to this slope gets one map; a wider one is nested, each window this much smaller."""

WIDEST_TANGENT = 15.0
"""Slopes beyond this (86 degrees) are cut off: light so grazing carries next to no irradiance."""

FACE_TANGENT = 1.25
"""Half window of a cube face: 45 degrees and a band for search regions that reach over the edge."""

WIDEST_SPOT = math.cos(math.radians(70.0))
"""A spot whose cone is narrower than 70 degrees to a side is seen in one frustum, not in cube faces."""

SMALLEST_NEAR = 1e-4
"""Nearest plane, as a share of the farthest."""

SEEN_MARGIN = 0.1
"""Share of the window that receivers fill that it grows by, for the search regions at its edges."""

SPARE = 1.5
"""The window of all casters gets a map of its own if it is so many times larger than the receivers'."""

VAST = 0.5
"""A caster wider than this share of everything is a ground, and no reason to spread a sun's texels thin."""

FARTHEST = 2.5e5
"""Distance of a lamp over the size of what it lights: a map's depths in single precision are 1.5% of that
size apart there, and farther off they would soon not tell a caster from what it shadows."""

FARTHEST_M = 2e9
"""Metres; beyond it the fourth power of a distance leaves single precision."""

NamedView = tuple[str, View]
LeftOut = tuple[str, str]


def light_views(
    emitter: Emitter, caster_bounds: np.ndarray, receiver_bounds: np.ndarray
) -> tuple[list[NamedView], list[LeftOut]]:
    """Views to rasterise `emitter`'s casters from, smallest window first, and what needed none, and why.

    `caster_bounds` (C, 2, 3) and `receiver_bounds` (R, 2, 3) float64: low and high corners of boxes in world
    space, metres. Nothing outside the windows' union casts a shadow onto a receiver. Names are empty, "wide"
    followed by a number, or a face such as "+X".
    """
    casters = np.asarray(caster_bounds, np.float64).reshape(-1, 2, 3)
    receivers = np.asarray(receiver_bounds, np.float64).reshape(-1, 2, 3)
    casters = casters[_may_shadow(emitter, casters, receivers)]
    if emitter.kind == EmitterKind.DISTANT_DISK:
        return _sun_view(emitter, casters, receivers)
    if emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
        return _nested_views(emitter, casters, receivers, WIDEST_TANGENT)
    if emitter.cos_cone > WIDEST_SPOT:
        sine = math.sqrt(1.0 - emitter.cos_cone**2)
        return _nested_views(emitter, casters, receivers, sine / emitter.cos_cone)
    return _cube_views(emitter, casters, receivers)


def too_far(emitter: Emitter, region: np.ndarray) -> str | None:
    """Why the light is too far for maps from what it lights, the box `region` (2, 3), or None."""
    if emitter.kind == EmitterKind.DISTANT_DISK:
        return None
    centre, size = np.array(emitter.centre), float(np.linalg.norm(region[1] - region[0]))
    distance = float(np.linalg.norm(centre - centre.clip(*region)))
    if distance > FARTHEST_M:
        return f"it is {distance:.2g} m away, more than single precision holds"
    if distance <= FARTHEST * size or size == 0.0:
        return None
    return f"it is {distance:.2g} m from a scene of {size:.2g} m: depths run together, take a sun instead"


def _may_shadow(emitter: Emitter, casters: np.ndarray, receivers: np.ndarray) -> np.ndarray:
    """(C,) bool: False where an axis plane has the caster on one side, light and receivers on the other, as
    the ground under everything does."""
    if not len(casters) or not len(receivers):
        return np.zeros(len(casters), bool)
    low, high = receivers[:, 0].min(axis=0), receivers[:, 1].max(axis=0)
    tolerance = 1e-9 * np.maximum(np.abs(low), np.abs(high)).max()
    if emitter.kind == EmitterKind.DISTANT_DISK:
        # Directions to the sun, of which each component may have either sign near zero.
        spread = _extent(emitter)
        to_light = -np.array(emitter.forward)
        light_low = np.where(to_light > spread, np.inf, -np.inf)
        light_high = np.where(to_light < -spread, -np.inf, np.inf)
    else:
        centre = np.array(emitter.centre)
        light_low, light_high = centre - _extent(emitter), centre + _extent(emitter)
    under = (casters[:, 1] <= np.minimum(low, light_low) + tolerance).any(axis=1)
    over = (casters[:, 0] >= np.maximum(high, light_high) - tolerance).any(axis=1)
    return ~(under | over)


def _extent(emitter: Emitter) -> np.ndarray:
    """(3,) half size of the box around the light; of a sun, of its directions."""
    if emitter.kind in (EmitterKind.SPHERE, EmitterKind.FACING_DISK):
        return np.full(3, emitter.half_width)
    return emitter.half_width * np.abs(emitter.right) + emitter.half_height * np.abs(emitter.up)


def _nested_views(
    emitter: Emitter, casters: np.ndarray, receivers: np.ndarray, widest: float
) -> tuple[list[NamedView], list[LeftOut]]:
    axes = (emitter.right, emitter.up, emitter.forward)
    casters, receivers = (_corners(emitter, axes, boxes, widest) for boxes in (casters, receivers))
    whole, reason = _window(emitter, casters, receivers, widest)
    if whole is None:
        return [], [("map", reason)]
    tight = _seen_window(receivers, widest, whole[0])
    limits = [max(abs(edge) for edge in tight)]
    while limits[0] > WIDEST_SINGLE_TANGENT:
        limits.insert(0, limits[0] / WIDEST_SINGLE_TANGENT)
    windows, left_out = [], []
    for limit in limits:
        inner, reason = _window(emitter, casters, receivers, limit)
        if inner is None:
            left_out.append((f"window within slopes of {limit:.1f}", reason))
        else:
            windows.append((_intersection(inner[0], tight), *inner[1:]))
    # The last window is always that of all casters: in place of the receivers' where it is hardly larger.
    if windows and _area(whole[0]) <= SPARE * _area(windows[-1][0]):
        windows.pop()
    windows.append(whole)
    views = [
        (f"wide {number}" if number else "", View(emitter.centre, *axes, window, near, far))
        for number, (window, near, far) in enumerate(windows)
    ]
    return views, left_out


def _seen_window(receivers: np.ndarray, widest: float, whole: tuple) -> tuple:
    """The part of the window `whole` that receivers fill. Casters close to the light lie around it, so that
    a point whose search region leaves it needs the whole window; most do not."""
    low, high, _ = _slopes(receivers, widest)
    low, high = low.min(axis=1), high.max(axis=1)
    margin = SEEN_MARGIN * (high - low)
    seen = (low[0] - margin[0], high[0] + margin[0], low[1] - margin[1], high[1] + margin[1])
    return _intersection(whole, tuple(float(edge) for edge in seen))


def _intersection(a: tuple, b: tuple) -> tuple:
    """Of two windows; the first if they do not meet."""
    both = (max(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), min(a[3], b[3]))
    return both if both[0] < both[1] and both[2] < both[3] else a


def _area(window: tuple) -> float:
    return (window[1] - window[0]) * (window[3] - window[2])


def _cube_views(
    emitter: Emitter, casters: np.ndarray, receivers: np.ndarray
) -> tuple[list[NamedView], list[LeftOut]]:
    views, left_out = [], []
    for name, axes in cube_axes():
        seen = (_corners(emitter, axes, boxes, FACE_TANGENT) for boxes in (casters, receivers))
        found, reason = _window(emitter, *seen, FACE_TANGENT)
        if found is None:
            left_out.append((f"face {name}", reason))
        else:
            window, near, far = found
            views.append((name, View(emitter.centre, *axes, window, near, far)))
    return views, left_out


def cube_axes() -> list[tuple[str, tuple[Vector, Vector, Vector]]]:
    """Name, and right, up, forward in the world, of each face of a cube."""
    faces = []
    unit = np.eye(3)
    for axis in range(3):
        for sign, letter in ((1.0, "+"), (-1.0, "-")):
            right, up, forward = -sign * unit[(axis + 1) % 3], unit[(axis + 2) % 3], sign * unit[axis]
            axes = tuple(tuple(float(c) for c in vector) for vector in (right, up, forward))
            faces.append((letter + "XYZ"[axis], axes))
    return faces


def share_axes(a: View, b: View) -> bool:
    """Whether window coordinates of the two differ by a shift at most, which only an orthographic eye may
    make: such views are nested windows of one light, others are faces of a cube (choose.rs)."""
    turned = (a.right, a.up, a.forward) != (b.right, b.up, b.forward)
    return not turned and a.orthographic == b.orthographic and (a.orthographic or a.eye == b.eye)


def _corners(emitter: Emitter, axes, boxes: np.ndarray, widest: float) -> np.ndarray:
    """Corners (3, 8, M) along `axes` from the light's centre, of those boxes (N, 2, 3) that may be in front
    of the light within slopes of `widest`. Boxes come last, and what each axis of the world adds is summed:
    thousands are looked at for every frame of a light that moves."""
    edges = np.subtract(
        boxes.T, np.array(emitter.centre)[:, None, None], order="C"
    )  # by axis of the world, and low or high
    axes = np.array(axes)
    half = np.abs(axes) @ (0.5 * (edges[:, 1] - edges[:, 0]))
    middle = axes @ (0.5 * (edges[:, 0] + edges[:, 1]))
    farthest = middle[2] + half[2]
    inside = (farthest > 0.0) & (np.abs(middle[:2]) - half[:2] < widest * farthest).all(axis=0)
    along = axes[:, :, None, None] * np.compress(inside, edges, axis=2)
    x, y, z = along[:, 0], along[:, 1], along[:, 2]
    corners = x[:, :, None, None] + y[:, None, :, None] + z[:, None, None, :]
    return corners.reshape(3, 8, -1)


def _window(emitter: Emitter, casters: np.ndarray, receivers: np.ndarray, widest: float):
    """Window, near and far of the casters that may shadow receivers within slopes of `widest`, or None; and
    why None. Both are corners (3, 8, N) in the light's axes."""
    receiver_low, receiver_high, receiver_depths = _slopes(receivers, widest)
    if not receiver_depths.size:
        return None, "no receivers"
    far = float(receiver_depths.max())
    caster_low, caster_high, caster_depths = _slopes(casters, widest)
    shadowing = caster_depths[0] < far
    if not shadowing.any():
        return None, "no casters"
    caster_low, caster_high = caster_low[:, shadowing], caster_high[:, shadowing]
    nearest = caster_depths[0, shadowing]
    # Not quite at the nearest caster: rounding would clip one that is parallel to the light.
    near = max(0.99 * float(nearest.min()), SMALLEST_NEAR * far)
    # A line from a receiver's point at slope p to the light's point l passes depth s at p + l (1/s - 1/z).
    half = np.array([[emitter.half_width], [emitter.half_height]])
    reach = half * (1.0 / np.maximum(nearest, near) - 1.0 / far)
    low = np.maximum(caster_low, receiver_low.min(axis=1)[:, None] - reach)
    high = np.minimum(caster_high, receiver_high.max(axis=1)[:, None] + reach)
    inside = (low <= high).all(axis=0)
    if not inside.any():
        return None, "no casters"
    low, high = low[:, inside].min(axis=1), high[:, inside].max(axis=1)
    return (_padded(low, high), near, far * 1.001), ""


def _slopes(corners: np.ndarray, widest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of boxes' corners (3, 8, N) in the light's axes: low and high slopes (2, M) within `widest`, and least
    and greatest depth (2, M), of those M boxes that are in front of the light and not outside."""
    depths = corners[2]
    edge = widest * depths
    in_front = depths.max(axis=0) > 0.0
    for across in corners[:2]:
        in_front &= (across < edge).any(axis=0) & (-across < edge).any(axis=0)
    corners = np.compress(in_front, corners, axis=2)  # in order in memory, which indexing would not keep
    depths = corners[2]
    nearest, farthest = depths.min(axis=0), depths.max(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = corners[:2] / depths
    # A box that reaches behind the light's plane may appear anywhere.
    behind = nearest <= 0.0
    low = np.where(behind, -widest, np.clip(slopes.min(axis=1), -widest, widest))
    high = np.where(behind, widest, np.clip(slopes.max(axis=1), -widest, widest))
    return low, high, np.stack([np.maximum(nearest, 0.0), farthest])


def _sun_view(
    emitter: Emitter, casters: np.ndarray, receivers: np.ndarray
) -> tuple[list[NamedView], list[LeftOut]]:
    """Orthographic views of the casters, no wider than the receivers' bounds and the penumbra's reach, so
    that neither a vast ground nor casters far aside waste texels."""
    if not len(receivers):
        return [], [("map", "no receivers")]
    if not len(casters):
        return [], [("map", "no casters")]
    axes = np.array([emitter.right, emitter.up, emitter.forward])
    middle = 0.5 * (receivers[:, 0].min(axis=0) + receivers[:, 1].max(axis=0))
    receiver_low, receiver_high = _ranges(receivers - middle, axes)
    receiver_low, receiver_high = receiver_low.min(axis=0), receiver_high.max(axis=0)
    caster_low, caster_high = _ranges(casters - middle, axes)
    # The disk's rays spread by its radius (a tangent) per metre between caster and receiver.
    height = np.maximum(receiver_high[2] - caster_low[:, 2:], 0.0)
    reach = height * np.array([emitter.half_width, emitter.half_height])
    low = np.maximum(caster_low[:, :2], receiver_low[:2] - reach)
    high = np.minimum(caster_high[:, :2], receiver_high[:2] + reach)
    inside = (low <= high).all(axis=1) & (caster_low[:, 2] < receiver_high[2])
    if not inside.any():
        return [], [("map", "no casters")]
    low, high = low[inside], high[inside]
    nearest, farthest = caster_low[inside, 2].min(), receiver_high[2]
    margin = 1e-3 * (farthest - nearest)
    near, far = float(0.5 * margin), float(farthest - nearest + 2.0 * margin)
    lamp_axes = (emitter.right, emitter.up, emitter.forward)
    views = []
    for name, (window_low, window_high) in _sun_windows(low, high):
        eye = middle + (nearest - margin) * axes[2] + axes[:2].T @ (0.5 * (window_low + window_high))
        half = 0.5 * (window_high - window_low)
        window = _padded(-half, half)
        views.append((name, View(tuple(eye.tolist()), *lamp_axes, window, near, far, orthographic=True)))
    return views, []


def _ranges(boxes: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest place (N, 3) of boxes (N, 2, 3) along each of `axes` (3, 3)."""
    middle, half = 0.5 * (boxes[:, 0] + boxes[:, 1]) @ axes.T, 0.5 * (boxes[:, 1] - boxes[:, 0]) @ abs(axes).T
    return middle - half, middle + half


def _sun_windows(low: np.ndarray, high: np.ndarray) -> list[tuple[str, tuple[np.ndarray, np.ndarray]]]:
    """Around casters whose boxes seen from the sun are `low` and `high` (C, 2): one window around all, and
    before it a smaller one around all but the vast (the ground that a town stands on), if that helps."""
    whole = low.min(axis=0), high.max(axis=0)
    size = whole[1] - whole[0]
    compact = (high - low <= VAST * size).all(axis=1)
    if not compact.any():
        return [("", whole)]
    inner = low[compact].min(axis=0), high[compact].max(axis=0)
    if np.prod(inner[1] - inner[0]) > 0.5 * np.prod(size):
        return [("", whole)]
    return [("", inner), ("wide 1", whole)]


def _padded(low: np.ndarray, high: np.ndarray) -> tuple[float, float, float, float]:
    """Left, right, bottom, top, a little wider so that no edge falls on the border, and never empty."""
    size = high - low
    margin = np.maximum(0.002 * size, 1e-6 * size.max() + 1e-12)
    low, high = low - margin, high + margin
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])
