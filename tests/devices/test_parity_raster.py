"""Geometry, surface and layered depth: the GPU against the kernels on identical inputs.

Tolerances. Both snap outlines to 1/256 pixel, but the GPU transforms vertices in float32, so a pixel may
change sides where it lies within 1.5/256 pixel of an edge; the float64 brute force says which pixels those
are, and everywhere else both must hold the same triangles. Depths come from float32 vertices: a rounding of
the largest corner by a few units in the last place, and a shift of the plane across the image by that much,
which costs its slope times the shift.
"""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.core.arrays import Opacities, OpacityArrays
from strata.addon.core.surface import ATTRIBUTES, Chunk
from strata.addon.effects.shared.steps import LAYERED_DEPTH, SURFACE
from strata.tests.kernels.raster_scenes import brute_force, down, pixel_rays, random_triangles, turned_view
from strata.tests.support.gpu_scenes import (
    EPSILON,
    bumpy_sheet,
    matrix_of,
    on_both,
    rotation,
    scene_of,
    share_beyond,
    triangle_mesh,
)

WIDTH, HEIGHT = 80, 60


def layered_depths(devices, view, layers, size=(WIDTH, HEIGHT), casters=None):
    maps = []
    for device, geometry in devices:
        everything = frozenset(range(len(device.instance_mask(()))))
        value = LAYERED_DEPTH.twin(device.name)(
            device, geometry, view, everything if casters is None else casters, layers, *size
        )
        maps.append(device.to_host(value))
    return maps


def surfaces(devices, view, chunk, attributes=tuple(ATTRIBUTES), visible=None, **more):
    values = []
    for device, geometry in devices:
        everything = frozenset(range(len(device.instance_mask(()))))
        value = SURFACE.twin(device.name)(
            device, geometry, view, everything if visible is None else visible, chunk, frozenset(attributes),
            **more,
        )  # fmt: skip
        values.append(device.to_host(value))
    return values


def depth_slopes(view, triangles, width, height, jitter=(0.0, 0.0)):
    """How much each triangle's plane changes its depth over a pixel (T, height, width)."""
    origin, direction = pixel_rays(view, width, height, jitter)
    corners = view.to_view(np.asarray(triangles, np.float64))
    a, b, c = (corners[:, i, None, None] for i in range(3))
    normal = np.cross(b - a, c - a)
    step = (view.window[1] - view.window[0]) / width, (view.window[3] - view.window[2]) / height
    across = np.hypot(normal[..., 0] * step[0], normal[..., 1] * step[1])
    with np.errstate(all="ignore"):
        if view.orthographic:
            return np.broadcast_to(across / np.abs(normal[..., 2]), (len(corners), height, width))
        t = ((a - origin) * normal).sum(-1) / (direction * normal).sum(-1)
        return across / np.abs((a * normal).sum(-1)) * t * t


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("kind", ["ordinary", "sliver", "near", "tiny", "huge"])
def test_layered_depths_agree(kind, orthographic):
    rng = np.random.default_rng(11)
    far = {"huge": 1e6, "near": 4.0}.get(kind, 40.0)  # 4: through the middle of the triangles
    view = turned_view(rng, near=0.3, far=far, orthographic=orthographic, half=2.0 if orthographic else 0.7)
    triangles = random_triangles(rng, view, kind, 60)
    devices = on_both(*scene_of([triangle_mesh(triangles)]))
    cpu, gpu = layered_depths(devices, view, 8)
    exact, doubtful = brute_force(view, triangles, WIDTH, HEIGHT)
    sure = ~doubtful.any(axis=0)
    assert sure.mean() > 0.9
    assert np.isfinite(cpu[0]).any() or kind == "tiny"
    assert np.array_equal(np.isfinite(cpu)[:, sure], np.isfinite(gpu)[:, sure])
    # Neither differs from the true planes by more than float32 vertices explain.
    order = np.argsort(exact, axis=0)[:8]
    expected = np.take_along_axis(exact, order, axis=0)
    slope = np.take_along_axis(depth_slopes(view, triangles, WIDTH, HEIGHT), order, axis=0)
    largest = np.abs(view.to_view(triangles)).max()
    shift_pixels = 0.01 if kind == "huge" else 2e-3  # a corner at 1e4 m is known to 1e-3 m
    tolerance = 8 * EPSILON * largest + slope * shift_pixels
    # Close depths may swap; sorted lists then differ by no more than the larger tolerance nearby.
    tolerance = np.maximum(tolerance, np.maximum(np.roll(tolerance, 1, 0), np.roll(tolerance, -1, 0)))
    there = np.isfinite(expected) & sure
    with np.errstate(invalid="ignore"):
        assert (np.abs(gpu - expected)[there] <= tolerance[there]).all()


def sure_of(cpu, view, triangles, jitter, kind, orthographic) -> tuple[np.ndarray, np.ndarray]:
    """Pixels that both must see alike, and (height, width) metres by which their depths may differ there."""
    exact, doubtful = brute_force(view, triangles, WIDTH, HEIGHT, jitter)
    # A pixel is in doubt, too, where the two nearest depths are closer than their rounding.
    nearest = np.sort(exact, axis=0)[:2]
    slope = np.take_along_axis(
        depth_slopes(view, triangles, WIDTH, HEIGHT, jitter), np.argsort(exact, axis=0)[:1], axis=0
    )[0]
    largest = np.abs(view.to_view(triangles)).max()
    # A corner at 1e4 m is known to 1e-3 m; a sliver's weights lose the sine of its angle, here 0.01.
    shift_pixels = {"huge": 0.01, "sliver": 0.01}.get(kind, 2e-3)
    pixel_m = (view.window[1] - view.window[0]) / WIDTH * (1.0 if orthographic else cpu["depth"])
    shift = np.hypot(np.where(np.isfinite(slope), slope, 0.0), np.where(np.isfinite(pixel_m), pixel_m, 0.0))
    tolerance = 8 * EPSILON * largest + shift * shift_pixels
    with np.errstate(invalid="ignore"):
        tied = nearest[1] - nearest[0] <= 2 * tolerance
    sure = ~doubtful.any(axis=0) & ~tied
    return sure, tolerance


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("kind", ["ordinary", "sliver", "near", "huge"])
def test_surfaces_of_triangle_soup_agree(kind, orthographic):
    rng = np.random.default_rng(23)
    far = {"huge": 1e6, "near": 4.0}.get(kind, 40.0)  # 4: through the middle of the triangles
    view = turned_view(rng, near=0.3, far=far, orthographic=orthographic, half=2.0 if orthographic else 0.7)
    triangles = random_triangles(rng, view, kind, 60)
    devices = on_both(*scene_of([triangle_mesh(triangles)]))
    jitter = (0.31, -0.17)
    cpu, gpu = surfaces(devices, view, Chunk(WIDTH, HEIGHT, 0, HEIGHT, 0, jitter))
    sure, tolerance = sure_of(cpu, view, triangles, jitter, kind, orthographic)
    assert sure.mean() > 0.9
    for name in ("triangle", "instance", "object_id", "material"):
        assert np.array_equal(cpu[name][sure], gpu[name][sure])
    seen = sure & (cpu["triangle"] >= 0)
    assert seen.mean() > 0.1
    # Along the ray the tolerance of depths; the ray's own length over its depth is below 2 here.
    assert (np.abs(cpu["position"] - gpu["position"])[seen].max(-1) <= 2 * tolerance[seen]).all()
    assert (np.abs(cpu["depth"][seen] - gpu["depth"][seen]) <= 2 * tolerance[seen]).all()
    assert (gpu["depth"][~np.isfinite(cpu["depth"]) & sure] == np.inf).all()
    # A side a - b of corners of size 1 is rounded by an ulp of the corner: slivers 0.02 wide lose most.
    turned = np.abs(cpu["geometric_normal"] - gpu["geometric_normal"])[seen].max()
    assert turned <= (1e-3 if kind == "sliver" else 1e-5)


def courtyard(rng, offset=0.0, ground_last=False):
    """Two meshes, six instances (turned, mirrored, squeezed), an alpha texture, an absent material."""
    ground = triangle_mesh(
        np.array([[[-9, -9, 0], [9, -9, 0], [9, 9, 0]], [[-9, -9, 0], [9, 9, 0], [-9, 9, 0]]])
    )
    instances = [(1, matrix_of(np.eye(3), (offset, 0, 0)), -7, (0,))]
    for index in range(5):
        linear = rotation(rng) @ np.diag([1.5, -1.5 if index % 2 else 1.5, 0.3 if index == 3 else 1.5])
        moved = np.array([offset, 0, 0]) + rng.uniform((-2, -2, 0.8), (2, 2, 2.5))
        instances.append((0, matrix_of(linear, moved), 2**24 + index, (0, 1) if index < 3 else (2, 3)))
    if ground_last:
        instances.append(instances.pop(0))
    opacities = (
        Opacities(),
        Opacities.of(OpacityArrays(texels=rng.random((7, 5)).astype(np.float32), threshold=0.5)),
        Opacities.of(OpacityArrays(0.4, threshold=0.5)),
        Opacities.of(OpacityArrays(0.6, threshold=0.5)),
    )
    return scene_of([bumpy_sheet(rng, 12), ground], instances, opacities)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_surfaces_of_a_scene_agree(offset, orthographic):
    rng = np.random.default_rng(5)
    devices = on_both(*courtyard(rng, offset))
    half = 3.0 if orthographic else 0.5
    view = down((-half, half, -half, half), 0.1, 50.0, (offset + 0.3, 0.2, 6.0), orthographic)
    chunk = Chunk(160, 120, 40, 110, 0, (0.2, 0.4))
    cpu, gpu = surfaces(devices, view, chunk)
    assert {name: (a.dtype, a.shape) for name, a in cpu.items()} == {
        name: (a.dtype, a.shape) for name, a in gpu.items()
    }
    assert len(np.unique(cpu["instance"])) == 6
    assert len(np.unique(cpu["material"])) >= 3
    # Silhouettes, seams and the borders of alpha texels: those few pixels that float32 puts elsewhere.
    other = (cpu["instance"] != gpu["instance"]) | (cpu["triangle"] != gpu["triangle"])
    assert other.mean() < 2e-3
    same = ~other
    for name in ("object_id", "material"):
        assert np.array_equal(cpu[name][same], gpu[name][same])
    # Points 6 m away on planes tilted up to 80 degrees: a few ulp of 6 m, times 1 / cos.
    assert np.abs(cpu["position"] - gpu["position"])[same].max() < 40 * EPSILON * 6.0
    assert (
        np.abs(cpu["depth"][same] - gpu["depth"][same])[cpu["instance"][same] >= 0].max() < 40 * EPSILON * 6.0
    )
    # Weights of corners are good to position error / triangle size (0.2 m), and uv change by 0.3 a triangle.
    assert np.abs(cpu["uv"] - gpu["uv"])[same].max() < 2e-4
    assert np.abs(cpu["corner_colour"] - gpu["corner_colour"])[same].max() < 2e-4
    # The ground has no colours of its own.
    assert (cpu["corner_colour"][(cpu["instance"] == 0)] == 1.0).all()
    assert np.abs(cpu["shading_normal"] - gpu["shading_normal"])[same].max() < 2e-4
    assert np.abs(cpu["geometric_normal"] - gpu["geometric_normal"])[same].max() < 2e-5
    # Weights, as good, times the bend of a triangle, which is some hundredths of a metre high.
    lifts = np.linalg.norm(cpu["terminator_lift"], axis=-1)
    assert 2e-3 < lifts[same].max() < 0.1
    assert np.abs(cpu["terminator_lift"] - gpu["terminator_lift"])[same].max() < 2e-5


def test_holdouts_hide_and_show_nothing():
    devices = on_both(*courtyard(np.random.default_rng(5)))
    view = down((-0.5, 0.5, -0.5, 0.5), 0.1, 50.0, (0.3, 0.2, 6.0))
    chunk = Chunk(160, 120, 40, 110, 0, (0.2, 0.4))
    held = frozenset({1, 3})
    for whole, holed in zip(
        surfaces(devices, view, chunk), surfaces(devices, view, chunk, holdouts=held), strict=True
    ):
        is_hole = np.isin(whole["instance"], sorted(held))
        assert is_hole.mean() > 0.02
        for name, each in ATTRIBUTES.items():
            assert np.array_equal(holed[name][~is_hole], whole[name][~is_hole]), name
            expected = whole[name][is_hole] if name == "depth" else each.miss
            assert (holed[name][is_hole] == expected).all(), name
    some = surfaces(devices, view, chunk, ("material",), holdouts=held)
    assert all(set(each) == {"material"} for each in some)


@pytest.mark.parametrize("ground_last", [False, True])
def test_layered_depths_of_a_scene_agree_for_any_casters(ground_last):
    """With the ground drawn last: rasterisers that drop what an opaque triangle covers must not drop this."""
    rng = np.random.default_rng(7)
    devices = on_both(*courtyard(rng, ground_last=ground_last))
    view = down((-0.7, 0.7, -0.7, 0.7), 0.5, np.inf, (0.3, 0.2, 6.0))
    for casters in (frozenset({0, 1, 2, 3, 4, 5}), frozenset({2, 4}), frozenset()):
        cpu, gpu = layered_depths(devices, view, 4, (256, 256), casters)
        assert share_beyond(cpu, gpu, 1e-4) < 2e-3  # outlines and alpha texels, as above
        assert (np.diff(np.where(np.isfinite(gpu), gpu, 1e30), axis=0) >= 0).all()
    assert not np.isfinite(gpu).any()


@pytest.mark.parametrize("orthographic", [False, True])
def test_slivers_keep_to_their_own_depths(orthographic):
    """Thinner than the 1/256 pixel that outlines are snapped by, and steep: planes leave them at once."""
    rng = np.random.default_rng(13)
    start = np.concatenate([rng.uniform(-0.9, 0.9, (4000, 2)), np.full((4000, 1), -2.0)], axis=1)
    end = start + np.concatenate([rng.normal(size=(4000, 2)) * 0.3, np.full((4000, 1), -0.5)], axis=1)
    apex = 0.5 * (start + end) + np.concatenate(
        [rng.normal(size=(4000, 2)) * 1e-4, np.full((4000, 1), 0.2)], axis=1
    )
    devices = on_both(*scene_of([triangle_mesh(np.stack([start, end, apex], axis=1))]))
    view = down(near=0.1, orthographic=orthographic)
    depths = layered_depths(devices, view, 4, (96, 96))[1]
    seen = depths[np.isfinite(depths)]
    assert len(seen) > 100
    assert seen.min() >= 2.0 - 1e-6
    assert seen.max() <= 2.5 + 1e-6


def test_both_devices_draw_bit_by_bit_the_same_twice():
    rng = np.random.default_rng(9)
    outline, arrays = courtyard(rng)
    view = down((-0.7, 0.7, -0.7, 0.7), 0.5, np.inf, (0.3, 0.2, 6.0))
    runs = []
    for _ in range(2):
        devices = on_both(outline, arrays)
        chunk = Chunk(160, 120, 0, 120, 0, (0.0, 0.0))
        runs.append((layered_depths(devices, view, 6, (256, 256)), surfaces(devices, view, chunk)))
    for first, second in zip(runs[0][0], runs[1][0], strict=True):
        assert np.array_equal(first, second)
    for first, second in zip(runs[0][1], runs[1][1], strict=True):
        assert all(np.array_equal(first[name], second[name]) for name in ATTRIBUTES)


def test_wanted_attributes_only():
    devices = on_both(*courtyard(np.random.default_rng(5)))
    view = down(eye=(0.0, 0.0, 6.0))
    chunk = Chunk(32, 24, 0, 24, 0, (0.0, 0.0))
    everything = surfaces(devices, view, chunk)[1]
    for attributes in (("depth",), ("position", "instance"), ("shading_normal",), ("uv", "triangle")):
        some = surfaces(devices, view, chunk, attributes)[1]
        assert set(some) == set(attributes)
        assert all(np.array_equal(some[name], everything[name]) for name in attributes)


def test_tiles_of_rows_are_the_rows_of_the_whole():
    devices = on_both(*courtyard(np.random.default_rng(5)))
    view = down(eye=(0.0, 0.0, 6.0))
    whole = surfaces(devices, view, Chunk(64, 48, 0, 48, 0, (0.0, 0.0)), ("depth", "instance"))[1]
    parts = [
        surfaces(devices, view, Chunk(64, 48, y0, y1, 0, (0.0, 0.0)), ("depth", "instance"))[1]
        for y0, y1 in ((0, 13), (13, 40), (40, 48))
    ]
    joined = np.concatenate([part["instance"] for part in parts])
    assert (joined != whole["instance"]).mean() < 2e-3  # rows are other clip coordinates: outlines may move


@pytest.mark.parametrize("backend", [0, 1])
def test_nothing_to_draw_is_no_error(backend):
    devices = on_both(*scene_of([triangle_mesh(np.zeros((0, 3, 3)))]))[backend : backend + 1]
    depths = layered_depths(devices, down(), 2, (16, 16))[0]
    assert np.isposinf(depths).all()
    found = surfaces(devices, down(), Chunk(16, 16, 0, 16, 0, (0.0, 0.0)))[0]
    assert (found["instance"] == -1).all()
    assert np.isposinf(found["depth"]).all()


def test_bad_vertices_and_matrices_leave_the_rest_alone():
    good = np.array([[[-9.0, -9, -2], [9, -9, -2], [0, 9, -2]]])
    bad = np.array([[[np.nan, 0, -1], [1, 0, -1], [0, 1, -1]], [[-9, -9, -1], [np.inf, -9, -1], [0, 9, -1]]])
    flat = matrix_of(np.zeros((3, 3)), (0, 0, -1.0))
    huge = matrix_of(np.eye(3) * 1e300, (0, 0, 0))
    meshes = [triangle_mesh(np.concatenate([bad, good])), triangle_mesh(good)]
    instances = [(0, np.eye(4), 1, (0,)), (1, flat, 2, (0,)), (1, huge, 3, (0,))]
    for depths in layered_depths(on_both(*scene_of(meshes, instances)), down(), 3, (16, 16)):
        # Where the good triangle lies, its depth and nothing else.
        np.testing.assert_allclose(depths[0][2:6, 6:10], 2.0, rtol=1e-6)
        assert np.isposinf(depths[1][2:6, 6:10]).all()


def test_more_triangles_than_one_draw_takes(monkeypatch):
    devices = on_both(*courtyard(np.random.default_rng(5)))
    view = down(eye=(0.0, 0.0, 6.0), near=0.5)
    whole = layered_depths(devices[1:], view, 4, (64, 64))[0]
    monkeypatch.setattr(type(devices[1][0]), "TRIANGLES_PER_DRAW", 100)
    assert np.array_equal(layered_depths(devices[1:], view, 4, (64, 64))[0], whole)
