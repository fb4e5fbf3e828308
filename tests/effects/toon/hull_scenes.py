"""Shapes whose hulls are looked at, and the view that they are seen in."""

from __future__ import annotations

import math

import numpy as np
import strata_kernels as kernels
from strata.addon.core.view import View

UNTURNED = np.eye(4)


def view(eye=(0.0, -6.0, 0.0), window=0.3, orthographic=False) -> View:
    return View(
        eye, (1, 0, 0), (0, 0, 1), (0, 1, 0), (-window, window, -window, window), 0.1, 1e3, orthographic
    )


def turned(about_z: float, about_x: float = 0.3) -> np.ndarray:
    c, s = math.cos(about_z), math.sin(about_z)
    e, f = math.cos(about_x), math.sin(about_x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[1, 0, 0], [0, e, -f], [0, f, e]]) @ np.array(
        [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    )
    return matrix


def box():
    corners = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float32)
    return corners, [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def split_box():
    """Each face with corners of its own, as after a split: welding has to find them."""
    corners, faces = box()
    return corners[np.concatenate(faces)], np.arange(24).reshape(6, 4).tolist()


def revolved(profile, steps):
    """Rings of quads around z; `profile` is a list of (radius, height), closed if its ends are one."""
    turn = np.linspace(0, 2 * math.pi, steps, endpoint=False)
    rings = [np.stack([r * np.cos(turn), r * np.sin(turn), np.full(steps, h)], 1) for r, h in profile]
    faces = [
        (i * steps + j, i * steps + (j + 1) % steps, (i + 1) * steps + (j + 1) % steps, (i + 1) * steps + j)
        for i in range(len(profile) - 1)
        for j in range(steps)
    ]
    return np.concatenate(rings).astype(np.float32), faces


def ball():
    angle = np.linspace(-math.pi / 2, math.pi / 2, 49)
    radii = np.cos(angle)
    radii[[0, -1]] = 0.0  # the poles are one vertex each, once welded
    return revolved(list(zip(radii, np.sin(angle), strict=True)), 96)


def torus():
    angle = 2 * math.pi * (np.arange(49) % 48) / 48
    return revolved([(1.0 + 0.4 * math.cos(a), 0.4 * math.sin(a)) for a in angle], 96)


def cone():
    return revolved([(0.0, -1.0), (1.2, -1.0), (0.0, 1.5)], 12)


def sheet():
    return np.array([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], np.float32), [(0, 1, 2, 3)]


def geometry_of(shape, matrices=(UNTURNED,)) -> kernels.Geometry:
    positions, faces = shape
    geometry = kernels.Geometry()
    starts = np.cumsum([0, *map(len, faces)]).astype(np.int32)
    geometry.add_mesh(np.ascontiguousarray(positions), np.concatenate(faces).astype(np.int32), starts)
    geometry.add_material()
    for matrix in matrices:
        geometry.add_instance(0, np.ascontiguousarray(matrix), 0, [0])
    return geometry


def hull_of(
    geometry, seen: View, side, width, in_pixels=True, least=0.0, most=1e3, scales=(1.0,), thickness=()
):
    """Corners (3 T, 3) of the hull of instance 0 in an image `side` pixels high."""
    pixel = (seen.window[3] - seen.window[2]) / side
    return kernels.toon_hull(
        geometry, [0], seen.packed(), pixel, width, in_pixels, least, most, list(scales), list(thickness)
    )[0]
