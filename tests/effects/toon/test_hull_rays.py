"""The outline's truth against meeting every triangle, and the time it takes over millions of them."""

import time

import numpy as np
import pytest
from strata.addon.core.view import View
from strata.addon.effects.toon.hull_rays import HullRays, _depths

SIZE = (96, 64)
PLACES = 200


def view_of(orthographic: bool) -> View:
    window = (-3.0, 3.0, -2.0, 2.0) if orthographic else (-0.6, 0.6, -0.4, 0.4)
    axes = (1.0, 0.0, 0.0), (0.0, 0.6, 0.8), (0.0, -0.8, 0.6)
    return View((0.0, 0.0, 0.0), *axes, window, 0.1, 100.0, orthographic)


def triangles_of(seed: int) -> dict[int, np.ndarray]:
    """Of all sizes, from a hundredth of a pixel to beyond the image, some across the eye's plane."""
    rng = np.random.default_rng(seed)
    soup = {}
    for instance in (4, 1):
        centres = rng.normal(0.0, 3.0, (300, 1, 3))
        sizes = 10.0 ** rng.uniform(-4.0, 1.0, (300, 1, 1))
        soup[instance] = (centres + sizes * rng.normal(size=(300, 3, 3))).reshape(-1, 3).astype(np.float32)
    soup[4][:9] = np.nan
    return soup


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_the_nearest_triangle_is_that_of_all(seed, orthographic):
    view, soup = view_of(orthographic), triangles_of(seed)
    rays = HullRays(soup, view, SIZE)
    places = np.random.default_rng(seed).uniform((-2.0, -2.0), np.array(SIZE) + 2.0, (PLACES, 2))
    left, right, bottom, top = view.window
    window = (left, bottom) + places / SIZE * (right - left, top - bottom)
    axes = np.array([view.right, view.up, view.forward]).T
    points = np.concatenate(list(soup.values())).reshape(-1, 3, 3).astype(np.float64) @ axes
    expected, which = _depths(points, window, view)
    owners = np.repeat(list(soup), [len(corners) // 3 for corners in soup.values()])[which]
    hits = 0
    for one in range(PLACES):
        depth, owner = rays.first(places[one : one + 1])
        assert depth == pytest.approx(expected[one], rel=1e-9)  # sums in another order
        if np.isfinite(depth):
            assert owner == owners[one]
            hits += 1
    assert hits > PLACES / 4
    some = slice(0, 20)  # of one call, wherever they lie
    assert rays.first(places[some])[0] == pytest.approx(expected[some], rel=1e-9)


def test_nothing_is_met_where_there_is_no_hull():
    depth, owner = HullRays({}, view_of(False), SIZE).first(np.array([[3.0, 4.0]]))
    assert (depth.tolist(), owner.tolist()) == ([np.inf], [-1])


def test_a_pixel_of_a_dense_hull_costs_what_is_near_it():
    """All triangles each time would take some hundred times as long."""
    rng = np.random.default_rng(0)
    count = 400_000
    centres = rng.uniform((-6.0, -2.0, 1.0), (6.0, 2.0, 10.0), (count, 1, 3)) @ np.array(
        [[1, 0, 0], [0, 0.6, 0.8], [0, -0.8, 0.6]]
    )
    soup = {0: (centres + 0.005 * rng.normal(size=(count, 3, 3))).reshape(-1, 3).astype(np.float32)}
    started = time.process_time()
    rays = HullRays(soup, view_of(False), SIZE)
    sorting = time.process_time() - started
    started = time.process_time()
    for x in range(20):
        rays.first(np.array([[40.0 + x, 30.0]]))
    assert time.process_time() - started < 0.5 * sorting
