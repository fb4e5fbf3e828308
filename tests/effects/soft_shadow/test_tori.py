"""Tori over a ground: soft shadow maps against rays, and what one wrong map or layer does."""

from __future__ import annotations

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.view import View
from strata.tests.effects.soft_shadow.scenes import GROUND, Stage, lamp, lamp_view, turned_axes
from strata.tests.support.figures import weighted_rmse


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


def test_a_scene_of_tori_agrees_with_1024_rays(tori, tori_truth):
    truth, weight = tori_truth
    found, _ = tori_visibility(tori, tori_maps(tori))
    # 64 stratified rays reach about .010 on such scenes.
    assert weighted_rmse(found.ravel() - truth, weight) < 0.013
    found, _ = tori_visibility(tori, tori_maps(tori), 4096)
    assert weighted_rmse(found.ravel() - truth, weight) < 0.010


def test_a_missing_layer_and_a_shifted_map_show(tori, tori_truth):
    truth, weight = tori_truth
    stage, emitter, (position, _, _) = tori
    good = weighted_rmse(tori_visibility(tori, tori_maps(tori))[0].ravel() - truth, weight)
    leaking = weighted_rmse(tori_visibility(tori, tori_maps(tori, layers=2))[0].ravel() - truth, weight)
    shifted = []
    for view, depths in stage.depths(emitter, position.reshape(-1, 3)):
        shifted.append(kernels.soft_shadow_prepare(np.roll(depths, 8, axis=2), view.packed()))
    moved = weighted_rmse(tori_visibility(tori, shifted)[0].ravel() - truth, weight)
    assert leaking > 1.3 * good
    assert moved > 2.0 * good


@pytest.mark.parametrize("max_samples", [64, 512, 1 << 20])
def test_the_fast_twin_hides_the_same_samples_as_the_plain_one(tori, max_samples):
    maps = tori_maps(tori, resolution=512)
    fast, _ = tori_visibility(tori, maps, max_samples)
    plain, _ = tori_visibility(tori, maps, max_samples, method="plain")
    # One sample more or less would be 1/256; the rest is the order of adding up.
    assert np.abs(fast - plain).max() < 1e-5


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
