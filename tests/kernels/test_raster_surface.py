"""The surface that the rasteriser sees: positions, normals, ids, and inputs gone wrong."""

from __future__ import annotations

import numpy as np
import pytest
import strata_kernels as kernels
from strata.tests.kernels.raster_scenes import (
    ALL_ATTRIBUTES,
    add_triangles,
    brute_force,
    down,
    everything,
    opacity,
    pixel_rays,
    random_triangles,
    turned_view,
)

SCREEN_FILLING = [[-99.0, -99.0, -2.0], [99.0, -99.0, -2.0], [0.0, 99.0, -2.0]]


def surface(geometry, view, width, height, attributes=ALL_ATTRIBUTES, **keywords):
    return kernels.raster_surface(
        geometry, everything(geometry), view.packed(), width, height, attributes=attributes, **keywords
    )


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("kind", ["ordinary", "sliver", "near", "huge"])
def test_points_lie_on_the_nearest_triangle(kind, orthographic):
    rng = np.random.default_rng(11)
    width, height, jitter = 80, 60, (0.31, -0.17)
    far = 1e6 if kind == "huge" else 40.0
    view = turned_view(rng, near=0.3, far=far, orthographic=orthographic, half=2.0 if orthographic else 0.7)
    triangles = random_triangles(rng, view, kind, 60)
    geometry = kernels.Geometry()
    add_triangles(geometry, triangles)
    s = surface(geometry, view, width, height, jitter=jitter)
    seen = s["triangle"] >= 0
    assert seen.mean() > 0.1

    # On the plane, to the float32 rounding of the position itself.
    corners = triangles[s["triangle"][seen]].astype(np.float64) - np.array(view.eye)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    position = s["position"][seen].astype(np.float64)
    size = np.linalg.norm(position, axis=-1)
    assert (np.abs(((position - corners[:, 0]) * normal).sum(-1)) <= 1e-7 * size).all()

    # On the pixel's ray, up to the 1/256 pixel that the outline was snapped by.
    origin, direction = pixel_rays(view, width, height, jitter)
    axes = np.array([view.right, view.up, view.forward])
    local = position @ axes.T
    np.testing.assert_allclose(local[:, 2], s["depth"][seen], rtol=1e-6)
    off = np.linalg.norm(local - origin[seen] - direction[seen] * local[:, 2:], axis=-1)
    pixel = (view.window[1] - view.window[0]) / width
    assert (off < pixel * 1.5 / 256 * (1.0 if orthographic else local[:, 2]) + 1e-6 * size).all()

    # Normals face the viewer; without corner normals both are the same.
    found = s["geometric_normal"][seen]
    np.testing.assert_allclose(np.abs((found * normal).sum(-1)), 1.0, atol=1e-6)
    assert ((found * (direction[seen] @ axes)).sum(-1) < 1e-6).all()
    np.testing.assert_array_equal(s["geometric_normal"], s["shading_normal"])

    assert np.isinf(s["depth"][~seen]).all()
    for name, value in (("object_id", 5), ("instance", 0), ("material", 0)):
        np.testing.assert_array_equal(s[name], np.where(seen, value, -1))

    depths, doubtful = brute_force(view, triangles, width, height, jitter)
    nearest, clear = depths.min(0), ~doubtful.any(0)
    np.testing.assert_array_equal(seen[clear], np.isfinite(nearest)[clear])
    clear &= seen
    np.testing.assert_allclose(s["depth"][clear], nearest[clear], rtol=5e-6)


def test_attributes_that_were_not_asked_for_are_not_there():
    geometry = kernels.Geometry()
    add_triangles(geometry, [SCREEN_FILLING])
    assert set(surface(geometry, down(), 4, 4, ["depth", "uv"])) == {"depth", "uv"}


def test_rows_are_those_of_the_whole_image():
    rng = np.random.default_rng(2)
    view = turned_view(rng)
    geometry = kernels.Geometry()
    add_triangles(geometry, random_triangles(rng, view, "ordinary", 200))
    whole = surface(geometry, view, 150, 200)
    for first, end in ((0, 64), (3, 5), (63, 131), (199, 200)):
        part = surface(geometry, view, 150, 200, rows=(first, end))
        for name in ALL_ATTRIBUTES:
            np.testing.assert_array_equal(part[name], whole[name][first:end])


@pytest.mark.parametrize("mirror", [1.0, -1.0])
@pytest.mark.parametrize("inside_out", [False, True])
def test_what_corners_carry_is_interpolated_in_perspective(mirror, inside_out):
    rng = np.random.default_rng(8)
    matrix = np.eye(4)
    matrix[:3, :3] = rng.normal(size=(3, 3)) * [1.0, 2.0, 0.5]
    matrix[0, :3] *= mirror * np.sign(np.linalg.det(matrix[:3, :3]))
    matrix[:3, 3] = (0.1, -0.2, -9.0)
    # A leaning triangle that fills the window, brought to object space.
    world = np.array([[-19.0, -19.0, -4.0], [19.0, -18.0, -6.0], [0.0, 29.0, -5.0]])
    world = world[::-1] if inside_out else world
    corners = ((world - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T).astype(np.float32)
    outward = np.cross(corners[1] - corners[0], corners[2] - corners[0]).astype(np.float64)
    normals = outward / np.linalg.norm(outward) + rng.normal(size=(3, 3)) * 0.3
    normals = (normals / np.linalg.norm(normals, axis=-1, keepdims=True)).astype(np.float32)
    uvs = rng.uniform(size=(3, 2)).astype(np.float32)
    colours = rng.uniform(size=(3, 3)).astype(np.float32)
    geometry = kernels.Geometry()
    more = {"corner_uvs": uvs, "corner_colours": colours}
    add_triangles(geometry, [corners], matrix, corner_normals=normals, **more)
    s = surface(geometry, down(), 16, 16)
    assert (s["triangle"] == 0).all()

    world = corners.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    position = s["position"].reshape(-1, 3).astype(np.float64)
    weights = np.linalg.solve(world.T, position.T).T
    np.testing.assert_allclose(weights.sum(-1), 1.0, atol=1e-5)
    np.testing.assert_allclose(s["uv"].reshape(-1, 2), weights @ uvs, atol=1e-5)
    np.testing.assert_allclose(s["corner_colour"].reshape(-1, 3), weights @ colours, atol=1e-5)
    # Normals go by the inverse transpose, whichever way the matrix mirrors.
    outward = outward @ np.linalg.inv(matrix[:3, :3])
    turn = np.where(position @ outward > 0, -1.0, 1.0)[:, None]
    expected = turn * (weights @ normals.astype(np.float64)) @ np.linalg.inv(matrix[:3, :3])
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    np.testing.assert_allclose(s["shading_normal"].reshape(-1, 3), expected, atol=2e-5)
    geometric = s["geometric_normal"].reshape(-1, 3)
    np.testing.assert_allclose(geometric, turn * outward / np.linalg.norm(outward), atol=1e-6)


def test_equal_depths_go_to_the_first_instance_and_triangle():
    geometry = kernels.Geometry()
    add_triangles(geometry, [SCREEN_FILLING] * 2)
    add_triangles(geometry, [SCREEN_FILLING])
    s = surface(geometry, down(), 70, 9, ["instance", "triangle"])
    assert (s["instance"] == 0).all()
    assert (s["triangle"] == 0).all()


def test_materials_come_from_slots_and_clip_by_alpha():
    geometry = kernels.Geometry()
    first, second = geometry.add_material(), opacity(geometry, texels=np.zeros((1, 1), np.float32))
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, -1], [1, 1], [-1, 1]], np.float32)
    positions = np.concatenate([square, np.full((6, 1), -1, np.float32)], -1)
    corners, starts = np.arange(6, dtype=np.int32), np.array([0, 3, 6], np.int32)
    # Slot 7 is beyond the end: the last one.
    mesh = geometry.add_mesh(positions, corners, starts, face_slots=np.array([0, 7], np.int32))
    geometry.add_instance(mesh, np.eye(4), 3, [first, second])
    geometry.add_instance(mesh, np.diag([2.0, 2.0, 2.0, 1.0]), 4, [second, first])
    s = surface(geometry, down(), 8, 8, ["material", "object_id"])
    np.testing.assert_array_equal(s["material"], first)
    # The near square shows its lower right half, the far one, its slots exchanged, the upper left.
    row, column = np.mgrid[:8, :8]
    np.testing.assert_array_equal(s["object_id"][row < column], 3)
    np.testing.assert_array_equal(s["object_id"][row > column], 4)


@pytest.mark.parametrize("orthographic", [False, True])
def test_pixels_do_not_depend_on_which_others_are_asked_for(orthographic):
    rng = np.random.default_rng(7)
    view = turned_view(rng, near=0.3, far=40.0, orthographic=orthographic, half=2.0 if orthographic else 0.7)
    geometry = kernels.Geometry()
    add_triangles(geometry, random_triangles(rng, view, "ordinary", 80))
    wide = surface(geometry, view, 90, 70, jitter=(0.3, -0.2), rows=(-70, 140), columns=(-90, 180))
    assert (wide["triangle"] >= 0).mean() > 0.1
    for rows, columns in (
        ((0, 70), (0, 90)),
        ((-41, 3), (-90, 7)),
        ((5, 6), (64, 180)),
        ((69, 140), (-1, 1)),
    ):
        part = surface(geometry, view, 90, 70, jitter=(0.3, -0.2), rows=rows, columns=columns)
        inside = slice(rows[0] + 70, rows[1] + 70), slice(columns[0] + 90, columns[1] + 90)
        for name, image in part.items():
            np.testing.assert_array_equal(image, wide[name][inside])
        mask, packed = everything(geometry), view.packed()
        region = {"rows": rows, "columns": columns, "jitter": (0.3, -0.2)}
        depth = np.full(part["depth"].shape, np.inf, np.float32)
        before = kernels.raster_before(geometry, mask, packed, 90, 70, depth, **region)
        np.testing.assert_array_equal(before, part["object_id"])
        assert (kernels.raster_before(geometry, mask, packed, 90, 70, part["depth"], **region) == -1).all()
        del region["jitter"]
        layers = kernels.layered_depth(geometry, mask, packed, 3, 90, 70, **region)
        whole = kernels.layered_depth(geometry, mask, packed, 3, 90, 70, rows=(-70, 140), columns=(-90, 180))
        np.testing.assert_array_equal(layers, whole[:, *inside])


# Extremes


def test_ten_thousand_kilometres_away_is_exact():
    rng = np.random.default_rng(4)
    triangles = random_triangles(rng, down(), "ordinary", 40)
    results = []
    for offset in (np.zeros(3), np.array([1e7, -1e7, 1e7])):
        # A little away from the object, by what doubles hold out there and floats do not.
        eye = tuple(offset + np.array([0.25, -0.125, 0.0625]))
        matrix = np.eye(4)
        matrix[:3, 3] = offset
        geometry = kernels.Geometry()
        add_triangles(geometry, triangles, matrix)
        view = down(eye=eye)
        layers = kernels.layered_depth(geometry, everything(geometry), view.packed(), 4, 60, 60)
        results.append({**surface(geometry, view, 60, 60), "layers": layers})
    assert (results[0]["triangle"] >= 0).mean() > 0.2
    for name, image in results[0].items():
        np.testing.assert_array_equal(results[1][name], image)


def test_bad_triangles_draw_nothing():
    nan, big = np.nan, 3e38
    geometry = kernels.Geometry()
    add_triangles(
        geometry, [[[nan, 0, -1], [1, 0, -1], [0, 1, -1]], [[0, 0, -1], [np.inf, 0, -1], [0, 1, -1]]]
    )
    add_triangles(geometry, [[[0, 0, -1]] * 3, [[-9, -3, -1], [0, 0, -1], [9, 3, -1]]])
    # Rank one, through a pixel's centre, so that a sliver left by rounding would show; rank zero; overflow.
    rng = np.random.default_rng(1)
    soup = rng.normal(size=(500, 3, 3))
    lines = [np.outer(rng.normal(size=3), rng.normal(size=3)) for _ in range(8)]
    for linear in (*lines, np.zeros((3, 3)), np.eye(3) * 1e200):
        matrix = np.eye(4)
        matrix[:3, :3] = linear
        matrix[:3, 3] = (1 / 32, 1 / 32, -2.0)
        add_triangles(geometry, soup, matrix)
    add_triangles(
        geometry, [[[-big, -big, -big], [big, -big, -big], [0, big, big]]], np.diag([1e300, 1, 1, 1])
    )
    s = surface(geometry, down(), 64, 64)
    assert (s["instance"] == -1).all()
    assert np.isinf(s["depth"]).all()


def test_a_flattening_matrix_draws_a_flat_object():
    matrix = np.diag([1.0, 1.0, 0.0, 1.0])
    matrix[2, 3] = -2.0
    rng = np.random.default_rng(0)
    geometry = kernels.Geometry()
    normals = rng.normal(size=(240, 3)).astype(np.float32)
    add_triangles(geometry, rng.normal(size=(80, 3, 3)) * 2, matrix, corner_normals=normals)
    s = surface(geometry, down(), 64, 64)
    seen = s["triangle"] >= 0
    assert seen.mean() > 0.9
    assert all(np.isfinite(s[name][seen]).all() for name in ALL_ATTRIBUTES)
    np.testing.assert_allclose(s["depth"][seen], 2.0, rtol=1e-6)
    np.testing.assert_allclose(s["geometric_normal"][seen][:, 2], 1.0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(s["shading_normal"][seen], axis=-1), 1.0, atol=1e-6)
