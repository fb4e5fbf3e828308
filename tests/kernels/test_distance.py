"""How close a place is to an instance's triangles."""

from __future__ import annotations

import numpy as np
import pytest
import strata_kernels as kernels


def mesh_of(triangles: np.ndarray) -> kernels.Mesh:
    """(T, 3, 3) corners, each a vertex of its own."""
    corners = np.arange(3 * len(triangles), dtype=np.int32)
    starts = np.arange(0, len(corners) + 1, 3, dtype=np.int32)
    return kernels.Mesh(np.float32(triangles).reshape(-1, 3), corners, starts)


def test_it_is_that_of_the_nearest_point_of_all_triangles():
    rng = np.random.default_rng(3)
    triangles = rng.normal(size=(5000, 1, 3)) * 3.0 + 0.3 * rng.normal(size=(5000, 3, 3))
    shares = rng.dirichlet([0.6] * 3, 2000)
    matrix = np.eye(4)
    matrix[:3, :3] = rng.normal(size=(3, 3))  # turned, sheared and unequally scaled
    matrix[:3, 3] = 1e7, -2e6, 5.0
    mesh = mesh_of(triangles)
    for place in rng.normal(size=(20, 3)) * 8.0:
        place = matrix[:3, :3] @ place + matrix[:3, 3]
        found = mesh.distance(matrix, place.tolist(), 1e3)
        relative = np.float32(triangles).astype(float) @ matrix[:3, :3].T + (matrix[:3, 3] - place)
        nearest = np.argsort(np.linalg.norm(relative, axis=2).min(axis=1))[:300]
        points = shares @ relative[nearest]
        least = np.linalg.norm(points, axis=2).min()
        assert least - 0.05 < found <= least + 1e-9


def test_no_more_than_was_asked_for():
    mesh = mesh_of(np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float))
    eye = np.eye(4)
    assert mesh.distance(eye, [0.2, 0.2, 3.0], 10.0) == 3.0
    assert mesh.distance(eye, [0.2, 0.2, 3.0], 2.0) == 2.0
    assert mesh.distance(eye, [0.2, 0.2, 0.0], 2.0) == 0.0
    assert mesh_of(np.zeros((0, 3, 3))).distance(eye, [0.0, 0.0, 0.0], 2.0) == 2.0


def test_lines_and_points_count():
    line = mesh_of(np.array([[[1, -1, 0], [1, 1, 0], [1, 2, 0]]], float))
    assert line.distance(np.eye(4), [0.0, 0.0, 0.0], 9.0) == 1.0
    flat = np.diag([0.0, 1.0, 1.0, 1.0])
    assert mesh_of(np.full((1, 3, 3), 2.0)).distance(flat, [0.0, 2.0, 0.0], 9.0) == 2.0


def test_a_matrix_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="finite"):
        mesh_of(np.ones((1, 3, 3))).distance(np.full((4, 4), np.nan), [0.0, 0.0, 0.0], 1.0)
