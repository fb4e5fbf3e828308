"""An object's surface over the unit square of its UV map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Arrays, Opacities, separate_triangles
from ..core.outline import Outline
from ..core.surface import Chunk
from ..core.view import Vector, View

SQUARE = View(
    (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0, 1.0), 0.5, 2.0, True
)
"""An eye over the unit square, to which triangles are drawn at their UVs."""


@dataclass(frozen=True)
class _Flat:
    """So that a device can place it."""

    mesh: int
    object_id: int
    materials: tuple[int, ...] = (0,)


@dataclass(frozen=True, eq=False)
class LaidOut:
    """Triangles of some instances of a `geometry` at their UVs, a `flat` geometry, and which
    `instances` (N,) int32 those are, in its order."""

    geometry: object
    flat: object
    instances: np.ndarray


def lay_out(
    geometry,
    geometry_of: Callable,
    triangulate: Callable,
    outline: Outline,
    arrays: Arrays,
    instances: frozenset[int],
) -> LaidOut:
    """Instances without UVs are on no chart. `triangulate(mesh)`: corners of each triangle (T, 3) and its
    face (T,)."""
    meshes, known = [], []
    for index in sorted(instances):
        mesh = arrays.meshes[outline.instances[index].mesh]
        uvs = mesh.corner_uvs if mesh.chart_uvs is None else mesh.chart_uvs
        if uvs is None:
            continue
        corners = triangulate(mesh)[0].reshape(-1)
        flat = np.zeros((corners.size, 3), np.float32)
        flat[:, :2] = uvs[corners]
        meshes.append(separate_triangles(flat))
        known.append(index)
    placed = [_Flat(number, number) for number in range(len(known))]
    matrices = np.broadcast_to(np.eye(4), (len(known), 4, 4))
    flat = geometry_of(placed, Arrays(tuple(meshes), matrices, (Opacities(),)))
    return LaidOut(geometry, flat, np.array(known, np.int32))


def chart_points(
    kernels, cancel_flag, laid_out: LaidOut, origin: Vector, chunk: Chunk, attributes: frozenset[str]
) -> dict[str, np.ndarray]:
    """Shading points at the chunk's texels; their normals face as their mesh does, their depth is 0."""
    found = kernels.raster_surface(
        laid_out.flat,
        np.ones(len(laid_out.instances), np.uint8),
        SQUARE.packed(),
        chunk.width,
        chunk.height,
        rows=(chunk.y0, chunk.y1),
        columns=(chunk.x0, chunk.x1),
        jitter=chunk.jitter,
        attributes=["instance", "triangle"],
        cancel=cancel_flag,
    )
    which = found["instance"].reshape(-1)
    rows, columns = np.indices(chunk.shape)
    places = np.stack([columns + chunk.x0, rows + chunk.y0], axis=-1).reshape(-1, 2) + 0.5
    surface = kernels.chart_surface(
        laid_out.geometry,
        np.append(laid_out.instances, np.int32(-1))[which],
        found["triangle"].reshape(-1),
        (places + np.array(chunk.jitter)) / (chunk.width, chunk.height),
        np.array(origin),
        sorted(attributes),
        cancel=cancel_flag,
    )
    return {name: values.reshape(*chunk.shape, *values.shape[1:]) for name, values in surface.items()}
