"""Any image against a truth that was found once."""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.measure.whole import Whole

PIXELS = 4000
MEAN = 1.0


def made(
    noise: float, pixels: int = PIXELS, population: int = PIXELS
) -> tuple[Whole, np.ndarray, np.ndarray]:
    """A truth in [0, 1] under light in [0, 2], each half of it with noise of its own."""
    random = np.random.default_rng(7)
    truth, light = random.random(population), 2.0 * random.random(population)
    seen = truth + noise * random.standard_normal((2, population))
    slopes = np.repeat((light / (light + MEAN))[:, None], 2, axis=1)[..., None]
    dark = -seen.T[..., None] * slopes
    chosen = np.arange(0, population, population // pixels)
    whole = Whole(chosen, population, dark[chosen], slopes[chosen], np.ones(len(chosen)))
    return whole, truth, light


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
def test_errors_of_any_image_without_the_noise_of_the_truth(noise):
    whole, truth, light = made(noise)
    off = 0.03 * np.random.default_rng(8).standard_normal(PIXELS)
    expected = np.sqrt(np.mean((off * light / (light + MEAN)) ** 2))
    found = whole.judged((truth + off).reshape(40, 100).astype(np.float32))
    low, high = found.ci95
    assert low - 1e-8 <= expected <= high + 1e-8  # images are float32
    # Each half's noise times the other's, over so many pixels, is left in the square.
    assert found.value == pytest.approx(
        expected, abs=0.01 * expected + 3.0 * noise**2 / PIXELS**0.5 / expected
    )
    assert whole.judged(truth.reshape(40, 100)).value <= 2.0 * noise / PIXELS**0.25 + 1e-9


def test_pixels_that_nobody_looked_at_widen_the_interval():
    image = np.zeros((40, 100), np.float32)
    every, some = made(0.01)[0].judged(image), made(0.01, pixels=400)[0].judged(image)
    assert some.pixels == 400
    assert some.ci95[1] - some.ci95[0] > 3.0 * (every.ci95[1] - every.ci95[0])
    assert some.ci95[0] < every.value < some.ci95[1]


def test_what_is_not_finite_is_black_and_no_light_is_no_error():
    whole, truth, _ = made(0.0)
    broken = truth.copy()
    broken[5] = np.nan
    black = truth.copy()
    black[5] = 0.0
    assert whole.judged(broken.reshape(40, 100)).value == whole.judged(black.reshape(40, 100)).value > 0.0
    nothing = Whole(np.arange(4), 4, np.zeros((4, 2, 1)), np.zeros((4, 2, 1)), np.zeros(4))
    assert nothing.judged(np.ones((2, 2))).value == 0.0


def test_kept_and_read_again(tmp_path):
    whole, truth, _ = made(0.02)
    np.savez(tmp_path / "whole.npz", **whole.to_arrays())
    with np.load(tmp_path / "whole.npz") as found:
        again = Whole.from_arrays(dict(found))
    image = truth.reshape(40, 100)
    assert again.judged(image) == whole.judged(image)
