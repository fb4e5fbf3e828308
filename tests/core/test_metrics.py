"""Error figures against values worked out by hand."""

import numpy as np
import pytest
from strata.addon.core.metrics import (
    antialiasing_error,
    maximum,
    quantile,
    seen,
)


def test_a_sample_that_stands_for_three_pixels_is_three_pixels():
    errors, weights, sampling = [0.1, -0.3, 0.02], [1.0, 2.0, 0.5], [3, 1, 2]
    many = [np.repeat(x, sampling) for x in (errors, weights)]
    assert maximum(errors, weights, sampling) == maximum(*many)
    for share in (0.01, 0.5, 0.67, 0.99, 1.0):
        assert quantile(errors, weights, share, sampling) == quantile(*many, share)


def test_nothing_lit_has_no_error():
    assert maximum([1.0], [0.0]) == quantile([1.0], [0.0], 0.99) == quantile([], [], 0.99) == 0.0


def test_quantile_counts_seen_pixels():
    errors = np.arange(1, 101) / 100.0
    assert quantile(errors, np.ones(100), 0.99) == 0.99
    assert quantile(errors, np.ones(100), 1.0) == 1.0
    # Mean weight 1.0: a pixel of weight 0.009 is not seen, whatever its error.
    errors, weights = np.array([0.1, 0.2, 9.0]), np.array([1.5, 1.491, 0.009])
    assert seen(weights).tolist() == [True, True, False]
    assert maximum(errors, weights) == 0.2
    assert quantile(-errors, weights, 0.99) == 0.2


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
