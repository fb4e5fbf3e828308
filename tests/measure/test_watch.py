"""Watched pixels stand for all of them, while a layer changes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from strata.addon.measure.drawn import draw, drawn_part, everything, likely_sizes, spread_of
from strata.addon.measure.interval import limits
from strata.addon.measure.target import Chosen, Target, told
from strata.addon.measure.watch import Watch
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


def watched(image, errors, count, seed, rng, noise=0.05) -> Watch:
    drawn = draw(likely_sizes(image, 1.0, 4), count, seed)
    pixels, stands_for = drawn.pixels, drawn.stands_for
    # Two halves with noise of their own, which must not count.
    halves = errors[pixels, None] + noise * rng.standard_normal((len(pixels), 2))
    values = image.reshape(-1, 1)[pixels].astype(float)
    halves, slopes = halves[..., None], np.ones_like(halves)[..., None]
    return Watch(pixels, stands_for, values, halves, slopes, image.size, 4)


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
    image = np.ones((3, 4), np.float32)
    drawn = draw(likely_sizes(image, 1.0, 4), 500, 0)
    assert drawn.pixels.tolist() == list(range(12))
    assert drawn.stands_for.sum() == pytest.approx(12.0)
    assert len(draw(likely_sizes(image, 0.0, 4), 500, 0).pixels) == 0
    assert len(draw(np.zeros(0), 500, 0).pixels) == 0


def test_reported_errors_are_drawn_apart_and_their_intervals_hold():
    """What was watched says how wrong a pixel may be for its size; the sum is that of the others alone."""
    rng = np.random.default_rng(5)
    image, errors = wrong_picture(rng)
    sizes, true = likely_sizes(image, 1.0, 4), float((errors**2).sum())
    held, totals, widths = 0, [], []
    for seed in range(400):
        watch = watched(image, errors, 600, 1000 + seed, rng, noise=0.01)
        drawn = draw(sizes, 150, seed)
        halves = errors[drawn.pixels, None] + 0.01 * rng.standard_normal((len(drawn.pixels), 2))
        squares, variances = halves.prod(axis=1), (0.5 * (halves[:, 0] ** 2 - halves[:, 1] ** 2)) ** 2
        seen = np.concatenate([halves.mean(axis=1), watch.errors[..., 0].mean(axis=1)]) ** 2
        worst = (seen / drawn.sizes[np.concatenate([drawn.pixels, watch.pixels])]).max()
        part = drawn_part(drawn, squares, variances, worst)
        low, high = limits(part)
        held += low <= true <= high
        totals.append(part.total)
        widths.append((high - low) / true)
    assert held >= 0.93 * 400  # 95% less two standard deviations of 400
    assert np.mean(totals) == pytest.approx(true, abs=4 * np.std(totals) / 20)
    assert np.median(widths) < 2.5  # of the square; by as many pixels anywhere it is 6.3


def test_where_every_pixel_is_drawn_only_noise_is_left():
    rng = np.random.default_rng(6)
    errors = 0.1 * rng.standard_normal(50)
    drawn = everything(50)
    part = drawn_part(drawn, errors**2, np.zeros(50), 100.0)
    assert part.total == pytest.approx(float((errors**2).sum()))
    assert (part.variance, part.noise_variance, part.unseen) == (0.0, 0.0, 0.0)


def test_how_sure_a_count_is_by_which_pixels_were_drawn():
    rng = np.random.default_rng(7)
    sizes, there = rng.random(4000) + 0.05, rng.random(4000) < 0.3
    told = []
    for seed in range(300):
        drawn = draw(rng.permutation(sizes), 200, seed)  # in no order, as draws that know nothing of others
        values = there[drawn.pixels].astype(float)
        told.append(((drawn.stands_for * values).sum(), spread_of(drawn, values)))
    sums, variances = np.array(told).T
    assert sums.mean() == pytest.approx(there.sum(), rel=0.05)
    assert variances.mean() == pytest.approx(sums.var(), rel=0.3)  # of 300: 8% of a variance, three times


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
