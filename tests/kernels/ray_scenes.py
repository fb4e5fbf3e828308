"""Triangles and lights for tests of rays."""

import numpy as np
import strata_kernels as kernels
from strata.addon.core.emitter import Emitter, EmitterKind

AXES = {"right": (1.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0), "forward": (0.0, 0.0, -1.0)}
LIGHTS = [
    Emitter(EmitterKind.RECTANGLE, (0, 0, 3), **AXES, half_width=0.75, half_height=0.5),
    Emitter(EmitterKind.ELLIPSE, (0, 0, 3), **AXES, half_width=0.75, half_height=0.5),
    Emitter(EmitterKind.SPHERE, (0, 0, 3), **AXES, half_width=0.75, half_height=0.75),
    Emitter(EmitterKind.FACING_DISK, (0, 0, 3), **AXES, half_width=0.75, half_height=0.75),
    Emitter(EmitterKind.DISTANT_DISK, (0, 0, 0), **AXES, half_width=0.3, half_height=0.3),
]
PLATES = [
    np.array([[-0.5, -0.3, 1.0], [0.5, -0.3, 1.0], [0.5, 0.6, 1.2], [-0.5, 0.6, 1.2]]),
    np.array([[-0.1, -0.6, 1.6], [0.4, -0.6, 1.6], [0.4, 0.2, 1.6], [-0.1, 0.2, 1.6]]),
]


def add_triangles(geometry, triangles, matrix=None, **material):
    """Adds (T, 3, 3) triangles as a mesh of their own; returns the instance's index."""
    triangles = np.ascontiguousarray(triangles, np.float32)
    count = len(triangles)
    mesh = geometry.add_mesh(
        triangles.reshape(-1, 3),
        np.arange(3 * count, dtype=np.int32),
        np.arange(0, 3 * count + 1, 3, dtype=np.int32),
        corner_uvs=material.pop("uvs", None),
    )
    sides = (kernels.Opacity(**material),) * 2
    slot = geometry.add_material(sides, sides)
    return geometry.add_instance(mesh, np.eye(4) if matrix is None else matrix, 0, [slot])


def accel_of(triangles, origin=(0.0, 0.0, 0.0)):
    geometry = kernels.Geometry()
    add_triangles(geometry, triangles)
    return kernels.Accel(geometry, np.array(origin, np.float64))


def quad(corners):
    corners = np.asarray(corners, np.float64)
    return corners[[[0, 1, 2], [0, 2, 3]]]
