"""An object's surface over the unit square of its UV map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Arrays, Cutout, MeshArrays
from ..core.outline import Outline
from ..core.surface import Chunk
from ..core.view import Vector, View
from .mesh_points import MeshPoints, nothing

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
    """Triangles of some instances at their UVs, a `handle` of the kernels', and which `instances` those are,
    in its order."""

    handle: object
    instances: tuple[int, ...]
    points: MeshPoints


def lay_out(
    geometry_of: Callable, triangulate: Callable, outline: Outline, arrays: Arrays, instances: frozenset[int]
) -> LaidOut:
    """Instances without UVs are on no chart."""
    points, meshes, known = MeshPoints(triangulate, outline, arrays), [], []
    for index in sorted(instances):
        mesh = arrays.meshes[outline.instances[index].mesh]
        if mesh.corner_uvs is None:
            continue
        corners, _ = points.split(outline.instances[index].mesh)
        flat = np.zeros((corners.size, 3), np.float32)
        flat[:, :2] = mesh.corner_uvs[corners.reshape(-1)]
        starts = np.arange(0, corners.size + 1, 3, dtype=np.int32)
        meshes.append(MeshArrays(flat, np.arange(corners.size, dtype=np.int32), starts))
        known.append(index)
    placed = [_Flat(number, number) for number in range(len(known))]
    matrices = np.broadcast_to(np.eye(4), (len(known), 4, 4))
    handle = geometry_of(placed, Arrays(tuple(meshes), matrices, (Cutout(),)))
    return LaidOut(handle, tuple(known), points)


def chart_points(
    kernels,
    cancel_flag,
    outline: Outline,
    arrays: Arrays,
    laid_out: LaidOut,
    origin: Vector,
    chunk: Chunk,
    attributes,
) -> dict[str, np.ndarray]:
    """Shading points at the chunk's texels; their normals face as their mesh does, their depth is 0."""
    found = kernels.raster_surface(
        laid_out.handle,
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
    which, triangles = found["instance"].reshape(-1), found["triangle"].reshape(-1)
    rows, columns = np.indices(chunk.shape)
    at = (
        np.stack([columns + chunk.x0, rows + chunk.y0], axis=-1).reshape(-1, 2) + 0.5 + np.array(chunk.jitter)
    )
    at /= (chunk.width, chunk.height)
    surface = nothing(len(which), attributes)
    for number, instance in enumerate(laid_out.instances):
        here = np.flatnonzero(which == number)
        mesh_index = outline.instances[instance].mesh
        uvs = arrays.meshes[mesh_index].corner_uvs

        def weigh(points, corner, here=here, uvs=uvs):
            return _weights(uvs[corner].astype(np.float64), at[here])

        instances = np.full(len(here), instance)
        laid_out.points.fill(
            surface,
            here,
            mesh_index,
            instances,
            triangles[here],
            origin,
            weigh,
            lambda winding: np.ones(len(winding)),
        )
        if "depth" in surface:
            surface["depth"][here] = 0.0
    return {name: values.reshape(*chunk.shape, *values.shape[1:]) for name, values in surface.items()}


def _weights(corners: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(N, 3) weights of the corners (N, 3, 2) at places (N, 2), kept inside: a texel's triangle is found to
    1/256 of a texel."""
    first, second, place = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], at - corners[:, 0]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (place[:, 0] * second[:, 1] - place[:, 1] * second[:, 0]) / area
        v = (first[:, 0] * place[:, 1] - first[:, 1] * place[:, 0]) / area
    weights = np.nan_to_num(np.stack([1.0 - u - v, u, v], axis=1), posinf=0.0, neginf=0.0).clip(0.0)
    weights[~weights.any(axis=1)] = 1.0
    return weights / weights.sum(axis=1, keepdims=True)
