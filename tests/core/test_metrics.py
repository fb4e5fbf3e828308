"""Error figures against values worked out by hand."""

import numpy as np
import pytest
from strata.addon.core.metrics import (
    antialiasing_error,
    maximum,
    quantile,
    seen,
    weighted_bias,
    weighted_rmse,
)
from strata.tests.measure.images import relative_l2, wrong_share


def test_weighted_rmse_and_bias_by_hand():
    # (3 * 0.1^2 + 1 * 0.3^2) / 4 = 0.03; (3 * 0.1 - 1 * 0.3) / 4 = 0.
    assert weighted_rmse([0.1, -0.3], [3, 1]) == pytest.approx(np.sqrt(0.03), rel=1e-15)
    assert weighted_bias([0.1, -0.3], [3, 1]) == pytest.approx(0.0, abs=1e-16)
    assert weighted_bias([0.5, 0.0], [1, 3]) == 0.125


def test_a_sample_that_stands_for_three_pixels_is_three_pixels():
    errors, weights, sampling = [0.1, -0.3, 0.02], [1.0, 2.0, 0.5], [3, 1, 2]
    many = [np.repeat(x, sampling) for x in (errors, weights)]
    for figure in (weighted_rmse, weighted_bias, maximum):
        assert figure(errors, weights, sampling=sampling) == pytest.approx(figure(*many), rel=1e-14)
    for share in (0.01, 0.5, 0.67, 0.99, 1.0):
        assert quantile(errors, weights, share, sampling) == quantile(*many, share)


def test_nothing_lit_has_no_error():
    assert weighted_rmse([1.0], [0.0]) == weighted_bias([1.0], [0.0]) == maximum([1.0], [0.0]) == 0.0
    assert weighted_rmse([], []) == quantile([], [], 0.99) == 0


def test_quantile_counts_seen_pixels():
    errors = np.arange(1, 101) / 100.0
    assert quantile(errors, np.ones(100), 0.99) == 0.99
    assert quantile(errors, np.ones(100), 1.0) == 1.0
    # Mean weight 1.0: a pixel of weight 0.009 is not seen, whatever its error.
    errors, weights = np.array([0.1, 0.2, 9.0]), np.array([1.5, 1.491, 0.009])
    assert seen(weights).tolist() == [True, True, False]
    assert maximum(errors, weights) == 0.2
    assert quantile(-errors, weights, 0.99) == 0.2


def test_relative_l2_by_hand():
    # sqrt((0.1^2 + 0.3^2) / 2) / 2 = sqrt(0.05) / 2
    assert relative_l2([1.1, 2.7], [1.0, 3.0]) == pytest.approx(np.sqrt(0.05) / 2.0, rel=1e-12)
    assert relative_l2([0.0], [0.0]) == 0.0
    assert relative_l2([0.1], [0.0]) == np.inf


def test_wrong_share_by_hand():
    assert wrong_share([0, 1, 1, 1], [0, 0, 1, 1]) == 0.25
    assert wrong_share([0.0, 1.0], [0.005, 1.5], tolerance=0.01) == 0.5


def test_float32_images_are_summed_in_float64():
    errors = np.full(100_000, 0.1, np.float32)
    assert weighted_rmse(errors, np.ones_like(errors)) == pytest.approx(float(np.float32(0.1)), rel=1e-12)


def test_antialiasing_error_of_an_edge():
    """Pixels cut by edges: the mean of 16 independent samples has the standard error that is
    claimed, and of one sample nothing can be said."""
    rng = np.random.default_rng(2)
    coverage = rng.random(4000)
    samples = (rng.random((16, 4000)) < coverage).astype(np.float32)
    mean = samples.mean(axis=0)
    spread = ((samples - mean) ** 2).mean(axis=0)
    actual = np.sqrt(((mean - coverage) ** 2).mean())
    assert antialiasing_error(spread, 16) == pytest.approx(actual, rel=0.05)
    assert antialiasing_error(spread, 1) is None
    # Well-spread samples do better than that, never worse.
    stratified = ((np.arange(16)[:, None] + rng.random((16, 4000))) / 16 < coverage).astype(np.float32)
    mean = stratified.mean(axis=0)
    spread = ((stratified - mean) ** 2).mean(axis=0)
    assert antialiasing_error(spread, 16) > np.sqrt(((mean - coverage) ** 2).mean())
