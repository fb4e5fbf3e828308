"""How errors fall, and who is best, of made curves."""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.report.curve import Order, front, order_of

STEPS = (1, 2, 4, 8, 16, 32, 64)


@pytest.mark.parametrize(
    ("scale", "power", "floor"), [(0.2, 0.5, 0.0), (0.2, 0.75, 0.004), (1.0, 1.0, 0.01), (0.05, 0.5, 0.008)]
)
def test_order_and_floor_of_exact_curves(scale, power, floor):
    made = Order(scale, power, floor, None)
    found = order_of(STEPS, [made.error_at(n) for n in STEPS])
    # Floors are looked for at 64 places below the least error.
    assert found.power == pytest.approx(power, abs=0.02)
    assert found.floor == pytest.approx(floor, abs=0.02 * made.error_at(64))
    assert found.error_at(1024) == pytest.approx(made.error_at(1024), rel=0.05)


def test_the_interval_of_the_power_holds_it():
    noise = (1.04, 0.97, 1.02, 0.95, 1.05, 0.99, 1.01)
    found = order_of(STEPS, [0.2 * n**-0.5 * each for n, each in zip(STEPS, noise, strict=True)])
    assert 0.0 < found.power_95 < 0.1
    assert abs(found.power - 0.5) < found.power_95 + 0.02


@pytest.mark.parametrize(
    ("steps", "errors"),
    [
        ((), ()),
        ((1, 2), (0.2, 0.1)),
        ((1, 2, 4), (0.0, 0.0, 0.0)),
        ((0, 1, 2), (0.3, 0.2, 0.1)),
        ((1, 2, 4), (0.1, 0.2, 0.3)),
        ((4, 4, 4), (0.1, 0.2, 0.3)),
    ],
)
def test_no_order_where_there_is_none(steps, errors):
    assert order_of(steps, errors) is None


def test_front():
    costs = [1.0, 2.0, 3.0, 4.0, 1.0]
    errors = [0.5, 0.6, 0.2, 0.2, 0.4]
    assert front(costs, errors) == [4, 2]
    assert front([], []) == []


@pytest.mark.parametrize("floor", [0.0, 0.01, 0.05])
def test_a_powers_interval_holds_it(floor):
    """With errors that are off by 3%, as measured ones are, and a floor that is fitted too."""
    chance, steps, held = np.random.default_rng(1), 2.0 ** np.arange(7), 0
    for _ in range(200):
        off = np.exp(0.03 * chance.normal(size=len(steps)))
        found = order_of(steps, np.hypot(0.1 * steps**-0.7, floor) * off)
        held += abs(found.power - 0.7) <= found.power_95
    assert 0.9 <= held / 200 < 1.0
