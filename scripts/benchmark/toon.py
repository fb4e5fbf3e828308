"""Toon: what the comic costs at 1080p, how wrong its masks are at eight samples, and how even its lines."""

from __future__ import annotations

import math
import time
from statistics import median

import numpy as np
import strata_kernels
from strata.addon.bake import BakeJob, Options, read_scene
from strata.addon.core.view import View

from .document import milliseconds, table

SIZE = (1920, 1080)
PLAIN = {"shadows": False}
TURNS = 24


def _bake(scene, size, samples: int, probes: int, backend: str = "cpu"):
    """A finished bake, and the seconds from its arrays to its layers."""
    options = Options(("toon",), backend, samples, probes, {"toon": PLAIN})
    *read, _ = read_scene(scene, scene.view_layers[0], options, size=size)
    started = time.perf_counter()
    baked = BakeJob(*read, options).result()
    return baked, time.perf_counter() - started


def speed(scene, repeats: int, size=SIZE) -> str:
    """Time of each step of one sample."""
    runs: dict[str, list[float]] = {}
    for _ in range(repeats):
        baked, seconds = _bake(scene, size, 1, 0)
        for step in baked.report.to_json()["steps"]:
            runs.setdefault(step["name"], []).append(step["seconds"])
        runs.setdefault("all", []).append(seconds)
    rows = [[name, milliseconds(median(values)), milliseconds(min(values))] for name, values in runs.items()]
    title = (
        f"`comic` at {size[0]}x{size[1]}, one sample, no cast shadows, from the scene's arrays to the layers."
    )
    return f"{title}\n\n{table(['step', 'median ms', 'best ms'], rows)}"


def masks(scene, size=(960, 540), samples: int = 8, probes: int = 4096) -> str:
    """Errors against 64 rays a pixel. Edges are the pixels whose samples differ at all."""
    baked, _ = _bake(scene, size, samples, probes)
    rows = []
    for layer in baked.layers.layers:
        error = next(each for each in baked.layers.report["layers"] if each["name"] == layer.name)["error"]
        values = layer.pixels.reshape(*layer.pixels.shape[:2], -1)
        grey = (np.abs(np.diff(values, axis=0)).max(axis=2) > 1e-3)[:, :-1]
        grey |= (np.abs(np.diff(values, axis=1)).max(axis=2) > 1e-3)[:-1]
        edges = float(grey.mean())
        rows.append(
            [
                layer.name,
                f"{100 * edges:.1f}%",
                f"{100 * error['value']:.2f}%",
                f"{100 * error['value'] / max(edges, 1e-9):.1f}%",
                f"{error['mean_absolute_error']:.4f}",
                f"{error['mean_absolute_error'] / max(edges, 1e-9):.4f}",
                f"{error['bias']:+.4f}",
                f"{error['max']:.2f}",
            ]
        )
    header = [
        "layer",
        "edge pixels",
        "off by over 1/8",
        "of edges",
        "mean error",
        "at edges",
        "bias",
        "largest",
    ]
    title = f"`comic` at {size[0]}x{size[1]}, {samples} samples, against 64 rays in each of {probes} pixels."
    return f"{title}\n\n{table(header, rows)}"


def _box():
    corners = [(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return np.array(corners, np.float32), faces


def _torus(rings: int = 64, sides: int = 32):
    u, v = np.meshgrid(np.arange(rings) / rings, np.arange(sides) / sides, indexing="ij")
    u, v = 2 * math.pi * u, 2 * math.pi * v
    reach = 1.0 + 0.4 * np.cos(v)
    points = np.stack([reach * np.cos(u), reach * np.sin(u), 0.4 * np.sin(v)], -1).reshape(-1, 3)
    at = lambda i, j: (i % rings) * sides + j % sides  # noqa: E731
    faces = [
        (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)) for i in range(rings) for j in range(sides)
    ]
    return points.astype(np.float32), faces


def evenness(width: float = 4.0, fine: int = 4, side: int = 220) -> str:
    """Width of a hull's ring over a turntable, in pixels: of each pixel at its outer rim, the distance to the
    object. Drawn `fine` times as fine."""
    rows = []
    for name, shape in (("box", _box()), ("torus", _torus())):
        found = [_ring(shape, turn, width * fine, side * fine) / fine for turn in np.arange(TURNS) / TURNS]
        every = np.concatenate(found)
        means = [float(each.mean()) for each in found]
        low, high = np.quantile(every, (0.01, 0.99))
        rows.append(
            [
                name,
                f"{min(means):.2f} to {max(means):.2f}",
                f"{low:.2f} to {high:.2f}",
                f"{every.min():.2f}",
                f"{every.max():.2f}",
            ]
        )
    header = ["object", "mean of a view", "98% of the rim", "least", "most"]
    every = f"each distance is exact to 1/{2 * fine} pixel"
    title = f"A line {width:g} pixels wide, {TURNS} views of a turntable; {every}."
    return f"{title}\n\n{table(header, rows)}"


def _ring(shape, turn: float, width: float, side: int) -> np.ndarray:
    positions, faces = shape
    c, s = math.cos(2 * math.pi * turn), math.sin(2 * math.pi * turn)
    e, f = math.cos(0.4), math.sin(0.4)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[1, 0, 0], [0, e, -f], [0, f, e]]) @ np.array(
        [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    )
    view = View((0, -6, 0), (1, 0, 0), (0, 0, 1), (0, 1, 0), (-0.36, 0.36, -0.36, 0.36), 0.1, 1e3)
    drawn = []
    for at, corners, starts in (
        _object(positions, faces, matrix),
        _hull(positions, faces, matrix, view, width, side),
    ):
        geometry = strata_kernels.Geometry()
        geometry.add_material()
        geometry.add_mesh(at, corners, starts)
        moved = np.eye(4)
        moved[:3, 3] = view.eye
        geometry.add_instance(0, moved, 0, [0])
        seen = strata_kernels.raster_surface(
            geometry, np.ones(1, bool), view.packed(), side, side, attributes=["depth"]
        )
        drawn.append(seen["depth"])
    mask, ink = np.isfinite(drawn[0]), drawn[1] < drawn[0]
    whole = mask | ink
    rim = (
        ink
        & ~mask
        & ~(np.roll(whole, 1, 0) & np.roll(whole, -1, 0) & np.roll(whole, 1, 1) & np.roll(whole, -1, 1))
    )
    border = mask & ~(np.roll(mask, 1, 0) & np.roll(mask, -1, 0) & np.roll(mask, 1, 1) & np.roll(mask, -1, 1))
    outer, inner = np.argwhere(rim).astype(np.float32), np.argwhere(border).astype(np.float32)
    # Rim and border are pixels wide themselves: half of one at each end.
    return np.array([np.sqrt(((inner - each) ** 2).sum(axis=1).min()) for each in outer])


def _inner(mask: np.ndarray) -> np.ndarray:
    """Pixels whose four neighbours are in it too."""
    return np.logical_and.reduce([np.roll(mask, step, axis) for step in (1, -1) for axis in (0, 1)])


def _object(positions, faces, matrix):
    at = positions @ matrix[:3, :3].T.astype(np.float32) + np.array([0, 6, 0], np.float32)
    starts = np.cumsum([0, *map(len, faces)]).astype(np.int32)
    return np.ascontiguousarray(at, np.float32), np.concatenate(faces).astype(np.int32), starts


def _hull(positions, faces, matrix, view, width, side):
    geometry = strata_kernels.Geometry()
    geometry.add_material()
    starts = np.cumsum([0, *map(len, faces)]).astype(np.int32)
    geometry.add_mesh(positions, np.concatenate(faces).astype(np.int32), starts)
    geometry.add_instance(0, matrix, 0, [0])
    pixel = (view.window[3] - view.window[2]) / side
    corners = strata_kernels.toon_hull(geometry, [0], view.packed(), pixel, width, True, 0.0, 1e3, [1.0])[0]
    count = len(corners)
    return corners, np.arange(count, dtype=np.int32), np.arange(0, count + 1, 3, dtype=np.int32)


def tables(scene, quick: bool) -> str:
    """All three."""
    size = (320, 180)
    parts = [
        speed(scene, 1 if quick else 9, size if quick else SIZE),
        masks(scene, size, probes=256) if quick else masks(scene),
        evenness(side=80) if quick else evenness(),
    ]
    return "\n\n".join(parts)
