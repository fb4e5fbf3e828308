"""Triangulation against Blender's own and against areas."""

from __future__ import annotations

import time

import bpy
import numpy as np
import pytest
import strata_kernels as kernels


def split(positions, faces):
    """Triangulates faces given as lists of vertices."""
    corners = np.concatenate([np.asarray(face, np.int32) for face in faces])
    starts = np.cumsum([0, *map(len, faces)], dtype=np.int32)
    positions = np.ascontiguousarray(positions, np.float32)
    triangles, of_face = kernels.triangulate(positions, corners, starts)
    return corners[triangles], of_face, triangles


def area_vectors(positions, triangles):
    a, b, c = np.moveaxis(np.asarray(positions, np.float64)[triangles], 1, 0)
    return np.cross(b - a, c - a) / 2


def polygon_area(points):
    """Signed area of a polygon in the plane, (n, 2)."""
    x, y = points.T
    return 0.5 * float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def star(rng, count, wild=0.95):
    """A simple, very concave polygon (count, 2): random radii, angles ascending by less than a half turn."""
    angle = (np.arange(count) + rng.random(count)) * 2 * np.pi / count
    radius = rng.uniform(1 - wild, 1, count)
    return np.stack([np.cos(angle) * radius, np.sin(angle) * radius], -1)


def comb(teeth):
    """A simple polygon (4 teeth + 2, 2) of which most corners block most others."""
    x = np.arange(2 * teeth + 1)
    zigzag = np.stack([x, np.where(x % 2 == 0, 0.1, 10.0)], -1)
    return np.concatenate([zigzag, [[2 * teeth, 0.0], [0.0, 0.0]]])[::-1]


def into_space(rng, points):
    """Turns plane points about in space: (n, 3)."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return points @ axes[:2] + rng.normal(size=3)


def blender_triangles(positions, faces):
    mesh = bpy.data.meshes.new("quads")
    mesh.from_pydata(positions.tolist(), [], faces)
    mesh.calc_loop_triangles()
    loops = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    bpy.data.meshes.remove(mesh)
    return loops.reshape(-1, 3)


def test_quads_and_triangles_split_as_in_blender():
    rng = np.random.default_rng(0)
    positions = rng.normal(size=(40000, 3)).astype(np.float32)
    order, faces, at = rng.permutation(40000).tolist(), [], 0
    while at + 4 <= len(order):
        size = 3 + int(rng.random() < 0.8)
        faces.append(order[at : at + size])
        at += size
    _, of_face, corners = split(positions, faces)
    expected = blender_triangles(positions, faces)
    np.testing.assert_array_equal(corners, expected)
    flipped = (np.diff(corners[1:][np.diff(of_face) == 0], axis=1) == 1).all(1)
    assert 0.1 < flipped.mean() < 0.9  # both diagonals are there


@pytest.mark.parametrize("count", [5, 6, 9, 30, 200])
def test_concave_polygons_keep_their_area(count):
    rng = np.random.default_rng(count)
    polygons = [star(rng, count) for _ in range(60)]
    positions = np.concatenate([into_space(rng, p) for p in polygons])
    faces = np.arange(len(positions)).reshape(-1, count)
    triangles, of_face, _ = split(positions, faces)
    assert len(triangles) == 60 * (count - 2)
    np.testing.assert_array_equal(of_face, np.repeat(np.arange(60), count - 2))
    vectors = area_vectors(positions.astype(np.float32), triangles)
    for face, polygon in enumerate(polygons):
        own = vectors[of_face == face]
        total = own.sum(0)
        # Triangles all turned the same way, together as large as the polygon: no overlap, nothing missing.
        assert (own @ total >= -1e-6 * (total @ total)).all()
        unsigned = np.linalg.norm(own, axis=-1).sum()
        np.testing.assert_allclose(unsigned, abs(polygon_area(polygon)), rtol=1e-5)


def test_a_comb_keeps_its_area():
    points = comb(300)
    positions = np.c_[points, np.zeros(len(points))]
    triangles, _, _ = split(positions, [range(len(points))])
    areas = area_vectors(positions, triangles)[:, 2]
    assert (areas >= -1e-9).all()
    np.testing.assert_allclose(areas.sum(), polygon_area(points), rtol=1e-9)


def test_corners_on_straight_edges_are_used():
    # A square with two more corners on each side: dropping one would leave a gap to the neighbour.
    side = np.array([[0, 0], [1, 0], [2, 0]], float)
    turn = np.array([[0, 1], [-1, 0]], float)
    points = np.concatenate([side, [3, 0] + side @ turn, [3, 3] - side, [0, 3] - side @ turn])
    positions = np.c_[points, np.zeros(12)]
    triangles, _, _ = split(positions, [range(12)])
    areas = area_vectors(positions, triangles)[:, 2]
    assert (areas > 0.1).all()
    np.testing.assert_allclose(areas.sum(), 9.0)


BAD_POLYGONS = {
    "bow tie": np.array([[0, 0], [2, 2], [2, 0], [0, 2], [-1, 1]], float),
    "one point": np.zeros((7, 2)),
    "a line": np.stack([np.arange(8.0) % 5, np.zeros(8)], -1),
    "there and back": np.array([[0, 0], [1, 0], [2, 0], [1, 0], [0, 0], [0, 1]], float),
    "repeated corners": np.array([[0, 0], [0, 0], [2, 0], [2, 0], [2, 2], [0, 2], [0, 2]], float),
    "a pentagram": np.stack([np.cos(np.arange(5) * 4 * np.pi / 5), np.sin(np.arange(5) * 4 * np.pi / 5)], -1),
    "noise": np.random.default_rng(0).normal(size=(300, 2)),
    "huge": np.random.default_rng(1).normal(size=(9, 2)) * 1e38,
    "tiny": np.random.default_rng(2).normal(size=(9, 2)) * 1e-40,
}


@pytest.mark.parametrize("name", BAD_POLYGONS)
def test_bad_polygons_still_become_triangles(name):
    points = BAD_POLYGONS[name]
    positions = np.c_[points, np.zeros(len(points))]
    _, of_face, corners = split(positions, [range(len(points))])
    assert len(of_face) == len(points) - 2
    assert set(corners.ravel()) == set(range(len(points)))
    assert (np.sort(corners, 1)[:, 1:] != np.sort(corners, 1)[:, :-1]).all()


def test_a_keyhole_keeps_its_area():
    # A square with a square hole, joined by a bridge that is walked twice: corners 0 and 5, 1 and 6 coincide.
    outer = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]]
    inner = [[1, 1], [1, 3], [3, 3], [3, 1], [1, 1]]
    points = np.array(outer + inner, float)
    positions = np.c_[points, np.zeros(len(points))]
    triangles, _, _ = split(positions, [range(len(points))])
    areas = area_vectors(positions, triangles)[:, 2]
    assert (areas >= 0).all()
    np.testing.assert_allclose(areas.sum(), 12.0)


def test_polygons_that_are_none_and_vertices_that_are_not_finite_are_dropped():
    positions = np.zeros((9, 3), np.float32)
    positions[:5, :2] = [[0, 0], [1, 0], [2, 1], [1, 2], [0, 1]]
    positions[5] = np.nan
    positions[6] = [0, np.inf, 0]
    faces = [
        [0, 1, 2],
        [],
        [0],
        [0, 1],
        [0, 1, 5],
        [0, 1, 2, 3],
        [0, 1, 2, 6],
        [5, 0, 1, 2, 3],
        [0, 1, 2, 3, 4],
    ]
    triangles, of_face, _ = split(positions, faces)
    assert np.bincount(of_face, minlength=len(faces)).tolist() == [1, 0, 0, 0, 0, 2, 0, 0, 3]
    assert np.isfinite(positions[triangles]).all()


@pytest.mark.parametrize(
    ("corners", "starts"),
    [
        ([0, 1, 3], [0, 3]),
        ([0, -1, 2], [0, 3]),
        ([0, 1, 2], [0, 4]),
        ([0, 1, 2], [-1, 3]),
        ([0, 1, 2], [0, 3, 1]),
        ([0, 1, 2], []),
    ],
)
def test_indices_out_of_range_are_refused(corners, starts):
    arrays = np.zeros((3, 3), np.float32), np.array(corners, np.int32), np.array(starts, np.int32)
    with pytest.raises(ValueError, match=r"corner_vertices|face_starts"):
        kernels.triangulate(*arrays)


def test_time_grows_at_most_with_the_square():
    def seconds(count):
        points = star(np.random.default_rng(3), count)
        positions = np.c_[points, np.zeros(count)].astype(np.float32)
        arrays = positions, np.arange(count, dtype=np.int32), np.array([0, count], np.int32)
        begun = time.perf_counter()
        kernels.triangulate(*arrays)
        return time.perf_counter() - begun

    # 8 times the corners: 64 times the work if quadratic, 512 if cubic; between them room for a busy machine.
    pairs = [(seconds(1000), seconds(8000)) for _ in range(8)]
    small, large = map(min, zip(*pairs, strict=True))
    assert large < 200 * small
