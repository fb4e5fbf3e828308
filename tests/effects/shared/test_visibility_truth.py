"""The reference for soft shadows against closed forms, itself and the kernels' own sampling of lights."""

import time
from dataclasses import replace

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.surface import SurfacePoints
from strata.addon.effects.shared.visibility_truth import evaluate
from strata.tests.kernels.ray_scenes import AXES, LIGHTS, PLATES
from strata.tests.support import closed_forms

EYE = np.array([2.0, 3.0, 4.0])
UP = np.array([0.0, 0.0, 1.0])


class Rays:
    """The kernels' tree over the plates; `origin` need not be the points' eye."""

    def __init__(self, origin):
        geometry = kernels.Geometry()
        geometry.add_material()
        for plate in PLATES:
            mesh = geometry.add_mesh(
                plate.astype(np.float32), np.arange(4, dtype=np.int32), np.array([0, 4], np.int32)
            )
            geometry.add_instance(mesh, np.eye(4), 0, [0])
        self.origin = np.array(origin, np.float64)
        self.accel = kernels.Accel(geometry, self.origin)

    def transmittance(self, casters, origins, directions, t_max):
        return self.accel.transmittance(casters, origins, directions, t_max)


def on_the_ground(count, seed, shading=None):
    generator = np.random.default_rng(seed)
    points = np.column_stack([generator.uniform(-1, 1, (count, 2)), np.zeros(count)])
    up = np.tile(UP, (count, 1))
    if shading:
        up = up + generator.uniform(-shading, shading, (count, 3)) * [1, 1, 0]
        up /= np.linalg.norm(up, axis=1)[:, None]
    geometric = np.tile(UP, (count, 1)).astype(np.float32)
    return points, up, SurfacePoints((points - EYE).astype(np.float32), geometric, up.astype(np.float32), EYE)


@pytest.mark.parametrize("light", LIGHTS, ids=lambda light: light.kind.name)
def test_visibility_of_two_plates_is_the_closed_form(light):
    points, up, surface = on_the_ground(500, 1, shading=0.6)
    expected, irradiance = closed_forms.visibility(light, points, up, PLATES)
    halves, weight = evaluate(Rays([0, 0, 1]), light, None, surface, 256, 5)
    error = halves.mean(1) - expected
    noise = 0.5 * np.sqrt(np.mean((halves[:, 0] - halves[:, 1]) ** 2))
    assert 1e-4 < noise < 0.01
    # The halves' own difference says how wrong they are: so the noise can be subtracted.
    assert np.sqrt(np.mean(error**2)) == pytest.approx(noise, rel=0.15)
    assert abs(error.mean()) < 4 * noise / np.sqrt(len(points))
    np.testing.assert_allclose(weight, irradiance, rtol=0.02)  # 512 stratified samples a point
    np.testing.assert_allclose(weight.mean(), irradiance.mean(), rtol=3e-4)


@pytest.mark.parametrize(
    "light",
    [
        replace(LIGHTS[0], tan_half_spread=0.3),
        replace(LIGHTS[1], tan_half_spread=0.3),
        replace(LIGHTS[2], cos_cone=0.96, blend=0.4),
        Emitter(EmitterKind.SPHERE, (0, 0, 0.4), **AXES, half_width=1.0, half_height=1.0),
        Emitter(EmitterKind.SPHERE, (0, 0, 3), **AXES, half_width=0.0, half_height=0.0),
        Emitter(EmitterKind.RECTANGLE, (0, 0, 3), **AXES, half_width=0.75, half_height=0.0),
        Emitter(EmitterKind.DISTANT_DISK, (0, 0, 0), **AXES, half_width=0.0, half_height=0.0),
    ],
    ids=["spread", "ellipse spread", "spot", "inside", "point", "line", "directional"],
)
def test_two_samplers_written_apart_agree(light):
    """What has no closed form: the kernels' samples and the reference's must converge to the same."""
    _, _, surface = on_the_ground(400, 2)
    halves, weight = evaluate(Rays([0, 0, 1]), light, None, surface, 400, 5)
    kernel_v, kernel_weight = kernels.ray_visibility(
        Rays(EYE).accel, None, light.packed(), EYE, surface.position, surface.geometric_normal,
        surface.shading_normal, 1024, 3,
    )  # fmt: skip
    assert (weight > 0).mean() > 0.1
    scale = weight.mean()
    np.testing.assert_allclose(weight.mean(), kernel_weight.mean(), rtol=1e-3)
    np.testing.assert_allclose(weight, kernel_weight, atol=0.06 * scale)  # 800 samples a point
    share = weight / weight.sum()
    assert np.sqrt(np.sum(share * (halves.mean(1) - kernel_v) ** 2)) < 0.012
    assert abs(np.sum(share * (halves.mean(1) - kernel_v))) < 0.002


def test_casters_and_odd_points():
    light = LIGHTS[0]
    points = np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 5], [0, 0, 0]])
    geometric = np.array([UP, UP, UP, -UP], np.float32)
    position = (points - EYE).astype(np.float32)
    position[1] = np.nan
    surface = SurfacePoints(position, geometric, np.tile(UP, (4, 1)).astype(np.float32), EYE)
    halves, weight = evaluate(Rays(EYE), light, None, surface)
    assert np.all(halves[0] < 0.5)
    assert np.all(halves[1:3] == 1)  # a miss, and a point behind the light
    assert np.all(weight[1:3] == 0)
    assert np.all(halves[3] == 0)  # below the geometric horizon
    assert weight[3] > 0
    free, _ = evaluate(Rays(EYE), light, np.zeros(2, np.uint8), surface)
    assert np.all(free[:3] == 1)


def test_the_same_seed_gives_the_same_numbers():
    _, _, surface = on_the_ground(300, 3)
    first, second, other = (evaluate(Rays(EYE), LIGHTS[2], None, surface, 36, s)[0] for s in (1, 1, 2))
    np.testing.assert_array_equal(first, second)
    assert (first != other).any()
    assert (first[:, 0] != first[:, 1]).any()


def test_two_thousand_probes_take_less_than_a_second():
    _, _, surface = on_the_ground(2048, 4)
    rays, light = Rays(EYE), LIGHTS[0]
    seconds = []
    for _ in range(3):
        started = time.process_time()  # of both threads: the machine's other work does not count
        evaluate(rays, light, None, surface)
        seconds.append(time.process_time() - started)
    assert min(seconds) < 1.0
