"""Extremes of volumetric light: relative errors against forty digits (airlight_truth.py)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from strata.addon.core.medium import Medium
from strata.addon.core.surface import Chunk
from strata.addon.core.view import View
from strata.addon.effects.volumetric_light import steps
from strata.addon.effects.volumetric_light.sources import Source, SourceKind
from strata.tests.effects.extremes import Row
from strata.tests.effects.volumetric_light import airlight_truth as truth

BOUND = 1e-3
DARK = 1e-35  # below this single precision has no digits: the result has to be as dark
LENGTH = 10.0

POINT = "point light, a ray of 10 m"
Airlight = Callable[[float, float, float, Medium, Source], np.ndarray]


def _along_y(
    device, height: float, before: float, length: float, medium: Medium, source: Source
) -> np.ndarray:
    """(3,): one ray along +Y from `before` metres ahead of its closest point to the origin, `height` away."""
    view = View((height, -before, 0.0), (1, 0, 0), (0, 0, 1), (0, 1, 0), (-1e-3, 1e-3, -1e-3, 1e-3), 0.0, 1e9)
    surface = {"depth": device.from_host(np.full((1, 1), length, np.float32))}
    image = steps.AIRLIGHT.twin(device.name)(
        device,
        surface,
        view=view,
        medium=medium,
        source=source,
        windows=1,
        counts=(0,),
        order=4,
        stride=1,
        chunk=Chunk(1, 1, 0, 1, 0, (0.0, 0.0)),
    )
    return device.to_host(image)[0, 0]


def _medium(extinction, anisotropy=0.0, albedo=1.0) -> Medium:
    sigma = np.broadcast_to(np.asarray(extinction, float), 3)
    return Medium(tuple(albedo * sigma), tuple((1.0 - albedo) * sigma), anisotropy)


def _off(values, exact) -> float:
    """Largest relative error of the channels."""
    worst = 0.0
    for value, expected in zip(np.asarray(values, np.float64), exact, strict=True):
        if not math.isfinite(value):
            return math.nan
        if expected < DARK:
            worst = max(worst, 0.0 if value <= DARK else math.inf)
        else:
            worst = max(worst, abs(value / expected - 1.0))
    return worst


def _row(devices, extreme, height, before, length, medium, radius=0.0) -> Row:
    source = Source(SourceKind.UNIFORM, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 1.0, radius)
    sigma = dict.fromkeys(medium.extinction)
    by_extinction = {
        each: float(truth.point(height, -before, length - before, each, medium.anisotropy, radius))
        for each in sigma
    }
    exact = [by_extinction[e] * s for e, s in zip(medium.extinction, medium.scattering, strict=True)]
    errors = {d.name: _off(_along_y(d, height, before, length, medium, source), exact) for d in devices}
    return Row(extreme, "forty digits", errors, BOUND)


def rows(devices) -> Iterator[Row]:
    """Every extreme, on each of `devices`."""
    for exponent in range(-8, 6):
        sigma = 10.0**exponent / LENGTH
        yield _row(
            devices, f"optical depth 1e{exponent}, {POINT} 2 m beside it", 2.0, 3.0, LENGTH, _medium(sigma)
        )
    for exponent in (2, 3, 4, 5):
        sigma = 10.0**exponent / LENGTH
        name = f"optical depth 1e{exponent}, the eye 0.1 mm from a point light"
        yield _row(devices, name, 1e-4, 1e-5, LENGTH, _medium(sigma))
    for exponent in range(-8, 6):
        sigma = 10.0**exponent / LENGTH
        sun = Source(SourceKind.DISTANT, (0.0, 0.0, 0.0), (0.6, 0.0, -0.8), 1.0)
        exact = [float(truth.sun(LENGTH, sigma)) * sigma / (4.0 * math.pi)] * 3
        errors = {d.name: _off(_along_y(d, 1.0, 0.0, LENGTH, _medium(sigma), sun), exact) for d in devices}
        yield Row(f"optical depth 1e{exponent}, sun", "forty digits", errors, BOUND)
    for g in (0.9999, -0.9999, 0.99, -0.99):
        for height in (2.0, 1e-2):
            name = f"anisotropy {g:g}, {POINT} {height:g} m beside it"
            yield _row(devices, name, height, 5.0, LENGTH, _medium(0.1, g))
    for albedo in (0.0, 1e-6, 1.0):
        yield _row(devices, f"albedo {albedo:g}, {POINT}", 1.0, 5.0, LENGTH, _medium(0.3, 0.0, albedo))
    for height in (1e-2, 1e-4, 1e-6):
        name = f"a ray {height:g} m beside a light of 0.1 m"
        yield _row(devices, name, height, 5.0, LENGTH, _medium(0.1), 0.1)
        name = f"a ray {height:g} m beside a light of no size"
        yield _row(devices, name, height, 5.0, LENGTH, _medium(0.1))
    far_apart = Medium((1e-3, 1.0, 1e3), (0.0, 0.0, 0.0), 0.3)
    yield _row(devices, f"extinction 1e-3, 1, 1e3 by channel, {POINT}", 1.0, 0.2, LENGTH, far_apart)
    for length in (1e-4, 1e6):
        yield _row(devices, f"a ray of {length:g} m beside a point light", 1.0, 0.5, length, _medium(0.1))
