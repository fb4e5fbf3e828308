"""Where a light's casters are rasterised from: one frustum, nested ones, or the cube faces that matter."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...core.emitter import Emitter, EmitterKind
from ...core.view import Vector, View
from .sun_views import sun_view
from .windows import LeftOut, NamedView, padded

WIDEST_SINGLE_TANGENT = 2.5
"""A window up to this slope gets one map; a wider one is nested, each window this much smaller."""

WIDEST_TANGENT = 15.0
"""Slopes beyond this (86 degrees) are cut off: light so grazing carries next to no irradiance, and what hides
a round light from there is closer to it than its own radius, or nearly (choose.rs, close_casters.py)."""

FACE_TANGENT = 1.02
"""Slope up to which points belong to a cube face: 45 degrees and what rounding may make of it (choose.rs)."""

WIDEST_SPOT = math.cos(math.radians(70.0))
"""A spot whose cone is narrower than 70 degrees to a side is seen in one frustum, not in cube faces."""

SMALLEST_NEAR = 1e-4
"""Nearest plane, as a share of the farthest."""

SEEN_MARGIN = 0.1
"""Share of the window that receivers fill that it grows by, for the search regions at its edges."""

SPARE = 1.5
"""The window of all casters gets a map of its own if it is so many times larger than the receivers'."""

FARTHEST = 2.5e5
"""Distance of a lamp over the size of what it lights: a map's depths in single precision are 1.5% of that
size apart there, and farther off they would soon not tell a caster from what it shadows."""

FARTHEST_M = 2e9
"""Metres; beyond it the fourth power of a distance leaves single precision."""

AROUND = 12.0
"""Radii of a spot or a point that a mesh whose box is around it is taken to be away until its triangles are
known, and within which they are asked."""

WINDOW_EDGE = 0.02
"""Share of a window at its edges that does not count as within it: some texels, which a map may not know."""

ROUND_KINDS = (EmitterKind.SPHERE, EmitterKind.FACING_DISK)


def light_views(
    emitter: Emitter,
    caster_bounds: np.ndarray,
    receiver_bounds: np.ndarray,
    away_m: np.ndarray | None = None,
    hold_receivers: bool = False,
    eye: np.ndarray | None = None,
) -> tuple[list[NamedView], list[LeftOut]]:
    """Views to rasterise `emitter`'s casters from, smallest window first, and what needed none, and why.

    `caster_bounds` (C, 2, 3) and `receiver_bounds` (R, 2, 3) float64: low and high corners of boxes in world
    space, metres. Nothing outside the windows' union casts a shadow onto a receiver. Names are empty, "wide"
    followed by a number, with a face such as "+X" before it. `away_m` (C,): how far each caster is at least
    from a spot or a point, by its box if None. `hold_receivers`: the widest windows of a spot or a point hold
    all receivers, to look up where each is even if nothing casts (close_casters.py). `eye` (3,): where the
    camera is, if the receivers are boxes of about as many of its pixels each: a sun's maps then get finer
    windows around the nearest."""
    casters = np.asarray(caster_bounds, np.float64).reshape(-1, 2, 3)
    receivers = np.asarray(receiver_bounds, np.float64).reshape(-1, 2, 3)
    away = distances_of_boxes(emitter, casters) if away_m is None else away_m
    may_shadow = _may_shadow(emitter, casters, receivers)
    casters, away = casters[may_shadow], away[may_shadow]
    if emitter.kind == EmitterKind.DISTANT_DISK:
        return sun_view(emitter, casters, receivers, eye)
    if emitter.kind not in ROUND_KINDS or emitter.cos_cone > WIDEST_SPOT:
        axes = (emitter.right, emitter.up, emitter.forward)
        lit = _lit_tangent(emitter, receivers)
        return _nested_views(emitter, axes, casters, away, receivers, lit, hold_receivers)
    views, left_out = [], []
    for name, axes in cube_axes():
        nested, lacking = _nested_views(emitter, axes, casters, away, receivers, FACE_TANGENT, hold_receivers)
        views += [(f"{name} {number}".strip(), view) for number, view in nested]
        left_out += [(f"face {name}" if what == "map" else f"{name} {what}", why) for what, why in lacking]
    return views, left_out


def distances_of_boxes(emitter: Emitter, boxes: np.ndarray) -> np.ndarray:
    """(N,) metres from the light's centre to boxes (N, 2, 3) at least; AROUND radii where it is in a box, as
    of a room or a lantern, which does not say how close its mesh is."""
    centre = np.array(emitter.centre)
    away = np.linalg.norm(centre.clip(boxes[:, 0], boxes[:, 1]) - centre, axis=1)
    return np.where(away > 0.0, away, AROUND * emitter.half_width)


def _lit_tangent(emitter: Emitter, receivers: np.ndarray) -> float:
    """The slope from the light's axis within which there are receivers: outside its cone a spot's rim still
    lights some. By how wide an angle is told from their middle distance: by that of the nearest the map of a
    lantern at a wall would spread its texels over a half space, for a few points with hardly any light."""
    if emitter.kind not in ROUND_KINDS:
        return WIDEST_TANGENT
    rim = 0.0
    if emitter.half_width > 0.0 and len(receivers):
        rim = math.asin(min(emitter.half_width / np.median(distances_of_boxes(emitter, receivers)), 1.0))
    widest = math.acos(emitter.cos_cone) + rim
    return math.tan(widest) if widest < math.atan(WIDEST_TANGENT) else WIDEST_TANGENT


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
    emitter: Emitter,
    axes,
    casters: np.ndarray,
    away: np.ndarray,
    receivers: np.ndarray,
    lit: float,
    hold_receivers: bool,
) -> tuple[list[NamedView], list[LeftOut]]:
    """Along `axes`, of receivers within slopes of `lit`."""
    casters = _Boxes.of(emitter, axes, casters, WIDEST_TANGENT, away)
    receivers = _Boxes.of(emitter, axes, receivers, lit)
    whole, reason = _window(emitter, casters, receivers, lit, WIDEST_TANGENT)
    if hold_receivers and reason != "no receivers":
        whole, reason = _holding(receivers, lit, whole), ""
    if whole is None:
        return [], [("map", reason)]
    tight = _seen_window(receivers, lit, whole[0])
    limits = [max(abs(edge) for edge in tight)]
    while limits[0] > WIDEST_SINGLE_TANGENT:
        limits.insert(0, limits[0] / WIDEST_SINGLE_TANGENT)
    windows, left_out = [], []
    for limit in limits:
        inner, reason = _window(emitter, casters, receivers, min(limit, lit), limit)
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


def _seen_window(receivers: _Boxes, widest: float, whole: tuple) -> tuple:
    """The part of the window `whole` that receivers fill. Casters close to the light lie around it, so that
    a point whose search region leaves it needs the whole window; most do not."""
    low, high, _, _ = receivers.slopes(widest)
    low, high = low.min(axis=1), high.max(axis=1)
    margin = SEEN_MARGIN * (high - low)
    seen = (low[0] - margin[0], high[0] + margin[0], low[1] - margin[1], high[1] + margin[1])
    return _intersection(whole, tuple(float(edge) for edge in seen))


def _holding(receivers: _Boxes, lit: float, whole: tuple | None) -> tuple:
    """Window, near and far of `whole`, or of nothing, so wide that they hold the receivers."""
    low, high, depths, _ = receivers.slopes(lit)
    low, high, far = low.min(axis=1), high.max(axis=1), 1.001 * float(depths.max())
    window, near, far = whole or (padded(low, high), SMALLEST_NEAR * far, far)
    left, right, bottom, top = window
    low, high = np.minimum(low, (left, bottom)), np.maximum(high, (right, top))
    return padded(low, high), near, far


def _intersection(a: tuple, b: tuple) -> tuple:
    """Of two windows; the first if they do not meet."""
    both = (max(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), min(a[3], b[3]))
    return both if both[0] < both[1] and both[2] < both[3] else a


def _area(window: tuple) -> float:
    return (window[1] - window[0]) * (window[3] - window[2])


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


@dataclass(frozen=True)
class _Boxes:
    """Boxes by their `corners` (3, 8, M) along axes from a light's centre, the `index` (M,) of each among
    all, and how far `away` (M,) from it the caster in it is, metres."""

    corners: np.ndarray
    index: np.ndarray
    away: np.ndarray

    @classmethod
    def of(
        cls, emitter: Emitter, axes, boxes: np.ndarray, widest: float, away: np.ndarray | None = None
    ) -> _Boxes:
        """Those of `boxes` (N, 2, 3) in the world that may be in front of the light within slopes `widest`.
        Boxes come last, and what each axis of the world adds is summed: thousands are looked at for every
        frame of a light that moves."""
        edges = np.subtract(
            boxes.T, np.array(emitter.centre)[:, None, None], order="C"
        )  # by axis of the world, and low or high
        axes = np.array(axes)
        half = np.abs(axes) @ (0.5 * (edges[:, 1] - edges[:, 0]))
        middle = axes @ (0.5 * (edges[:, 0] + edges[:, 1]))
        farthest = middle[2] + half[2]
        inside = (farthest > 0.0) & (np.abs(middle[:2]) - half[:2] < widest * farthest).all(axis=0)
        edges = np.compress(inside, edges, axis=2)
        along = axes[:, :, None, None] * edges
        x, y, z = along[:, 0], along[:, 1], along[:, 2]
        corners = x[:, :, None, None] + y[:, None, :, None] + z[:, None, None, :]
        index = np.flatnonzero(inside)
        return cls(corners.reshape(3, 8, -1), index, np.zeros(len(index)) if away is None else away[index])

    def slopes(self, widest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Low and high slopes (2, M) within `widest`, least and greatest depth (2, M), and which (M,) of the
        boxes are in front of the light and not outside."""
        depths = self.corners[2]
        edge = widest * depths
        in_front = depths.max(axis=0) > 0.0
        for across in self.corners[:2]:
            in_front &= (across < edge).any(axis=0) & (-across < edge).any(axis=0)
        corners = np.compress(
            in_front, self.corners, axis=2
        )  # in order in memory, which indexing would not keep
        across, depths = corners[:2], corners[2]
        nearest, farthest = depths.min(axis=0), depths.max(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = across / depths
        # A box that reaches behind the light's plane may appear anywhere on its side of the axis.
        behind = nearest <= 0.0
        least, most = across.min(axis=1), across.max(axis=1)
        low = np.where(behind, np.where(least > 0.0, least / farthest, -widest), slopes.min(axis=1))
        high = np.where(behind, np.where(most < 0.0, most / farthest, widest), slopes.max(axis=1))
        low, high = (np.clip(edge, -widest, widest) for edge in (low, high))
        return low, high, np.stack([np.maximum(nearest, 0.0), farthest]), np.flatnonzero(in_front)


def _window(emitter: Emitter, casters: _Boxes, receivers: _Boxes, lit: float, widest: float):
    """Window, near and far of the casters within slopes of `widest` that may shadow receivers within slopes
    of `lit`, or None; and why None."""
    spans, reason = _spans(emitter, casters, receivers, lit, widest)
    if spans is None:
        return None, reason
    low, high, near, far, _ = spans
    return (padded(low.min(axis=1), high.max(axis=1)), near, far * 1.001), ""


def _spans(emitter: Emitter, casters: _Boxes, receivers: _Boxes, lit: float, widest: float):
    """Of those casters: low and high slopes (2, M) between which each may, least and greatest depth of all,
    and which they are (M,); or None; and why None."""
    receiver_low, receiver_high, receiver_depths, _ = receivers.slopes(lit)
    if not receiver_depths.size:
        return None, "no receivers"
    far = float(receiver_depths.max())
    caster_low, caster_high, caster_depths, which = casters.slopes(widest)
    shadowing = caster_depths[0] < far
    if not shadowing.any():
        return None, "no casters"
    caster_low, caster_high, which = caster_low[:, shadowing], caster_high[:, shadowing], which[shadowing]
    nearest, away = caster_depths[0, shadowing], casters.away[which]
    # Not quite at the nearest caster: rounding would clip one that is parallel to the light.
    near = max(0.99 * float(nearest.min()), SMALLEST_NEAR * far)
    receiver_low, receiver_high = receiver_low.min(axis=1), receiver_high.max(axis=1)
    reach = _reach(emitter, np.maximum(nearest, near), far, away, np.maximum(-receiver_low, receiver_high))
    low = np.maximum(caster_low, receiver_low[:, None] - reach)
    high = np.minimum(caster_high, receiver_high[:, None] + reach)
    inside = (low <= high).all(axis=0)
    if not inside.any():
        return None, "no casters"
    return (low[:, inside], high[:, inside], near, far, casters.index[which[inside]]), ""


def reaching_out_of(
    view: View, emitter: Emitter, casters: np.ndarray, away_m: np.ndarray, receivers: np.ndarray
) -> np.ndarray:
    """(C,) bool: boxes (C, 2, 3), so far away (C,), that may keep light of a spot or a point from receivers
    (R, 2, 3) beside the window of `view`, one of `light_views`: a wider map need not draw the others."""
    axes = view.right, view.up, view.forward
    lit = _lit_tangent(emitter, receivers) if emitter.cos_cone > WIDEST_SPOT else FACE_TANGENT
    boxes = _Boxes.of(emitter, axes, casters, WIDEST_TANGENT, away_m)
    spans, _ = _spans(emitter, boxes, _Boxes.of(emitter, axes, receivers, lit), lit, WIDEST_TANGENT)
    found = np.zeros(len(casters), bool)
    if spans is not None:
        low, high, _, _, index = spans
        left, right, bottom, top = view.window
        room_x, room_y = WINDOW_EDGE * (right - left), WINDOW_EDGE * (top - bottom)
        beside = (low[0] < left + room_x) | (high[0] > right - room_x)
        beside |= (low[1] < bottom + room_y) | (high[1] > top - room_y)
        found[index[beside]] = True
    return found


def _reach(
    emitter: Emitter, nearest: np.ndarray, far: float, away: np.ndarray, aside: np.ndarray
) -> np.ndarray:
    """(2, M): how far at most, in slopes, casters (M,) at depths from `nearest` on and so far `away` lie
    from a receiver that they keep light from, of those down to depth `far` and up to slopes `aside` (2,)."""
    # A line from a receiver's point at slope p to the light's point l passes depth s at p + l (1/s - 1/z).
    half = np.array([[emitter.half_width], [emitter.half_height]])
    if emitter.kind not in ROUND_KINDS:
        return half * (1.0 / nearest - 1.0 / far)
    aside = np.maximum(aside, 0.0)
    # A disk that is turned to a point aside reaches farther on the light's plane.
    on_plane = half * math.hypot(1.0, *aside) * (1.0 / nearest - 1.0 / far)
    # And no ray to it is turned by more than asin(radius / away); seen along one axis only, more.
    turn = np.arcsin(np.minimum(emitter.half_width / np.maximum(away, 1e-30), 1.0))
    turn = np.arctan(np.tan(turn) * np.hypot(1.0, aside[::-1])[:, None])
    angle = np.minimum(np.arctan(aside)[:, None] + turn, 0.5 * np.pi - 1e-6)
    return np.minimum(on_plane, np.tan(angle) - aside[:, None])
