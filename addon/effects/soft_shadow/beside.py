"""What stands so close to a round light that its maps cannot know it: where it may hide a part of the light.

A point sees a sphere or a facing disk as a disk that is turned to it. Rays to its rim reach behind the
light's plane, where no map of that point looks: to a lantern's tray above its bulb.
"""

from __future__ import annotations

import math

import numpy as np

from ...core.emitter import Emitter
from ...core.view import View
from .views import FACE_TANGENT, WIDEST_SPOT, WIDEST_TANGENT, cube_axes

LOOK_RESOLUTION = 128  # texels, a side of the look around
SMALLEST_RADIUS_M = 1e-9  # smaller lamps are points: hidden whole, or not at all
CELLS = 32  # a side of the tables, and of the look's nearest distances


def reach_m(emitter: Emitter) -> float:
    """How far from the light's centre at most something is that hides a part of it from a point and that
    the maps along the point's axis cannot know: it is seen more than WIDEST_TANGENT from the axis, and so at
    that angle less the point's from the point's own direction, and hides by asin(radius / distance)."""
    farthest = math.atan(FACE_TANGENT * math.sqrt(2.0))
    if emitter.cos_cone > WIDEST_SPOT:
        farthest = math.acos(emitter.cos_cone)
    return emitter.half_width / math.sin(math.atan(WIDEST_TANGENT) - farthest)


def close_casters(emitter: Emitter, boxes: np.ndarray) -> np.ndarray:
    """(N,) bool: boxes (N, 2, 3) in the world that come within `reach_m`."""
    if emitter.half_width < SMALLEST_RADIUS_M:
        return np.zeros(len(boxes), bool)
    centre = np.array(emitter.centre)
    nearest = np.clip(centre, boxes[:, 0], boxes[:, 1])
    return np.linalg.norm(nearest - centre, axis=1) <= reach_m(emitter)


def looks_around(emitter: Emitter) -> list[tuple[str, View]]:
    """Six views of all that is close to the light."""
    near, far = 1e-3 * emitter.half_width, reach_m(emitter)
    window = (-1.0, 1.0, -1.0, 1.0)
    return [(name, View(emitter.centre, *axes, window, near, far)) for name, axes in cube_axes()]


def table(looks: list[np.ndarray], emitter: Emitter, view: View) -> np.ndarray:
    """(CELLS, CELLS) uint8 over the window of `view`, rows from the bottom: 1 where what is close to the
    light but out of the view may hide a part of it from points in that direction. `looks`: a depth map of
    each of `looks_around`, (1, LOOK_RESOLUTION, LOOK_RESOLUTION) float32, metres."""
    directions, distances = _surroundings(looks, view)
    close = np.isfinite(distances)
    directions, distances = directions[close], distances[close]
    towards, half_cell = _cells(view)
    # A point in direction p sees a disk at right angles to p. Its rays to the rim pass what lies in
    # direction u and is no farther than radius / sin(angle between p and u). Cells have a size.
    angle = np.arcsin(np.minimum(emitter.half_width / np.maximum(distances, 1e-30), 1.0))
    angle += half_cell + np.sqrt(2.0) / CELLS  # half the diagonal of a look's cell, where it is largest
    hidden = (towards @ directions.T >= np.cos(np.minimum(angle, np.pi))).any(axis=1)
    return hidden.reshape(CELLS, CELLS).astype(np.uint8)


def _surroundings(looks: list[np.ndarray], view: View) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (N, 3) of cells all around the light, and how far the closest thing in each is (N,),
    metres, infinite where maps along the axes of `view` know it."""
    at = (np.arange(LOOK_RESOLUTION) + 0.5) / LOOK_RESOLUTION * 2.0 - 1.0
    slopes = np.stack([*np.meshgrid(at, at), np.ones((LOOK_RESOLUTION, LOOK_RESOLUTION))], -1)
    length = np.linalg.norm(slopes, axis=-1)
    step = LOOK_RESOLUTION // CELLS
    directions, distances = [], []
    for look, (_, axes) in zip(looks, cube_axes(), strict=True):
        world = slopes @ np.array(axes)
        x, y, z = np.moveaxis(world @ np.array([view.right, view.up, view.forward]).T, -1, 0)
        known = np.maximum(np.abs(x), np.abs(y)) <= WIDEST_TANGENT * z
        distance = np.where(known, np.inf, look[0] * length)
        distances.append(distance.reshape(CELLS, step, CELLS, step).min(axis=(1, 3)).ravel())
        middles = world.reshape(CELLS, step, CELLS, step, 3).mean(axis=(1, 3)).reshape(-1, 3)
        directions.append(middles / np.linalg.norm(middles, axis=1, keepdims=True))
    return np.concatenate(directions), np.concatenate(distances)


def _cells(view: View) -> tuple[np.ndarray, float]:
    """Unit directions (CELLS^2, 3) of a table's cells, row by row, and how far at most a cell reaches from
    there, radians."""
    left, right, bottom, top = view.window
    share = (np.arange(CELLS) + 0.5) / CELLS
    x, y = np.meshgrid(left + share * (right - left), bottom + share * (top - bottom))
    slopes = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3)
    world = slopes @ np.array([view.right, view.up, view.forward])
    # An angle is no larger than the distance on the plane at depth 1.
    half = 0.5 * float(np.hypot(right - left, top - bottom)) / CELLS
    return world / np.linalg.norm(world, axis=1, keepdims=True), half
