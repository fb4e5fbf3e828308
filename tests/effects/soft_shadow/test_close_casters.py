"""What is so close to a light that no map knows it: the doubt that sends such points to rays."""

from __future__ import annotations

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.emitter import EmitterKind
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.soft_shadow import close_casters
from strata.addon.effects.soft_shadow.views import light_views
from strata.tests.effects.soft_shadow.scenes import Stage, ground_points, lamp, plate

UP = np.float32([0.0, 0.0, 1.0])
GROUND = plate(-6, 6, -6, 6, 0)
# A tray above a bulb of 20 cm, behind the plane of the spot that shines down.
TRAY = plate(-0.25, 0.5, -0.4, 0.4, 2.08)
SPOT = lamp(EmitterKind.FACING_DISK, (0.0, 0.0, 2.0), (0.2, 0.2), cos_cone=0.6)
BULB = lamp(EmitterKind.SPHERE, (0.0, 0.0, 2.0), (0.2, 0.2))
# Close to the bulb, lower than its rim and beside the window of the face that looks down.
BAR = plate(0.21, 0.4, -0.15, 0.15, 1.95)
# At the border of the face that looks down.
CORNERS = [plate(3.5, 3.8, 3.5, 3.8, -2.9), plate(-3.8, -3.5, -3.8, -3.5, -2.9)]
# Something that maps know, and what widens their windows.
BOARD = plate(-0.3, 0.3, -0.2, 0.2, 0.8)
RIM = [plate(1.95, 2.2, 1.95, 2.2, 0.05), plate(-2.2, -1.95, -2.2, -1.95, 0.05)]


def tables_of(stage, emitter, views):
    everything, size = stage.everything(), close_casters.RESOLUTION
    depths = [
        kernels.layered_depth(stage.geometry, everything, view.packed(), 1, size, size)
        for _, view in close_casters.surrounding_views(emitter)
    ]
    return [close_casters.table(CpuDevice(), depths, emitter, view) for view in views]


def visibility(stage, emitter, points, with_tables, leave_uncertain=True):
    """V by maps (N,), how it is doubted (N,), V by 1024 rays (N,), and the weight of each point (N,)."""
    views, _ = light_views(emitter, stage.boxes, np.array([[points.min(axis=0), points.max(axis=0)]]))
    views = [view for _, view in views]
    depths = [
        kernels.layered_depth(stage.geometry, stage.everything(), view.packed(), 3, 512, 512)
        for view in views
    ]
    maps = [
        kernels.soft_shadow_prepare(depth, view.packed()) for depth, view in zip(depths, views, strict=True)
    ]
    normals = np.tile(UP, (len(points), 1))
    surface = (points.astype(np.float32), normals, normals)
    tables = tables_of(stage, emitter, views) if with_tables else []
    found, doubt = kernels.soft_shadow_backproject(
        *surface, stage.origin, emitter.packed(), maps, leave_uncertain=leave_uncertain, close_casters=tables
    )
    accelerator = kernels.Accel(stage.geometry, stage.origin, stage.everything())
    truth, weight = kernels.ray_visibility(
        accelerator, stage.everything(), emitter.packed(), stage.origin, *surface, 1024, 3
    )
    return found, doubt, truth, weight


def test_a_tray_above_a_spot_is_doubted_where_it_hides_a_part():
    points, stage = ground_points(half=2.0, count=41), Stage([GROUND, BOARD, *RIM, TRAY])
    found, doubt, truth, weight = visibility(stage, SPOT, points, with_tables=False)
    error, lit = np.abs(found - truth), weight > 1e-3 * weight.max()
    # Without the table the map is sure of light that the tray keeps away.
    assert error[lit & (doubt == 0)].max() > 0.1
    _, doubt, _, _ = visibility(stage, SPOT, points, with_tables=True)
    assert error[lit & (doubt == 0)].max() < 0.03
    # And believed where the disk does not lean behind the lamp far enough.
    assert 0.02 < (lit & (doubt == 0)).sum() / lit.sum() < 0.98
    assert not doubt[lit & (np.linalg.norm(points[:, :2], axis=1) < 0.2)].any()


def test_a_bar_far_out_of_a_cube_face_is_known_from_that_face():
    points, stage = ground_points(half=3.6, count=41, z=-3.0), Stage([GROUND - (0, 0, 3.0), *CORNERS, BAR])
    found, doubt, truth, _ = visibility(stage, BULB, points, with_tables=False)
    assert truth.min() < 0.9
    assert np.abs(found - truth)[doubt == 0].max() < 0.03
    assert (doubt != 0).mean() < 0.1


def test_without_other_doubts_the_tables_alone_leave_points_to_rays():
    points, stage = ground_points(half=2.0, count=21), Stage([GROUND, BOARD, *RIM, TRAY])
    _, doubt, _, _ = visibility(stage, SPOT, points, with_tables=True, leave_uncertain=False)
    assert set(np.unique(doubt)) == {0, 2}
    _, both, _, _ = visibility(stage, SPOT, points, with_tables=True)
    np.testing.assert_array_equal(both == 2, doubt == 2)
    _, none, _, _ = visibility(stage, SPOT, points, with_tables=False, leave_uncertain=False)
    assert not none.any()


def test_nothing_is_doubted_for_casters_that_maps_know_or_that_are_far():
    high = plate(-3.0, 3.0, -3.0, 3.0, 2.0 + 1.01 * close_casters.reach_m(SPOT))
    stage = Stage([GROUND, BOARD, high])
    views, _ = light_views(SPOT, stage.boxes, np.array([[(-2, -2, 0), (2, 2, 0)]], float))
    (table,) = tables_of(stage, SPOT, [view for _, view in views])
    assert table.shape == (close_casters.CELLS, close_casters.CELLS)
    assert table.dtype == np.uint8
    assert not table.any()


def test_a_light_whose_only_casters_are_behind_it_still_looks_at_all_it_shines_on():
    receivers = np.array([[(-2, -2, 0), (2, 2, 0)]], float)
    boxes = Stage([GROUND, TRAY]).boxes
    assert not light_views(SPOT, boxes, receivers)[0]
    ((_, view),), _ = light_views(SPOT, boxes, receivers, hold_receivers=True)
    assert view.window[1] == pytest.approx(1.0, abs=0.01)
    # Of the lamp without a cone the face that looks down has casters, others have receivers.
    views, left_out = light_views(BULB, boxes, receivers, hold_receivers=True)
    assert {name[:2] for name, _ in views} == {"+X", "-X", "+Y", "-Y", "-Z"}
    assert ("face +Z", "no receivers") in left_out


@pytest.mark.parametrize("tables", [[np.zeros((0, 4), np.uint8)], [np.zeros((4, 4), np.uint8)] * 2])
def test_useless_tables_are_refused(tables):
    stage = Stage([GROUND, TRAY])
    points = ground_points(count=3)
    maps = stage.maps(SPOT, points, resolution=64)
    normals = np.tile(UP, (len(points), 1))
    arguments = (points.astype(np.float32), normals, normals, stage.origin, SPOT.packed(), maps)
    with pytest.raises(ValueError, match="close_casters"):
        kernels.soft_shadow_backproject(*arguments, close_casters=tables)
