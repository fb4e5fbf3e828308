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

    def __init__(self, origin, aside=(0.0, 0.0, 0.0)):
        geometry = kernels.Geometry()
        geometry.add_material()
        for plate in PLATES:
            mesh = geometry.add_mesh(
                (plate + aside).astype(np.float32), np.arange(4, dtype=np.int32), np.array([0, 4], np.int32)
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


@pytest.mark.parametrize("kind", [EmitterKind.FACING_DISK, EmitterKind.SPHERE])
def test_few_rays_to_a_wide_spot_are_right_at_its_rim(kind):
    """By the truth and by the kernel: rays that miss the sliver of a lamp that shines on a point know nothing
    of its visibility. Against very many, none of which is aimed."""
    radius, centre, cone = 0.8, np.array([0.0, 0.0, 3.0]), 0.35
    light = Emitter(kind, tuple(centre), (1, 0, 0), (0, 1, 0), (0, 0, -1), half_width=radius,
                    half_height=radius, cos_cone=np.cos(cone), blend=0.3)  # fmt: skip
    across = 3.0 * np.tan(cone)
    x = np.linspace(across, across + 0.5, 64)
    points = np.column_stack([x, 0.3 * np.sin(40.0 * x), np.zeros(64)])
    up = np.tile(UP, (64, 1)).astype(np.float32)
    surface = SurfacePoints((points - EYE).astype(np.float32), up, up, EYE)
    rays, generator = Rays([0, 0, 1], (0.5, 0.0, 0.0)), np.random.default_rng(3)
    plain, count = np.zeros((64, 2)), 1 << 15
    for number, point in enumerate(points):
        towards = (centre - point) / np.linalg.norm(centre - point)
        first = np.cross(towards, [0.0, 1.0, 0.0])
        first /= np.linalg.norm(first)
        second = np.cross(towards, first)
        far = np.linalg.norm(centre - point)
        if kind == EmitterKind.FACING_DISK:
            r, phi = radius * np.sqrt(generator.random(count)), 2.0 * np.pi * generator.random(count)
            spoke = centre - point + np.outer(r * np.cos(phi), first) + np.outer(r * np.sin(phi), second)
            reach = np.linalg.norm(spoke, axis=1)
            direction = spoke / reach[:, None]
            weight = direction @ towards / reach**2
        else:
            cosine = 1.0 - generator.random(count) * (1.0 - np.sqrt(1.0 - (radius / far) ** 2))
            phi, sine = 2.0 * np.pi * generator.random(count), np.sqrt(1.0 - cosine**2)
            direction = np.outer(cosine, towards) + np.outer(sine * np.cos(phi), first)
            direction += np.outer(sine * np.sin(phi), second)
            weight, reach = np.ones(count), np.full(count, far - radius)
        edge = np.clip((direction[:, 2] - np.cos(cone)) / ((1.0 - np.cos(cone)) * 0.3), 0.0, 1.0)
        weight = weight * direction[:, 2] * edge * edge * (3.0 - 2.0 * edge)
        origins = np.tile((point - rays.origin).astype(np.float32), (count, 1))
        through = rays.transmittance(None, origins, direction.astype(np.float32), reach.astype(np.float32))
        plain[number] = (weight * through).sum(), weight.sum()
    whole = plain[:, 1].sum()
    expected = plain[:, 0] / np.maximum(plain[:, 1], 1e-12)
    assert 0.1 < plain[:, 0].sum() / whole < 0.9
    halves, _ = evaluate(rays, light, None, surface, 4, 5)
    number = np.arange(64, dtype=np.uint32)
    traced = np.mean(
        [
            kernels.ray_visibility(
                rays.accel, None, light.packed(), EYE, surface.position, up, up, 4, seed, number
            )[0]
            for seed in range(64)
        ],
        axis=0,
    )
    lit = plain[:, 1] > 1e-4 * plain[:, 1].max()
    for found, noise in ((halves.mean(axis=1), 0.25), (traced, 0.1)):
        off = (plain[:, 1] * (found - expected))[lit]
        assert abs(off.sum()) / whole < 0.05  # a ratio of four rays has some bias; unaimed .2 and more
        assert np.abs(found - expected)[lit].mean() < noise
