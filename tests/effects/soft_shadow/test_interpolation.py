"""Points between evaluated ones (interpolate.rs), on a level ground that is an image of points."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.bake import bake
from strata.addon.planning import Options
from strata.tests.effects.soft_shadow.scenes import GROUND, HIGH, LOW, UP, Stage, ground_points, lamp
from strata.tests.support import closed_forms
from strata.tests.support.settings import maps

COUNT = 61


def shadow(spacing, *, points=None, normals=None, stage=None, **more):
    """V and uncertainty, (COUNT, COUNT) each, of the ground under a lamp."""
    points = ground_points(count=COUNT) if points is None else points
    stage = stage or Stage([GROUND, LOW, HIGH])
    emitter = lamp()
    maps = stage.maps(emitter, points, resolution=512)
    if normals is None:
        normals = np.broadcast_to(np.float32(UP), points.shape)
    image = [np.ascontiguousarray(a, np.float32).reshape(COUNT, COUNT, 3) for a in (points, normals, normals)]
    return kernels.soft_shadow_backproject(
        *image, stage.origin, emitter.packed(), maps, spacing=spacing, **more
    )


@pytest.mark.parametrize("spacing", [2, 3, 4])
def test_grid_points_are_what_they_were_and_the_rest_stays_close(spacing):
    every, _ = shadow(1)
    found, _ = shadow(spacing)
    np.testing.assert_array_equal(found[::spacing, ::spacing], every[::spacing, ::spacing])
    assert (found != every).any()
    # What is interpolated spans a tenth at most, and its ends are right.
    assert np.abs(found - every).max() <= 0.1
    # What the 256 samples err by (.004 where an edge crosses the light), which interpolating smooths.
    assert np.abs(found - every).mean() < 4e-3


def test_interpolating_adds_no_error_to_a_penumbra():
    points = ground_points(count=COUNT)
    truth, weight = closed_forms.visibility(lamp(), points, np.tile(UP, (len(points), 1)), [LOW, HIGH])

    def rmse(found):
        return np.sqrt((weight * (found.ravel() - truth) ** 2).sum() / weight.sum())

    assert rmse(shadow(2)[0]) < 1.1 * rmse(shadow(1)[0])


def test_nothing_is_interpolated_across_creases_steps_or_bent_normals():
    flat = np.broadcast_to(np.float32(UP), (COUNT * COUNT, 3)).reshape(COUNT, COUNT, 3)
    steps = ground_points(count=COUNT).reshape(COUNT, COUNT, 3)
    steps[1::2] += (0.0, 0.0, 0.05)  # every other row a step higher
    bent = flat.copy()
    bent[:, 1::2] = (0.6, 0.0, 0.8)
    for changed in ({"points": steps.reshape(-1, 3)}, {"normals": bent.reshape(-1, 3)}):
        every, found = shadow(1, **changed)[0], shadow(2, **changed)[0]
        rows, columns = (
            (slice(1, None, 2), slice(None)) if "points" in changed else (slice(None), slice(1, None, 2))
        )
        np.testing.assert_array_equal(found[rows, columns], every[rows, columns])


def test_uncertain_points_stay_uncertain_and_tell_nothing_of_their_neighbours():
    # Normals that lean away put the lamp partly below the horizon, which rays are for.
    leaning = np.broadcast_to(np.float32((0.995, 0.0, 0.0998)), (COUNT * COUNT, 3))
    every, doubts = shadow(1, normals=leaning, leave_uncertain=True)
    found, still = shadow(2, normals=leaning, leave_uncertain=True)
    assert doubts.any()
    np.testing.assert_array_equal(still, doubts)
    np.testing.assert_array_equal(found[doubts != 0], every[doubts != 0])


def test_points_that_are_no_image_and_other_methods_know_no_spacing():
    stage, emitter, points = Stage([GROUND, LOW]), lamp(), ground_points(count=21)
    maps = stage.maps(emitter, points, layers=4, resolution=256)
    normals = np.broadcast_to(np.float32(UP), points.shape).copy()
    flat = (points.astype(np.float32), normals, normals, stage.origin, emitter.packed(), maps)
    np.testing.assert_array_equal(
        kernels.soft_shadow_backproject(*flat, spacing=3)[0], kernels.soft_shadow_backproject(*flat)[0]
    )
    image = (*(a.reshape(21, 21, 3) for a in flat[:3]), *flat[3:])
    for method in ("plain", "area"):
        np.testing.assert_array_equal(
            kernels.soft_shadow_backproject(*image, spacing=3, method=method)[0],
            kernels.soft_shadow_backproject(*image, method=method)[0],
        )
    with pytest.raises(ValueError, match="at least 1"):
        kernels.soft_shadow_backproject(*image, spacing=0)


def tilted_plane_under_a_box() -> bpy.types.Scene:
    """A camera looks down on a plane that fills its view; a box beside the view shadows it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=60.0, rotation=(0.1, 0.05, 0.0))
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(-1.5, 0.4, 6.5))
    bpy.ops.object.camera_add(location=(0.0, 0.0, 6.0))
    scene.camera = bpy.context.object
    data = bpy.data.lights.new("Lamp", "AREA")
    data.energy, data.size = 500.0, 1.0
    lamp = bpy.data.objects.new("Lamp", data)
    lamp.location = (-3.0, 0.8, 13.0)
    scene.collection.objects.link(lamp)
    return scene


@pytest.mark.parametrize("spacing", [2, 3])
def test_tiles_do_not_show(backend, spacing, monkeypatch):
    scene, size = tilted_plane_under_a_box(), (40, 30)
    values = maps(spacing=spacing, resolution=256)
    options = Options(("soft_shadow",), backend, samples=1, probes=0, values=values)
    found = []
    for rows in (30, 24, 7, 1):
        monkeypatch.setattr("strata.addon.core.sampling.PIXELS_PER_TILE", size[0] * rows)
        baked = bake(scene, scene.view_layers[0], options, size=size)
        found.append(baked.layers.layers[0].pixels)
    assert ((found[0] > 0.0) & (found[0] < 1.0)).mean() > 0.1  # a penumbra
    for tiled in found[1:]:
        np.testing.assert_array_equal(tiled, found[0])
