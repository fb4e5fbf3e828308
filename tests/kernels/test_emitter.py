"""Samples of lights in the kernels, against the formulas of addon/core/emitter.py and against quadrature."""

import math

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.emitter import Emitter, EmitterKind

AXES = {"right": (0.6, 0.0, 0.8), "up": (0.0, 1.0, 0.0), "forward": (0.8, 0.0, -0.6)}


def grid(count):
    line = (np.arange(count) + 0.5) / count
    u, v = np.meshgrid(line, line)
    return u.ravel().astype(np.float32), v.ravel().astype(np.float32)


def samples_at(emitter, point, normal, count=64):
    u, v = grid(count)
    points = np.tile(np.asarray(point, np.float64), (len(u), 1))
    normals = np.tile(np.asarray(normal, np.float32), (len(u), 1))
    return kernels.sample_emitter(emitter.packed(), points, normals, u, v)


def radiance(emitter, d):
    """Relative radiance for directions (N, 3) to the light: the docstring of Emitter, word by word."""
    cosine = -d @ np.array(emitter.forward)
    a = np.arccos(np.clip(cosine, -1, 1))
    result = np.ones(len(d))
    tangent = emitter.tan_half_spread
    if math.isfinite(tangent):
        slope = np.where(a < np.pi / 2, np.tan(a), np.inf)
        result *= np.maximum(tangent - slope, 0) / (tangent - math.atan(tangent))
    if emitter.cos_cone > -1:
        x = np.clip((cosine - emitter.cos_cone) / ((1 - emitter.cos_cone) * emitter.blend), 0, 1)
        result *= x * x * (3 - 2 * x)
    return result


@pytest.mark.parametrize("tan_half_spread", [math.inf, 1.5, 0.4])
@pytest.mark.parametrize("kind", [EmitterKind.RECTANGLE, EmitterKind.ELLIPSE])
def test_area_light(kind, tan_half_spread):
    centre, half = np.array([-2.0, 0.3, 1.5]), np.array([0.7, 0.4])
    emitter = Emitter(kind, tuple(centre), **AXES, half_width=half[0], half_height=half[1],
                      tan_half_spread=tan_half_spread)  # fmt: skip
    point, normal = np.array([0.2, 0.1, 0.0]), np.array([-0.6, 0.0, 0.8])
    d, distance, weight = samples_at(emitter, point, normal)
    # Every sample lies on the light ...
    plan = (point + d * distance[:, None] - centre) @ np.array([AXES["right"], AXES["up"], AXES["forward"]]).T
    np.testing.assert_allclose(plan[:, 2], 0, atol=1e-6)
    share = plan[:, :2] / half
    counts = weight > 0
    assert counts.mean() > 0.4  # sampling is narrowed to where spread lets light through
    if kind == EmitterKind.RECTANGLE:
        assert np.all(np.abs(share[counts]) <= 1 + 1e-6)
    else:
        assert np.all(np.square(share[counts]).sum(1) <= 1 + 1e-5)
    # ... and the weights' mean is the integral of L cos cos / d^2, here a finer sum over its plane.
    line = (np.arange(1000) + 0.5) / 500 - 1
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    spoke = centre - point + np.outer(x * half[0], AXES["right"]) + np.outer(y * half[1], AXES["up"])
    square = np.square(spoke).sum(1)
    to_light = spoke / np.sqrt(square)[:, None]
    value = np.maximum(to_light @ normal, 0) * np.maximum(-to_light @ np.array(AXES["forward"]), 0) / square
    value *= radiance(emitter, to_light)
    if kind == EmitterKind.ELLIPSE:
        value *= x * x + y * y <= 1
    expected = value.sum() * 4 * half.prod() / len(x)
    # Midpoint sums over 64 x 64 cells; a clipped ellipse's rim falls between them.
    np.testing.assert_allclose(weight.mean(), expected, rtol=3e-3 if math.isfinite(tan_half_spread) else 3e-4)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, rtol=1e-6)


@pytest.mark.parametrize(
    ("radius", "centre"),
    [(0.5, (0.6, 0.2, 2.0)), (1e-4, (0.6, 0.2, 2.0)), (1.9, (0.6, 0.2, 2.0)), (0.5, (0, 0, 3e5))],
)
def test_sphere_seen_from_outside(radius, centre):
    emitter = Emitter(EmitterKind.SPHERE, centre, **AXES, half_width=radius, half_height=radius)
    d, distance, weight = samples_at(emitter, (0, 0, 0), (0, 0, 1))
    far = np.linalg.norm(centre)
    hit = d.astype(np.float64) * distance[:, None] - centre
    # On the surface, to float32's rounding of the distance, and on the near side.
    np.testing.assert_allclose(np.linalg.norm(hit, axis=1), radius, atol=3e-7 * far + 1e-6)
    if radius > 1e-3 * far:
        assert np.all(np.einsum("nc,nc->n", hit, d) <= 1e-4 * radius)
    # pi r^2 / d^2 cos, if all of it is above the horizon.
    if centre[2] > radius:
        expected = np.pi * (radius / far) ** 2 * centre[2] / far
        np.testing.assert_allclose(weight.mean(), expected, rtol=3e-4)


def test_sphere_seen_from_inside_shines_from_everywhere():
    emitter = Emitter(EmitterKind.SPHERE, (0.2, 0, 0.1), **AXES, half_width=1.0, half_height=1.0)
    d, distance, weight = samples_at(emitter, (0, 0, 0), (0, 0, 1))
    np.testing.assert_allclose(np.linalg.norm(d * distance[:, None] - [0.2, 0, 0.1], axis=1), 1, rtol=1e-5)
    np.testing.assert_allclose(d.mean(0), 0, atol=1e-3)
    np.testing.assert_allclose(weight.mean(), np.pi, rtol=1e-3)  # a hemisphere of radiance 1


def test_facing_disk_turns_to_the_point():
    emitter = Emitter(EmitterKind.FACING_DISK, (1, 2, 2), **AXES, half_width=0.8, half_height=0.8)
    d, distance, weight = samples_at(emitter, (0, 0, 0), (0, 0, 1))
    hit = d * distance[:, None]
    axis = np.array([1, 2, 2]) / 3
    np.testing.assert_allclose(hit @ axis, 3, rtol=1e-5)
    assert np.linalg.norm(hit - 3 * axis, axis=1).max() <= 0.8 + 1e-5
    # A cone of half angle atan(r / d): pi sin^2 times the cosine of its axis.
    np.testing.assert_allclose(weight.mean(), np.pi * 0.64 / 9.64 * 2 / 3, rtol=3e-4)


def test_distant_disk_has_uniform_radiance_over_its_directions():
    emitter = Emitter(EmitterKind.DISTANT_DISK, (5, 5, 5), **AXES, half_width=0.4, half_height=0.4)
    d, distance, weight = samples_at(emitter, (1e6, 0, 0), (-0.8, 0, 0.6))
    assert np.all(distance > 1e30)
    cosine = -d @ np.array(AXES["forward"])
    assert cosine.min() >= np.cos(np.arctan(0.4)) - 1e-6
    np.testing.assert_allclose(weight.mean(), np.pi * 0.16 / 1.16, rtol=3e-4)  # pi sin^2 of the half angle


@pytest.mark.parametrize(("cone", "blend"), [(30.0, 0.15), (30.0, 0.0), (0.5, 1.0)])
def test_spot(cone, blend):
    cosine = math.cos(math.radians(cone))
    emitter = Emitter(EmitterKind.SPHERE, (0, 0, 4), (1, 0, 0), (0, 1, 0), (0, 0, -1), 0.0, 0.0,
                      cos_cone=cosine, blend=blend)  # fmt: skip
    angle = np.radians(np.linspace(0, 1.2 * cone, 200))
    points = np.stack([4 * np.tan(angle), 0 * angle, 0 * angle], 1)
    normals = np.tile(np.array([0, 0, 1], np.float32), (200, 1))
    half = np.full(200, 0.5, np.float32)
    _, distance, weight = kernels.sample_emitter(emitter.packed(), points, normals, half, half)
    x = np.clip((np.cos(angle) - cosine) / max((1 - cosine) * blend, 1e-12), 0, 1)
    expected = x * x * (3 - 2 * x) * np.cos(angle) / distance**2
    away = np.abs(angle - math.radians(cone)) > 1e-6
    np.testing.assert_allclose(weight[away], expected[away], atol=2e-4 / 16)


@pytest.mark.parametrize("kind", list(EmitterKind))
@pytest.mark.parametrize(
    "point",
    [
        (0, 0, 1),
        (0, 0, 1 - 1e-7),
        (0, 0, 1 + 1e-30),
        (1e30, 0, 0),
        (0, 0, -1e-30),
        (1e7, 1e7, 1e7),
        (0, 0, 2),
    ],
)
def test_no_point_makes_anything_but_numbers(kind, point):
    for size in (0.0, 1e-9, 1.0, 1e9):
        for spread in (math.inf, 0.0, 1e-6, 1.0):
            emitter = Emitter(kind, (0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, -1), size, size, spread, 0.5, 0.0)
            d, distance, weight = samples_at(emitter, point, (0, 0, 1), 4)
            assert not np.isnan(d).any()
            assert not np.isnan(distance).any()
            assert np.isfinite(weight).all()
            assert np.all(weight >= 0)


def test_a_line_is_sampled_along_its_length():
    emitter = Emitter(EmitterKind.RECTANGLE, (0, 0, 2), (1, 0, 0), (0, 1, 0), (0, 0, -1), 1.0, 0.0)
    d, distance, weight = samples_at(emitter, (0, 0, 0), (0, 0, 1))
    hit = d * distance[:, None]
    np.testing.assert_allclose(hit[:, 1], 0, atol=1e-7)
    assert np.ptp(hit[:, 0]) > 1.9
    # The integral of z^2 / d^4 along the line, a length of one across: 2 * int_0^1 4 / (4 + x^2)^2 dx.
    expected = 2 * (0.5 * (1 / 5 + 0.5 * math.atan(0.5)))
    np.testing.assert_allclose(weight.mean(), expected, rtol=3e-4)


SPOTS = [
    # kind, radius, metres away, degrees from the axis, half the cone's, blend
    (EmitterKind.FACING_DISK, 0.6, 4.0, 0.0, 22.5, 0.15),
    (EmitterKind.FACING_DISK, 0.6, 4.0, 21.0, 22.5, 0.15),
    (EmitterKind.FACING_DISK, 0.6, 4.0, 28.0, 22.5, 0.15),
    (EmitterKind.FACING_DISK, 1.0, 1.0, 40.0, 10.0, 1.0),
    (EmitterKind.FACING_DISK, 1.0, 1.0, 0.0, 5.0, 1e-3),
    (EmitterKind.FACING_DISK, 1.0, 0.5, 80.0, 90.0, 0.5),
    (EmitterKind.FACING_DISK, 1.0, 0.2, 100.0, 60.0, 0.3),
    (EmitterKind.FACING_DISK, 1.0, 1.0, 100.0, 85.0, 0.3),
    (EmitterKind.SPHERE, 0.6, 4.0, 28.0, 22.5, 0.15),
    (EmitterKind.SPHERE, 1.0, 1.2, 0.0, 5.0, 1e-3),
    (EmitterKind.SPHERE, 1.0, 1.2, 50.0, 20.0, 0.3),
    (EmitterKind.SPHERE, 1.0, 1.2, 100.0, 60.0, 0.3),
    (EmitterKind.SPHERE, 1.0, 0.5, 100.0, 60.0, 0.3),
    (EmitterKind.SPHERE, 1.0, 0.5, 30.0, 10.0, 0.3),
]


@pytest.mark.parametrize(("kind", "radius", "away", "angle", "cone", "blend"), SPOTS)
def test_of_a_spot_only_what_shines_on_the_point_is_sampled(kind, radius, away, angle, cone, blend):
    """And the weights' mean is the integral over all of the disk or sphere, by a million samples of it."""
    angle, cone = math.radians(angle), math.radians(cone)
    forward = np.array([0.48, -0.6, -0.64])
    aside = np.cross(forward, [0.0, 0.0, 1.0])
    aside /= np.linalg.norm(aside)
    centre = np.array([0.3, -0.2, 1.0])
    emitter = Emitter(kind, tuple(centre), (1, 0, 0), (0, 1, 0), tuple(forward), half_width=radius,
                      half_height=radius, cos_cone=math.cos(cone), blend=blend)  # fmt: skip
    point = centre + away * (math.cos(angle) * forward + math.sin(angle) * aside)
    normal = (centre - point) / away
    *_, weight = samples_at(emitter, point, normal, count=128)
    generator = np.random.default_rng(1)
    count = 1 << 20
    if kind == EmitterKind.FACING_DISK:
        r, phi = radius * np.sqrt(generator.random(count)), math.tau * generator.random(count)
        first = np.cross(normal, [1.0, 0.0, 0.0])
        first /= np.linalg.norm(first)
        place = centre + np.outer(r * np.cos(phi), first) + np.outer(r * np.sin(phi), np.cross(normal, first))
        spoke = place - point
        far = np.linalg.norm(spoke, axis=1)
        to_light = spoke / far[:, None]
        value = np.maximum(to_light @ normal, 0) ** 2 / far**2 * np.pi * radius**2
    else:
        to_light = generator.normal(size=(count, 3))
        to_light /= np.linalg.norm(to_light, axis=1)[:, None]
        cosine = to_light @ normal
        hits = (cosine >= math.sqrt(max(1.0 - (radius / away) ** 2, 0.0))) | (away < radius)
        value = np.where(hits, np.maximum(cosine, 0.0) * 4.0 * np.pi, 0.0)
    value *= radiance(emitter, to_light)
    expected, noise = value.mean(), value.std() / math.sqrt(count)
    assert expected > 0.0
    # A hard rim crosses the cells of samples: their whole row at a time.
    assert abs(weight.mean() - expected) < 4.0 * noise + (0.02 if blend < 0.01 else 0.005) * expected
    assert (weight > 0.0).mean() > 0.2
