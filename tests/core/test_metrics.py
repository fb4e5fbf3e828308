"""Error figures against values worked out by hand."""

import numpy as np
from strata.addon.core.metrics import (
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
