"""Soft shadow maps against closed forms, against rays, and against their own plain twin."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.emitter import EmitterKind
from strata.addon.core.view import View
from strata.tests.effects.soft_shadow.scenes import (
    DOWN,
    GROUND,
    HIGH,
    LOW,
    UP,
    Stage,
    ground_points,
    lamp,
    plate,
)
from strata.tests.support import closed_forms


def turned_axes(forward):
    forward = np.array(forward) / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    return tuple(tuple(map(float, axis)) for axis in (right, np.cross(right, forward), forward))


def weighted_rmse(found, truth, weight):
    return float(np.sqrt((weight * (found - truth) ** 2).sum() / weight.sum()))


def against_closed_form(emitter, plates, points, extra=(GROUND,), **settings):
    truth, weight = closed_forms.visibility(emitter, points, np.tile(UP, (len(points), 1)), plates)
    found, _ = Stage([*extra, *plates]).visibility(emitter, points, UP, **settings)
    return weighted_rmse(found, truth, weight)


def torus(major_radius, minor_radius, rotation, place, around=48, across=24):
    """Positions and quads of a torus."""
    a, b = np.meshgrid(
        np.arange(around) * 2 * np.pi / around, np.arange(across) * 2 * np.pi / across, indexing="ij"
    )
    ring = major_radius + minor_radius * np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), minor_radius * np.sin(b)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    corner = lambda i, j: i % around * across + j % across  # noqa: E731
    quads = np.stack([corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)], -1).reshape(
        -1, 4
    )
    return points @ rotation.T + place, quads


@pytest.fixture(scope="module")
def tori():
    """Eight tori over the ground, and a camera's surface of them."""
    rng = np.random.default_rng(3)
    meshes = []
    for i in range(8):
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        place = np.array([1.3 * (i % 4 - 1.5), 1.3 * (i // 4 - 0.5), rng.uniform(0.7, 1.8)])
        meshes.append(torus(0.5, 0.16, rotation, place))
    stage = Stage([GROUND], meshes, origin=(0.5, -4.0, 4.0))
    stage = Stage([GROUND - stage.origin], [(p - stage.origin, q) for p, q in meshes], stage.origin)
    right, up, forward = turned_axes((0.0, 1.0, -1.0))
    camera = View(tuple(stage.origin), right, up, forward, (-0.6, 0.6, -0.4, 0.4), 0.1, 100.0)
    surface = kernels.raster_surface(
        stage.geometry,
        stage.everything(),
        camera.packed(),
        96,
        64,
        attributes=["geometric_normal", "position", "shading_normal"],
    )
    emitter = lamp(centre=(0.3, -0.2, 4.5), half=(0.5, 0.5))
    names = ("position", "geometric_normal", "shading_normal")
    return stage, emitter, [np.ascontiguousarray(surface[name]) for name in names]


def tori_maps(tori, **settings):
    stage, emitter, (position, _, _) = tori
    return stage.maps(emitter, position.reshape(-1, 3), **settings)


def tori_visibility(tori, maps, *settings, **more):
    stage, emitter, surface = tori
    return kernels.soft_shadow_backproject(*surface, stage.origin, emitter.packed(), maps, *settings, **more)


@pytest.fixture(scope="module")
def tori_truth(tori):
    """V by 1024 rays a point, and the unshadowed irradiance, flat."""
    stage, emitter, surface = tori
    accelerator = kernels.Accel(stage.geometry, stage.origin, stage.everything())
    points = [np.ascontiguousarray(a.reshape(-1, 3)) for a in surface]
    return kernels.ray_visibility(
        accelerator, stage.everything(), emitter.packed(), stage.origin, *points, 1024, 1
    )


# At 512 samples the light covers 11 to 22 texels a side, and each edge errs by about a twentieth of a texel
# (its rows meet the edge at different places). Where an edge crosses the light, 256 samples err by .004, the
# some 200 of a disk by .005; of two plates half the points are such. Little more than what was measured:
# .0018 .0037 .0037 .0020 .0021 .0045 .0026 .0043.
CASES = {
    "rectangle": (lamp(half=(0.5, 0.3)), [LOW], (GROUND,), 0.003),
    "stacked plates": (lamp(half=(0.5, 0.3)), [LOW, HIGH], (GROUND,), 0.004),
    "nothing behind the plates": (lamp(half=(0.5, 0.3)), [LOW, HIGH], (), 0.004),
    "ellipse": (lamp(EmitterKind.ELLIPSE, half=(0.5, 0.3)), [LOW], (GROUND,), 0.003),
    "sphere": (lamp(EmitterKind.SPHERE, half=(0.3, 0.3)), [LOW], (GROUND,), 0.003),
    "facing disk": (lamp(EmitterKind.FACING_DISK, half=(0.3, 0.3)), [LOW, HIGH], (GROUND,), 0.005),
    "sun": (
        lamp(EmitterKind.DISTANT_DISK, half=(0.1, 0.1), axes=turned_axes((0.3, 0.2, -1.0))),
        [LOW, HIGH],
        (GROUND,),
        0.004,
    ),
    "turned rectangle": (
        lamp(half=(0.5, 0.3), centre=(-0.8, 0.5, 4.0), axes=turned_axes((0.3, 0.2, -1.0))),
        [LOW, HIGH],
        (GROUND,),
        0.005,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_plates_agree_with_closed_forms(name):
    emitter, plates, extra, tolerance = CASES[name]
    assert against_closed_form(emitter, plates, ground_points(count=31), extra) < tolerance


def test_reading_every_texel_leaves_only_the_samples_and_the_resolution():
    emitter, plates, extra, _ = CASES["stacked plates"]
    # Measured .0013; a texel is 1/80 of the light where it is largest.
    assert against_closed_form(emitter, plates, ground_points(count=31), extra, settings=(1 << 20, 2)) < 0.003


# A plate close to the lamp, beside the small window around the points: only the wide map knows it, and it
# hides a part of the lamp from points within. Another reaches over the border.
BESIDE = [
    plate(-0.25, 0.1, -0.2, 0.3, 1.0),
    plate(0.28, 0.5, -0.3, 0.3, 3.5),
    plate(-0.8, -0.7, -0.8, 0.8, 0.3),
    plate(0.7, 0.8, -0.8, 0.8, 0.3),
]


def nested_maps(stage, windows, eye=(0.0, 0.0, 4.0), axes=DOWN, far=5.0, resolution=1024, **more):
    """Prepared maps of windows from one eye; orthographic ones each from an eye in its middle."""
    maps = []
    for window in windows:
        own = View(eye, *axes, window, 0.01, far, **more)
        if own.orthographic:
            middle = 0.5 * np.array([window[0] + window[1], window[2] + window[3]])
            moved = np.array(eye) + middle @ np.array(axes[:2])
            half = 0.5 * (window[1] - window[0]), 0.5 * (window[3] - window[2])
            own = View(
                tuple(moved.tolist()), *axes, (-half[0], half[0], -half[1], half[1]), 0.01, far, **more
            )
        size = (3, resolution, resolution)
        depths = kernels.layered_depth(stage.geometry, stage.everything(), own.packed(), *size)
        maps.append(kernels.soft_shadow_prepare(depths, own.packed()))
    return maps


@pytest.mark.parametrize(
    "windows",
    [
        [(-0.22, 0.22, -0.22, 0.22), (-0.3, 1.05, -0.65, 0.65)],
        # Borders on texels' borders, and points outside the smallest.
        [(-0.125, 0.0625, -0.125, 0.125), (-0.25, 0.25, -0.25, 0.25), (-1.05, 1.05, -1.05, 1.05)],
    ],
)
@pytest.mark.parametrize("method", ["bitmask", "plain"])
def test_a_point_sees_the_occluders_beside_a_small_window(windows, method):
    emitter, points, normals = lamp(half=(0.5, 0.5)), ground_points(half=0.6, count=15), np.float32(UP)
    truth, weight = closed_forms.visibility(emitter, points, np.tile(UP, (len(points), 1)), BESIDE)
    stage = Stage([GROUND, *BESIDE])
    maps = nested_maps(stage, windows)
    found, _ = stage.visibility(emitter, points, normals, method, maps=maps)
    # As the widest alone; to read the smallest map alone gave .13.
    assert weighted_rmse(found, truth, weight) < 0.012
    # The other twin, to the last sample.
    other = "plain" if method == "bitmask" else "bitmask"
    twin, _ = stage.visibility(emitter, points, normals, other, maps=maps)
    assert np.abs(found - twin).max() < 1e-5


def test_the_small_window_of_a_sun_reads_what_the_wide_one_knows():
    axes = turned_axes((0.3, 0.2, -1.0))
    emitter = lamp(EmitterKind.DISTANT_DISK, half=(0.1, 0.1), axes=axes)
    points, plates = ground_points(half=0.6, count=15), [plate(-0.45, 0.3, -1.2, 0.2, 2.5)]
    truth, weight = closed_forms.visibility(emitter, points, np.tile(UP, (len(points), 1)), plates)
    stage = Stage([GROUND, *plates])
    windows = [(-0.25, 0.125, -0.25, 0.125), (-3.0, 3.0, -3.0, 3.0)]
    maps = nested_maps(stage, windows, (0.0, 0.0, 6.0), axes, 20.0, orthographic=True)
    found, _ = stage.visibility(emitter, points, UP, maps=maps)
    # As the wide map alone; the small map alone gives .44.
    assert weighted_rmse(found, truth, weight) < 0.015
    alone, _ = stage.visibility(emitter, points, UP, maps=maps[1:])
    small, _ = stage.visibility(emitter, points, UP, maps=maps[:1])
    assert weighted_rmse(alone, truth, weight) < 0.015
    assert weighted_rmse(small, truth, weight) > 0.3


def test_nested_windows_do_not_count_an_area_twice():
    emitter, points = lamp(half=(0.5, 0.3)), ground_points(half=0.6, count=15)
    stage = Stage([GROUND, LOW])
    windows = [(-0.1, 0.07, -0.13, 0.05), (-0.6, 0.6, -0.6, 0.6)]
    maps = nested_maps(stage, windows, resolution=256)
    both, _ = stage.visibility(emitter, points, UP, "area", maps=maps, settings=(1 << 20, 1))
    wide, _ = stage.visibility(emitter, points, UP, "area", maps=maps[1:], settings=(1 << 20, 1))
    # They differ by where the fine map's texels end. Whole texels at the seam would add .02 to the sum.
    assert np.abs(both - wide).max() < 0.02
    assert np.abs((both - wide).mean()) < 2e-3


def test_the_penumbra_of_a_suns_edge_is_as_wide_as_the_sun():
    sun = lamp(EmitterKind.DISTANT_DISK, half=(0.05, 0.05))
    x = np.linspace(-0.15, 0.15, 61)
    points = np.stack([x, np.full_like(x, 0.003), np.zeros_like(x)], 1)
    screen = plate(-0.5, 0.0, -0.5, 0.5, 2.0)
    found, _ = Stage([GROUND, screen]).visibility(sun, points, UP)
    # Texels of 1/11 to 1/22 of the penumbra's .2 m; 256 samples of a disk err by .005.
    truth = closed_forms.disk_share_beyond_edge(-x / (2.0 * 0.05))
    assert np.abs(found - truth).max() < 0.03


def test_a_scene_of_tori_agrees_with_1024_rays(tori, tori_truth):
    truth, weight = tori_truth
    found, _ = tori_visibility(tori, tori_maps(tori))
    # 64 stratified rays reach about .010 on such scenes.
    assert weighted_rmse(found.ravel(), truth, weight) < 0.013
    found, _ = tori_visibility(tori, tori_maps(tori), 4096)
    assert weighted_rmse(found.ravel(), truth, weight) < 0.010


def test_a_missing_layer_and_a_shifted_map_show(tori, tori_truth):
    truth, weight = tori_truth
    stage, emitter, (position, _, _) = tori
    good = weighted_rmse(tori_visibility(tori, tori_maps(tori))[0].ravel(), truth, weight)
    leaking = weighted_rmse(tori_visibility(tori, tori_maps(tori, layers=2))[0].ravel(), truth, weight)
    shifted = []
    for view, depths in stage.depths(emitter, position.reshape(-1, 3)):
        shifted.append(kernels.soft_shadow_prepare(np.roll(depths, 8, axis=2), view.packed()))
    moved = weighted_rmse(tori_visibility(tori, shifted)[0].ravel(), truth, weight)
    assert leaking > 1.3 * good
    assert moved > 2.0 * good


@pytest.mark.parametrize("max_samples", [64, 512, 1 << 20])
def test_the_fast_twin_hides_the_same_samples_as_the_plain_one(tori, max_samples):
    maps = tori_maps(tori, resolution=512)
    fast, _ = tori_visibility(tori, maps, max_samples)
    plain, _ = tori_visibility(tori, maps, max_samples, method="plain")
    # One sample more or less would be 1/256; the rest is the order of adding up.
    assert np.abs(fast - plain).max() < 1e-5


@pytest.mark.parametrize("name", ["sphere", "facing disk", "sun", "ellipse"])
def test_the_twins_agree_for_every_kind_of_light(name):
    emitter, plates, extra, _ = CASES[name]
    stage, points = Stage([*extra, *plates]), ground_points(count=21)
    maps = stage.maps(emitter, points, resolution=512)
    fast, _ = stage.visibility(emitter, points, UP, maps=maps)
    normals = np.broadcast_to(np.float32(UP), points.shape).copy()
    arguments = (points.astype(np.float32), normals, normals, stage.origin, emitter.packed(), maps)
    plain, _ = kernels.soft_shadow_backproject(*arguments, method="plain")
    assert np.abs(fast - plain).max() < 1e-5


@pytest.mark.parametrize("kind", [EmitterKind.DISTANT_DISK, EmitterKind.RECTANGLE])
def test_points_on_parallel_planes_do_not_share_a_tangent_plane(kind):
    # The top of a plate comes first, as where its edge crosses an image; what lies under is in full shadow.
    top = np.array([[x, 0.0, 1.0] for x in np.linspace(-0.3, 0.3, 6)])
    under = top * (1.0, 1.0, 0.0)
    stage, emitter = Stage([GROUND, plate(-0.5, 0.5, -0.5, 0.5, 1.0)]), lamp(kind, half=(0.05, 0.05))
    found, _ = stage.visibility(emitter, np.concatenate([top, under]), UP)
    np.testing.assert_array_equal(found, np.repeat([1.0, 0.0], 6))


@pytest.mark.parametrize(
    "light",
    [
        {"tan_half_spread": 0.4},
        {"kind": EmitterKind.SPHERE, "half": (0.3, 0.3), "cos_cone": 0.85, "blend": 0.3},
        {"kind": EmitterKind.SPHERE, "half": (0.3, 0.3), "cos_cone": 0.85, "blend": 0.0},
    ],
)
def test_spread_and_cone_weigh_the_samples_alike_in_both_twins(light):
    emitter, points = lamp(**light), ground_points(count=21)
    stage = Stage([GROUND, LOW])
    maps = stage.maps(emitter, points, resolution=512)
    normals = np.broadcast_to(np.float32(UP), points.shape).copy()
    arguments = (points.astype(np.float32), normals, normals, stage.origin, emitter.packed(), maps)
    fast, _ = kernels.soft_shadow_backproject(*arguments)
    plain, _ = kernels.soft_shadow_backproject(*arguments, method="plain")
    assert np.abs(fast - plain).max() < 1e-5
    assert np.ptp(fast) > 0.5


def test_the_same_bits_on_any_number_of_threads_and_any_processor():
    digests = set()
    for environment in (
        {"RAYON_NUM_THREADS": "1"},
        {"RAYON_NUM_THREADS": "3"},
        {"STRATA_AVX512": "0"},
        {"STRATA_PORTABLE": "1"},
    ):
        here = {**os.environ, **environment}
        code = "from strata.tests.effects.soft_shadow.test_kernels import digest; print(digest())"
        run = [sys.executable, "-c", code]
        digests.add(subprocess.run(run, env=here, capture_output=True, text=True, check=True).stdout)
    assert len(digests) == 1


def digest() -> str:
    emitter, plates, extra, _ = CASES["sphere"]
    found, uncertain = Stage([*extra, *plates]).visibility(
        emitter, ground_points(count=21), UP, resolution=256
    )
    return hashlib.sha256(found.tobytes() + uncertain.tobytes()).hexdigest()


def test_samples_below_the_geometric_horizon_are_hidden():
    # A wall that faces +X under a lamp that reaches over its plane on both sides, shaded as if it leaned up.
    emitter = lamp(centre=(0.1, 0.0, 3.0), half=(0.6, 0.4))
    points = np.array([[0.0, y, z] for y in (-0.5, 0.2) for z in (0.0, 1.0, 2.0)])
    wall = np.broadcast_to(np.float32([1.0, 0.0, 0.0]), points.shape).copy()
    leaning = np.broadcast_to(np.float32([0.8, 0.0, 0.6]), points.shape).copy()
    found, _ = kernels.soft_shadow_backproject(
        points.astype(np.float32), wall, leaning, np.zeros(3), emitter.packed(), []
    )
    u, v = np.meshgrid(np.linspace(-1, 1, 801)[1::2], np.linspace(-1, 1, 801)[1::2])
    light = np.stack([0.1 + 0.6 * u, 0.4 * v, np.full_like(u, 3.0)], -1).reshape(-1, 3)
    for point, share in zip(points, found, strict=True):
        to_light = light - point
        length = np.linalg.norm(to_light, axis=1)
        weight = np.maximum(to_light @ leaning[0].astype(float), 0.0) * to_light[:, 2] / length**4
        # The edge of a half-plane on 256 samples.
        assert share == pytest.approx((weight * (to_light[:, 0] > 0.0)).sum() / weight.sum(), abs=0.012)


def test_turned_away_surfaces_are_not_lit_and_so_count_as_visible():
    points = ground_points(count=5)
    found, _ = Stage([GROUND, LOW]).visibility(lamp(), points, (0.0, 0.0, -1.0))
    np.testing.assert_array_equal(found, 1.0)


def test_the_sum_of_areas_is_exact_on_one_parallel_plate():
    emitter, points = lamp(half=(0.5, 0.3)), ground_points(count=21)
    found, uncertain = Stage([GROUND, LOW]).visibility(emitter, points, UP, "area", settings=(1 << 20, 2))
    # The plate at 1.5, projected through the point onto the lamp's plane at 4: a rectangle.
    grown = points[:, None, :2] + (LOW[None, ::2, :2] - points[:, None, :2]) * (4.0 / 1.5)
    covered = np.minimum(grown[:, 1], (0.5, 0.3)) - np.maximum(grown[:, 0], (-0.5, -0.3))
    truth = 1.0 - np.maximum(covered, 0.0).prod(axis=1) / (1.0 * 0.6)
    # Edges err by half a texel of some 1/40 of the lamp.
    assert np.abs(found - truth).max() < 0.03
    assert not uncertain.any()


@pytest.mark.parametrize("height", [2.3, 13.7, 77.7])
def test_the_sum_of_areas_leaves_ground_lit_that_is_parallel_to_the_light(height):
    # Rounding alone decides whether the ground is nearer to the light than itself.
    points = ground_points(half=0.6 * height, count=41, z=0.1234)
    stage = Stage([plate(-2 * height, 2 * height, -2 * height, 2 * height, 0.1234)])
    emitter = lamp(centre=(0.017, -0.031, 0.1234 + height), half=(0.1 * height, 0.1 * height))
    view = View(emitter.centre, *DOWN, (-1.0, 1.0, -1.0, 1.0), 0.5 * height, 2.0 * height)
    depths = kernels.layered_depth(stage.geometry, stage.everything(), view.packed(), 2, 512, 512)
    maps = [kernels.soft_shadow_prepare(depths, view.packed())]
    found, _ = stage.visibility(emitter, points, UP, "area", maps=maps)
    np.testing.assert_array_equal(found, 1.0)


def test_the_sum_of_areas_overshadows_where_occluders_overlap():
    emitter, plates, extra, _ = CASES["stacked plates"]
    points = ground_points(count=21)
    area = against_closed_form(emitter, plates, points, extra, method="area", settings=(1 << 20, 2))
    assert area > 10 * against_closed_form(emitter, plates, points, extra)


def test_uncertain_points_may_be_left_to_rays(tori):
    maps = tori_maps(tori, resolution=512)
    found, doubted = tori_visibility(tori, maps)
    left, uncertain = tori_visibility(tori, maps, leave_uncertain=True)
    assert not doubted.any()
    np.testing.assert_array_equal(left[uncertain == 1], 1.0)
    np.testing.assert_array_equal(left[uncertain == 0], found[uncertain == 0])
    plain, plainly_uncertain = tori_visibility(tori, maps, method="plain", leave_uncertain=True)
    np.testing.assert_array_equal(uncertain, plainly_uncertain)
    assert np.abs(left - plain).max() < 1e-5
    assert 0.0 < uncertain.mean() < 0.9


def test_scattered_points_get_what_the_image_got(tori):
    stage, emitter, surface = tori
    maps = tori_maps(tori, resolution=512)
    image, _ = tori_visibility(tori, maps)
    order = np.random.default_rng(2).permutation(image.size)
    scattered = [np.ascontiguousarray(a.reshape(-1, 3)[order]) for a in surface]
    found, _ = kernels.soft_shadow_backproject(*scattered, stage.origin, emitter.packed(), maps)
    np.testing.assert_array_equal(found, image.ravel()[order])


def test_cancelling_stops_it(tori):
    cancel = kernels.CancelFlag()
    maps = tori_maps(tori, resolution=256)
    cancel.set()
    with pytest.raises(kernels.Cancelled):
        tori_visibility(tori, maps, cancel=cancel)
    with pytest.raises(kernels.Cancelled):
        kernels.soft_shadow_prepare(np.ones((2, 64, 64), np.float32), lamp_view().packed(), cancel=cancel)


def lamp_view():
    return View((0.0, 0.0, 4.0), *DOWN, (-1.0, 1.0, -1.0, 1.0), 0.1, 10.0)


@pytest.mark.parametrize("shape", [(0, 8, 8), (2, 0, 8), (2, 8, 0)])
def test_maps_of_useless_shape_are_refused(shape):
    with pytest.raises(ValueError, match="layer and sides"):
        kernels.soft_shadow_prepare(np.ones(shape, np.float32), lamp_view().packed())


def test_negative_biases_and_mismatched_points_are_refused():
    depths = np.ones((2, 8, 8), np.float32)
    with pytest.raises(ValueError, match="negative"):
        kernels.soft_shadow_prepare(depths, lamp_view().packed(), -1.0)
    points, normals = np.zeros((4, 3), np.float32), np.zeros((5, 3), np.float32)
    with pytest.raises(ValueError, match="normals"):
        kernels.soft_shadow_backproject(points, normals, normals, np.zeros(3), lamp().packed(), [])
