"""A wide map and small windows inside it: what the one knows and the other does not."""

from __future__ import annotations

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.emitter import EmitterKind
from strata.addon.core.view import View
from strata.tests.effects.soft_shadow.scenes import (
    DOWN,
    GROUND,
    LOW,
    UP,
    Stage,
    ground_points,
    lamp,
    plate,
    turned_axes,
)
from strata.tests.support import closed_forms
from strata.tests.support.figures import weighted_rmse

# A plate close to the lamp, beside the small window around the points: only the wide map knows it, and it
# hides a part of the lamp from points within. Another reaches over the border.
BESIDE = [
    plate(-0.25, 0.1, -0.2, 0.3, 1.0),
    plate(0.28, 0.5, -0.3, 0.3, 3.5),
    plate(-0.8, -0.7, -0.8, 0.8, 0.3),
    plate(0.7, 0.8, -0.8, 0.8, 0.3),
]


def nested_maps(stage, windows, eye=(0.0, 0.0, 4.0), axes=DOWN, far=5.0, resolution=1024, **more):
    """Prepared maps of windows from one eye; orthographic ones each from an eye in its middle."""
    maps = []
    for window in windows:
        own = View(eye, *axes, window, 0.01, far, **more)
        if own.orthographic:
            middle = 0.5 * np.array([window[0] + window[1], window[2] + window[3]])
            moved = np.array(eye) + middle @ np.array(axes[:2])
            half = 0.5 * (window[1] - window[0]), 0.5 * (window[3] - window[2])
            own = View(
                tuple(moved.tolist()), *axes, (-half[0], half[0], -half[1], half[1]), 0.01, far, **more
            )
        size = (3, resolution, resolution)
        depths = kernels.layered_depth(stage.geometry, stage.everything(), own.packed(), *size)
        maps.append(kernels.soft_shadow_prepare(depths, own.packed()))
    return maps


@pytest.mark.parametrize(
    "windows",
    [
        [(-0.22, 0.22, -0.22, 0.22), (-0.3, 1.05, -0.65, 0.65)],
        # Borders on texels' borders, and points outside the smallest.
        [(-0.125, 0.0625, -0.125, 0.125), (-0.25, 0.25, -0.25, 0.25), (-1.05, 1.05, -1.05, 1.05)],
    ],
)
@pytest.mark.parametrize("method", ["bitmask", "plain"])
def test_a_point_sees_the_occluders_beside_a_small_window(windows, method):
    emitter, points, normals = lamp(half=(0.5, 0.5)), ground_points(half=0.6, count=15), np.float32(UP)
    truth, weight = closed_forms.visibility(emitter, points, np.tile(UP, (len(points), 1)), BESIDE)
    stage = Stage([GROUND, *BESIDE])
    maps = nested_maps(stage, windows)
    found, _ = stage.visibility(emitter, points, normals, method, maps=maps)
    # As the widest alone; to read the smallest map alone gave .13.
    assert weighted_rmse(found - truth, weight) < 0.012
    # The other twin, to the last sample.
    other = "plain" if method == "bitmask" else "bitmask"
    twin, _ = stage.visibility(emitter, points, normals, other, maps=maps)
    assert np.abs(found - twin).max() < 1e-5


def test_the_small_window_of_a_sun_reads_what_the_wide_one_knows():
    axes = turned_axes((0.3, 0.2, -1.0))
    emitter = lamp(EmitterKind.DISTANT_DISK, half=(0.1, 0.1), axes=axes)
    points, plates = ground_points(half=0.6, count=15), [plate(-0.45, 0.3, -1.2, 0.2, 2.5)]
    truth, weight = closed_forms.visibility(emitter, points, np.tile(UP, (len(points), 1)), plates)
    stage = Stage([GROUND, *plates])
    windows = [(-0.25, 0.125, -0.25, 0.125), (-3.0, 3.0, -3.0, 3.0)]
    maps = nested_maps(stage, windows, (0.0, 0.0, 6.0), axes, 20.0, orthographic=True)
    found, _ = stage.visibility(emitter, points, UP, maps=maps)
    # As the wide map alone; the small map alone gives .44.
    assert weighted_rmse(found - truth, weight) < 0.015
    alone, _ = stage.visibility(emitter, points, UP, maps=maps[1:])
    small, _ = stage.visibility(emitter, points, UP, maps=maps[:1])
    assert weighted_rmse(alone - truth, weight) < 0.015
    assert weighted_rmse(small - truth, weight) > 0.3


def test_nested_windows_do_not_count_an_area_twice():
    emitter, points = lamp(half=(0.5, 0.3)), ground_points(half=0.6, count=15)
    stage = Stage([GROUND, LOW])
    windows = [(-0.1, 0.07, -0.13, 0.05), (-0.6, 0.6, -0.6, 0.6)]
    maps = nested_maps(stage, windows, resolution=256)
    both, _ = stage.visibility(emitter, points, UP, "area", maps=maps, settings=(1 << 20, 1))
    wide, _ = stage.visibility(emitter, points, UP, "area", maps=maps[1:], settings=(1 << 20, 1))
    # They differ by where the fine map's texels end. Whole texels at the seam would add .02 to the sum.
    assert np.abs(both - wide).max() < 0.02
    assert np.abs((both - wide).mean()) < 2e-3


def test_the_penumbra_of_a_suns_edge_is_as_wide_as_the_sun():
    sun = lamp(EmitterKind.DISTANT_DISK, half=(0.05, 0.05))
    x = np.linspace(-0.15, 0.15, 61)
    points = np.stack([x, np.full_like(x, 0.003), np.zeros_like(x)], 1)
    screen = plate(-0.5, 0.0, -0.5, 0.5, 2.0)
    found, _ = Stage([GROUND, screen]).visibility(sun, points, UP)
    # Texels of 1/11 to 1/22 of the penumbra's .2 m; 256 samples of a disk err by .005.
    truth = closed_forms.disk_share_beyond_edge(-x / (2.0 * 0.05))
    assert np.abs(found - truth).max() < 0.03
