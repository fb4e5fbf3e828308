"""Extremes of soft shadow: a plate over a ground, against closed forms (tests/support/closed_forms.py)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from strata.addon.core.arrays import MeshArrays
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.surface import Chunk
from strata.addon.core.view import View
from strata.addon.effects.shared.steps import LAYERED_DEPTH, SURFACE
from strata.addon.effects.soft_shadow import steps
from strata.addon.effects.soft_shadow.views import light_views, too_far
from strata.tests.effects.extremes import Row
from strata.tests.effects.soft_shadow.scenes import GROUND, LOW, ground_points, lamp
from strata.tests.support.closed_forms import visibility
from strata.tests.support.gpu_scenes import scene_of

TRUTH = "closed form"
RESOLUTION, LAYERS, MAX_SAMPLES = 512, 3, 512
BOUND = 0.01
"""Weighted RMSE; ten times what a map of this resolution leaves of a plate's penumbra."""
HARD_BOUND = 0.06
"""Where a penumbra is narrower than a texel: 0.003 of the points lie within half a texel of its edge, and
such a point may be wrong by all of it."""
VAST_BOUND = 0.1
"""Where a light is so large that a small part of it is what matters: its 256 samples are spread over all of
it, so that a plate's shadow, here 0.06 deep, may be missed. No closer than leaving it out."""
SMALL = 1e-5
"""Half sizes below this have hard shadows for the truth: closed forms in double precision cancel."""
POINTS = ("position", "geometric_normal", "shading_normal")


def _mesh(polygon: np.ndarray, origin: np.ndarray) -> tuple[MeshArrays, np.ndarray]:
    corners = np.arange(len(polygon), dtype=np.int32)
    starts = np.array([0, len(polygon)], np.int32)
    matrix = np.eye(4)
    matrix[:3, 3] = origin
    return MeshArrays(np.ascontiguousarray(polygon, np.float32), corners, starts), matrix


def _found(device, polygons, emitter: Emitter, origin: np.ndarray, points, camera: View | None):
    """Visibility (N,) at points (N, 3) relative to `origin`, and these: those that `camera` sees."""
    made = [_mesh(polygon, origin) for polygon in polygons]
    instances = [(index, matrix, 1, (0,)) for index, (_, matrix) in enumerate(made)]
    outline, arrays = scene_of([mesh for mesh, _ in made], instances)
    device.set_scene(outline, arrays)
    geometry, everything = device.geometry(), frozenset(range(len(made)))
    if camera is None:
        up = np.tile(np.float32([0.0, 0.0, 1.0]), (len(points), 1))[None]
        surface = {"position": points.astype(np.float32)[None], "geometric_normal": up, "shading_normal": up}
        shown, eye = np.ones(len(points), bool), origin
    else:
        chunk = Chunk(64, 48, 0, 48, 0, (0.0, 0.0))
        wanted = frozenset({*POINTS, "instance"})
        surface = SURFACE.twin(device.name)(device, geometry, camera, everything, chunk, wanted)
        surface = device.to_host(surface)
        shown, eye = surface["instance"].ravel() == 0, np.array(camera.eye)
        points = surface["position"].reshape(-1, 3).astype(np.float64) + eye - origin
    boxes = np.array([(polygon.min(axis=0), polygon.max(axis=0)) for polygon in polygons]) + origin
    world = points[shown] + origin
    views, _ = light_views(emitter, boxes, np.array([[world.min(axis=0), world.max(axis=0)]]))
    size = RESOLUTION, RESOLUTION
    maps = [
        steps.PREPARE.twin(device.name)(
            device,
            LAYERED_DEPTH.twin(device.name)(device, geometry, view, everything, LAYERS, *size),
            view=view,
            gradient_scale=1.0,
            gradient_cap_m=1e9,
        )
        for _, view in views
    ]
    values = steps.BACKPROJECT.twin(device.name)(
        device,
        device.from_host({name: surface[name] for name in POINTS}),
        *maps,
        eye=tuple(eye),
        emitter=emitter,
        method="bitmask",
        max_samples=MAX_SAMPLES,
        refinements=1,
        spacing=1,
        maps=len(maps),
    )
    return device.to_host(values)["visibility"].ravel()[shown], points[shown]


def _truth(emitter: Emitter, points: np.ndarray, plate: np.ndarray, origin: np.ndarray):
    """V (N,) and its weight; hard where the light is a point or nearly."""
    centre = np.array(emitter.centre) - origin
    if emitter.kind == EmitterKind.DISTANT_DISK or emitter.half_width > SMALL * np.linalg.norm(centre):
        up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        return visibility(replace(emitter, centre=tuple(centre)), points, up, [plate])
    to = centre - points
    share = (plate[0, 2] - points[:, 2]) / to[:, 2]
    at = points[:, :2] + share[:, None] * to[:, :2]
    low, high = plate.min(axis=0)[:2], plate.max(axis=0)[:2]
    return 1.0 - ((at > low) & (at < high)).all(axis=1), to[:, 2] ** 2 / (to**2).sum(axis=1) ** 3


def _row(
    devices,
    extreme,
    emitter,
    polygons=(GROUND, LOW),
    plate=LOW,
    origin=(0.0, 0.0, 0.0),
    points=None,
    camera=None,
    bound=BOUND,
) -> Row:
    origin = np.array(origin, np.float64)
    points = ground_points(count=31) if points is None else points
    world = points + origin
    if refused := too_far(emitter, np.array([world.min(axis=0), world.max(axis=0)])):
        return Row(extreme, TRUTH, {}, bound, refused)
    errors = {}
    for device in devices:
        found, at = _found(device, polygons, emitter, origin, points, camera)
        truth, weight = _truth(emitter, at, plate, origin)
        square = (weight * (found - truth) ** 2).sum() / weight.sum()
        errors[device.name] = math.sqrt(square) if np.isfinite(found).all() else math.nan
    return Row(extreme, TRUTH, errors, bound)


def _sizes(devices) -> Iterator[Row]:
    for half in (0.0, 1e-6, 1e-3, 0.05, 0.5, 2.0, 20.0, 1e3):
        bound = HARD_BOUND if half < 0.01 else BOUND if half < 10.0 else VAST_BOUND
        yield _row(
            devices,
            f"a rectangle of {2 * half:g} m, 4 m above a ground of 12 m",
            lamp(half=(half, half)),
            bound=bound,
        )
    for half in (1e-6, 0.05, 1.0, 1e3):
        sun = lamp(EmitterKind.DISTANT_DISK, centre=(0.0, 0.0, 0.0), half=(half, half))
        bound = HARD_BOUND if half < 0.01 else BOUND if half < 10.0 else VAST_BOUND
        yield _row(devices, f"a sun of {2 * math.degrees(math.atan(half)):.3g} degrees", sun, bound=bound)


def _distances(devices) -> Iterator[Row]:
    points = ground_points(count=31)
    for distance in (1e-3, 1e-1, 1e1, 1e3, 1e6, 1e9, 1e10):
        scale = distance / 4.0
        emitter = lamp(centre=(0.0, 0.0, distance), half=(0.5 * scale, 0.5 * scale))
        name = f"the lamp {distance:g} m away and all in proportion"
        yield _row(devices, name, emitter, (GROUND * scale, LOW * scale), LOW * scale, points=points * scale)
    for distance in (1e2, 1e4, 1e6, 1e9):
        emitter = lamp(centre=(0.0, 0.0, distance), half=(0.125 * distance,) * 2)
        yield _row(devices, f"only the lamp {distance:g} m away, as large to the eye as at 4 m", emitter)


def _close(devices) -> Iterator[Row]:
    """A plate so close to a point that it hides the rim from points that see it far aside."""
    points = ground_points(half=3.0, count=31)
    for kind, shape in ((EmitterKind.FACING_DISK, "disk"), (EmitterKind.SPHERE, "sphere")):
        for radius, share in ((0.01, 2.0), (0.1, 1.2), (0.1, 5.0), (0.5, 1.2), (0.5, 3.0)):
            size = radius * max(share, 1.5)
            plate = LOW * (size, size, 0.0) + (0.0, 0.0, 4.0 - share * radius)
            name = f"a {shape} of {radius:g} m, a plate {share:g} radii below it"
            yield _row(
                devices, name, lamp(kind, half=(radius, radius)), (GROUND, plate), plate, points=points
            )


def _places(devices) -> Iterator[Row]:
    for offset in (1e3, 1e5, 1e7, 1e9):
        origin = offset, -offset, offset
        emitter = lamp(centre=(offset, -offset, offset + 4.0))
        yield _row(devices, f"everything {offset:g} m off in x, y and z", emitter, origin=origin)


def _slivers(devices) -> Iterator[Row]:
    x0, x1, z = LOW[0, 0], LOW[2, 0], LOW[0, 2]
    for aspect in (1e4, 1e8):
        thin = np.array([[x0, 0.0, z], [x1, 0.0, z], [x1, 1.0 / aspect, z], [x0, 1.0 / aspect, z]])
        yield _row(devices, f"a plate of aspect {aspect:g}", lamp(), (GROUND, thin), thin)
        # Corners along one side, as close as the aspect says: triangulating makes slivers of them.
        close = np.linspace(0.0, 1.0, 9)[1:-1, None] * [0.0, 1.0 / aspect, 0.0]
        fan = np.concatenate([LOW[:2], LOW[1:2] + close, LOW[2:]])
        yield _row(devices, f"a plate of triangles of aspect {aspect:g}", lamp(), (GROUND, fan))


def _camera(eye, pitch_degrees: float, field_degrees: float) -> View:
    """Looking along +Y, tilted down."""
    c, s = math.cos(math.radians(pitch_degrees)), math.sin(math.radians(pitch_degrees))
    half = math.tan(math.radians(field_degrees) / 2.0)
    axes = (1.0, 0.0, 0.0), (0.0, s, c), (0.0, c, -s)
    return View(eye, *axes, (-half, half, -0.75 * half, 0.75 * half), 1e-3, 1e6)


def _views(devices) -> Iterator[Row]:
    emitter = lamp()
    for height in (0.3, 0.01, 1e-4):
        camera = _camera((0.0, -2.0, height), math.degrees(math.atan2(height, 2.0)), 40.0)
        name = f"seen {math.degrees(math.atan2(height, 2.0)):.2g} degrees above the ground"
        yield _row(devices, name, emitter, camera=camera)
    yield _row(
        devices, "a field of view of 0.1 degrees", emitter, camera=_camera((0.9, -900.0, 900.0), 45.0, 0.1)
    )
    yield _row(
        devices, "a field of view of 170 degrees", emitter, camera=_camera((0.0, -0.8, 0.6), 40.0, 170.0)
    )


def rows(devices) -> Iterator[Row]:
    """Every extreme, on each of `devices`."""
    for group in (_sizes, _distances, _close, _places, _slivers, _views):
        yield from group(devices)
