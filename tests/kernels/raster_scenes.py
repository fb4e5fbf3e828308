"""Triangles, views and float64 brute force for the rasteriser's tests."""

from __future__ import annotations

import numpy as np
import strata_kernels as kernels
from strata.addon.core.surface import ATTRIBUTES
from strata.addon.core.view import View

ALL_ATTRIBUTES = list(ATTRIBUTES)


def down(window=(-1.0, 1.0, -1.0, 1.0), near=0.01, far=1e6, eye=(0.0, 0.0, 0.0), orthographic=False) -> View:
    """A view along -Z with X to the right, so that depth is the eye's z minus z."""
    axes = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)
    return View(eye, *axes, window, near, far, orthographic)


def turned_view(rng, near=0.1, far=100.0, orthographic=False, half=0.6) -> View:
    """A view from anywhere to anywhere, its window off centre and not square."""
    right, up, forward = (tuple(map(float, axis)) for axis in np.linalg.qr(rng.normal(size=(3, 3)))[0])
    eye = tuple(map(float, rng.normal(size=3)))
    return View(eye, right, up, forward, (-half, half, -half * 0.8, half * 0.7), near, far, orthographic)


def add_triangles(geometry, triangles, matrix=None, material=None, **arrays) -> int:
    """Adds (T, 3, 3) positions as separate triangles of one instance with object id 5."""
    positions = np.ascontiguousarray(np.reshape(triangles, (-1, 3)), np.float32)
    corners = np.arange(len(positions), dtype=np.int32)
    mesh = geometry.add_mesh(
        positions, corners, np.arange(0, len(positions) + 1, 3, dtype=np.int32), **arrays
    )
    material = geometry.add_material() if material is None else material
    return geometry.add_instance(mesh, np.eye(4) if matrix is None else matrix, 5, [material])


def opacity(geometry, **opacity) -> int:
    """Adds a material that is so opaque on both sides, to cameras and to shadow rays."""
    sides = (kernels.Opacity(**opacity),) * 2
    return geometry.add_material(sides, sides)


def everything(geometry: kernels.Geometry) -> np.ndarray:
    return np.ones(geometry.instance_count(), bool)


def pixel_rays(view, width, height, jitter=(0.0, 0.0)):
    """Origins and directions (height, width, 3) in view axes; the parameter along them is the depth.
    `jitter`: two numbers, or two arrays (height, width)."""
    left, right, bottom, top = view.window
    x = left + (np.arange(width)[None, :] + 0.5 + jitter[0]) * (right - left) / width
    y = bottom + (np.arange(height)[:, None] + 0.5 + jitter[1]) * (top - bottom) / height
    x, y = np.broadcast_arrays(x, y)
    zero, one = np.zeros_like(x), np.ones_like(x)
    if view.orthographic:
        return np.stack([x, y, zero], -1), np.stack([zero, zero, one], -1)
    return np.stack([zero, zero, zero], -1), np.stack([x, y, one], -1)


def brute_force(view, triangles, width, height, jitter=(0.0, 0.0)):
    """Every triangle against every pixel's ray in float64, with no clipping but by depth.

    Returns depths (T, height, width), inf where missed, and whether a hit is in doubt (T, height, width):
    within 1.5/256 pixel of an edge, or of where the plane meets the near or far plane, since outlines
    are snapped to 1/256 pixel.
    """
    doubt_pixels = 1.5 / 256
    origin, direction = pixel_rays(view, width, height, jitter)
    corners = view.to_view(np.asarray(triangles, np.float64))
    a, b, c = (corners[:, i, None, None] for i in range(3))
    normal = np.cross(b - a, c - a)
    pixel = (view.window[1] - view.window[0]) / width, (view.window[3] - view.window[2]) / height
    toward = np.array([0.0, 0.0, 1.0])
    with np.errstate(all="ignore"):
        t = ((a - origin) * normal).sum(-1) / (direction * normal).sum(-1)
        side = np.sign(normal[..., 2] if view.orthographic else (a * normal).sum(-1))
        margins = []  # pixels inside each edge
        for p, q in ((a, b), (b, c), (c, a)):
            plane = np.cross(toward, q - p) if view.orthographic else np.cross(p, q)
            value = ((origin - p) * plane if view.orthographic else direction * plane).sum(-1) * side
            margins.append(value / np.hypot(plane[..., 0] * pixel[0], plane[..., 1] * pixel[1]))
        margin = np.min(margins, axis=0)
        depths = np.where((margin >= 0) & (t >= view.near) & (t <= view.far), t, np.inf)
        # 1 / depth (perspective) or depth (orthographic) is affine over the image: its change a pixel.
        if view.orthographic:
            value, limits = t, (view.near, view.far)
            change = np.hypot(normal[..., 0] * pixel[0], normal[..., 1] * pixel[1]) / np.abs(normal[..., 2])
        else:
            value, limits = 1 / t, (1 / view.near, 1 / view.far)
            distance = np.abs((a * normal).sum(-1))
            change = np.hypot(normal[..., 0] * pixel[0], normal[..., 1] * pixel[1]) / distance
        cut = [np.abs(value - limit) <= doubt_pixels * change for limit in limits]
        doubtful = (np.abs(margin) < doubt_pixels) | ((cut[0] | cut[1]) & (margin > -doubt_pixels))
    return depths, doubtful


def random_triangles(rng, view, kind, count):
    """World-space triangles (count, 3, 3) f32 about a view.

    Kinds: ordinary, sliver, near (crossing the near plane), tiny, huge.
    """
    middle = np.concatenate([rng.uniform(-2, 2, (count, 1, 2)), rng.uniform(1.0, 6.0, (count, 1, 1))], -1)
    if kind == "sliver":
        along = rng.normal(size=(count, 1, 3)) * 3.0
        corners = middle + along * np.array([-1.0, 0.1, 1.0])[:, None]
        corners += rng.normal(size=(count, 3, 3)) * 0.02
    else:
        size = {"ordinary": 1.0, "near": np.array([1.0, 1.0, 5.0]), "tiny": 0.05, "huge": 1e4}[kind]
        corners = middle + rng.normal(size=(count, 3, 3)) * size
    axes = np.array([view.right, view.up, view.forward])
    return (corners @ axes + np.array(view.eye)).astype(np.float32)


def sheet(rng, columns, rows, extent=1.6, wobble=0.3):
    """A triangulated grid over more than the window of `down()`: positions (V, 3) f32, triangles (T, 3) i32.

    Vertices are moved about without folding over, diagonals and windings are random.
    """
    x, y = np.meshgrid(np.linspace(-extent, extent, columns + 1), np.linspace(-extent, extent, rows + 1))
    points = np.stack([x, y], -1)
    points += rng.uniform(-wobble, wobble, points.shape) * 2 * extent / np.array([columns, rows])
    positions = np.concatenate([points, -rng.uniform(1.0, 1.2, (*points.shape[:2], 1))], -1).reshape(-1, 3)
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    flip = (rng.random(len(a)) < 0.5)[:, None]
    first = np.where(flip, np.stack([a, b, d], -1), np.stack([a, b, c], -1))
    second = np.where(flip, np.stack([b, c, d], -1), np.stack([a, c, d], -1))
    triangles = np.stack([first, second], 1).reshape(-1, 3)
    turned = rng.random(len(triangles)) < 0.5
    triangles[turned] = triangles[turned][:, ::-1]
    return positions.astype(np.float32), triangles.astype(np.int32)


def cone_about_the_eye(seed: int) -> np.ndarray:
    """(40, 3 corners, 3) float32, closed: its apex ahead of an eye at the origin, its rim behind and up to
    1e6 m away."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 40))
    radius = 10.0 ** rng.uniform(1.0, 6.0, 40)
    rim = np.stack([np.cos(angle) * radius, np.sin(angle) * radius, 2.0 * radius], -1)
    apex = np.broadcast_to([rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), -1.0], rim.shape)
    return np.stack([apex, rim, np.roll(rim, -1, 0)], 1).astype(np.float32)
