"""The closed forms against plain quadrature and against textbook formulas."""

import numpy as np
import pytest
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.tests.support import closed_forms

AXES = {"right": (1.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0), "forward": (0.0, 0.0, -1.0)}
EMITTERS = [
    Emitter(EmitterKind.RECTANGLE, (0, 0, 3), **AXES, half_width=0.8, half_height=0.5),
    Emitter(EmitterKind.ELLIPSE, (0, 0, 3), **AXES, half_width=0.8, half_height=0.5),
    Emitter(EmitterKind.SPHERE, (0, 0, 3), **AXES, half_width=0.8, half_height=0.8),
    Emitter(EmitterKind.FACING_DISK, (0, 0, 3), **AXES, half_width=0.8, half_height=0.8),
    Emitter(EmitterKind.DISTANT_DISK, (0, 0, 0), **AXES, half_width=0.3, half_height=0.3),
]
PLATES = [
    np.array([[-0.1, -0.2, 1.0], [0.5, -0.2, 1.0], [0.5, 0.4, 1.1], [-0.1, 0.4, 1.1]]),
    np.array([[-0.4, -0.1, 1.6], [0.4, -0.1, 1.6], [0.1, 0.7, 1.6]]),
]


def by_quadrature(emitter, point, normal, plates, count=250):
    """V and E by the midpoint rule on the light's own plane, or on the tangent plane of its directions."""
    line = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    weight = np.ones_like(x) if emitter.kind == EmitterKind.RECTANGLE else (x * x + y * y < 1.0) * 1.0
    right, up, forward = (np.array(v) for v in (emitter.right, emitter.up, emitter.forward))
    to_centre = np.array(emitter.centre) - point
    if emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
        spoke = to_centre + x[:, None] * emitter.half_width * right + y[:, None] * emitter.half_height * up
        square = np.einsum("nc,nc->n", spoke, spoke)
        d = spoke / np.sqrt(square)[:, None]
        weight *= np.maximum(-d @ forward, 0.0) / square * 4.0 * emitter.half_width * emitter.half_height
    else:
        axis, slope = -forward, emitter.half_width
        if emitter.kind != EmitterKind.DISTANT_DISK:
            distance = np.linalg.norm(to_centre)
            sphere = emitter.half_width**2 if emitter.kind == EmitterKind.SPHERE else 0.0
            axis, slope = to_centre / distance, emitter.half_width / np.sqrt(distance**2 - sphere)
        a = np.cross(axis, [0.3, 0.5, 0.7])
        a /= np.linalg.norm(a)
        d = axis + slope * (x[:, None] * a + y[:, None] * np.cross(axis, a))
        length = np.linalg.norm(d, axis=1)
        d /= length[:, None]
        weight *= 4.0 * slope**2 / length**3
    weight *= np.maximum(d @ normal, 0.0) / count**2
    visible = np.ones(len(d), bool)
    for plate in plates:
        edges, face = np.roll(plate, -1, 0) - plate, np.cross(plate[1] - plate[0], plate[2] - plate[0])
        hit = point + d * (((plate[0] - point) @ face) / (d @ face))[:, None]
        sides = np.array([np.cross(e, hit - p) @ face for e, p in zip(edges, plate, strict=True)])
        visible &= ~(np.all(sides >= 0.0, 0) | np.all(sides <= 0.0, 0))
    return (weight * visible).sum() / weight.sum(), weight.sum()


@pytest.mark.parametrize("emitter", EMITTERS, ids=lambda e: e.kind.name)
def test_visibility_behind_two_overlapping_plates(emitter):
    generator = np.random.default_rng(1)
    points = np.column_stack([generator.uniform(-1.0, 1.0, (8, 2)), np.zeros(8)])
    normals = np.array([0.0, 0.0, 1.2]) + generator.uniform(-1.0, 1.0, (8, 3))  # some see part of the light
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    v, e = closed_forms.visibility(emitter, points, normals, PLATES)
    expected = np.array([by_quadrature(emitter, p, n, PLATES) for p, n in zip(points, normals, strict=True)])
    # The quadrature places the plates' edges to within a cell, 1/250 of the light's width.
    np.testing.assert_allclose(v, expected[:, 0], atol=4e-3)
    np.testing.assert_allclose(e, expected[:, 1], rtol=2e-3)
    assert np.ptp(v) > 0.3


def test_unshadowed_irradiance_is_the_textbooks():
    up = [[0.0, 0.0, 1.0]]
    ellipse = Emitter(EmitterKind.ELLIPSE, (0.7, 0, 2), **AXES, half_width=0.8, half_height=0.8)
    _, e = closed_forms.visibility(ellipse, [[0.0, 0.0, 0.0]], up)
    np.testing.assert_allclose(e, closed_forms.irradiance_of_parallel_disk(2.0, 0.7, 0.8), rtol=1e-8)
    sphere = Emitter(EmitterKind.SPHERE, (0.7, 0, 2), **AXES, half_width=0.8, half_height=0.8)
    _, e = closed_forms.visibility(sphere, [[0.0, 0.0, 0.0]], up)
    distance = np.hypot(0.7, 2.0)
    np.testing.assert_allclose(
        e, closed_forms.irradiance_of_sphere(distance, 2.0 / distance, 0.8), rtol=1e-12
    )


def test_small_sun_over_an_edge():
    """A plate that ends at x = 0, one metre up, wide enough to be a half-plane."""
    sun = Emitter(EmitterKind.DISTANT_DISK, (0, 0, 0), **AXES, half_width=0.005, half_height=0.005)
    plate = np.array([[0, -50, 1], [50, -50, 1], [50, 50, 1], [0, 50, 1]], np.float64)
    x = np.linspace(-0.006, 0.006, 25)
    points = np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
    v, _ = closed_forms.visibility(sun, points, np.tile([0.0, 0.0, 1.0], (25, 1)), [plate])
    # Tilting the sun's disk by 0.005 rad changes cosines by a square of that.
    np.testing.assert_allclose(v, closed_forms.disk_share_beyond_edge(x / 0.005), atol=1e-4)


def test_a_plate_that_just_covers_the_light_leaves_nothing():
    """Edges of plate and light coincide as seen from the point: the common planes must count once."""
    light = Emitter(EmitterKind.RECTANGLE, (0, 0, 2), **AXES, half_width=1.0, half_height=1.0)
    plate = np.array([[-0.5, -0.5, 1], [0.5, -0.5, 1], [0.5, 0.5, 1], [-0.5, 0.5, 1]], np.float64)
    v, _ = closed_forms.visibility(light, [[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [plate])
    np.testing.assert_allclose(v, 0.0, atol=1e-12)
