"""An empty flat floor, which nothing shadows: V is 1 at every point that a lamp above it lights.

It holds whatever the floor's tilt and triangles, the scene's scale, the eye's distance and the device. Depths
of the floor in a map and of its points come from different float32 numbers: a bias too small for their
rounding shows as black points, or as a black floor. Eyes and lamps stand off the float32 grid.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.surface import Chunk
from strata.addon.core.view import View
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared.steps import LAYERED_DEPTH, SURFACE
from strata.addon.effects.soft_shadow.steps import BACKPROJECT, PREPARE
from strata.addon.effects.soft_shadow.views import light_views
from strata.tests.support.gpu_scenes import gpu_device, matrix_of, scene_of, triangle_mesh

POINTS = ("position", "geometric_normal", "shading_normal", "instance")
SIZE = (64, 36)
MAP = 128  # texels a side
KINDS = ("point", "spot", "rectangle", "ellipse", "facing disk", "sun")
HALF = 8.0  # of the floor, as all lengths below in units of the scene's scale


def tilted(angle: float) -> np.ndarray:
    """(3, 3), about two axes."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def floor(cells: int, half: float) -> np.ndarray:
    """(T, 3, 3) triangles of cells x cells squares."""
    side = np.linspace(-half, half, cells + 1)
    x, y = np.meshgrid(side, side)
    at = np.stack([x, y, np.zeros_like(x)], -1)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    return np.concatenate([np.stack(corners, -2).reshape(-1, 3, 3) for corners in ([a, b, c], [a, c, d])])


def camera(rng, scale: float, orthographic: bool) -> View:
    eye = np.array([0.0, -6.0, 5.0]) + rng.uniform(-0.5, 0.5, 3)
    forward = -eye / np.linalg.norm(eye)
    right = np.array([1.0, 0.0, 0.0])
    half = 4.0 * scale if orthographic else 0.5
    window = (-half, half, -0.56 * half, 0.56 * half)
    axes = tuple(right), tuple(np.cross(right, forward)), tuple(forward)
    return View(tuple(eye * scale), *axes, window, 0.01 * scale, 1e3 * scale, orthographic)


def lamp(rng, kind: str, scale: float, turned: np.ndarray) -> Emitter:
    """Over the floor, near or far, straight down onto it or slanted."""
    height = math.exp(rng.uniform(math.log(0.03), math.log(5.0)))
    size = math.exp(rng.uniform(math.log(0.01), math.log(0.5))) * min(1.0, 0.5 * height)
    slant = rng.uniform(-0.5, 0.5, 2) * (rng.random() < 0.5)
    down = turned @ (np.array([*slant, -1.0]) / math.hypot(*slant, 1.0))
    right = np.cross(down, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    axes = tuple(right), tuple(np.cross(right, down)), tuple(down)
    place = tuple(turned @ np.array([*rng.uniform(-2.5, 2.5, 2), height]) * scale)
    of_kind = {
        "rectangle": EmitterKind.RECTANGLE,
        "ellipse": EmitterKind.ELLIPSE,
        "facing disk": EmitterKind.FACING_DISK,
        "sun": EmitterKind.DISTANT_DISK,
    }.get(kind, EmitterKind.SPHERE)
    if kind == "sun":
        return Emitter(of_kind, (0.0, 0.0, 0.0), *axes, 0.1 * size, 0.1 * size)
    emitter = Emitter(of_kind, place, *axes, size * scale, size * scale)
    return replace(emitter, cos_cone=0.6, blend=0.3) if kind == "spot" else emitter


def visibilities(backend, kind, method, scale, orthographic, lamps=6, tilt=0.0, cells=1, far=0.0):
    """V (lamps, points) where there is floor, which lies `far` from the world's origin."""
    device = CpuDevice() if backend == "cpu" else gpu_device()
    rng = np.random.default_rng(KINDS.index(kind))
    turned, moved = tilted(tilt), np.array([far, 2.0 * far, 0.0])
    device.set_scene(
        *scene_of([triangle_mesh(floor(cells, HALF * scale))], [(0, matrix_of(turned, moved), 1, (0,))])
    )
    view = camera(rng, scale, orthographic)
    view = replace(view, eye=tuple(np.array(view.eye) + moved))
    chunk = Chunk(*SIZE, 0, SIZE[1], 0, (0.1, 0.2))
    surface = SURFACE.twin(device.name)(
        device, device.geometry(), view, frozenset([0]), chunk, frozenset(POINTS)
    )
    host = device.to_host(surface)
    seen = host["instance"] >= 0
    assert seen.mean() > 0.5
    places = host["position"][seen] + np.array(view.eye)
    receivers = np.array([[places.min(axis=0), places.max(axis=0)]])
    # Deeper than it is: a flat box under everything would be known to cast no shadow.
    box = np.array([[moved - 1.1 * HALF * scale, moved + 1.1 * HALF * scale]])
    found = []
    for _ in range(lamps):
        emitter = lamp(rng, kind, scale, turned)
        if kind != "sun":
            emitter = replace(emitter, centre=tuple(np.array(emitter.centre) + moved))
        views = [of_light for _, of_light in light_views(emitter, box, receivers)[0]]
        assert views
        found.append(visibility(device, surface, views, emitter, view.eye, method)[seen])
    return np.array(found)


def visibility(device, surface, views, emitter: Emitter, eye, method: str) -> np.ndarray:
    """V at the points of a surface, by maps of all there is."""
    maps, geometry, everything = [], device.geometry(), frozenset([0])
    for view in views:
        depths = LAYERED_DEPTH.twin(device.name)(device, geometry, view, everything, 3, MAP, MAP)
        bias = {"gradient_scale": 1.0, "gradient_cap_m": 1e9}
        maps.append(PREPARE.twin(device.name)(device, depths, view, **bias))
    settings = {"max_samples": 512, "refinements": 1, "spacing": 1, "maps": len(maps)}
    shadow = BACKPROJECT.twin(device.name)(
        device, surface, *maps, eye=eye, emitter=emitter, method=method, **settings
    )
    return device.to_host(shadow)["visibility"]


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e5])
@pytest.mark.parametrize("method", ["area", "bitmask"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_level_floor_shadows_nothing(backend, kind, method, scale, orthographic):
    assert (visibilities(backend, kind, method, scale, orthographic) == 1.0).all()


@pytest.mark.parametrize(("tilt", "cells", "far"), [(3e-4, 1, 0.0), (0.05, 9, 1e4), (0.3, 1, 0.0)])
@pytest.mark.parametrize("method", ["area", "bitmask", "hybrid"])
@pytest.mark.parametrize("kind", ["point", "rectangle", "sun"])
def test_nor_does_a_tilted_one(backend, kind, method, tilt, cells, far):
    found = visibilities(backend, kind, method, 1.0, False, tilt=tilt, cells=cells, far=far)
    assert (found == 1.0).all()


@pytest.mark.parametrize("method", ["area", "bitmask"])
@pytest.mark.parametrize("kind", ["rectangle", "sun"])
def test_points_in_the_middles_of_texels_are_not_shadowed_by_those(backend, kind, method):
    """There nothing but rounding decides whether the texel is above the point: its direction says nothing."""
    device = CpuDevice() if backend == "cpu" else gpu_device()
    device.set_scene(*scene_of([triangle_mesh(floor(1, HALF))]))
    rng = np.random.default_rng(1)
    down = tuple(np.eye(3)[0]), tuple(np.eye(3)[1]), (0.0, 0.0, -1.0)
    middle = (np.arange(MAP) + 0.5) / MAP
    for height in np.geomspace(0.03, 30.0, 12):
        centre = tuple(np.array([*rng.uniform(-1.0, 1.0, 2), height]))
        half = 1.0 if kind == "sun" else 1.0 / height
        window = (-half, half, -half, half)
        view = View(centre, *down, window, 0.01 * height, 2.0 * height, kind == "sun")
        of_kind = EmitterKind.DISTANT_DISK if kind == "sun" else EmitterKind.RECTANGLE
        emitter = Emitter(of_kind, centre, *down, 0.01, 0.01)
        x, y = np.meshgrid(*(centre[axis] + (2.0 * middle - 1.0) for axis in (0, 1)))
        eye = tuple(rng.uniform(3.0, 9.0, 3))
        normals = np.broadcast_to(np.array([0.0, 0.0, 1.0], np.float32), (MAP, MAP, 3)).copy()
        position = (np.stack([x, y, np.zeros_like(x)], -1) - eye).astype(np.float32)
        surface = {"position": position, "geometric_normal": normals, "shading_normal": normals}
        surface = device.from_host(surface) if backend == "gpu" else surface
        assert (visibility(device, surface, [view], emitter, eye, method) == 1.0).all()
