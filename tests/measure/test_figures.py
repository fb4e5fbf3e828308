"""Error figures of whole images against values worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from strata.tests.support.figures import in_use_of_light, weighted_bias, weighted_rmse, wrong_share


def test_weighted_rmse_and_bias_by_hand():
    # (3 * 0.1^2 + 1 * 0.3^2) / 4 = 0.03; (3 * 0.1 - 1 * 0.3) / 4 = 0.
    assert weighted_rmse([0.1, -0.3], [3, 1]) == pytest.approx(np.sqrt(0.03), rel=1e-15)
    assert weighted_bias([0.1, -0.3], [3, 1]) == pytest.approx(0.0, abs=1e-16)
    assert weighted_bias([0.5, 0.0], [1, 3]) == 0.125


def test_nothing_lit_has_no_error():
    assert weighted_rmse([1.0], [0.0]) == weighted_bias([1.0], [0.0]) == weighted_rmse([], []) == 0.0


def test_light_in_use_by_hand():
    # The mean truth is 2: 0.3 / (1 + 2) and 0.5 / (3 + 2) are both a tenth.
    values, truths = np.array([[[1.3], [2.5]]]), np.array([[[1.0], [3.0]]])
    assert in_use_of_light(values, truths) == pytest.approx(0.1, rel=1e-12)
    assert in_use_of_light(0.0 * values, 0.0 * truths) == 0.0


def test_wrong_share_by_hand():
    assert wrong_share([0, 1, 1, 1], [0, 0, 1, 1]) == 0.25
    assert wrong_share([0.0, 1.0], [0.005, 1.5], tolerance=0.01) == 0.5


def test_float32_images_are_summed_in_float64():
    errors = np.full(100_000, 0.1, np.float32)
    assert weighted_rmse(errors, np.ones_like(errors)) == pytest.approx(float(np.float32(0.1)), rel=1e-12)
