"""How wide a hull's ring is, without a grid: rays decide what is ink, and distances to the object's outline
in the window are worked out in float64."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import bpy
import numpy as np
import strata_kernels as kernels
from strata.addon.core.view import View
from strata.tests.effects.toon.hull_scenes import ball, box, cone, geometry_of, hull_of, sheet, torus, turned
from strata.tests.support.places import SAMPLES

LINE = 4.0  # pixels
SIDE = 220  # pixels of the image
TILT = 0.4  # radians, of a turntable's axis towards the eye


def silhouette(triangles: np.ndarray, view: View) -> np.ndarray:
    """(S, 2, 2) float64: ends in the window of edges where what faces the eye meets what does not, of open
    borders, and where triangles are too thin to face anywhere or two neighbours wind against each other.
    `triangles` (T, 3, 3) in the world."""
    triangles = np.asarray(triangles, np.float64)
    corners = triangles - np.array(view.eye)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards = np.array(view.forward) if view.orthographic else corners[:, 0]
    away = (normals * towards).sum(axis=1) > 0.0
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    thin = np.linalg.norm(normals, axis=1) < 1e-3 * longest**2
    _, welded = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    welded = welded.reshape(-1, 3)
    ends = np.stack([welded, np.roll(welded, -1, axis=1)], axis=2).reshape(-1, 2)
    places = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    real = ends[:, 0] != ends[:, 1]
    winding = np.where(ends[:, 0] < ends[:, 1], 1.0, -1.0)[real]
    ends, places = np.sort(ends[real], axis=1), places[real]
    sides, thin = np.repeat(away, 3)[real], np.repeat(thin, 3)[real]
    _, first, which = np.unique(ends, axis=0, return_index=True, return_inverse=True)
    count, facing_away = np.bincount(which), np.bincount(which, weights=sides)
    kept = (facing_away > 0) & (facing_away < count)
    kept |= (np.bincount(which, weights=winding) != 0) | (np.bincount(which, weights=thin) > 0)
    return in_window(places[first[kept]], view)


def in_window(points: np.ndarray, view: View) -> np.ndarray:
    """(..., 2) window coordinates of points (..., 3) relative to the eye."""
    x, y, depth = np.moveaxis(points @ np.array([view.right, view.up, view.forward]).T, -1, 0)
    depth = np.ones_like(depth) if view.orthographic else depth
    return np.stack([x / depth, y / depth], axis=-1)


def distances(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """(N,) from points (N, 2) to the nearest of the segments (S, 2, 2)."""
    nearest = np.full(len(points), np.inf)
    for start in range(0, len(edges), 256):
        a, b = edges[start : start + 256, 0], edges[start : start + 256, 1]
        side = b - a
        length = np.maximum((side * side).sum(axis=1), 1e-300)
        along = ((points @ side.T - (a * side).sum(axis=1)) / length).clip(0.0, 1.0)
        off = points[:, None] - (a + along[..., None] * side)
        nearest = np.minimum(nearest, np.sqrt((off * off).sum(axis=2)).min(axis=1))
    return nearest


def is_hit(geometry: kernels.Geometry, points: np.ndarray, view: View) -> np.ndarray:
    """(N,) bool: whether rays through window points (N, 2) meet anything."""
    right, up, forward = (np.array(axis) for axis in (view.right, view.up, view.forward))
    across = points[:, :1] * right + points[:, 1:] * up
    flat = np.zeros_like(across)
    origins, directions = (across, flat + forward) if view.orthographic else (flat, across + forward)
    tree = kernels.Accel(geometry, np.array(view.eye, np.float64))
    through = tree.transmittance(
        None,
        np.ascontiguousarray(origins, np.float32),
        np.ascontiguousarray(directions, np.float32),
        np.full(len(points), np.inf, np.float32),
    )
    return through == 0.0


def geometry_of_hull(corners: np.ndarray, view: View) -> kernels.Geometry:
    """Of triangle corners (3 T, 3) relative to the eye."""
    made, count = kernels.Geometry(), len(corners)
    made.add_material()
    made.add_mesh(corners, np.arange(count, dtype=np.int32), np.arange(0, count + 1, 3, dtype=np.int32))
    matrix = np.eye(4)
    matrix[:3, 3] = view.eye
    made.add_instance(0, matrix, 0, [0])
    return made


def ring(
    geometry: kernels.Geometry,
    triangles: np.ndarray,
    hull: np.ndarray,
    view: View,
    pixel: float,
    width: float,
    points: int = 3000,
) -> tuple[float, float]:
    """Distance in pixels, from the object's outline, of the nearest place without ink and of the farthest one
    with it: a ring of even width has its width for both. `triangles` (T, 3, 3) are the object's in the world,
    `hull` (3 T, 3) its hull's corners relative to the eye, `pixel` a pixel's side in the window.

    Places are random, a few to a square pixel of the ring: either may miss some hundredths of a pixel."""
    edges = silhouette(triangles, view)
    rng = np.random.default_rng(1)
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) + pixel
    chosen = rng.choice(len(edges), points, p=lengths / lengths.sum())
    at = edges[chosen, 0] + rng.random((points, 1)) * (edges[chosen, 1] - edges[chosen, 0])
    turn = rng.uniform(0.0, 2.0 * np.pi, points)
    # Most of the places lie near where the ring should end.
    near, anywhere = rng.uniform(0.85, 1.15, points), rng.uniform(0.0, 2.0, points)
    away = width * np.where(rng.random(points) < 0.8, near, anywhere)
    at = at + pixel * away[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    at = at[~is_hit(geometry, at, view)]
    off = distances(at, edges) / pixel
    inked = is_hit(geometry_of_hull(hull, view), at, view)
    least = float(off[~inked].min(initial=np.inf))
    return least, float(off[inked].max(initial=0.0))


@cache
def character():
    """The hero of the comic, all of it one mesh 2.6 m tall; positions (V, 3) and faces."""
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLES / "comic.blend"))
    parts = ("Suit", "Boot", "Glove", "Belt", "Head", "Chin", "Ear", "Hair", "Cape", "Collar")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    points, faces, count = [], [], 0
    for thing in (thing for thing in bpy.data.objects if thing.name.startswith(parts)):
        mesh = thing.evaluated_get(depsgraph).data
        local = np.zeros(3 * len(mesh.vertices), np.float32)
        mesh.attributes["position"].data.foreach_get("vector", local)
        matrix = np.array(thing.matrix_world)
        points.append(local.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3])
        faces += [tuple(count + vertex for vertex in polygon.vertices) for polygon in mesh.polygons]
        count += len(mesh.vertices)
    points = np.concatenate(points)
    low, high = points.min(axis=0), points.max(axis=0)
    return (2.6 / (high - low).max() * (points - 0.5 * (low + high))).astype(np.float32), faces


SHAPES: dict[str, Callable] = {
    "ball": ball,
    "torus": torus,
    "box": box,
    "cone": cone,
    "sheet": sheet,
    "character": character,
}


def ring_of(shape, turn: float, place=(0.0, 0.0, 0.0)) -> tuple[float, float]:
    """`ring` of a line LINE pixels wide around a shape on a turntable 6 m away, `place` metres beside the
    middle of the image."""
    positions, faces = shape
    matrix = turned(turn, TILT)
    matrix[:3, 3] = place
    window = tuple(place[axis] / 6.0 + side * 0.36 for axis in (0, 2) for side in (-1, 1))
    seen = View((0.0, -6.0, 0.0), (1, 0, 0), (0, 0, 1), (0, 1, 0), window, 0.1, 1e3)
    corners = np.concatenate(faces).astype(np.int32)
    starts = np.cumsum([0, *map(len, faces)]).astype(np.int32)
    triangles, _ = kernels.triangulate(positions, corners, starts)
    places = positions.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    geometry = geometry_of(shape, [matrix])
    hull = hull_of(geometry, seen, SIDE, LINE)
    return ring(geometry, places[corners[triangles]], hull, seen, 0.72 / SIDE, LINE)
