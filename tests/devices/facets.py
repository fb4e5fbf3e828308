"""Surface attributes at points of triangles in numpy and float64: what the kernels are judged by."""

from __future__ import annotations

import numpy as np
from strata.addon.devices.cpu import triangulate


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def kept_inside(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(N, 3) weights of three corners from those of the second and the third."""
    weights = np.stack([1.0 - u - v, u, v], axis=1).clip(0.0)
    return weights / weights.sum(axis=1, keepdims=True)


def weights_along(points: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(N, 3) weights of the corners (N, 3, 3) where rays meet them: a linear system for each."""
    first, second = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    system = np.stack([first, second, -directions], axis=2)
    found = np.linalg.solve(system, (origins - points[:, 0])[..., None])[..., 0]
    return kept_inside(found[:, 0], found[:, 1])


def weights_at(corners: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(N, 3) weights of the corners (N, 3, 2) at places (N, 2)."""
    system = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    found = np.linalg.solve(system, (places - corners[:, 0])[..., None])[..., 0]
    return kept_inside(found[:, 0], found[:, 1])


def heights(corners: np.ndarray, normals: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(N,) of the surface that the normals (N, 3, 3) tell of above points of triangles (N, 3, 3), as Cycles
    has it: the greater of half a parabola's, and of the least that the highest corner has along a normal."""
    point = np.einsum("ni,nik->nk", weights, corners)[:, None]
    above = np.einsum("njk,nik->nij", corners - point, normals).max(axis=2).min(axis=1)
    parabola = np.zeros(len(corners))
    for i, j in ((0, 1), (1, 2), (2, 0)):
        bend = ((normals[:, j] - normals[:, i]) * (corners[:, j] - corners[:, i])).sum(axis=1)
        parabola += weights[:, i] * weights[:, j] * bend
    return np.maximum(above, 0.5 * parabola)


def facets(outline, arrays, instance, triangle, origin, weigh, turned) -> dict[str, np.ndarray]:
    """All attributes but depth, float64, of points on the triangles (N,) of instances (N,), positions
    relative to `origin`. `weigh(points, uvs, rows)`: weights (N, 3) of the corners (N, 3, 3) and their UVs
    (N, 3, 2), which belong to `rows` of the arrays; `turned(winding, rows)`: 1, or -1 where a normal faces
    the wrong way."""
    count = len(instance)
    triples = "position", "geometric_normal", "shading_normal", "terminator_lift", "corner_colour"
    values = {name: np.zeros((count, 3)) for name in triples}
    values |= {"uv": np.zeros((count, 2)), "instance": instance, "triangle": triangle}
    values |= {name: np.zeros(count, int) for name in ("object_id", "material")}
    for index in np.unique(instance):
        rows = np.flatnonzero(instance == index)
        placed, matrix = outline.instances[index], arrays.matrices[index]
        mesh, linear = arrays.meshes[placed.mesh], matrix[:3, :3]
        corners, faces = triangulate(mesh)
        corner = corners[triangle[rows]]
        points = mesh.positions[mesh.corner_vertices[corner]].astype(np.float64) @ linear.T
        points += matrix[:3, 3] - origin
        uvs = mesh.corner_uvs[corner].astype(np.float64)
        weights = weigh(points, uvs, rows)[:, None]
        winding = unit(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]))
        turn = turned(winding, rows)[:, None]
        normals = mesh.corner_normals[corner].astype(np.float64)
        local = (weights @ normals)[:, 0]
        cofactors = np.linalg.det(linear) * np.linalg.inv(linear).T
        slots = mesh.face_slots[faces[triangle[rows]]].clip(0, len(placed.materials) - 1)
        values["position"][rows] = (weights @ points)[:, 0]
        values["uv"][rows] = (weights @ uvs)[:, 0]
        values["corner_colour"][rows] = (weights @ mesh.corner_colours[corner].astype(np.float64))[:, 0]
        values["geometric_normal"][rows] = turn * winding
        values["shading_normal"][rows] = turn * unit(local @ cofactors.T)
        corners_at = mesh.positions[mesh.corner_vertices[corner]].astype(np.float64)
        way = local @ linear.T
        side = np.where((way * turn * winding).sum(axis=1) > 0.0, 1.0, -1.0)
        height = side * heights(corners_at, side[:, None, None] * normals, weights[:, 0])
        values["terminator_lift"][rows] = way * height[:, None]
        values["object_id"][rows] = placed.object_id
        values["material"][rows] = np.array(placed.materials)[slots]
    return values
