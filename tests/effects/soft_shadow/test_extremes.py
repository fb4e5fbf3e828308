"""Soft shadow maps where inputs are extreme: no size, no distance, no finite place, other scales."""

from __future__ import annotations

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.emitter import EmitterKind
from strata.addon.core.view import View
from strata.tests.effects.soft_shadow.scenes import (
    DOWN,
    GROUND,
    HIGH,
    LOW,
    UP,
    Stage,
    ground_points,
    lamp,
    plate,
)


def test_a_light_of_no_size_casts_a_hard_shadow():
    emitter, points = lamp(half=(0.0, 0.0)), ground_points(count=61)
    found, _ = Stage([GROUND, LOW]).visibility(emitter, points, UP)
    # The plate at 1.5 under a lamp at 4 casts a shadow 4 / 2.5 as large; a texel is about .005 m.
    scale = 4.0 / 2.5
    low, high = LOW.min(axis=0)[:2] * scale, LOW.max(axis=0)[:2] * scale
    beyond = np.maximum(low - points[:, :2], points[:, :2] - high).max(axis=1)
    assert set(np.unique(found)) <= {0.0, 1.0}
    np.testing.assert_array_equal(found[beyond > 0.01], 1.0)
    np.testing.assert_array_equal(found[beyond < -0.01], 0.0)


def box(half):
    """Positions and quads of a closed box."""
    positions = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return positions, np.array(quads)


@pytest.mark.parametrize("kind", [EmitterKind.SPHERE, EmitterKind.FACING_DISK])
def test_a_light_inside_a_closed_mesh_leaves_all_outside_dark(kind):
    emitter = lamp(kind, centre=(0.0, 0.0, 0.0), half=(0.1, 0.1))
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = 3.0 * directions
    stage = Stage([], [box(1.0)])
    normals = -directions.astype(np.float32)
    found, _ = kernels.soft_shadow_backproject(
        points.astype(np.float32),
        normals,
        normals,
        stage.origin,
        emitter.packed(),
        stage.maps(emitter, points),
    )
    # In every direction, the borders between cube faces too. Where two walls meet, their texels need not:
    # through such a crack up to 5 of 256 samples were seen, in 13 of 2000 directions, all close to an edge.
    assert found.max() < 6 / 256
    assert found.mean() < 1e-4
    towards = np.sort(np.abs(directions), axis=1)
    np.testing.assert_array_equal(found[towards[:, 1] < 0.8 * towards[:, 2]], 0.0)


def test_a_light_that_touches_a_surface_stays_finite():
    emitter = lamp(centre=(0.0, 0.0, 0.0), half=(0.5, 0.5), axes=((1.0, 0, 0), (0, 0, 1.0), (0, 1.0, 0)))
    points = ground_points(count=21)
    found, _ = Stage([GROUND, plate(-0.5, 0.5, 1.0, 1.5, 0.3)]).visibility(emitter, points, UP)
    assert np.isfinite(found).all()
    assert found.min() >= 0.0
    assert found.max() <= 1.0


# At .01 and 1e-4, rounding once clipped the plate nearest to the lamp.
@pytest.mark.parametrize("scale", [1e-4, 1e-2, 1e4])
def test_the_scenes_size_does_not_matter(scale):
    points = ground_points(count=21)
    usual, _ = Stage([GROUND, LOW, HIGH]).visibility(lamp(), points, UP)
    small = lamp(centre=(0.0, 0.0, 4.0 * scale), half=(0.5 * scale, 0.5 * scale))
    found, _ = Stage([GROUND * scale, LOW * scale, HIGH * scale]).visibility(small, points * scale, UP)
    # Rounding moves a sample in or out of a texel here and there.
    assert np.abs(found - usual).max() <= 4 / 256
    assert (np.abs(found - usual) > 1e-4).mean() < 0.2


def test_ten_thousand_kilometres_away_is_the_same():
    points, far = ground_points(count=21), (1e7, -1e7, 1e7)
    near, _ = Stage([GROUND, LOW, HIGH]).visibility(lamp(), points, UP)
    emitter = lamp(centre=(far[0], far[1], far[2] + 4.0))
    found, _ = Stage([GROUND, LOW, HIGH], origin=far).visibility(emitter, points, UP)
    # A double at 1e7 is good to 2e-9 m, so windows differ by that.
    assert np.abs(found - near).max() <= 4 / 256
    assert (np.abs(found - near) > 1e-4).mean() < 0.2


@pytest.mark.parametrize("method", ["bitmask", "area"])
def test_points_that_are_not_finite_are_visible_and_harm_no_other(method):
    points = ground_points(count=9)
    stage = Stage([GROUND, LOW])
    clean, _ = stage.visibility(lamp(), points, UP, method, maps=(maps := stage.maps(lamp(), points)))
    broken = points.copy()
    broken[::3, 1] = np.nan
    broken[1::3, 0] = np.inf
    found, _ = stage.visibility(lamp(), broken, UP, method, maps=maps)
    np.testing.assert_array_equal(found[::3], 1.0)
    np.testing.assert_array_equal(found[1::3], 1.0)
    np.testing.assert_allclose(found[2::3], clean[2::3], atol=1e-6)
    found, _ = stage.visibility(lamp(), points, (np.nan, 0.0, 1.0), method, maps=maps)
    assert np.isfinite(found).all()


def test_maps_of_broken_depths_give_finite_shadows():
    view = View((0.0, 0.0, 4.0), *DOWN, (-1.0, 1.0, -1.0, 1.0), 0.1, 10.0)
    depths = np.full((3, 40, 40), np.inf, np.float32)
    depths[0] = 2.0
    depths[0, ::3] = np.nan
    depths[0, 1::3, ::2] = 0.0
    depths[0, 1::3, 1::2] = -1.0
    depths[0, 2::3, ::5] = 1e-38
    prepared = [kernels.soft_shadow_prepare(depths, view.packed())]
    for method in ("bitmask", "area"):
        found, _ = Stage([GROUND]).visibility(lamp(), ground_points(count=15), UP, method, maps=prepared)
        assert np.isfinite(found).all()
        assert found.min() >= 0.0
        assert found.max() <= 1.0
