"""Where rays of shadows begin near the terminator of smooth triangles."""

from __future__ import annotations

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.surface import SurfacePoints
from strata.addon.devices.cpu import CpuRays
from strata.addon.effects.shared.visibility_truth import evaluate
from strata.tests.kernels.raster_scenes import add_triangles, down, everything
from strata.tests.kernels.ray_scenes import AXES

CORNERS = np.array([[1.0, 0.0, -3.0], [0.0, 1.0, -3.0], [-1.0, -1.0, -3.0]])
LEANING = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 2.0], [-1.0, -1.0, 2.0]])
LEANING /= np.linalg.norm(LEANING, axis=1, keepdims=True)


def lifts(corners, normals, matrix=None):
    """(h, w, 3) of a triangle seen from above, by the rasteriser."""
    geometry = kernels.Geometry()
    add_triangles(geometry, corners[None], matrix, corner_normals=np.ascontiguousarray(normals, np.float32))
    view = down((-0.7, 0.7, -0.7, 0.7)).packed()
    names = ["terminator_lift"]
    return kernels.raster_surface(geometry, everything(geometry), view, 33, 33, attributes=names)[names[0]]


def test_the_middle_of_a_dome_is_as_high_as_worked_out_by_hand():
    """The normal at a corner p is (p, 2) / |(p, 2)|. Along it the highest corner above the middle is that
    corner itself, by |p|^2 / |(p, 2)|: 1 / sqrt 5 where |p| is 1, and more where it is sqrt 2."""
    found = lifts(CORNERS, LEANING)
    sides = [(LEANING[j] - LEANING[i]) @ (CORNERS[j] - CORNERS[i]) for i, j in ((0, 1), (1, 2), (2, 0))]
    assert 0.5 * sum(sides) / 9.0 < 1.0 / np.sqrt(5.0)  # the parabola's
    assert found[16, 16] == pytest.approx(LEANING.mean(axis=0) / np.sqrt(5.0), abs=1e-6)
    assert found[..., 2].min() >= 0.0
    assert (found[0, 0] == 0.0).all()  # no surface


def test_a_dish_and_what_is_seen_from_behind():
    """Along a dish's normals other corners are highest, least by 1 / sqrt 6. The back of a surface is what
    the front of one with opposite normals is."""
    dish = LEANING * (-1, -1, 1)
    found = lifts(CORNERS, dish)
    assert found[16, 16] == pytest.approx(dish.mean(axis=0) / np.sqrt(6.0), abs=1e-6)
    assert np.allclose(lifts(CORNERS, -dish), found, atol=1e-6)


def test_order_and_flat_normals_and_matrices():
    whole = lifts(CORNERS, LEANING)
    for order in ((1, 2, 0), (2, 1, 0)):
        turned = lifts(CORNERS[list(order)], LEANING[list(order)])
        assert np.allclose(turned, whole, atol=1e-6)
    up = np.tile((0.0, 0.0, 1.0), (3, 1))
    assert np.abs(lifts(CORNERS, up)).max() < 1e-12
    # Twice as large about the eye, everything is twice as high, at the same pixels; mirrored, it is mirrored.
    double = lifts(CORNERS, LEANING, np.diag([2.0, 2.0, 2.0, 1.0]))
    assert np.allclose(double, 2.0 * whole, atol=1e-6)
    mirrored = lifts(CORNERS, LEANING, np.diag([-1.0, 1.0, 1.0, 1.0]))
    assert np.allclose(mirrored[:, ::-1] * (-1, 1, 1), whole, atol=1e-6)


LIGHTS = {
    "sun": Emitter(EmitterKind.DISTANT_DISK, (0.0, 0.0, 0.0), **AXES, half_width=0.3, half_height=0.3),
    "lamp": Emitter(EmitterKind.SPHERE, (0.0, 0.0, 2.5), **AXES, half_width=0.5, half_height=0.5),
    "panel": Emitter(EmitterKind.RECTANGLE, (0.0, 0.0, 2.0), **AXES, half_width=0.5, half_height=0.8),
    "hard sun": Emitter(EmitterKind.DISTANT_DISK, (0.0, 0.0, 0.0), **AXES, half_width=0.0, half_height=0.0),
}


def grazed(count: int, seed: int):
    """Points whose surface is about at the horizon of lights above them, and whose normals lean to those."""
    rng = np.random.default_rng(seed)
    position = np.zeros((count, 3), np.float32)
    position[:, 0], position[:, 1] = rng.uniform(-1.0, 1.0, (2, count))
    geometric = np.tile((1.0, 0.0, 0.0), (count, 1)) + rng.uniform(-0.2, 0.2, (count, 3))
    shading = geometric + rng.uniform(-0.3, 0.6, (count, 3)) * (0.0, 0.0, 1.0)
    geometric, shading = (
        (each / np.linalg.norm(each, axis=1, keepdims=True)).astype(np.float32)
        for each in (geometric, shading)
    )
    lifts = np.concatenate([0.5 * shading, rng.choice([0.0, 0.1, 0.5], (count, 1))], axis=1)
    return position, geometric, shading, lifts.astype(np.float32)


def slats_accel():
    """Blades close above the points, so that it matters where rays begin."""
    geometry = kernels.Geometry()
    x = np.linspace(-1.2, 1.5, 10)[:, None] + np.array([0.0, 0.0, 0.2])
    corners = np.stack(np.broadcast_arrays(x, [-2.0, 2.0, 0.0], [0.05, 0.1, 0.4]), axis=-1)
    add_triangles(geometry, corners)
    return kernels.Accel(geometry, np.zeros(3))


@pytest.mark.parametrize("light", LIGHTS)
def test_two_writings_of_where_rays_begin_agree(light):
    """The kernel's and the truth's, whose samples differ too."""
    emitter, accel, eye = LIGHTS[light], slats_accel(), np.zeros(3)
    position, geometric, shading, lifts = grazed(400, 3)
    found, weight = kernels.ray_visibility(
        accel, None, emitter.packed(), eye, position, geometric, shading, 1024, 3, lifts=lifts
    )
    points = SurfacePoints(position, geometric, shading, eye, lifts)
    expected = evaluate(CpuRays(accel, eye), emitter, None, points, 512, 5)[0].mean(axis=1)
    lit = weight > 0.0
    assert lit.mean() > 0.3
    # Two sets of 1024 stratified samples, of which few count where the light is low.
    share = weight / (weight + weight[lit].mean())
    assert np.sqrt(np.mean((share * (found - expected))[lit] ** 2)) < 0.006
    assert abs((share * (found - expected))[lit].mean()) < 0.001
    flat, _ = kernels.ray_visibility(
        accel, None, emitter.packed(), eye, position, geometric, shading, 1024, 3
    )
    assert np.abs(found - flat)[lit].mean() > 0.05
    assert (found == flat)[lifts[:, 3] == 0.0].all()


def test_few_rays_single_rays_and_rays_towards_a_place_begin_there_too():
    emitter, accel, eye = LIGHTS["hard sun"], slats_accel(), np.zeros(3)
    position, geometric, shading, lifts = grazed(400, 4)
    arguments = accel, None, emitter.packed(), eye, position, geometric, shading
    found, weight = kernels.ray_visibility(*arguments, 1, 3, lifts=lifts)
    lit = weight > 0.0
    assert 0.1 < found[lit].mean() < 0.9
    screened = kernels.ray_screen(*arguments, 3, lifts=lifts)
    assert (screened == found[:, None]).all()
    images = [each.reshape(20, 20, -1) for each in (position, geometric, shading)]
    towards = kernels.rays_towards(
        accel, None, -np.array(emitter.forward), True, *images, lifts.reshape(20, 20, 4)
    )
    assert (towards.ravel() == found)[lit].all()


def test_a_place_that_is_near_is_met_from_where_the_ray_begins():
    emitter = Emitter(EmitterKind.SPHERE, (0.0, 0.0, 2.5), **AXES, half_width=0.0, half_height=0.0)
    accel, eye = slats_accel(), np.zeros(3)
    position, geometric, shading, lifts = grazed(400, 5)
    found, weight = kernels.ray_visibility(
        accel, None, emitter.packed(), eye, position, geometric, shading, 1, 3, lifts=lifts
    )
    images = [each.reshape(20, 20, -1) for each in (position, geometric, shading)]
    towards = kernels.rays_towards(
        accel, None, np.array(emitter.centre), False, *images, lifts.reshape(20, 20, 4)
    )
    lit = weight > 0.0
    assert (towards.ravel() == found)[lit].mean() > 0.99


def test_lifts_of_another_shape_are_refused_and_those_that_are_no_numbers_do_nothing():
    emitter, accel, eye = LIGHTS["sun"], slats_accel(), np.zeros(3)
    position, geometric, shading, lifts = grazed(50, 6)
    arguments = accel, None, emitter.packed(), eye, position, geometric, shading
    with pytest.raises(ValueError, match=r"lifts is \(50, 4\)"):
        kernels.ray_visibility(*arguments, 16, 3, lifts=lifts[:, :3].copy())
    with pytest.raises(ValueError, match=r"lifts is \(50, 4\)"):
        kernels.ray_screen(*arguments, 3, lifts=lifts[1:])
    images = [each.reshape(5, 10, -1) for each in (position, geometric, shading)]
    with pytest.raises(ValueError, match="lifts are an image"):
        kernels.rays_towards(accel, None, np.array((0.0, 0.0, 1.0)), True, *images, lifts.reshape(10, 5, 4))
    plain, _ = kernels.ray_visibility(*arguments, 16, 3)
    lifts[:, 0] = np.nan
    assert np.array_equal(kernels.ray_visibility(*arguments, 16, 3, lifts=lifts)[0], plain)
