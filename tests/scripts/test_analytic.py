"""The cases of docs/analytic.md: their closed forms agree with others, and what is delivered with them."""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.ui import properties
from strata.scripts.bench import analytic
from strata.tests.support.closed_forms import irradiance_of_polygon

ORIGIN = np.zeros(3)


def test_a_corner_is_lambert_s_polygon():
    polygon = analytic.rectangle(0.0, 1.2, 0.0, 0.8, 1.0)
    exact = irradiance_of_polygon(ORIGIN, analytic.UP, polygon)
    assert analytic.corner(1.2, 0.8, 1.0) == pytest.approx(exact, rel=1e-12)


def test_a_line_is_a_thin_polygon():
    width = 1e-4
    polygon = analytic.rectangle(-1.0, 1.0, -width / 2, width / 2, 0.7)
    exact = irradiance_of_polygon(ORIGIN, analytic.UP, polygon)
    # A strip of a width w differs by (w / h)².
    assert width * analytic.line(1.0, 0.7) == pytest.approx(exact, rel=1e-6)


# Rounding; and five standard errors of 64 pixels' 64 samples of four rays.
@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("point 2 m above", 1e-5),
        ("sun of 0.5 degrees, 60 degrees down", 1e-4),
        ("sun of 6 degrees behind an edge 2 m above, +0 of its radius beside its middle", 0.005),
        ("disk of 0.5 m, 2 m above, 1.5 m aside", 0.001),
    ],
)
def test_what_is_delivered_is_the_closed_form(name, most):
    (case,) = (each for each in analytic.cases() if each.name == name)
    properties.register()
    try:
        error, _ = map(float, analytic.measured(case, analytic.by_strata))
    finally:
        properties.unregister()
    assert abs(error) < most
