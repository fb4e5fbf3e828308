"""The figures of layers in use, on images whose error is known."""

import numpy as np
import pytest
from strata.scripts.bench import in_use

SIZE = (90, 160)
NOWHERE = np.zeros(SIZE, bool)


@pytest.fixture
def random():
    return np.random.default_rng(5)


def image(random) -> np.ndarray:
    """Grey, some of it black, some of it far brighter than its mean."""
    grey = random.lognormal(0.0, 1.0, SIZE)
    grey[:30] = 0.0
    return np.repeat(grey[..., None], 3, axis=2)


def noisy(random, truth: np.ndarray, noise: float) -> np.ndarray:
    """Two halves, as noisy as bright."""
    return truth * (1.0 + noise * random.standard_normal((2, *SIZE, 1)))


def test_the_error_is_that_of_the_layer_whatever_the_noise(random):
    bare, error = image(random), 0.02 * random.standard_normal(SIZE)
    visibility = random.random(SIZE)
    grey = bare[30:, :, 0]
    expected = np.sqrt(np.mean((error[30:] * grey / (grey + grey.mean())) ** 2))
    for noise in (0.0, 0.03):
        shadowed = noisy(random, visibility[..., None] * bare, noise)
        found = in_use.of_layer(visibility + error, np.stack([bare, bare]), shadowed, NOWHERE)
        own = noise * np.sqrt(0.5 * np.mean((visibility[30:] * grey / (grey + grey.mean())) ** 2))
        assert found.error == pytest.approx(expected, rel=0.05 if noise else 1e-6)
        assert found.noise == pytest.approx(own, rel=0.05)
        assert found.colour == pytest.approx(found.error)


def test_noise_alone_is_no_error(random):
    bare = image(random)
    found = in_use.of_layer(np.ones(SIZE), np.stack([bare, bare]), noisy(random, bare, 0.1), NOWHERE)
    assert found.error < 0.2 * found.noise


def test_what_the_lamp_does_not_light_does_not_count(random):
    bare, layer = image(random), np.ones(SIZE)
    layer[:30] = 0.0
    halves = np.stack([bare, bare])
    assert in_use.of_layer(layer, halves, halves, NOWHERE).error == 0.0
    assert in_use.of_layer(layer, 0.0 * halves, 0.0 * halves, NOWHERE).error == 0.0


def test_a_lamp_of_one_colour_counts_by_that(random):
    bare = image(random) * (0.0, 1.0, 0.0)
    halves = np.stack([bare, bare])
    found = in_use.of_layer(np.full(SIZE, 0.9), halves, halves, NOWHERE)
    assert found.colour == pytest.approx(found.error)


def test_colour_that_no_scalar_has_is_told(random):
    """More red and less blue, as bright as before."""
    bare = image(random)
    shift = np.array([0.1, 0.0, -0.1 * in_use.LUMINANCE[0] / in_use.LUMINANCE[2]])
    found = in_use.of_layer(np.ones(SIZE), np.stack([bare] * 2), np.stack([bare * (1 + shift)] * 2), NOWHERE)
    assert found.error == pytest.approx(0.0, abs=1e-9)
    assert found.colour > 0.05


def test_silhouettes_are_told_apart(random):
    bare, layer, edge = image(random), np.ones(SIZE), NOWHERE.copy()
    layer[:, 70:75], edge[:, 70:75] = 0.0, True
    halves = np.stack([bare, bare])
    found = in_use.of_layer(layer, halves, halves, edge)
    assert found.error > 0.05
    assert found.inside == 0.0


def test_a_picture_is_held_against_the_truths_brightness():
    truth = np.full((2, *SIZE, 3), 0.4)
    # 10% too bright everywhere: half of that beside twice the brightness.
    assert in_use.of_picture(1.1 * truth, truth, NOWHERE).error == pytest.approx(0.05)
