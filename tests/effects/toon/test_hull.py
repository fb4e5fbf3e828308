"""The inverted hull: how wide its ring is, from every side, on ball, box, cone, torus and open sheet."""

from __future__ import annotations

import math

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.view import View
from strata.tests.effects.toon import hull_scenes
from strata.tests.effects.toon.hull_scenes import (
    ball,
    box,
    geometry_of,
    sheet,
    split_box,
    torus,
    turned,
    view,
)
from strata.tests.effects.toon.outline_width import LINE, SHAPES, geometry_of_hull, ring_of

SIDE = 360  # pixels
WIDTH = 16.0  # of the line: four times that of a line of 4 pixels, so that a pixel here is a quarter of one


def hull_of(geometry, seen, width=WIDTH, *more, **settings):
    return hull_scenes.hull_of(geometry, seen, SIDE, width, *more, **settings)


def ink_and_mask(geometry, seen: View, triangles: np.ndarray):
    """(SIDE, SIDE) bool: where the hull lies before the surface, and where a surface is."""
    made = geometry_of_hull(triangles, seen)
    depths = [
        kernels.raster_surface(each, np.ones(1, bool), seen.packed(), SIDE, SIDE, attributes=["depth"])[
            "depth"
        ]
        for each in (geometry, made)
    ]
    return depths[1] < depths[0], np.isfinite(depths[0])


def away_from(mask: np.ndarray) -> np.ndarray:
    """Distance of every pixel to the nearest of `mask`, in pixels; counted only near it."""
    edge = mask & ~(np.roll(mask, 1, 0) & np.roll(mask, -1, 0) & np.roll(mask, 1, 1) & np.roll(mask, -1, 1))
    rows, columns = np.nonzero(edge)
    result = np.full(mask.shape, np.inf, np.float32)
    y0, y1 = max(rows.min() - 30, 0), min(rows.max() + 31, SIDE)
    x0, x1 = max(columns.min() - 30, 0), min(columns.max() + 31, SIDE)
    part = np.full((y1 - y0, x1 - x0), np.inf, np.float32)
    for dy in range(-28, 29):
        for dx in range(-28, 29):
            near = np.zeros_like(part, bool)
            near[(rows - y0 + dy).clip(0, y1 - y0 - 1), (columns - x0 + dx).clip(0, x1 - x0 - 1)] = True
            part[near & (part > math.hypot(dx, dy))] = math.hypot(dx, dy)
    result[y0:y1, x0:x1] = part
    result[mask] = 0.0
    return result


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (3.0, 0.0, -2.0)], ids=["middle", "aside"])
@pytest.mark.parametrize("shape", [*SHAPES, "split box"])
def test_the_line_is_as_wide_from_every_side(shape, place):
    """A line of 4 pixels on a turntable, in the middle of the image and where perspective stretches it."""
    shape = SHAPES[shape]() if shape in SHAPES else split_box()
    for turn in 2.0 * math.pi * np.arange(12) / 12 + 0.05:
        least, most = ring_of(shape, turn, place)
        assert least > LINE - 0.25, turn
        assert most < LINE + 0.25, turn


def test_a_balls_ring_is_the_closed_form():
    """Ring of a ball of radius R moved out by w at distance d: f ((R+w) / sqrt(d^2 - (R+w)^2) - R / ...)."""
    seen, w, d = view(), 0.08, 6.0
    geometry = geometry_of(ball())
    ink, mask = ink_and_mask(geometry, seen, hull_of(geometry, seen, w, in_pixels=False))
    pixels = SIDE / 0.6
    inner, outer = (pixels * r / math.sqrt(d * d - r * r) for r in (1.0, 1.0 + w))
    row = ink[SIDE // 2]
    # Facets of 3.75 degrees lie up to 0.05% inside the ball.
    assert row.sum() / 2 == pytest.approx(outer - inner, abs=1.0)
    area = math.pi * (outer**2 - inner**2)
    assert (ink & ~mask).sum() == pytest.approx(area, rel=0.03)


def test_limits_hold_near_and_far():
    geometry = geometry_of(ball())
    far = view((0.0, -60.0, 0.0), 0.03)
    near = view()
    metres = 0.05
    pixel = {id(far): 0.06 / SIDE * 60.0, id(near): 0.6 / SIDE * 6.0}
    for seen in (far, near):
        wanted = metres / pixel[id(seen)]
        for least, most in ((0.0, 1e3), (wanted + 5.0, 1e3), (0.0, wanted - 5.0)):
            ink, _ = ink_and_mask(geometry, seen, hull_of(geometry, seen, metres, False, least, most))
            assert ink[SIDE // 2].sum() / 2 == pytest.approx(np.clip(wanted, least, most), abs=1.2)


def test_thickness_scales_the_line_and_zero_ends_it():
    geometry, seen = geometry_of(ball()), view()
    positions = ball()[0]
    # None on the left, full on the right.
    thickness = (positions[:, 0] > 0.0).astype(np.float32)
    ink, _ = ink_and_mask(geometry, seen, hull_of(geometry, seen, thickness=[(0, thickness)]))
    row = ink[SIDE // 2]
    assert not row[: SIDE // 2 - 20].any()
    assert row[SIDE // 2 :].sum() == pytest.approx(WIDTH, abs=1.0)
    halved, _ = ink_and_mask(geometry, seen, hull_of(geometry, seen, scales=[0.5]))
    assert halved[SIDE // 2].sum() / 2 == pytest.approx(WIDTH / 2, abs=1.0)
    assert not len(hull_of(geometry, seen, width=0.0, least=5.0))


@pytest.mark.parametrize(
    "matrix", [np.diag([-1.0, 1, 1, 1]), np.diag([0.5, 1.3, -1.0, 1]), turned(0.4) * 1.0]
)
def test_mirrored_and_stretched_objects_have_the_same_line(matrix):
    seen, geometry = view(), geometry_of(ball(), [matrix])
    ink, mask = ink_and_mask(geometry, seen, hull_of(geometry, seen))
    away = away_from(mask)
    assert ink[~mask & (away < WIDTH - 1.7)].all()
    assert not ink[~mask & (away > WIDTH + 1.7)].any()
    # What faces the eye is never covered, but for less than a pixel at the silhouette.
    assert not ink[mask & (away_from(~mask) > 1.5)].any()


def test_an_orthographic_view_has_the_same_line():
    seen, geometry = view(window=2.0, orthographic=True), geometry_of(box(), [turned(0.5)])
    ink, mask = ink_and_mask(geometry, seen, hull_of(geometry, seen))
    away = away_from(mask)
    assert ink[~mask & (away < WIDTH - 1.7)].all()
    assert not ink[~mask & (away > WIDTH + 1.7)].any()


def test_a_valley_has_no_ink_where_the_hull_cuts_itself():
    """A step with an edge inwards: the hull folds over itself there."""
    step = np.array([(-1, -1), (1, -1), (1, 0), (0, 0), (0, 1), (-1, 1)], np.float64)
    low, high = (np.column_stack([step[:, 0], np.full(6, y), step[:, 1]]) for y in (-1.0, 1.0))
    faces = [(0, 1, 2, 3, 4, 5), tuple(range(11, 5, -1))]
    faces += [(i + 6, (i + 1) % 6 + 6, (i + 1) % 6, i) for i in range(6)]
    shape = np.concatenate([low, high]).astype(np.float32), faces
    for turn in (-0.5, -0.2, 0.0):
        seen, geometry = view((0.0, -6.0, 1.0)), geometry_of(shape, [turned(turn, 0.4)])
        ink, mask = ink_and_mask(geometry, seen, hull_of(geometry, seen, width=40.0))
        # The step is seen from above: nothing of it hides another part, so no line lies on it but for less
        # than a pixel at the silhouette.
        assert not ink[mask & (away_from(~mask) > 1.5)].any()


def test_a_part_before_another_has_its_line_on_it():
    positions, faces = ball()
    count = len(positions)
    two = np.concatenate([0.4 * positions - (0.0, 2.0, 0.0), positions]).astype(np.float32)
    shape = two, [*faces, *(tuple(i + count for i in face) for face in faces)]
    seen, geometry = view(), geometry_of(shape)
    ink, mask = ink_and_mask(geometry, seen, hull_of(geometry, seen, width=8.0))
    inner = ink & mask
    y, x = np.nonzero(inner)
    radius = np.hypot(x - SIDE / 2 + 0.5, y - SIDE / 2 + 0.5)
    small = SIDE / 0.6 * 0.4 / math.sqrt(16.0 - 0.16)
    assert radius.min() == pytest.approx(small, abs=1.0)
    assert radius.max() == pytest.approx(small + 8.0, abs=1.0)


def test_the_near_plane_and_the_eye_within_leave_it_finite():
    for eye in ((0.0, -1.05, 0.0), (0.0, 0.0, 0.0), (0.0, -1.0, 0.0)):
        for shape in (ball, box, sheet):
            seen, geometry = view(eye), geometry_of(shape())
            triangles = hull_of(geometry, seen)
            assert np.isfinite(triangles).all()
            ink, mask = ink_and_mask(geometry, seen, triangles)
            assert not (ink & mask).any() or shape is sheet


def test_bad_faces_have_no_hull():
    positions, faces = box()
    positions = np.concatenate([positions, positions[:1], positions[:1] + 1e-30]).astype(np.float32)
    shape = positions, [*faces, (0, 8, 9), (0, 1, 1)]
    seen, geometry = view(), geometry_of(shape)
    triangles = hull_of(geometry, seen)
    assert np.isfinite(triangles).all()
    ink, mask = ink_and_mask(geometry, seen, triangles)
    assert (ink & ~mask).any()


def test_a_hull_does_not_depend_on_the_threads():
    seen, geometry = view(), geometry_of(torus(), [turned(0.3)])
    np.testing.assert_array_equal(hull_of(geometry, seen), hull_of(geometry, seen))
