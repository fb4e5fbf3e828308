"""Visibility of lights by rays, against closed forms."""

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.tests.kernels.ray_scenes import AXES, LIGHTS, PLATES, accel_of, quad
from strata.tests.support import closed_forms

UP = np.array([[0.0, 0.0, 1.0]])


def plate_scene():
    eye = np.array([2.0, 3.0, 4.0])
    return PLATES, eye, accel_of(np.concatenate([quad(p) for p in PLATES]), eye)


@pytest.mark.parametrize("light", LIGHTS, ids=lambda light: light.kind.name)
def test_visibility_of_two_plates_converges_to_the_closed_form(light):
    plates, eye, accel = plate_scene()
    generator = np.random.default_rng(6)
    count = 600
    points = np.concatenate([generator.uniform(-1, 1, (count, 2)), np.zeros((count, 1))], 1)
    # Tilted shading normals put the light partly below their horizon.
    shading = UP + generator.uniform(-0.6, 0.6, (count, 3)) * [1, 1, 0]
    shading /= np.linalg.norm(shading, axis=1)[:, None]
    expected, irradiance = closed_forms.visibility(light, points, shading, plates)
    position = (points - eye).astype(np.float32)
    geometric = np.tile(UP, (count, 1)).astype(np.float32)
    errors = []
    for samples in (16, 256):
        v, w = kernels.ray_visibility(
            accel, None, light.packed(), eye, position, geometric, shading.astype(np.float32), samples, 7
        )
        errors.append(np.sqrt(np.mean((v - expected) ** 2)))
    # Random samples would err by 0.1 and 0.025; these are stratified. No bias: the mean is four sigmas close.
    assert errors[0] < 0.045
    assert errors[1] < 0.007
    assert abs(np.mean(v - expected)) < 4 * errors[1] / np.sqrt(count)
    np.testing.assert_allclose(w.mean(), irradiance.mean(), rtol=3e-4)


@pytest.mark.parametrize("samples", [1, 4, 7, 8, 16, 100])
def test_any_number_of_samples_is_free_of_bias(samples):
    plates, eye, accel = plate_scene()
    point = np.array([[0.6, 0.4, 0.0]])
    expected, irradiance = closed_forms.visibility(LIGHTS[0], point, UP, plates)
    assert 0.3 < expected[0] < 0.7
    count = 40000 // samples
    position = np.repeat(point - eye, count, axis=0).astype(np.float32)
    up = np.repeat(UP, count, axis=0).astype(np.float32)
    v, w = kernels.ray_visibility(accel, None, LIGHTS[0].packed(), eye, position, up, up, samples, 3)
    arrived = (v.astype(np.float64) * w).mean()
    sigma = (v * w).std() / np.sqrt(count)
    # The ratio of the sums is biased for few samples; numerator and denominator are not.
    assert abs(arrived - expected[0] * irradiance[0]) < 4 * sigma
    assert abs(w.mean() - irradiance[0]) < 4 * w.std() / np.sqrt(count) + 1e-4 * irradiance[0]


def test_two_single_rays_estimate_a_mean_square_error():
    plates, eye, accel = plate_scene()
    generator = np.random.default_rng(8)
    count = 60000
    points = np.concatenate([generator.uniform(-1, 1, (count, 2)), np.zeros((count, 1))], 1)
    position, up = (points - eye).astype(np.float32), np.tile(UP, (count, 1)).astype(np.float32)
    some = slice(0, 1000)
    for light in LIGHTS[0], LIGHTS[3]:
        true, _ = closed_forms.visibility(light, points[some], np.tile(UP, (1000, 1)), plates)
        v, _ = kernels.ray_visibility(accel, None, light.packed(), eye, position, up, up, 256, 1)
        both = kernels.ray_screen(accel, None, light.packed(), eye, position, up, up, 2).astype(np.float64)
        assert both.shape == (count, 2)
        # A wrong layer: every shadow 0.05 too dark. v stands in for the truth, to 0.005.
        layer = v - 0.05
        estimate = ((layer[:, None] - both).prod(1)).mean()
        assert abs(estimate - 0.05**2) < 1e-3
        assert abs(both.mean() - v.mean()) < 4 * 0.5 / np.sqrt(2 * count)
        assert abs(true.mean() - v[some].mean()) < 1e-3


def test_screening_rays_are_not_biased_by_their_candidates():
    """The hardest case: a large near light, half of it hidden, so that weight and visibility go together."""
    light = Emitter(EmitterKind.RECTANGLE, (0.6, 0, 0.4), **AXES, half_width=1.0, half_height=1.0)
    plate = np.array([[0.0, -1, 0.2], [1, -1, 0.2], [1, 1, 0.2], [0.0, 1, 0.2]])
    eye = np.array([0.0, 0.0, 1.0])
    accel = accel_of(quad(plate), eye)
    point = np.array([[0.0, 0.0, 0.0]])
    expected, _ = closed_forms.visibility(light, point, UP, [plate])
    assert 0.1 < expected[0] < 0.9
    count = 200000
    position = np.repeat(point - eye, count, axis=0).astype(np.float32)
    up = np.repeat(UP, count, axis=0).astype(np.float32)
    both = kernels.ray_screen(accel, None, light.packed(), eye, position, up, up, 2)
    sigma = 0.5 / np.sqrt(2 * count)
    assert abs(both.mean() - expected[0]) < 1e-3 + 3 * sigma
    # Independent: the product's mean is the means' product.
    assert abs(both.prod(1).mean() - both.mean() ** 2) < 4 * 0.5 / np.sqrt(count)


def test_what_the_definition_says_about_odd_points():
    _, eye, accel = plate_scene()
    lamp = LIGHTS[0].packed()
    position = np.array([[0, 0, 0], [np.nan, 0, 0], [0, 0, 5], [0, 0, 0]], np.float64) - eye
    geometric = np.array([UP[0], UP[0], UP[0], -UP[0]], np.float32)
    shading = np.tile(UP, (4, 1)).astype(np.float32)
    v, w = kernels.ray_visibility(
        accel, None, lamp, eye, position.astype(np.float32), geometric, shading, 64, 1
    )
    assert 0 <= v[0] < 0.5
    assert w[0] > 0
    assert (v[1], w[1]) == (1, 0)  # a miss
    assert (v[2], w[2]) == (1, 0)  # behind the light
    assert v[3] == 0  # the light is below the geometric horizon but not below the shading normal's
    assert w[3] > 0
    with pytest.raises(ValueError, match="samples"):
        kernels.ray_visibility(accel, None, lamp, eye, position.astype(np.float32), geometric, shading, 0, 1)


def test_a_light_of_no_size_casts_a_hard_shadow():
    _, eye, accel = plate_scene()
    lamp = Emitter(EmitterKind.SPHERE, (0, 0, 3), **AXES, half_width=0.0, half_height=0.0)
    x = np.linspace(-1.5, 1.5, 301)
    points = np.stack([x, np.zeros_like(x), np.zeros_like(x)], 1)
    up = np.tile(UP, (301, 1)).astype(np.float32)
    v, w = kernels.ray_visibility(
        accel, None, lamp.packed(), eye, (points - eye).astype(np.float32), up, up, 64, 1
    )
    assert set(v) == {0.0, 1.0}
    distance = np.hypot(x, 3.0)
    np.testing.assert_allclose(w, 3.0 / distance**3, rtol=1e-4)  # cos / d^2, intensity 1


def test_same_bits_whatever_the_company():
    """A point's result depends on its index and seed, not on chunks or threads."""
    _, eye, accel = plate_scene()
    generator = np.random.default_rng(9)
    points = np.concatenate([generator.uniform(-1, 1, (3000, 2)), np.zeros((3000, 1))], 1)
    position, up = (points - eye).astype(np.float32), np.tile(UP, (3000, 1)).astype(np.float32)
    lamp = LIGHTS[0].packed()
    for samples in (4, 16):
        a, _ = kernels.ray_visibility(accel, None, lamp, eye, position, up, up, samples, 1)
        b, _ = kernels.ray_visibility(accel, None, lamp, eye, position[:700], up[:700], up[:700], samples, 1)
        c, _ = kernels.ray_visibility(accel, None, lamp, eye, position, up, up, samples, 2)
        np.testing.assert_array_equal(a[:700], b)
        assert (a != c).any()


def test_cancelling():
    _, eye, accel = plate_scene()
    flag = kernels.CancelFlag()
    flag.set()
    rays = np.zeros((9, 3), np.float32), np.ones((9, 3), np.float32), np.ones(9, np.float32)
    with pytest.raises(kernels.Cancelled):
        accel.transmittance(None, *rays, cancel=flag)
    with pytest.raises(kernels.Cancelled):
        kernels.ray_visibility(accel, None, LIGHTS[0].packed(), eye, *[rays[1]] * 3, 4, 1, cancel=flag)
