"""Edges of a sun's shadows that are harder than a texel: no map knows where they run, so rays are asked."""

import itertools

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.emitter import EmitterKind
from strata.tests.effects.soft_shadow.scenes import GROUND, UP, Stage, lamp, plate

SUN = lamp(EmitterKind.DISTANT_DISK, half=(0.004, 0.004))
WIDTH, HEIGHT = 96, 64


def ground_image(half=1.5):
    """(HEIGHT, WIDTH, 3) points of the ground, as an image shows them."""
    x, y = np.meshgrid(np.linspace(-half, half, WIDTH) + 0.0137, np.linspace(-half, half, HEIGHT) + 0.0071)
    return np.stack([x, y, np.zeros_like(x)], -1)


def evaluated(stage, emitter, points, resolution, method="bitmask", normals=None, **settings):
    """V by the map, how it is doubted, and V by 1024 rays, each (HEIGHT, WIDTH)."""
    maps = stage.maps(emitter, points.reshape(-1, 3), resolution=resolution)
    normals = np.tile(np.float32(UP), (*points.shape[:2], 1)) if normals is None else normals
    surface = points.astype(np.float32), normals, normals
    found, doubt = kernels.soft_shadow_backproject(
        *surface, stage.origin, emitter.packed(), maps, method=method, **settings
    )
    accelerator = kernels.Accel(stage.geometry, stage.origin, stage.everything())
    flat = [array.reshape(-1, 3) for array in surface]
    truth, _ = kernels.ray_visibility(
        accelerator, stage.everything(), emitter.packed(), stage.origin, *flat, 1024, 3
    )
    return found, doubt, truth.reshape(found.shape)


def slats(height):
    return [plate(x, x + 0.06, -1.0, 1.0, height) for x in np.arange(-1.2, 1.2, 0.151)]


@pytest.mark.parametrize("method", ["bitmask", "plain"])
def test_where_the_map_errs_at_a_hard_edge_it_is_doubted(method):
    found, doubt, truth = evaluated(
        Stage([GROUND, *slats(0.4)]), SUN, ground_image(), 256, method, leave_edges=True
    )
    believed, _, _ = evaluated(Stage([GROUND, *slats(0.4)]), SUN, ground_image(), 256, method)
    # A texel is a fifth of a slat wide, and four times as wide as the sun's disk.
    assert np.abs(believed - truth).max() > 0.5
    assert set(np.unique(doubt)) == {0, 1}
    assert np.abs(found - truth)[doubt == 0].max() < 0.02
    # And believed elsewhere: in the light, in the shadow, and around all that is far from an edge.
    assert {0.0, 1.0} <= set(found[doubt == 0].tolist())
    assert (doubt != 0).mean() < 0.5


def test_edges_that_are_a_penumbra_to_the_map_are_believed():
    wide = lamp(EmitterKind.DISTANT_DISK, half=(0.05, 0.05))
    _, doubt, _ = evaluated(Stage([GROUND, *slats(1.5)]), wide, ground_image(), 256, leave_edges=True)
    assert not doubt.any()


def test_a_bent_surface_without_an_occluder_is_believed():
    # A gutter of facets, each 5 degrees from the next: they rise above each other's planes and shade nothing.
    angles = np.radians(np.linspace(-30.0, 30.0, 13))
    places = np.stack([np.sin(angles), 1.0 - np.cos(angles)], 1)
    gutter = [
        np.array([[x0, -2.0, z0], [x1, -2.0, z1], [x1, 2.0, z1], [x0, 2.0, z0]])
        for (x0, z0), (x1, z1) in itertools.pairwise(places)
    ]
    x, y = np.meshgrid(np.linspace(-0.48, 0.48, WIDTH), np.linspace(-1.0, 1.0, HEIGHT))
    points = np.stack([x, y, np.interp(x, *places.T)], -1)
    lean = np.radians(-27.5 + 5.0 * np.clip(np.searchsorted(places[:, 0], x) - 1, 0, 11))
    normals = np.stack([-np.sin(lean), np.zeros_like(x), np.cos(lean)], -1).astype(np.float32)
    _, doubt, truth = evaluated(Stage(gutter), SUN, points, 256, normals=normals, leave_edges=True)
    assert truth.min() > 0.99
    assert not doubt.any()


def test_points_a_street_apart_in_one_tile_get_what_each_gets_alone():
    """Tiles of the image hold what lies far from each other, as behind a railing: they are taken in parts."""
    rng = np.random.default_rng(2)
    near = rng.uniform(-0.1, 0.1, (HEIGHT, WIDTH, 2))
    far = rng.uniform(-5.0, 5.0, (HEIGHT, WIDTH, 2))
    across = np.where(rng.random((HEIGHT, WIDTH, 1)) < 0.5, near, far)
    points = np.concatenate([across, np.zeros((HEIGHT, WIDTH, 1))], -1)
    plates = [plate(x, x + 0.5, y, y + 0.3, 1.0 + 0.1 * x) for x, y in rng.uniform(-5.0, 5.0, (60, 2))]
    for emitter in (SUN, lamp(EmitterKind.DISTANT_DISK, half=(0.1, 0.1)), lamp(half=(0.5, 0.4))):
        fast, _, _ = evaluated(Stage([GROUND, *plates]), emitter, points, 512)
        plain, _, _ = evaluated(Stage([GROUND, *plates]), emitter, points, 512, "plain")
        assert fast.min() < 0.1
        # One sample more or less would be 1/256.
        assert np.abs(fast - plain).max() < 1e-5
