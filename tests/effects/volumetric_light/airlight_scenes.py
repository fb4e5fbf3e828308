"""Small inputs for the airlight kernels."""

from __future__ import annotations

import numpy as np
import strata_kernels
from strata.addon.core.view import View


def medium(scattering, extinction, anisotropy=0.0) -> np.ndarray:
    """Packed as core/medium.py; numbers or three of them."""
    return np.array(
        [*np.broadcast_to(scattering, 3), *np.broadcast_to(extinction, 3), anisotropy], np.float64
    )


def source(kind=1, position=(0, 0, 0), axis=(0, 0, -1), radius=0.0, cos_cone=-1.0, blend=0.0, spread=np.inf):
    """Packed as volumetric_light/sources.py: 0 distant, 1 uniform, 2 spot, 3 area."""
    return np.array([kind, *position, *axis, radius, 0.0, cos_cone, blend, spread, 0.0], np.float64)


def lattice(eye, width=1, height=1, window=(-1e-3, 1e-3, -1e-3, 1e-3), near=0.0) -> np.ndarray:
    """Rays from `eye` along +Y, Z up, packed as volumetric_light/lattice.py."""
    step = (window[1] - window[0]) / width, (window[3] - window[2]) / height
    first = window[0] + 0.5 * step[0], window[2] + 0.5 * step[1]
    return np.array([*eye, 1, 0, 0, 0, 0, 1, 0, 1, 0, *first, *step, near, 0.0], np.float64)


def along_y(eye, length, a_medium, a_source, order=4, **more) -> np.ndarray:
    """(3,) single precision: one ray from `eye` along +Y."""
    depth = np.full((1, 1), length, np.float32)
    rays = np.array([*eye, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 1e-3, 1e-3, 0.0, 0.0], np.float64)
    return strata_kernels.airlight(depth, rays, a_medium, a_source, [], order=order, **more)[0, 0]


def exactly_along_y(eye, length, a_medium, a_source) -> np.ndarray:
    """(3,) double precision: the same."""
    origin, direction = np.array([eye], np.float64), np.array([[0.0, 1.0, 0.0]])
    limits = np.array([[0.0, length]])
    return strata_kernels.airlight_along(origin, direction, limits, a_medium, a_source)[0]


def square_geometry(squares) -> strata_kernels.Geometry:
    """Horizontal squares: (centre x, y, z, half side)."""
    geometry = strata_kernels.Geometry()
    positions = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    mesh = np.arange(4, dtype=np.int32), np.array([0, 4], np.int32)
    geometry.add_mesh(positions, *mesh, None, None, None)
    geometry.add_material()
    for number, (x, y, z, half) in enumerate(squares):
        matrix = np.diag([half, half, 1.0, 1.0])
        matrix[:3, 3] = x, y, z
        geometry.add_instance(0, matrix, number, [0])
    return geometry


def map_from_above(squares, eye, window=1.0, resolution=512, orthographic=False):
    """A LightMap of squares seen straight down from `eye`, and its view."""
    view = View(
        tuple(map(float, eye)), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0),
        (-window, window, -window, window), 0.0 if orthographic else 1e-3, 100.0, orthographic,
    )  # fmt: skip
    drawn = np.ones(len(squares), np.uint8)
    depths = strata_kernels.layered_depth(
        square_geometry(squares), drawn, view.packed(), 1, resolution, resolution
    )
    return strata_kernels.light_map(depths, view.packed()), view
