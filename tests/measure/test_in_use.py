"""Where the error of a layer that multiplies comes from, and what does not count for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.tests.measure import fields
from strata.tests.measure.fields import Field

PIXELS = 2000


def measured(field: Field, **options):
    """By a look at every pixel, and all their samples."""
    return field.measured(4 * PIXELS, 1, **options)


def silhouettes(rng, share=(0.0, 1.0)) -> Field:
    """Every pixel shows a lit thing and one in shadow."""
    truths = np.ones((PIXELS, 2, 1)) * np.array([1.0, 0.0])[:, None]
    light = rng.uniform(0.5, 1.5, (PIXELS, 2, 1)) * np.ones(3)
    return Field(np.zeros((PIXELS, 1)), truths, light, rng.uniform(*share, PIXELS))


@pytest.mark.parametrize("channels", [1, 3])
def test_a_layer_that_is_right_where_it_was_evaluated_is_aliased(channels):
    """Four samples a pixel at places that all pixels share, and the mean of what they found."""
    field = silhouettes(np.random.default_rng(1))
    if channels == 3:
        field = field.in_colour()
    kept = field.kept(4)
    error = measured(replace(field, values=kept.values.mean(axis=0).astype(np.float64)), kept=kept)
    assert error.value > 0.05
    assert error.method < 1e-6
    assert error.sampling == pytest.approx(error.value, rel=1e-6)


def test_a_layer_of_a_wrong_map_is_wrong_where_it_was_evaluated():
    field = silhouettes(np.random.default_rng(2), share=(1.0, 1.0))
    wrong = field.truths.copy()
    wrong[::7, 0] = 0.6
    kept = field.kept(4, wrong)
    error = measured(replace(field, values=kept.values.mean(axis=0).astype(np.float64)), kept=kept)
    assert error.value == pytest.approx(0.4 / np.sqrt(7) / 2, rel=0.1)
    assert error.method == pytest.approx(error.value, rel=0.1)
    assert error.sampling < 0.5 * error.value
    assert measured(field).method is None  # nobody kept a sample


def red_beside_green(rng) -> Field:
    """A lit red thing and a green one in shadow share every pixel; the layer holds their luminance."""
    field = silhouettes(rng, share=(0.3, 0.7))
    field = replace(field, light=field.light * np.array([[1.0, 0.05, 0.05], [0.05, 1.0, 0.05]]))
    return replace(field, values=field.used())


def test_one_channel_cannot_hold_colours_and_three_can():
    field = red_beside_green(np.random.default_rng(3))
    one, three = measured(field), measured(field.in_colour())
    assert one.value < 0.02  # the luminance is right, as far as views of one pixel tell
    light = field.mean(field.light)
    errors = field.values * light - field.mean(field.truths * field.light)
    whole = light @ fields.LUMINANCE
    by_channel = errors / (whole + whole.mean())[:, None]
    assert one.model == pytest.approx(np.sqrt((by_channel**2 @ fields.LUMINANCE).mean()), rel=0.1)
    assert one.model > 0.1
    assert three.model is None
    grey = silhouettes(np.random.default_rng(3))
    assert measured(replace(grey, values=grey.used())).model is None


@pytest.mark.parametrize("channels", [1, 3])
def test_what_a_display_clips_does_not_show(channels):
    rng = np.random.default_rng(4)
    truths, light = rng.uniform(0.2, 1.0, (PIXELS, 1, channels)), rng.uniform(0.2, 0.9, (PIXELS, 1, 3))
    field = Field(
        0.9 * truths[:, 0], *(np.repeat(each, 2, axis=1) for each in (truths, light)), np.ones(PIXELS)
    )
    field = replace(field, noise=0.0)
    error = measured(field)
    assert error.value == pytest.approx(field.error, rel=0.02)
    if channels == 1:  # where nothing clips; in colour one is of luminance, the other of each channel
        assert error.display == pytest.approx(error.value, rel=0.02)
    brighter = measured(replace(field, exposure=2.0))
    assert 0.1 * error.value < brighter.display < 0.95 * error.display
    over = measured(replace(field, exposure=100.0))
    assert over.display == 0.0
    assert over.value == error.value


def test_a_pixel_far_brighter_than_the_rest_does_not_rule_the_error():
    """A million times: whether right or wrong, it counts as one pixel of them all."""
    field = fields.badly_weighed(np.random.default_rng(5), PIXELS)
    light, values = field.light.copy(), field.values.copy()
    pixel = np.flatnonzero(field.values[:, 0] == 1.0)[0]
    light[pixel] *= 1e6
    bright = replace(field, light=light)
    assert bright.error == pytest.approx(field.error, rel=0.02)
    values[pixel] = 0.0
    spoilt = replace(field, light=light, values=values)
    assert abs(spoilt.error**2 - bright.error**2) <= 1.0 / spoilt.lit.sum()
    assert measured(bright).value == pytest.approx(bright.error, rel=0.05)
    assert measured(spoilt).value ** 2 == pytest.approx(spoilt.error**2, rel=0.1)


def test_the_mean_light_of_a_lamp_that_lights_next_to_nothing_is_found():
    count = 100_000
    is_lit = np.arange(count) % 4000 == 7
    light = np.zeros((count, 2, 3))
    light[is_lit] = 1.0
    values = np.where(is_lit, 0.8, 1.0)[:, None]
    field = Field(values, np.ones((count, 2, 1)), light, np.ones(count))
    for seed in range(8):
        assert field.measured(256, seed).value == pytest.approx(0.1, rel=0.01)
        # Nothing weighed: a look at some of all pixels must meet one that is lit.
        assert field.measured(256, seed, weighed=False).value == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize("samples", [1, 4])
def test_silhouettes_that_samples_missed_are_found(samples):
    """Two dark disks before nothing. Where no sample met them the layer is 1."""
    rng, count = np.random.default_rng(1), 40_000
    y, x = np.divmod(np.arange(count), fields.WIDTH)
    disks = [radius + 0.5 - np.hypot(x - 50, y - row) for radius, row in ((20, 200), (6, 90))]
    covered = np.clip(np.maximum(*disks), 0.0, 1.0)
    light, truths = np.ones((count, 2, 3)), np.zeros((count, 2, 1))
    light[:, 1], truths[:, 1] = 0.0, 1.0
    hits = rng.binomial(samples, covered)
    field = Field((hits == 0)[:, None] * 1.0, truths, light, covered)
    field.weights = lambda: np.maximum(0.01 * hits[:, None] / samples, 1e-30)
    errors = [field.measured(64, seed) for seed in range(16)]
    assert sum(error.ci95[0] <= field.error <= error.ci95[1] for error in errors) >= 13
    assert np.mean([error.value for error in errors]) == pytest.approx(field.error, rel=0.06)
