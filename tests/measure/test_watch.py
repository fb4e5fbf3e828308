"""Watched pixels stand for all of them, while a layer changes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from strata.addon.measure.target import Chosen, Target, told
from strata.addon.measure.watch import Watch, likely_pixels
from strata.addon.passes import _Looked

SIZE = (60, 80)


def wrong_picture(rng):
    """Values and errors: large where the values change, small elsewhere, and a few that nothing shows."""
    image = np.zeros(SIZE, np.float32)
    image[10:40, 20:50] = 1.0
    errors = 0.02 * rng.standard_normal(SIZE)
    errors[9:11, 20:50] += 0.2 * rng.standard_normal((2, 30))
    errors[50, 10:40] += 0.1
    return image, errors.reshape(-1)


def watched(image, errors, count, seed, rng) -> Watch:
    pixels, stands_for = likely_pixels(image, 1.0, count, 4, seed)
    # Two halves with noise of their own, which must not count.
    halves = errors[pixels, None] + 0.05 * rng.standard_normal((len(pixels), 2))
    values = image.reshape(-1, 1)[pixels].astype(float)
    return Watch(pixels, stands_for, values, halves[..., None], np.ones_like(halves)[..., None], image.size)


def test_sums_over_all_pixels_are_right_in_the_mean():
    rng = np.random.default_rng(3)
    image, errors = wrong_picture(rng)
    true = np.mean(errors**2)
    found = []
    for seed in range(300):
        watch = watched(image, errors, 300, seed, rng)
        found.append(watch.rms(watch.values) ** 2)
    assert np.mean(found) == pytest.approx(true, abs=4 * np.std(found) / np.sqrt(300))
    assert np.std(found) < 0.3 * true  # by pixels anywhere it is 0.6


def test_what_a_layer_becomes_is_told_without_rays():
    rng = np.random.default_rng(4)
    image, errors = wrong_picture(rng)
    watch = watched(image, errors, 400, 1, rng)
    right = (watch.values[:, 0] - watch.errors.mean(axis=1)[:, 0])[:, None]
    assert watch.rms(right) < 0.5 * watch.rms(watch.values)


def test_small_and_flat_pictures_are_watched_too():
    pixels, stands_for = likely_pixels(np.ones((3, 4), np.float32), 1.0, 500, 4, 0)
    assert pixels.tolist() == list(range(12))
    assert stands_for.sum() == pytest.approx(12.0)
    assert len(likely_pixels(np.ones((3, 4), np.float32), 0.0, 500, 4, 0)[0]) == 0


@pytest.mark.parametrize(
    ("chosen", "method", "words"),
    [
        (Chosen(8, Target(0.02, 0.019)), 0.01, ""),
        (Chosen(8), None, ""),
        (
            Chosen(16, Target(0.02, 0.026, is_stuck=True)),
            0.025,
            "the method cannot go below 2.5%: Method Hybrid",
        ),
        (
            Chosen(32, Target(0.02, 0.026, is_stuck=True)),
            0.01,
            "more than 32 samples do not lower it: Method Hybrid",
        ),
        (
            Chosen(64, Target(0.02, 0.026)),
            0.025,  # few samples' noise counts as the method's
            "64 samples at most, and not enough",
        ),
    ],
)
def test_why_a_target_was_missed_is_told(chosen, method, words):
    off = "by the pixels that decide off by 2.6%, target 2%: " if words else ""
    assert told(chosen, method, "Method Hybrid") == off + words


def test_a_layer_that_goes_on_with_others_stays_stuck():
    """The composite's slowest lamp decides; why the others' error stayed is still told."""

    class Asked:
        def watch(self, layer, samples):
            return 0.03
            yield

    looked, told_of = _Looked(Asked(), SimpleNamespace(name="A"), 0.02), []
    for samples in (4, 8, 16, 20, 32):
        chosen = looked.chosen(samples)
        with pytest.raises(StopIteration) as ended:
            next(chosen)
        told_of.append((ended.value.value.samples, ended.value.value.target.is_stuck))
    assert told_of == [(4, False), (8, False), (16, True), (20, True), (32, True)]
