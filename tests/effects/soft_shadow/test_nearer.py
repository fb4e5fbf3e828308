"""A sun over a wide view: what is near gets maps of its own, fine enough for what an artist looks at."""

import bpy
import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.effects.soft_shadow import sun_views
from strata.addon.effects.soft_shadow.views import light_views
from strata.addon.planning import Options
from strata.scripts.bench.methods import accelerator_of, surface_of, traced
from strata.scripts.bench.scenes import read
from strata.tests.support.figures import weighted_rmse
from strata.tests.support.settings import maps

DOWN = Emitter(
    EmitterKind.DISTANT_DISK,
    (0.0, 0.0, 0.0),
    right=(1.0, 0.0, 0.0),
    up=(0.0, 1.0, 0.0),
    forward=(0.0, 0.0, -1.0),
    half_width=0.01,
    half_height=0.01,
)


def boxes(places, half: float) -> np.ndarray:
    places = np.array(places, np.float64)
    return np.stack([places - half, places + half], axis=1)


def scattered(count: int, reach: float, height: float, seed: int) -> np.ndarray:
    """Places within `reach` of the origin."""
    across = np.random.default_rng(seed).uniform(-reach, reach, (count, 2))
    return np.concatenate([across, np.full((count, 1), height)], axis=1)


def test_windows_lie_within_each_other_and_hold_the_nearest():
    near, far = scattered(300, 2.0, 0.0, 1), scattered(200, 100.0, 0.0, 2)
    receivers = boxes(np.concatenate([near, far]), 0.05)
    casters = boxes(np.concatenate([scattered(30, 2.0, 1.0, 3), scattered(30, 100.0, 1.0, 4)]), 0.2)
    (plain,), _ = light_views(DOWN, casters, receivers)
    views, _ = light_views(DOWN, casters, receivers, eye=np.array([0.0, -3.0, 1.0]))
    assert [name for name, _ in views] == ["", "wide 1"]
    inner, outer, alone = (
        np.add(np.reshape(view.window, (2, 2)), np.array(view.eye)[:2, None])
        for view in (views[0][1], views[1][1], plain[1])
    )
    np.testing.assert_allclose(outer, alone, rtol=1e-12)
    # One eye, so that all maps see a point alike.
    assert views[0][1].eye == views[1][1].eye
    assert (inner[:, 0] >= outer[:, 0]).all()
    assert (inner[:, 1] <= outer[:, 1]).all()
    assert np.prod(inner[:, 1] - inner[:, 0]) < 0.01 * np.prod(outer[:, 1] - outer[:, 0])
    shadowed = near[(np.abs(near[:, :2]) < 1.5).all(axis=1), :2]
    assert ((inner[:, 0] < shadowed) & (shadowed < inner[:, 1])).all()


def test_nothing_is_added_where_all_is_about_as_near():
    receivers, casters = boxes(scattered(500, 2.0, 0.0, 1), 0.05), boxes(scattered(30, 2.0, 1.0, 3), 0.2)
    eye = np.array([0.0, -3.0, 1.0])
    assert light_views(DOWN, casters, receivers, eye=eye) == light_views(DOWN, casters, receivers)


@pytest.fixture
def fence():
    """Slats close to the eye, towers as far as 200 m."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 160, 90
    bpy.ops.mesh.primitive_plane_add(size=600.0)
    for number in range(24):
        bpy.ops.mesh.primitive_cube_add(
            size=1.0, location=(0.12 * number - 1.4, 0.5, 0.4), scale=(0.04, 0.02, 0.8)
        )
    for x, y in scattered(40, 180.0, 0.0, 5)[:, :2]:
        bpy.ops.mesh.primitive_cube_add(size=4.0, location=(x, abs(y) + 10.0, 6.0), scale=(1.0, 1.0, 3.0))
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.angle, sun.rotation_euler = 0.01, (0.9, 0.2, 0.0)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, -2.0, 1.2), (1.45, 0.0, 0.0)
    for thing in (sun, camera):
        scene.collection.objects.link(thing)
    scene.camera = camera
    return scene


def error(scene, backend: str, **values) -> float:
    """RMSE at the pixels' centres against rays from the points that the rasteriser sees there, weighted by
    the light that would arrive."""
    options = Options(("soft_shadow",), backend, samples=1, probes=0, values=maps(**values))
    (layer,) = bake(scene, scene.view_layers[0], options).layers.layers
    case = read(scene)
    surface, _ = surface_of(case)
    truth, weight = traced(case, accelerator_of(case), surface, 256, seed=1)
    return weighted_rmse(layer.pixels.ravel() - truth, weight)


def test_slats_near_the_eye_keep_their_shape_before_a_town(fence, backend, monkeypatch):
    """Measured by rays: .0041, and .0113 without finer windows, when this was written."""
    found = error(fence, backend, rays=0)
    assert found < 0.006
    if backend == "cpu":
        monkeypatch.setattr(sun_views, "MOST_NEARER", 0)
        assert error(fence, backend, rays=0) > 2.0 * found


@pytest.mark.parametrize("method", ["bitmask", "hybrid"])
def test_rays_where_edges_are_hard_leave_little_of_the_error(fence, backend, method):
    """Of 57,600 pixels, so that one which rounding lets a device miss weighs little: .017 becomes .0004."""
    fence.render.resolution_percentage = 200
    bpy.data.lights["Sun"].angle = 0.002
    assert error(fence, backend, method=method) < 0.5 * error(fence, backend, rays=0)
