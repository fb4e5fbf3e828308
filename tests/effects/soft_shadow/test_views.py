"""Where a light's maps are rendered from, and what is left out."""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.core.emitter import EmitterKind
from strata.addon.effects.soft_shadow.views import light_views, too_far
from strata.tests.effects.soft_shadow.scenes import DOWN, lamp

REGION = np.array([[[-20.0, -20.0, 0.0], [20.0, 20.0, 2.0]]])
GROUND = np.array([[-500.0, -500.0, 0.0], [500.0, 500.0, 0.0]])
CRATE = np.array([[-1.0, -0.5, 0.5], [1.0, 0.5, 1.5]])
SIDES = ("+", "-X", "-Y")
SUN = lamp(EmitterKind.DISTANT_DISK, half=(0.005, 0.005))


def views_of(emitter, *casters, region=REGION):
    return light_views(emitter, np.array(casters).reshape(-1, 2, 3), region)


def corners(box):
    return np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def in_window(view, points):
    """Whether `points` lie in the window and between near and far."""
    x, y, z = view.to_view(points).T
    if not view.orthographic:
        x, y = x / z, y / z
    left, right, bottom, top = view.window
    return (left <= x) & (x <= right) & (bottom <= y) & (y <= top) & (view.near < z) & (z < view.far)


@pytest.mark.parametrize(
    "emitter", [lamp(), lamp(EmitterKind.ELLIPSE), SUN], ids=["rectangle", "ellipse", "sun"]
)
def test_the_ground_under_everything_takes_no_texels(emitter):
    (_, with_ground), (_, without) = views_of(emitter, GROUND, CRATE)[0][0], views_of(emitter, CRATE)[0][0]
    assert with_ground == without
    assert in_window(with_ground, corners(CRATE)).all()
    # The window is the crate's, not the ground's: at its top, 2.5 m below the lamp, 2 m are a slope of .8.
    assert with_ground.window[1] - with_ground.window[0] < 2.02


def test_nothing_to_cast_or_to_receive_needs_no_map():
    assert views_of(lamp(), GROUND) == ([], [("map", "no casters")])
    above = CRATE + np.array([0.0, 0.0, 9.0])
    assert views_of(lamp(), above) == ([], [("map", "no casters")])
    behind = np.array([[[-1.0, -1.0, 5.0], [1.0, 1.0, 6.0]]])
    assert views_of(lamp(), CRATE, region=behind)[0] == []
    assert views_of(SUN, np.zeros((0, 2, 3)))[1] == [("map", "no casters")]


def test_wide_windows_are_nested_and_keep_the_lamps_axes():
    far = np.array([[15.0, -1.0, 1.0], [18.0, 1.0, 1.5]])
    views, _ = views_of(lamp(), CRATE, far)
    assert len(views) == 3
    assert [name for name, _ in views] == ["", "wide 1", "wide 2"]
    widths = [view.window[1] - view.window[0] for _, view in views]
    assert widths == sorted(widths)
    for _, view in views:
        assert (view.right, view.up, view.forward) == DOWN
    assert in_window(views[0][1], corners(CRATE)).all()
    assert in_window(views[-1][1], corners(far)).all()


def test_a_point_light_gets_the_faces_that_matter():
    views, left_out = views_of(lamp(EmitterKind.SPHERE, half=(0.1, 0.1)), CRATE)
    assert [name for name, _ in views] == ["-Z"]
    reasons = dict(left_out)
    assert reasons["face +Z"] == "no receivers"
    assert reasons["face +X"] == "no casters"
    assert in_window(views[0][1], corners(CRATE)).all()
    assert max(map(abs, views[0][1].window)) <= 0.41


def test_a_narrow_spot_gets_one_frustum_and_a_wide_one_faces():
    narrow = lamp(EmitterKind.SPHERE, half=(0.1, 0.1), cos_cone=np.cos(np.radians(30.0)))
    views, _ = views_of(narrow, CRATE, GROUND - np.array([0.0, 0.0, 1.0]))
    assert [name for name, _ in views] == [""]
    wide = lamp(EmitterKind.SPHERE, half=(0.1, 0.1), cos_cone=np.cos(np.radians(80.0)))
    assert all(name[0] in "+-" for name, _ in views_of(wide, CRATE)[0])


def test_the_nearest_caster_is_in_front_of_the_near_plane():
    plate = np.array([[-1.0, -1.0, 1.5], [1.0, 1.0, 1.5]])
    for emitter in (lamp(), SUN, lamp(EmitterKind.SPHERE, half=(0.1, 0.1))):
        ((_, view),), _ = views_of(emitter, plate)
        depth = view.to_view(plate)[:, 2].min()
        # Far enough for float32, near enough to cost no precision.
        assert view.near < depth * (1.0 - 1e-4) < view.near * 3.0 + 1e-2


def test_a_mesh_around_the_lamp_is_seen_whole():
    room = np.array([[-3.0, -3.0, -1.0], [3.0, 3.0, 5.0]])
    region = room[None]
    views, left_out = light_views(lamp(EmitterKind.SPHERE, half=(0.1, 0.1)), room[None], region)
    # The room's box does not say how close it is.
    assert [name for name, _ in views] == [letter + axis for axis in "XYZ" for letter in "+-"]
    assert left_out == []
    for _, view in views:
        assert view.near < 0.01 * view.far


def test_what_is_close_to_a_spot_or_a_point_widens_their_windows():
    """A plate, and a lamp of 0.2 m that is `away` above it: from the edge of what a view lights, at 30 or 45
    degrees, its rim is seen past what lies far outside."""
    spot = lamp(EmitterKind.FACING_DISK, half=(0.2, 0.2), cos_cone=np.cos(np.radians(30.0)))
    bulb = lamp(EmitterKind.SPHERE, half=(0.2, 0.2))
    for emitter, edge in ((spot, 30.0), (bulb, 45.0)):
        for away in (0.25, 0.5, 1.0):
            close = np.array([[-4.0, -4.0, 4.0 - away], [4.0, 4.0, 4.0 - away]])
            views, _ = views_of(emitter, close)
            widest = max(view.window[1] for name, view in views if not name.startswith(SIDES))
            # In the plane of the axis the rim is seen past a slope of tan(edge) + radius / (away cos(edge)).
            needed = np.tan(np.radians(edge)) + 0.2 / np.cos(np.radians(edge)) * (1.0 / away - 1.0 / 4.0)
            assert widest > min(needed, 4.0 / away) * 0.999
        far = np.array([[-4.0, -4.0, 0.5], [4.0, 4.0, 1.0]])
        assert all(max(map(abs, view.window)) < 1.6 for _, view in views_of(emitter, far)[0])


def test_a_bit_of_wall_at_a_spot_does_not_spread_its_texels():
    """Its rim lights that bit by a wide angle, and hardly any of it; far more is to be seen far away. So
    there is no second, wider map."""
    spot = lamp(EmitterKind.FACING_DISK, half=(0.1, 0.1), cos_cone=np.cos(np.radians(45.0)))
    ground = np.array([[[x, -2.0, 0.0], [x + 1.0, 2.0, 0.1]] for x in range(-4, 4)])
    wall = np.array([[[0.05, -0.05, 3.9], [0.15, 0.05, 4.1]]])
    board = np.array([[-3.0, -3.0, 2.9], [3.0, 3.0, 3.0]])
    alone, _ = views_of(spot, board, region=ground)
    beside, _ = views_of(spot, board, region=np.concatenate([ground, wall]))
    assert len(alone) == len(beside) == 1
    assert max(map(abs, beside[0][1].window)) < 1.05 * max(map(abs, alone[0][1].window))


def test_penumbras_of_casters_beside_the_receivers_are_kept():
    # A caster just outside the receivers' cone still hides part of a wide light.
    region = np.array([[[0.0, -0.1, 0.0], [0.2, 0.1, 0.0]]])
    beside = np.array([[-0.4, -0.1, 3.0], [-0.2, 0.1, 3.0]])
    views, _ = views_of(lamp(half=(0.5, 0.5)), beside, region=region)
    # The last ray, from x = 0 on the ground to x = -.5 on the lamp, passes the caster's height at -.375.
    assert views[0][1].window[0] == pytest.approx(-0.375, abs=1e-3)
    assert in_window(views[0][1], np.array([[-0.374, 0.0, 3.0]])).all()


def test_a_lamp_whose_depths_would_run_together_is_refused():
    region = np.array([[-2.0, -2.0, 0.0], [2.0, 2.0, 0.5]])
    assert too_far(lamp(centre=(0.0, 0.0, 1e6)), region) is None
    assert "depths run together" in too_far(lamp(centre=(0.0, 0.0, 1e8)), region)
    assert "single precision" in too_far(lamp(centre=(0.0, 0.0, 1e10)), 1e9 * region)
    assert too_far(lamp(EmitterKind.DISTANT_DISK, centre=(0.0, 0.0, 1e12)), region) is None
    assert too_far(lamp(centre=(0.5, 0.0, 0.2)), region) is None  # within what it lights
