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

RESOLUTION = 64  # texels, a side of the depth maps around the light
SMALLEST_RADIUS_M = 1e-9  # smaller lamps are points: hidden whole, or not at all
CELLS = 20  # a side of the tables

LEAST_SHARE = 0.0075
"""Share of the light: where less of it is hidden by what maps do not know, rays would hardly better them."""


def reach_m(emitter: Emitter) -> float:
    """How far from the light's centre at most something is that hides a part of it from a point and that
    the maps along the point's axis cannot know: it is seen more than WIDEST_TANGENT from the axis, and so at
    that angle less the point's from the point's own direction, and hides by asin(radius / distance)."""
    farthest = math.atan(FACE_TANGENT * math.sqrt(2.0))
    if emitter.cos_cone > WIDEST_SPOT:
        farthest = math.acos(emitter.cos_cone)
    return emitter.half_width / math.sin(math.atan(WIDEST_TANGENT) - farthest)


def surrounding_views(emitter: Emitter) -> list[tuple[str, View]]:
    """Six views of all that is close to the light."""
    near, far = 1e-3 * emitter.half_width, reach_m(emitter)
    window = (-1.0, 1.0, -1.0, 1.0)
    return [(name, View(emitter.centre, *axes, window, near, far)) for name, axes in cube_axes()]


def table(device, depths: list[np.ndarray], emitter: Emitter, view: View) -> np.ndarray:
    """(CELLS, CELLS) uint8 over the window of `view`, rows from the bottom: 1 where what is close to the
    light but out of the view may hide a part of it from points in that direction that nothing in the view
    hides. `depths`: a depth map of each of `surrounding_views`, (1, RESOLUTION, RESOLUTION) float32,
    metres. `device` is the CPU."""
    places, known = _surroundings(depths, view)
    if known.all():
        return np.zeros((CELLS, CELLS), np.uint8)
    radii = np.float32(places / emitter.half_width)
    shares = device.kernels.soft_shadow_unknown_shares(radii, known, np.float32(_towards(view)))
    doubtful = (shares > LEAST_SHARE).reshape(CELLS + 1, CELLS + 1)
    corners = doubtful[1:, 1:] | doubtful[1:, :-1] | doubtful[:-1, 1:] | doubtful[:-1, :-1]
    return corners.astype(np.uint8)


def _surroundings(depths: list[np.ndarray], view: View) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 3) on what is closest to the light, from its centre in the world, metres, and whether maps
    along the axes of `view` know each (N,)."""
    at = (np.arange(RESOLUTION) + 0.5) / RESOLUTION * 2.0 - 1.0
    slopes = np.stack([*np.meshgrid(at, at), np.ones((RESOLUTION, RESOLUTION))], -1)
    found = []
    for depth, (_, axes) in zip(depths, cube_axes(), strict=True):
        hit = np.isfinite(depth[0])
        found.append((slopes[hit] * depth[0][hit][:, None]) @ np.array(axes))
    places = np.concatenate(found)
    x, y, z = (places @ np.array([view.right, view.up, view.forward]).T).T
    return places, np.maximum(np.abs(x), np.abs(y)) <= WIDEST_TANGENT * z


def _towards(view: View) -> np.ndarray:
    """Unit directions ((CELLS + 1)^2, 3) to the corners of a table's cells, row by row."""
    left, right, bottom, top = view.window
    x, y = np.meshgrid(np.linspace(left, right, CELLS + 1), np.linspace(bottom, top, CELLS + 1))
    slopes = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3)
    world = slopes @ np.array([view.right, view.up, view.forward])
    return world / np.linalg.norm(world, axis=1, keepdims=True)
