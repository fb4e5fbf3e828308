"""FLIP against the numbers that its authors' own program gives (flip-evaluator 1.7, LDR, linear input)."""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.report.flip import flip

# The authors' program works in float32.
CLOSE = 1e-4


def pictures() -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[:48, :64]
    reference = np.stack([0.5 + 0.5 * np.sin(x / 5), 0.5 + 0.5 * np.cos(y / 7), (x + y) / 112], axis=-1)
    test = reference.copy()
    test[10:20, 12:30] *= 0.8
    test[30:, 40:, 2] = 1.0 - test[30:, 40:, 2]
    test[5, 50] = 1.0
    return test, reference


def test_the_authors_numbers():
    found = flip(*pictures())
    assert found.mean() == pytest.approx(0.1531504, abs=CLOSE)
    assert found.max() == pytest.approx(0.9634326, abs=CLOSE)
    places = {(15, 20): 0.2673947, (40, 50): 0.9002657, (5, 50): 0.2806239, (0, 0): 0.0}
    for place, expected in places.items():
        assert found[place] == pytest.approx(expected, abs=CLOSE)


def test_black_and_white_and_the_same():
    black, white = np.zeros((8, 8, 3)), np.ones((8, 8, 3))
    assert flip(white, black).mean() == pytest.approx(0.9673882, abs=CLOSE)
    assert not flip(white, white).any()
    assert not flip(black, -black).any()


def test_what_is_beyond_white_is_white():
    test, reference = pictures()
    assert np.array_equal(flip(test + 5.0, reference), flip(np.ones_like(test), reference))
