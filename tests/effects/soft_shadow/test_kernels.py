"""Soft shadow maps against closed forms, against rays, and against their own plain twin."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

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
    against_closed_form,
    ground_points,
    lamp,
    lamp_view,
    plate,
    turned_axes,
)

# At 512 samples the light covers 11 to 22 texels a side, and each edge errs by about a twentieth of a texel
# (its rows meet the edge at different places). Where an edge crosses the light, 256 samples err by .004, the
# some 200 of a disk by .005; of two plates half the points are such. Little more than what was measured:
# .0018 .0037 .0037 .0020 .0021 .0045 .0026 .0043.
CASES = {
    "rectangle": (lamp(half=(0.5, 0.3)), [LOW], (GROUND,), 0.003),
    "stacked plates": (lamp(half=(0.5, 0.3)), [LOW, HIGH], (GROUND,), 0.004),
    "nothing behind the plates": (lamp(half=(0.5, 0.3)), [LOW, HIGH], (), 0.004),
    "ellipse": (lamp(EmitterKind.ELLIPSE, half=(0.5, 0.3)), [LOW], (GROUND,), 0.003),
    "sphere": (lamp(EmitterKind.SPHERE, half=(0.3, 0.3)), [LOW], (GROUND,), 0.003),
    "facing disk": (lamp(EmitterKind.FACING_DISK, half=(0.3, 0.3)), [LOW, HIGH], (GROUND,), 0.005),
    "sun": (
        lamp(EmitterKind.DISTANT_DISK, half=(0.1, 0.1), axes=turned_axes((0.3, 0.2, -1.0))),
        [LOW, HIGH],
        (GROUND,),
        0.004,
    ),
    "turned rectangle": (
        lamp(half=(0.5, 0.3), centre=(-0.8, 0.5, 4.0), axes=turned_axes((0.3, 0.2, -1.0))),
        [LOW, HIGH],
        (GROUND,),
        0.005,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_plates_agree_with_closed_forms(name):
    emitter, plates, extra, tolerance = CASES[name]
    assert against_closed_form(emitter, plates, ground_points(count=31), extra) < tolerance


def test_reading_every_texel_leaves_only_the_samples_and_the_resolution():
    emitter, plates, extra, _ = CASES["stacked plates"]
    # Measured .0013; a texel is 1/80 of the light where it is largest.
    assert against_closed_form(emitter, plates, ground_points(count=31), extra, settings=(1 << 20, 2)) < 0.003


@pytest.mark.parametrize("name", ["sphere", "facing disk", "sun", "ellipse"])
def test_the_twins_agree_for_every_kind_of_light(name):
    emitter, plates, extra, _ = CASES[name]
    stage, points = Stage([*extra, *plates]), ground_points(count=21)
    maps = stage.maps(emitter, points, resolution=512)
    fast, _ = stage.visibility(emitter, points, UP, maps=maps)
    normals = np.broadcast_to(np.float32(UP), points.shape).copy()
    arguments = (points.astype(np.float32), normals, normals, stage.origin, emitter.packed(), maps)
    plain, _ = kernels.soft_shadow_backproject(*arguments, method="plain")
    assert np.abs(fast - plain).max() < 1e-5


@pytest.mark.parametrize("kind", [EmitterKind.DISTANT_DISK, EmitterKind.RECTANGLE])
def test_points_on_parallel_planes_do_not_share_a_tangent_plane(kind):
    # The top of a plate comes first, as where its edge crosses an image; what lies under is in full shadow.
    top = np.array([[x, 0.0, 1.0] for x in np.linspace(-0.3, 0.3, 6)])
    under = top * (1.0, 1.0, 0.0)
    stage, emitter = Stage([GROUND, plate(-0.5, 0.5, -0.5, 0.5, 1.0)]), lamp(kind, half=(0.05, 0.05))
    found, _ = stage.visibility(emitter, np.concatenate([top, under]), UP)
    np.testing.assert_array_equal(found, np.repeat([1.0, 0.0], 6))


@pytest.mark.parametrize(
    "light",
    [
        {"tan_half_spread": 0.4},
        {"kind": EmitterKind.SPHERE, "half": (0.3, 0.3), "cos_cone": 0.85, "blend": 0.3},
        {"kind": EmitterKind.SPHERE, "half": (0.3, 0.3), "cos_cone": 0.85, "blend": 0.0},
    ],
)
def test_spread_and_cone_weigh_the_samples_alike_in_both_twins(light):
    emitter, points = lamp(**light), ground_points(count=21)
    stage = Stage([GROUND, LOW])
    maps = stage.maps(emitter, points, resolution=512)
    normals = np.broadcast_to(np.float32(UP), points.shape).copy()
    arguments = (points.astype(np.float32), normals, normals, stage.origin, emitter.packed(), maps)
    fast, _ = kernels.soft_shadow_backproject(*arguments)
    plain, _ = kernels.soft_shadow_backproject(*arguments, method="plain")
    assert np.abs(fast - plain).max() < 1e-5
    assert np.ptp(fast) > 0.5


def test_the_same_bits_on_any_number_of_threads_and_any_processor():
    digests = set()
    for environment in (
        {"RAYON_NUM_THREADS": "1"},
        {"RAYON_NUM_THREADS": "3"},
        {"STRATA_AVX512": "0"},
        {"STRATA_PORTABLE": "1"},
    ):
        here = {**os.environ, **environment}
        code = "from strata.tests.effects.soft_shadow.test_kernels import digest; print(digest())"
        run = [sys.executable, "-c", code]
        digests.add(subprocess.run(run, env=here, capture_output=True, text=True, check=True).stdout)
    assert len(digests) == 1


def digest() -> str:
    emitter, plates, extra, _ = CASES["sphere"]
    found, uncertain = Stage([*extra, *plates]).visibility(
        emitter, ground_points(count=21), UP, resolution=256
    )
    return hashlib.sha256(found.tobytes() + uncertain.tobytes()).hexdigest()


def test_samples_below_the_geometric_horizon_are_hidden():
    # A wall that faces +X under a lamp that reaches over its plane on both sides, shaded as if it leaned up.
    emitter = lamp(centre=(0.1, 0.0, 3.0), half=(0.6, 0.4))
    points = np.array([[0.0, y, z] for y in (-0.5, 0.2) for z in (0.0, 1.0, 2.0)])
    wall = np.broadcast_to(np.float32([1.0, 0.0, 0.0]), points.shape).copy()
    leaning = np.broadcast_to(np.float32([0.8, 0.0, 0.6]), points.shape).copy()
    found, _ = kernels.soft_shadow_backproject(
        points.astype(np.float32), wall, leaning, np.zeros(3), emitter.packed(), []
    )
    u, v = np.meshgrid(np.linspace(-1, 1, 801)[1::2], np.linspace(-1, 1, 801)[1::2])
    light = np.stack([0.1 + 0.6 * u, 0.4 * v, np.full_like(u, 3.0)], -1).reshape(-1, 3)
    for point, share in zip(points, found, strict=True):
        to_light = light - point
        length = np.linalg.norm(to_light, axis=1)
        weight = np.maximum(to_light @ leaning[0].astype(float), 0.0) * to_light[:, 2] / length**4
        # The edge of a half-plane on 256 samples.
        assert share == pytest.approx((weight * (to_light[:, 0] > 0.0)).sum() / weight.sum(), abs=0.012)


def test_turned_away_surfaces_are_not_lit_and_so_count_as_visible():
    points = ground_points(count=5)
    found, _ = Stage([GROUND, LOW]).visibility(lamp(), points, (0.0, 0.0, -1.0))
    np.testing.assert_array_equal(found, 1.0)


def test_the_sum_of_areas_is_exact_on_one_parallel_plate():
    emitter, points = lamp(half=(0.5, 0.3)), ground_points(count=21)
    found, uncertain = Stage([GROUND, LOW]).visibility(emitter, points, UP, "area", settings=(1 << 20, 2))
    # The plate at 1.5, projected through the point onto the lamp's plane at 4: a rectangle.
    grown = points[:, None, :2] + (LOW[None, ::2, :2] - points[:, None, :2]) * (4.0 / 1.5)
    covered = np.minimum(grown[:, 1], (0.5, 0.3)) - np.maximum(grown[:, 0], (-0.5, -0.3))
    truth = 1.0 - np.maximum(covered, 0.0).prod(axis=1) / (1.0 * 0.6)
    # Edges err by half a texel of some 1/40 of the lamp.
    assert np.abs(found - truth).max() < 0.03
    assert not uncertain.any()


@pytest.mark.parametrize("height", [2.3, 13.7, 77.7])
def test_the_sum_of_areas_leaves_ground_lit_that_is_parallel_to_the_light(height):
    # Rounding alone decides whether the ground is nearer to the light than itself.
    points = ground_points(half=0.6 * height, count=41, z=0.1234)
    stage = Stage([plate(-2 * height, 2 * height, -2 * height, 2 * height, 0.1234)])
    emitter = lamp(centre=(0.017, -0.031, 0.1234 + height), half=(0.1 * height, 0.1 * height))
    view = View(emitter.centre, *DOWN, (-1.0, 1.0, -1.0, 1.0), 0.5 * height, 2.0 * height)
    depths = kernels.layered_depth(stage.geometry, stage.everything(), view.packed(), 2, 512, 512)
    maps = [kernels.soft_shadow_prepare(depths, view.packed())]
    found, _ = stage.visibility(emitter, points, UP, "area", maps=maps)
    np.testing.assert_array_equal(found, 1.0)


def test_the_sum_of_areas_overshadows_where_occluders_overlap():
    emitter, plates, extra, _ = CASES["stacked plates"]
    points = ground_points(count=21)
    area = against_closed_form(emitter, plates, points, extra, method="area", settings=(1 << 20, 2))
    assert area > 10 * against_closed_form(emitter, plates, points, extra)


@pytest.mark.parametrize("shape", [(0, 8, 8), (2, 0, 8), (2, 8, 0)])
def test_maps_of_useless_shape_are_refused(shape):
    with pytest.raises(ValueError, match="layer and sides"):
        kernels.soft_shadow_prepare(np.ones(shape, np.float32), lamp_view().packed())


def test_negative_biases_and_mismatched_points_are_refused():
    depths = np.ones((2, 8, 8), np.float32)
    with pytest.raises(ValueError, match="negative"):
        kernels.soft_shadow_prepare(depths, lamp_view().packed(), -1.0)
    points, normals = np.zeros((4, 3), np.float32), np.zeros((5, 3), np.float32)
    with pytest.raises(ValueError, match="normals"):
        kernels.soft_shadow_backproject(points, normals, normals, np.zeros(3), lamp().packed(), [])
