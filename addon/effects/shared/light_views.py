"""Where the casters of a point or of a distant light are rasterised from, without overlap: one frustum, or
the faces of a cube."""

from __future__ import annotations

import math

import numpy as np

from ...core.culling import corners_of, in_frustum
from ...core.view import View

WIDEST_SINGLE_TANGENT = 2.5
"""A cone up to this slope is seen in one frustum, a wider one in cube faces."""

SMALLEST_NEAR = 1e-5
"""Nearest plane, as a share of the farthest."""

NamedView = tuple[str, View]


def distant_view(forward, right, up, boxes: np.ndarray, region: np.ndarray) -> list[NamedView]:
    """The orthographic view along `forward` of the boxes (C, 2, 3) that may shadow any of the points `region`
    (P, 3), world space; none where no box can."""
    axes = np.array([right, up, forward], np.float64)
    seen = corners_of(boxes) @ axes.T
    wanted = np.asarray(region, np.float64) @ axes.T
    low = np.maximum(seen[..., :2].min(axis=(0, 1)), wanted[:, :2].min(axis=0))
    high = np.minimum(seen[..., :2].max(axis=(0, 1)), wanted[:, :2].max(axis=0))
    if (low >= high).any():
        return []
    nearest, farthest = seen[..., 2].min(), seen[..., 2].max()
    room = 0.01 * (farthest - nearest) + 1e-6 * np.abs(seen).max() + 1e-6
    eye = axes.T @ [*(0.5 * (low + high)), nearest - room]
    half = 0.5 * (high - low) * (1.0 + 1e-6) + 1e-9
    window = (-half[0], half[0], -half[1], half[1])
    far = float(farthest - nearest + 2.0 * room)
    return [("", View(_vector(eye), *map(_vector, axes), tuple(map(float, window)), 0.0, far, True))]


def point_views(
    position, axes: np.ndarray, tan_cone: float, boxes: np.ndarray, behind: bool = True
) -> list[NamedView]:
    """Perspective views from `position` that together see all of the boxes (C, 2, 3) within the cone of slope
    `tan_cone` (infinite: all around) around the third of `axes` (3, 3), right, up and forward. `behind`:
    whether the light shines backwards too."""
    position, axes = np.asarray(position, np.float64), np.asarray(axes, np.float64)
    seen = (corners_of(boxes) - position) @ axes.T
    far = float(np.linalg.norm(seen, axis=-1).max()) * 1.01 + 1e-6
    near = SMALLEST_NEAR * far
    if tan_cone <= WIDEST_SINGLE_TANGENT:
        window = _window(seen, tan_cone, near)
        if window is None:
            return []
        return [("", View(_vector(position), *map(_vector, axes), window, near, far))]
    views = []
    right, up, forward = axes
    faces = {
        "+Z": (right, up, forward),
        "+X": (up, forward, right),
        "-X": (forward, up, -right),
        "+Y": (forward, right, up),
        "-Y": (right, forward, -up),
        "-Z": (up, right, -forward),
    }
    for name, (across, along, ahead) in faces.items():
        if name == "-Z" and not behind:
            continue
        view = View(
            _vector(position),
            _vector(across),
            _vector(along),
            _vector(ahead),
            (-1.0, 1.0, -1.0, 1.0),
            near,
            far,
        )
        if in_frustum(view, boxes, guard=0.0).any():
            views.append((name, view))
    return views


def _window(seen: np.ndarray, tan_cone: float, near: float) -> tuple[float, float, float, float] | None:
    """Slopes that the boxes' corners (C, 8, 3) take, within the cone; None where all lie behind."""
    low, high = np.full(2, math.inf), np.full(2, -math.inf)
    for corners in seen:
        ahead = corners[:, 2] > near
        if not ahead.any():
            continue
        if ahead.all():
            slopes = corners[:, :2] / corners[:, 2:]
            low, high = np.minimum(low, slopes.min(axis=0)), np.maximum(high, slopes.max(axis=0))
        else:
            low[:], high[:] = -tan_cone, tan_cone
    margin = 1e-3 * tan_cone
    low, high = np.maximum(low - margin, -tan_cone), np.minimum(high + margin, tan_cone)
    if (low >= high).any():
        return None
    return (float(low[0]), float(high[0]), float(low[1]), float(high[1]))


def _vector(array) -> tuple[float, float, float]:
    return tuple(float(x) for x in array)
