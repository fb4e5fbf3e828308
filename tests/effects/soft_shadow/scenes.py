"""Small scenes, from geometry to visibility, for the soft shadow kernels' tests."""

from __future__ import annotations

import numpy as np
import strata_kernels as kernels
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.view import View
from strata.addon.effects.soft_shadow.views import light_views
from strata.tests.support import closed_forms
from strata.tests.support.figures import weighted_rmse

DOWN = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))


def lamp(kind=EmitterKind.RECTANGLE, centre=(0.0, 0.0, 4.0), half=(0.5, 0.5), axes=DOWN, **more) -> Emitter:
    return Emitter(kind, centre, *axes, *half, **more)


def plate(x0, x1, y0, y1, z):
    """(4, 3) corners of a level rectangle."""
    return np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]], np.float64)


UP = (0.0, 0.0, 1.0)
GROUND = plate(-6, 6, -6, 6, 0)
LOW = plate(-0.7, 0.6, -0.5, 0.45, 1.5)
HIGH = plate(-0.4, 0.9, -0.6, 0.3, 2.5)


def ground_points(half=2.0, count=41, z=0.0):
    """(N, 3) points on the ground, off any texel's grid."""
    at = np.linspace(-half, half, count) + 0.0137
    x, y = np.meshgrid(at, at)
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], 1)


class Stage:
    """Convex polygons and meshes, seen by one light."""

    def __init__(self, polygons=(), meshes=(), origin=(0.0, 0.0, 0.0)):
        self.geometry = kernels.Geometry()
        self.origin = np.array(origin, np.float64)
        self.boxes = []
        material = self.geometry.add_material()
        faces = [(polygon, np.arange(len(polygon))[None]) for polygon in polygons]
        for positions, corners in [*faces, *meshes]:
            positions, corners = np.asarray(positions, np.float64), np.asarray(corners, np.int32)
            starts = np.arange(len(corners) + 1, dtype=np.int32) * corners.shape[1]
            mesh = self.geometry.add_mesh(positions.astype(np.float32), corners.ravel(), starts)
            matrix = np.eye(4)
            matrix[:3, 3] = self.origin
            self.geometry.add_instance(mesh, matrix, 1, [material])
            self.boxes.append((positions.min(axis=0) + self.origin, positions.max(axis=0) + self.origin))
        self.boxes = np.array(self.boxes).reshape(-1, 2, 3)

    def everything(self):
        return np.ones(len(self.boxes), np.uint8)

    def depths(self, emitter, points, layers=3, resolution=1024):
        """Views that the points need and their layered depths; `points` relative to the origin."""
        world = points[np.isfinite(points).all(axis=1)] + self.origin
        region = np.array([[world.min(axis=0), world.max(axis=0)]])
        views, _ = light_views(emitter, self.boxes, region)
        size = (layers, resolution, resolution)
        return [
            (view, kernels.layered_depth(self.geometry, self.everything(), view.packed(), *size))
            for _, view in views
        ]

    def maps(self, emitter, points, layers=3, resolution=1024, **bias):
        """Prepared maps; arguments as `depths`."""
        found = self.depths(emitter, points, layers, resolution)
        return [kernels.soft_shadow_prepare(depths, view.packed(), **bias) for view, depths in found]

    def visibility(
        self,
        emitter,
        points,
        normals,
        method="bitmask",
        maps=None,
        settings=(512, 2),
        **map_settings,
    ):
        """V (N,) and uncertain (N,); `points` relative to the origin, which is also the eye."""
        if maps is None:
            maps = self.maps(emitter, points, **map_settings)
        normals = np.broadcast_to(np.asarray(normals, np.float32), points.shape).copy()
        arguments = (points.astype(np.float32), normals, normals, self.origin, emitter.packed(), maps)
        return kernels.soft_shadow_backproject(*arguments, *settings, method=method)


def turned_axes(forward):
    forward = np.array(forward) / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    return tuple(tuple(map(float, axis)) for axis in (right, np.cross(right, forward), forward))


def against_closed_form(emitter, plates, points, extra=(GROUND,), **settings):
    truth, weight = closed_forms.visibility(emitter, points, np.tile(UP, (len(points), 1)), plates)
    found, _ = Stage([*extra, *plates]).visibility(emitter, points, UP, **settings)
    return weighted_rmse(found - truth, weight)


def lamp_view():
    return View((0.0, 0.0, 4.0), *DOWN, (-1.0, 1.0, -1.0, 1.0), 0.1, 10.0)
