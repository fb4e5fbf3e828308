"""What stands close to a spot or a point: gobos, barn doors, shades and window frames, against rays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import bpy
import numpy as np
from strata.addon.core.metrics import maximum, quantile
from strata.tests.support.figures import weighted_bias, weighted_rmse

from . import against_cycles
from .methods import Effect, accelerator_of, surface_of, traced
from .scenes import read

SIZE = (60, 45)
RAYS = 1024
"""From each point, for the truth: a noise of some .004 in its penumbra."""
HEIGHT_M = 3.0
"""Of the lamp above a ground of 12 m."""
RADII_M = (0.0, 0.05, 0.25, 0.5)
LAMPS = {
    "spot of 45 degrees": ("SPOT", {"spot_size": math.radians(45.0)}),
    "spot of 100 degrees": ("SPOT", {"spot_size": math.radians(100.0)}),
    "point": ("POINT", {}),
}

Mesh = tuple[np.ndarray, list[tuple[int, ...]]]


def _bars(bars: list[tuple[float, float, float, float, float]]) -> Mesh:
    """Level rectangles (x0, x1, y0, y1, z)."""
    corners = [((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)) for x0, x1, y0, y1, z in bars]
    faces = [tuple(range(4 * i, 4 * i + 4)) for i in range(len(bars))]
    return np.array(corners, float).reshape(-1, 3), faces


def tube(rings: list[tuple[float, float]], sides: int = 48) -> Mesh:
    """An open tube about the vertical through (radius, z) of each ring."""
    turn = np.arange(sides) / sides * 2.0 * np.pi
    points = [np.stack([r * np.cos(turn), r * np.sin(turn), np.full(sides, z)], 1) for r, z in rings]
    side = np.arange(sides)
    turned = (side + 1) % sides
    quads = [
        np.stack([side, turned, turned + sides, side + sides], 1) + ring * sides
        for ring in range(len(rings) - 1)
    ]
    faces = [tuple(quad) for quad in np.concatenate(quads).tolist()]
    return np.concatenate(points), faces


def gobo(size: float) -> Mesh:
    """A plate with 3 x 3 square holes, one `size` below the lamp."""
    edges = np.linspace(-1.5, 1.5, 7) * size
    bars = [
        (-3 * size, edges[0], -3 * size, 3 * size, -size),
        (edges[-1], 3 * size, -3 * size, 3 * size, -size),
    ]
    bars += [(edges[0], edges[-1], edge, 3 * size, -size) for edge in edges[-1:]]
    bars += [(edges[0], edges[-1], -3 * size, edge, -size) for edge in edges[:1]]
    for row in range(6):
        y0, y1 = edges[row], edges[row + 1]
        if row % 2:
            bars.append((edges[0], edges[-1], y0, y1, -size))
        else:
            bars += [(edges[i], edges[i + 1], y0, y1, -size) for i in range(1, 6, 2)]
    return _bars(bars)


def barn_doors(size: float) -> Mesh:
    """Four flaps around the lamp, hinged a little below it, that open by 20 degrees."""
    top, bottom, out = -0.3 * size, -1.8 * size, 1.5 * size * math.tan(math.radians(20.0))
    near, far = 1.1 * size, 1.1 * size + out
    flap = np.array([(near, -near, top), (near, near, top), (far, far, bottom), (far, -far, bottom)])
    turns = [np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    return np.concatenate([flap @ turn.T for turn in turns]), [
        tuple(range(4 * i, 4 * i + 4)) for i in range(4)
    ]


def cylinder(size: float) -> Mesh:
    """An open shade around the bulb."""
    return tube([(1.5 * size, 1.2 * size), (1.5 * size, -1.2 * size)])


def cone(size: float) -> Mesh:
    """An open shade that widens downward."""
    return tube([(1.2 * size, 0.8 * size), (2.4 * size, -1.2 * size)])


def window(size: float) -> Mesh:
    """A frame with a cross, upright before the lamp."""
    w, b, d = 1.6 * size, 0.15 * size, 1.3 * size
    upright = [(x, x + b, -w, w, 0) for x in (-w, -b / 2, w - b)]
    level = [(-w, w, y, y + b, 0) for y in (-w, -b / 2, w - b)]
    flat, faces = _bars(upright + level)
    return np.stack([flat[:, 0], np.full(len(flat), d), flat[:, 1]], 1), faces


def plate(_: float) -> Mesh:
    """A plate that covers the cone of a narrow spot, far from it."""
    return _bars([(-1.2, 1.2, -1.2, 1.2, -1.0)])


FIXTURES: dict[str, Callable[[float], Mesh]] = {
    "gobo": gobo,
    "barn doors": barn_doors,
    "cylinder": cylinder,
    "cone": cone,
    "window": window,
    "plate": plate,
}


def scene_of(lamp: str, fixture: str, radius_m: float) -> bpy.types.Scene:
    """The lamp above a ground, and what stands about it, in proportion to the lamp."""
    kind, settings = LAMPS[lamp]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    ground = np.array([(-6, -6, 0), (6, -6, 0), (6, 6, 0), (-6, 6, 0)], float)
    points, faces = FIXTURES[fixture](max(radius_m, 0.1))
    for name, corners, polygons in (
        ("Ground", ground, [(0, 1, 2, 3)]),
        ("Fixture", points + np.array([0.0, 0.0, HEIGHT_M]), faces),
    ):
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(corners.tolist(), [], polygons)
        scene.collection.objects.link(bpy.data.objects.new(name, mesh))
    data = bpy.data.lights.new("Light", kind)
    data.shadow_soft_size = radius_m
    for name, value in settings.items():
        setattr(data, name, value)
    light = bpy.data.objects.new("Light", data)
    light.location = (0.0, 0.0, HEIGHT_M)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    narrow = settings.get("spot_size", 3.0) < 1.0
    camera.location = (0.0, -2.6, 1.2) if narrow else (0.0, -7.5, 4.0)
    camera.rotation_euler = (math.radians(62.0 if narrow else 60.0), 0.0, 0.0)
    for made in (light, camera):
        scene.collection.objects.link(made)
    scene.camera = camera
    bpy.context.view_layer.update()
    return scene


@dataclass(frozen=True)
class CloseError:
    """Errors over all that the camera sees."""

    lamp: str
    fixture: str
    radius_m: float
    method: str
    rmse: float
    bias: float
    p99: float
    largest: float
    seconds: float


def measure(lamps, fixtures, radii, methods, size=SIZE) -> Iterator[CloseError]:
    """Each of these, at default settings but the method."""
    for lamp in lamps:
        for fixture in fixtures:
            for radius_m in radii:
                case = read(scene_of(lamp, fixture, radius_m), size)
                surface, _ = surface_of(case)
                truth, weight = traced(case, accelerator_of(case), surface, RAYS, seed=1)
                for method in methods:
                    effect = Effect(case, {"method": method})
                    seconds = effect()["total"]
                    errors = effect.visibility.ravel() - truth
                    figures = [
                        weighted_rmse(errors, weight),
                        weighted_bias(errors, weight),
                        quantile(errors, weight, 0.99),
                        maximum(errors, weight),
                    ]
                    yield CloseError(lamp, fixture, radius_m, method, *figures, seconds)


IN_CYCLES = (("point", "cylinder", 0.25), ("spot of 100 degrees", "cylinder", 0.25), ("point", "gobo", 0.25))


def by_cycles(samples: int, methods, size=SIZE) -> Iterator[tuple[tuple, str, against_cycles.Comparison]]:
    """Lamp, fixture and radius, method, and its layer against two renders of so many samples by Cycles."""
    settings = {method: {"soft_shadow": {"method": method}} for method in methods}
    for what in IN_CYCLES:
        for method, found in against_cycles.compare_all(scene_of(*what), samples, size, settings):
            yield what, method, found
