"""Coverage and layered depths of the rasteriser against brute force in double precision."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
import strata_kernels as kernels
from strata.tests.kernels.raster_scenes import (
    add_triangles,
    brute_force,
    cone_about_the_eye,
    down,
    everything,
    opacity,
    random_triangles,
    sheet,
    turned_view,
)

SCREEN_FILLING = [[-99.0, -99.0, -2.0], [99.0, -99.0, -2.0], [0.0, 99.0, -2.0]]


def layered(geometry, view, layers, width, height):
    return kernels.layered_depth(geometry, everything(geometry), view.packed(), layers, width, height)


def add_sheet(geometry, positions, triangles):
    starts = np.arange(0, triangles.size + 1, 3, dtype=np.int32)
    mesh = geometry.add_mesh(positions, triangles.ravel(), starts)
    geometry.add_instance(mesh, np.eye(4), 0, [geometry.add_material()])


# Coverage


@pytest.mark.parametrize("cells", [3, 17, 60, 150])
def test_a_sheet_covers_every_pixel_exactly_once(cells):
    geometry = kernels.Geometry()
    add_sheet(geometry, *sheet(np.random.default_rng(cells), cells, cells + 2))
    # Orthographic: in perspective the wobbling depths would fold it over.
    layers = layered(geometry, down(orthographic=True), 16, 130, 101)
    assert (np.isfinite(layers).sum(0) == 1).all()


def test_a_sheet_seen_in_perspective_covers_every_pixel_exactly_once():
    positions, triangles = sheet(np.random.default_rng(7), 80, 70)
    positions[:, :2] *= -positions[:, 2:]
    geometry = kernels.Geometry()
    add_sheet(geometry, positions, triangles)
    assert (np.isfinite(layered(geometry, down(), 16, 130, 101)).sum(0) == 1).all()


def test_vertices_on_pixel_centres_cover_every_pixel_once():
    # Every vertex and every diagonal runs through pixel centres: all the ties of the fill rule.
    n = 32
    x, y = np.meshgrid(np.arange(-2, n + 3), np.arange(-2, n + 3))
    positions = np.stack([(x + 0.5) / n * 2 - 1, (y + 0.5) / n * 2 - 1, np.full(x.shape, -1.0)], -1)
    a = (np.arange(n + 4)[:, None] * (n + 5) + np.arange(n + 4)).ravel()
    triangles = np.concatenate([np.stack([a, a + 1, a + n + 6], -1), np.stack([a, a + n + 6, a + n + 5], -1)])
    geometry = kernels.Geometry()
    add_sheet(geometry, positions.reshape(-1, 3).astype(np.float32), triangles.astype(np.int32))
    layers = layered(geometry, down(orthographic=True), 16, n, n)
    assert (np.isfinite(layers).sum(0) == 1).all()


def test_top_left_rule():
    # A square from pixel centre to pixel centre owns its left and top edges, not its right and bottom ones.
    low, high = (2 + 0.5) / 8 * 2 - 1, (5 + 0.5) / 8 * 2 - 1
    quad = np.array([[low, low, -1], [high, low, -1], [high, high, -1], [low, high, -1]])
    geometry = kernels.Geometry()
    add_triangles(geometry, quad[[0, 1, 2, 0, 2, 3]])
    rows, columns = np.nonzero(np.isfinite(layered(geometry, down(), 1, 8, 8)[0]))
    assert (columns.min(), columns.max(), rows.min(), rows.max(), len(rows)) == (2, 4, 3, 5, 9)


@pytest.mark.parametrize("seed", range(4))
def test_a_fan_through_the_near_plane_leaves_no_holes(seed):
    triangles = cone_about_the_eye(seed)
    geometry = kernels.Geometry()
    add_triangles(geometry, triangles)
    view = down(near=1e-4)
    depths, doubtful = brute_force(view, triangles, 97, 83)
    clear = ~doubtful.any(0)
    count = np.isfinite(layered(geometry, view, 16, 97, 83)).sum(0)
    np.testing.assert_array_equal(count[clear], np.isfinite(depths).sum(0)[clear])
    assert (count == 1).mean() > 0.95


# Depths


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("kind", ["ordinary", "sliver", "near", "tiny", "huge"])
def test_peeled_depths_against_brute_force(kind, orthographic):
    rng = np.random.default_rng(3)
    width, height, layers = 61, 47, 8
    far = 1e6 if kind == "huge" else 40.0
    view = turned_view(rng, near=0.3, far=far, orthographic=orthographic, half=2.0 if orthographic else 0.7)
    triangles = random_triangles(rng, view, kind, 2000 if kind == "tiny" else 60)
    geometry = kernels.Geometry()
    add_triangles(geometry, triangles)
    measured = layered(geometry, view, layers, width, height)
    depths, doubtful = brute_force(view, triangles, width, height)
    clear = ~doubtful.any(0)
    measured, expected = measured[:, clear], np.sort(depths, 0)[:layers, clear]
    finite = np.isfinite(expected)
    assert clear.mean() > 0.7
    assert finite.sum() > 300
    np.testing.assert_array_equal(np.isfinite(measured), finite)
    # float32: the plane is stepped from a double to within a block, then rounded, then divided.
    np.testing.assert_allclose(measured[finite], expected[finite], rtol=5e-6)


@pytest.mark.parametrize("orthographic", [False, True])
def test_depths_never_leave_their_triangle(orthographic):
    # Seen all but edge on and a few subpixels wide, along a row of pixel centres: pixels that only
    # snapping put inside the outline lie far off the plane.
    rng = np.random.default_rng(12)
    view, size, found = down(orthographic=orthographic), 48, 0
    for _ in range(300):
        depth = rng.uniform(1.0, 50.0, 3)
        row = (rng.integers(size) + 0.5) / size * 2 - 1
        y = row + rng.normal(size=3) * 10.0 ** rng.uniform(-4.0, -2.0) * 2 / size
        window = np.stack([[-1.0, rng.uniform(-0.5, 0.5), 1.0], y], -1)
        corners = np.c_[window * (1.0 if orthographic else depth[:, None]), -depth].astype(np.float32)
        geometry = kernels.Geometry()
        add_triangles(geometry, corners)
        depths = layered(geometry, view, 2, size, size)
        own = depths[np.isfinite(depths)]
        found += own.size
        assert (own >= -corners[:, 2].max()).all()
        assert (own <= -corners[:, 2].min()).all()
    assert found > 100


def test_layers_ascend_and_fewer_are_the_first_of_more():
    rng = np.random.default_rng(5)
    view = turned_view(rng)
    geometry = kernels.Geometry()
    add_triangles(geometry, random_triangles(rng, view, "ordinary", 300))
    maps = {k: layered(geometry, view, k, 150, 90) for k in (1, 4, 8, 16)}
    np.testing.assert_array_equal(maps[1], maps[8][:1])
    np.testing.assert_array_equal(maps[4], maps[16][:4])
    assert (maps[16][1:] >= maps[16][:-1]).all()
    assert np.isfinite(maps[16]).mean() > 0.2


def test_coplanar_duplicates_are_all_kept():
    geometry = kernels.Geometry()
    add_triangles(geometry, [SCREEN_FILLING] * 3)
    layers = layered(geometry, down(), 4, 8, 8)
    assert (layers[:3] == 2.0).all()
    assert np.isinf(layers[3]).all()


def test_far_plane_and_hidden_instances_are_left_out():
    geometry = kernels.Geometry()
    for scale in (1.0, 2.0, 4.0):
        add_triangles(geometry, np.array([SCREEN_FILLING]) * scale)
    mask = np.array([0, 1, 1], np.uint8)
    layers = kernels.layered_depth(geometry, mask, down(far=5.0).packed(), 3, 4, 4)
    assert (layers[0] == 4.0).all()
    assert np.isinf(layers[1:]).all()


def test_alpha_clip_lets_light_through():
    rng = np.random.default_rng(6)
    texels = (rng.random((4, 4)) < 0.5).astype(np.float32)
    geometry = kernels.Geometry()
    leaf, absent = opacity(geometry, texels=texels, threshold=0.5), opacity(geometry, value=0.0)
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], np.float32)
    square = np.concatenate([uvs * 2 - 1, np.zeros((6, 1), np.float32)], -1)
    add_triangles(geometry, square - [0, 0, 1], material=leaf, corner_uvs=uvs)
    add_triangles(geometry, square * 9 - [0, 0, 0.5], material=absent)
    add_triangles(geometry, square * 9 - [0, 0, 2])
    layers = layered(geometry, down(), 2, 4, 4)
    # Texel centres fall on pixel centres: nothing is interpolated.
    np.testing.assert_array_equal(layers[0], np.where(texels > 0, 1.0, 2.0).astype(np.float32))
    np.testing.assert_array_equal(layers[1], np.where(texels > 0, 2.0, np.inf).astype(np.float32))


# Threads, cancelling, border

DIGEST = """
import hashlib
import numpy as np
import strata_kernels as kernels
rng = np.random.default_rng(9)
g = kernels.Geometry()
clip = kernels.Opacity(texels=rng.random((8, 8)).astype("f"), threshold=0.5)
for material in (g.add_material(), g.add_material((clip, clip), (clip, clip))):
    p = (rng.normal(size=(9000, 1, 3)) * 3 + rng.normal(size=(9000, 3, 3)) * 0.3).reshape(-1, 3).astype("f")
    n = np.arange(len(p) + 1, dtype="i")
    m = g.add_mesh(p, n[:-1], n[::3].copy(), None, rng.random((len(p), 2)).astype("f"))
    for z in (-4.0, -5.0):
        matrix = np.eye(4)
        matrix[2, 3] = z
        g.add_instance(m, matrix, 0, [material])
view = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, -1, -1, 1, -1, 1, 0.01, 100, 0], float)
digest, drawn = hashlib.sha256(), np.ones(4, bool)
names = ["position", "shading_normal", "depth", "uv", "instance", "triangle", "material"]
for image in kernels.raster_surface(g, drawn, view, 200, 170, attributes=names).values():
    digest.update(image.tobytes())
digest.update(kernels.layered_depth(g, drawn, view, 5, 200, 170).tobytes())
view[18] = 1
digest.update(kernels.layered_depth(g, drawn, view, 3, 200, 170).tobytes())
print(digest.hexdigest())
"""


def test_same_bits_on_any_number_of_threads_and_any_processor():
    settings = [{"RAYON_NUM_THREADS": "1"}, {"RAYON_NUM_THREADS": "2"}, {"RAYON_NUM_THREADS": "7"}]
    digests = set()
    for setting in [*settings, {"STRATA_PORTABLE": "1"}]:
        run = subprocess.run(
            [sys.executable, "-c", DIGEST], env={**os.environ, **setting}, capture_output=True, text=True
        )
        assert run.returncode == 0, run.stderr
        digests.add(run.stdout)
    assert len(digests) == 1


def test_a_raised_flag_cancels():
    geometry = kernels.Geometry()
    add_triangles(geometry, [SCREEN_FILLING])
    cancel = kernels.CancelFlag()
    cancel.set()
    with pytest.raises(kernels.Cancelled):
        kernels.layered_depth(geometry, everything(geometry), down().packed(), 2, 8, 8, cancel=cancel)
    with pytest.raises(kernels.Cancelled):
        kernels.raster_surface(geometry, everything(geometry), down().packed(), 8, 8, cancel=cancel)


def bad_calls():
    geometry = kernels.Geometry()
    add_triangles(geometry, [SCREEN_FILLING])
    mask, view = everything(geometry), down().packed()
    endless = view.copy()
    endless[0] = np.inf

    def depth(mask=mask, view=view, layers=1, width=8, height=8):
        return lambda: kernels.layered_depth(geometry, mask, view, layers, width, height)

    def surface(**keywords):
        return lambda: kernels.raster_surface(geometry, mask, view, 8, 8, **keywords)

    return [
        (depth(layers=0), "1 to 16"),
        (depth(layers=17), "1 to 16"),
        (depth(width=0), "pixels a side"),
        (depth(height=40000), "pixels a side"),
        (depth(mask=mask[:0]), "marks"),
        (depth(mask=mask.astype(float)), "bool or uint8"),
        (depth(view=endless), "finite"),
        (depth(view=down(near=0.0).packed()), "near"),
        (depth(view=view[:4]), "19 numbers"),
        (surface(rows=(4, 9000)), "rows"),
        (surface(columns=(-9000, 4)), "columns"),
        (surface(rows=(4, 4)), "rows"),
        (surface(attributes=["colour"]), "colour"),
        (surface(jitter=(np.nan, 0.0)), "finite"),
        (surface(jitter=(0.0, -65.0)), "64 pixels"),
    ]


@pytest.mark.parametrize(("call", "message"), bad_calls())
def test_bad_input_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_empty_geometry_is_empty():
    assert np.isinf(layered(kernels.Geometry(), down(), 2, 5, 3)).all()
