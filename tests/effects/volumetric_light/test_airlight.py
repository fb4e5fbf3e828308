"""The airlight integral against closed forms and against forty digits; its shadows against marching."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import strata_kernels
from strata.addon.core.view import View
from strata.addon.effects.volumetric_light.lattice import Lattice
from strata.tests.effects.volumetric_light import airlight_truth as truth
from strata.tests.effects.volumetric_light.airlight_scenes import (
    along_y,
    exactly_along_y,
    lattice,
    map_from_above,
    medium,
    source,
)

ISOTROPIC = 1.0 / (4.0 * math.pi)
STIFF = 1e-3  # what the issue of stiff media allows; the formulas do better by far
SINGLE = 1e-5  # rounding of a few dozen single precision operations

# (distance of the ray from the light, metres before it, ray's length, extinction, anisotropy, radius)
STIFF_CASES = [
    (2.0, 3.0, 10.0, 1e-9, 0.0, 0.0),
    (2.0, 3.0, 10.0, 1e-8, 0.0, 0.1),
    (2.0, 3.0, 10.0, 0.1, 0.0, 0.0),
    (2.0, 3.0, 10.0, 10.0, 0.5, 0.1),
    (0.5, 0.2, 10.0, 100.0, 0.0, 0.1),
    (1e-4, 1e-4, 10.0, 1e4, 0.0, 0.0),
    (1e-5, -1e-5, 10.0, 1e4, 0.9, 0.0),
    (1.0, 5.0, 20.0, 0.5, 0.9999, 0.0),
    (1.0, 5.0, 20.0, 0.5, -0.9999, 0.0),
    (1e-3, 5.0, 20.0, 0.5, 0.9999, 0.0),
    (1e-3, 5.0, 20.0, 0.5, -0.9999, 0.1),
    (1e-6, 5.0, 20.0, 0.5, 0.0, 0.1),
    (1e-6, 5.0, 20.0, 0.5, 0.9999, 0.1),
    (1e-6, 5.0, 4.0, 0.5, 0.0, 0.0),
    (50.0, -100.0, 1e4, 1e-3, -0.5, 1.0),
]


@pytest.mark.parametrize("case", STIFF_CASES)
@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
def test_point_light_against_forty_digits(case, single):
    height, before, length, extinction, anisotropy, radius = case
    scattering = extinction or 1.0
    exact = float(truth.point(height, -before, length - before, extinction, anisotropy, radius)) * scattering
    evaluate = along_y if single else exactly_along_y
    value = evaluate(
        (height, -before, 0.0), length, medium(scattering, extinction, anisotropy), source(radius=radius)
    )
    assert np.isfinite(value).all()
    if exact < 1e-37:  # below single precision
        assert (np.abs(value) <= 1e-37).all()
    else:
        # Single precision knows the ray's place to 2^-24 of its origin's distance from the light.
        place = 2e-7 * math.hypot(before, height) / height if single and anisotropy else 0.0
        assert value == pytest.approx(exact, rel=min(max(2e-5, 4.0 * place), STIFF) if single else 1e-6)


def test_channels_whose_extinctions_differ_by_a_million():
    sigma = [1e-3, 1.0, 1e3]
    value = exactly_along_y((0.5, -0.3, 0.0), 8.0, medium(1.0, np.maximum(sigma, 1.0)), source())
    single = along_y((0.5, -0.3, 0.0), 8.0, medium([1e-3, 1.0, 1e3], sigma), source())
    assert np.isfinite(value).all()
    for channel, extinction in enumerate(sigma):
        exact = float(truth.point(0.5, -0.3, 7.7, extinction, 0.0, 0.0)) * sigma[channel]
        assert single[channel] == pytest.approx(exact, rel=2e-5)


@pytest.mark.parametrize("extinction", [1e-10, 1e-8, 1e-4, 0.1, 10.0, 1e4])
@pytest.mark.parametrize("length", [1e-2, 10.0])
def test_sun_against_forty_digits(extinction, length):
    exact = float(truth.sun(length, extinction)) * extinction * ISOTROPIC
    a_medium, a_source = medium(extinction, extinction), source(0, axis=(0.6, 0.0, -0.8))
    assert exactly_along_y((0, 0, 0), length, a_medium, a_source) == pytest.approx(exact, rel=1e-14)
    assert along_y((0, 0, 0), length, a_medium, a_source) == pytest.approx(exact, rel=SINGLE)


@pytest.mark.parametrize("anisotropy", [0.9999, -0.9999, 0.3])
def test_sun_straight_ahead_and_behind(anisotropy):
    """Where the phase function's peak and trough are: (1 -+ g) to the third."""
    for axis, cosine in (((0, -1, 0), 1.0), ((0, 1, 0), -1.0)):
        square = (1.0 - anisotropy * cosine) ** 2
        phase = (1.0 - anisotropy**2) * ISOTROPIC / square**1.5
        value = along_y((0, 0, 0), 3.0, medium(0.1, 0.1, anisotropy), source(0, axis=axis))
        assert value == pytest.approx(phase * -math.expm1(-0.3), rel=2e-5)


def test_point_light_without_extinction_in_closed_form():
    """1 / (4 pi h) times the angle that the stretch takes at the light."""
    for height, before, length in ((1.0, 2.0, 5.0), (0.01, 2.0, 5.0), (30.0, -1.0, 2.0)):
        angle = math.atan((length - before) / height) - math.atan(-before / height)
        value = exactly_along_y((height, -before, 0.0), length, medium(1.0, 1.0 + 1e-15), source())
        thin = exactly_along_y((height, -before, 0.0), length, medium(1e-12, 1e-12), source()) * 1e12
        assert np.isfinite(value).all()
        assert thin == pytest.approx(ISOTROPIC * angle / height, rel=1e-7)


def test_spot_against_a_plain_sum():
    """Cone and blend, by a sum over a hundred thousand points."""
    eye, axis = np.array([1.5, -4.0, -2.0]), np.array([0.2, 0.1, -1.0])
    axis /= np.linalg.norm(axis)
    t = (np.arange(200_000) + 0.5) * 9.0 / 200_000
    points = eye + t[:, None] * [0.0, 1.0, 0.0]
    away = np.linalg.norm(points, axis=1)
    cosine = points @ axis / away
    for cone, blend in ((math.cos(0.7), 0.3), (math.cos(0.7), 0.0), (math.cos(0.7), 1.0)):
        x = np.clip((cosine - cone) / max((1.0 - cone) * blend, 1e-12), 0.0, 1.0)
        light = ISOTROPIC * x * x * (3.0 - 2.0 * x) / away**2 * np.exp(-0.2 * (t + away)) * 0.1
        exact = light.sum() * 9.0 / len(t)
        a_source = source(2, axis=axis, cos_cone=cone, blend=blend)
        # The sum itself is off by a step at a hard edge.
        assert exactly_along_y(eye, 9.0, medium(0.1, 0.2), a_source) == pytest.approx(exact, rel=1e-4)
        assert along_y(eye, 9.0, medium(0.1, 0.2), a_source) == pytest.approx(exact, rel=2e-4)


@pytest.mark.parametrize("spread", [np.inf, 1.2])
def test_area_light_against_a_plain_sum(spread):
    eye = np.array([1.0, -4.0, -2.0])
    t = (np.arange(200_000) + 0.5) * 9.0 / 200_000
    points = eye + t[:, None] * [0.0, 1.0, 0.0]
    away = np.linalg.norm(points, axis=1)
    cosine = np.maximum(-points[:, 2] / away, 0.0)
    light = cosine / away**2
    if np.isfinite(spread):
        slope = np.linalg.norm(points[:, :2], axis=1) / -points[:, 2]
        light *= np.maximum(spread - slope, 0.0) / (spread - math.atan(spread))
    exact = (light * np.exp(-0.2 * (t + away))).sum() * 9.0 / len(t) * 0.1 * ISOTROPIC
    for evaluate in (exactly_along_y, along_y):
        value = evaluate(eye, 9.0, medium(0.1, 0.2), source(3, spread=spread))
        assert value == pytest.approx(exact, rel=1e-4)


def test_furnace():
    """In light that comes evenly from everywhere, what gets through, is taken and is scattered adds up to
    what there was. Suns all around, 4 pi in all, scatter what the ray loses by scattering."""
    scattering, absorption, length = np.array([0.3, 0.02, 5.0]), np.array([0.1, 0.0, 1.0]), 4.0
    extinction = scattering + absorption
    heights = 1.0 - 2.0 * (np.arange(400) + 0.5) / 400
    turns = np.pi * (1.0 + math.sqrt(5.0)) * np.arange(400)
    across = np.sqrt(1.0 - heights**2)
    axes = np.stack([across * np.cos(turns), across * np.sin(turns), heights], 1)
    a_medium = medium(scattering, extinction, 0.4)
    gained = sum(exactly_along_y((0, 0, 0), length, a_medium, source(0, axis=axis)) for axis in axes)
    gained *= 4.0 * math.pi / 400
    through = strata_kernels.transmittance(np.full((1, 1), length, np.float32), extinction)[0, 0]
    taken = gained * absorption / scattering
    assert through + gained + taken == pytest.approx(1.0, abs=1e-4)  # 400 suns sum the phase function to 1e-4


def test_rows_of_pixels_agree_with_single_rays():
    """The evaluation of whole rows, sixteen rays at once, against double precision."""
    width, height = 37, 5
    eye, near = (0.3, -2.0, 0.2), 0.1
    rays = lattice(eye, width, height, (-0.6, 0.5, -0.4, 0.3), near)
    depth = np.random.default_rng(2).uniform(0.05, 9.0, (height, width)).astype(np.float32)
    depth[0, 0] = np.inf
    x = rays[12] + np.arange(width) * rays[14]
    y = rays[13] + np.arange(height) * rays[15]
    across = np.stack(np.broadcast_arrays(x[None, :], 1.0, y[:, None]), 2).reshape(-1, 3)
    lengths = np.linalg.norm(across, axis=1)
    ends = depth.reshape(-1) * lengths
    starts = near * lengths
    directions = across / lengths[:, None]
    a_medium = medium([0.1, 0.2, 0.3], [0.15, 0.2, 0.9], 0.5)
    for a_source in (source(position=(0.4, 1.0, 0.5), radius=0.001), source(0, axis=(0.48, 0.6, -0.64))):
        origins = np.array(eye) + starts[:, None] * directions  # the medium begins at the near plane
        limits = np.stack([np.zeros_like(ends), np.maximum(ends - starts, 0.0)], 1)
        exact = strata_kernels.airlight_along(origins, directions, limits, a_medium, a_source)
        image = strata_kernels.airlight(depth, rays, a_medium, a_source, [], order=6).reshape(-1, 3)
        assert np.isfinite(image).all()
        assert np.abs(image - exact).max() < SINGLE * exact.max()
        assert image == pytest.approx(exact, rel=2e-4, abs=1e-9)


@pytest.mark.parametrize("kind", [1, 2, 3], ids=["point", "spot", "area"])
def test_numbers_far_apart_stay_within_single_precision(kind):
    """Lamps from a point at the eye to beyond what single precision can square, media from next to nothing to
    opaque: against double precision. With a size the kernel has another model: there they are finite."""
    shape = {1: {}, 2: {"cos_cone": 0.7, "blend": 0.15}, 3: {"spread": 2.0}}[kind]
    lengths, extinctions = (1.0, 1e9, np.inf), (1e-30, 1e-12, 1.0, 1e6)
    for away in (1e-40, 1e-20, 1e-9, 1e-3, 1.0, 1e9, 1e15, 1e18, 1e20, 1e38):
        for length, extinction, g, off, radius in itertools.product(
            lengths, extinctions, (0.0, 0.9999), (0.0, 1.0), (0.0, 0.1, 1e4)
        ):
            a_medium = medium([extinction, 0.0, 1.0], [extinction, 0.0, 1.0], g)
            position = (0.7 * off * away, away, -0.3 * off * away)
            a_source = source(kind, position, (0, -1, 0), radius, **shape)
            value = along_y((0, 0, 0), length, a_medium, a_source, order=6)
            assert np.isfinite(value).all(), (away, length, extinction, g, off, radius)
            if radius == 0.0 and away < 1e19:
                exact = exactly_along_y((0, 0, 0), length, a_medium, a_source)
                held = (exact > 1e-28) & (exact < 1e37)  # where a sum's parts are normal numbers too
                assert value[held] == pytest.approx(exact[held], rel=1e-3)


SQUARES = [(0.0, 0.0, -1.0, 0.25), (0.5, 0.4, -1.5, 0.3), (-0.6, 0.1, -0.8, 0.1)]


def _shadowed(points, light, squares):
    """(N,) bool by hand: whether a square lies between each point and the light."""
    dark = np.zeros(len(points), bool)
    for x, y, z, half in squares:
        towards = light["direction"] if "direction" in light else light["position"] - points
        towards = np.broadcast_to(towards, points.shape)
        share = (z - points[:, 2]) / towards[:, 2]
        at = points + share[:, None] * towards
        limit = np.inf if "direction" in light else 1.0
        inside = (np.abs(at[:, :2] - [x, y]) < half).all(axis=1)
        dark |= inside & (share > 0.0) & (share < limit)
    return dark


@pytest.mark.parametrize("distant", [False, True], ids=["point", "sun"])
def test_shadows_against_marching_with_true_visibility(distant):
    """Rays through the shadows of three squares; 4000 points of each ray, shadowed by hand."""
    eye, width, height = np.array([0.1, -3.0, -2.2]), 24, 16
    rays = lattice(eye, width, height, (-0.5, 0.5, -0.25, 0.35))
    depth = np.full((height, width), 6.0, np.float32)
    a_medium = medium(0.2, 0.3, 0.3)
    if distant:
        a_map, _ = map_from_above(SQUARES, (0, 0, 0.0), 1.5, 1024, True)
        a_source, light = source(0), {"direction": np.array([0.0, 0.0, 1.0])}
    else:
        a_map, _ = map_from_above(SQUARES, (0, 0, 0.0), 1.5, 1024)
        a_source, light = source(2, cos_cone=math.cos(1.0), blend=0.2), {"position": np.zeros(3)}
    image = strata_kernels.airlight(depth, rays, a_medium, a_source, [a_map], order=6)
    unshadowed = strata_kernels.airlight(depth, rays, a_medium, a_source, [], order=6)
    steps = 4000
    errors, total = [], []
    for row in range(height):
        for column in range(width):
            towards = np.array([rays[12] + column * rays[14], 1.0, rays[13] + row * rays[15]])
            length = 6.0 * np.linalg.norm(towards)
            direction = towards / np.linalg.norm(towards)
            t = (np.arange(steps) + 0.5) * length / steps
            points = eye + t[:, None] * direction
            away = np.linalg.norm(points, axis=1)
            g = 0.3
            turned = direction[2] if distant else -(points @ direction) / away
            phase = (1 - g * g) * ISOTROPIC / (1 + g * g - 2 * g * turned) ** 1.5
            value = 0.2 * phase * np.exp(-0.3 * t)
            if not distant:
                x = np.clip((-points[:, 2] / away - math.cos(1.0)) / ((1 - math.cos(1.0)) * 0.2), 0, 1)
                value = value * x * x * (3 - 2 * x) / away**2 * np.exp(-0.3 * away)
            exact = (value * ~_shadowed(points, light, SQUARES)).sum() * length / steps
            errors.append(image[row, column, 0] - exact)
            total.append(exact)
    relative = math.sqrt(np.mean(np.square(errors))) / np.mean(total)
    assert relative < 5e-3  # texels of 1 / 340 of the map's width
    assert np.abs(image - unshadowed).max() > 0.05 * unshadowed.max()


def test_walking_and_marching_read_the_same_map():
    """Every texel's edge crossed: the walk down the pyramid against 20 000 look-ups a ray in the same map."""
    rng = np.random.default_rng(5)
    depths = np.where(rng.random((1, 67, 91)) < 0.5, np.inf, rng.uniform(0.5, 4.0, (1, 67, 91))).astype(
        np.float32
    )
    for orthographic in (False, True):
        _, view = map_from_above(SQUARES, (0.2, 0.1, 0.0), 1.2, 64, orthographic)
        a_map = strata_kernels.light_map(depths, view.packed())
        rays = lattice((0.1, -3.0, -2.2), 9, 7, (-0.6, 0.6, -0.4, 0.6))
        depth = np.full((7, 9), 6.0, np.float32)
        a_source = (
            source(0) if orthographic else source(2, (0.2, 0.1, 0.0), cos_cone=math.cos(0.85), blend=0.1)
        )
        arguments = (depth, rays, medium(0.2, 0.3), a_source, [a_map])
        walked = strata_kernels.airlight(*arguments, order=6)
        marched = strata_kernels.airlight(*arguments, march_steps=20_000)
        assert np.abs(walked - marched).max() < 2e-3 * walked.max()


def test_table_of_the_antiderivative():
    """The source's method: right where its table is fine, worse than the walk near the light."""
    rays = lattice((0.0, -4.0, 0.0), 32, 32, (-0.5, 0.5, -0.5, 0.5))
    depth = np.full((32, 32), 8.0, np.float32)
    arguments = (depth, rays, medium(0.1, 0.12, 0.2), source(position=(0.8, 0.0, 0.6), radius=0.2), [])
    walked = strata_kernels.airlight(*arguments, order=8)
    table = strata_kernels.airlight(*arguments, table_reach=10.0)
    assert np.sqrt(np.mean((table - walked) ** 2)) < 0.02 * walked.mean()
    assert np.abs(table - walked).max() > 1e-4 * walked.max()


def test_bounded_medium():
    """A slab of a metre across the ray: the light outside it loses nothing on the way there."""
    rays = lattice((0.0, -4.0, 0.0), 1, 1)
    depth = np.full((1, 1), 10.0, np.float32)
    spans = np.array([3.0, 4.0, np.inf], np.float32).reshape(3, 1, 1)
    a_medium, a_source = medium(0.5, 0.5), source(0)
    value = strata_kernels.airlight(depth, rays, a_medium, a_source, [], spans=spans)[0, 0]
    assert value == pytest.approx(ISOTROPIC * -math.expm1(-0.5), rel=1e-5)
    metres = strata_kernels.metres_inside(spans, np.zeros((1, 1), np.float32), depth)
    assert metres[0, 0] == 1.0
    from_inside = np.array([2.0, np.inf, np.inf], np.float32).reshape(3, 1, 1)
    assert strata_kernels.metres_inside(from_inside, np.full((1, 1), 0.5, np.float32), depth)[0, 0] == 1.5


def test_bad_input_is_refused():
    depth, rays = np.ones((1, 1), np.float32), lattice((0, 0, 0))
    for bad in (medium(-1.0, 1.0), medium(2.0, 1.0), medium(1.0, 1.0, 1.0), medium(np.nan, 1.0)):
        with pytest.raises(ValueError, match="medium"):
            strata_kernels.airlight(depth, rays, bad, source(), [])
    with pytest.raises(ValueError, match="source"):
        strata_kernels.airlight(depth, rays, medium(1.0, 1.0), source(7), [])
    flag = strata_kernels.CancelFlag()
    flag.set()
    with pytest.raises(strata_kernels.Cancelled):
        strata_kernels.airlight(depth, rays, medium(1.0, 1.0), source(), [], cancel=flag)


def test_upsampling_keeps_to_its_own_depth():
    """Two planes beside each other: no pixel takes from the other; within one the way is bilinear."""
    depth = np.full((8, 16), 2.0, np.float32)
    depth[:, 7:] = 9.0
    coarse_depth = np.ascontiguousarray(depth[1::2, 1::2])
    near = (coarse_depth < 5.0)[..., None]
    coarse = np.where(near, 1.0, 5.0).astype(np.float32) * np.ones(3, np.float32)
    image = strata_kernels.upsample_by_depth(coarse, coarse_depth, depth, 2, (1, 1))
    assert image[:, :7] == pytest.approx(1.0, rel=2e-3)
    assert image[:, 7:] == pytest.approx(5.0, rel=2e-3)
    ramp = np.ones((8, 8), np.float32)
    slope = np.repeat(np.arange(4, dtype=np.float32)[None, :, None], 4, 0) * np.ones(3, np.float32)
    image = strata_kernels.upsample_by_depth(slope, ramp[1::2, 1::2].copy(), ramp, 2, (1, 1))
    assert image[:, 2, 0] == pytest.approx(0.5, abs=2e-3)


def _beside_a_disk(height, length, g, radius, along=None, cos_cone=-1.0, blend=0.0):
    """Brute force in double precision: a ray along +Y whose middle is `height` beside a disk of `radius` that
    turns to every point, its directions one by one; without extinction. `along`: a spot's axis."""
    sides = np.geomspace(1e-4 * radius, 0.5 * length, 500)
    tau = np.concatenate([-sides[::-1], sides])
    points = np.stack([np.full_like(tau, height), tau, np.zeros_like(tau)], 1)
    away = np.linalg.norm(points, axis=1)
    middle = points / away[:, None]
    first = np.cross(middle, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(middle, first)
    lowest = away / np.hypot(away, radius)
    values = np.zeros_like(tau)
    turns = 2.0 * np.pi * (np.arange(96) + 0.5) / 96
    for ring in (np.arange(96) + 0.5) / 96:
        lean = lowest + (1.0 - lowest) * ring
        out = np.sqrt(1.0 - lean**2)
        for turn in turns:
            across = math.cos(turn) * first + math.sin(turn) * second
            light = lean[:, None] * middle + out[:, None] * across
            share = np.ones_like(tau)
            if along is not None:
                x = np.clip((light @ along - cos_cone) / ((1.0 - cos_cone) * blend), 0.0, 1.0)
                share = x * x * (3.0 - 2.0 * x)
            values += share * (1 - g * g) / (4 * math.pi * (1 + g * g + 2 * g * light[:, 1]) ** 1.5)
    fluence = 2.0 * (1.0 - lowest) / radius**2
    return np.trapezoid(fluence * values / (96 * 96), tau)


@pytest.mark.parametrize("g", [0.0, 0.35, -0.6])
@pytest.mark.parametrize("height", [0.1, 0.5, 1.0, 3.0])
def test_a_ray_beside_a_disk(height, g):
    """Near a light the phase function is averaged over all of it."""
    exact = _beside_a_disk(0.02 * height, 8.0, g, 0.02)
    value = along_y((0.02 * height, -4.0, 0.0), 8.0, medium(1e-4, 1e-4, g), source(radius=0.02)) * 1e4
    assert value[0] == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize("blend", [0.02, 0.25, 1.0])
@pytest.mark.parametrize(("height", "bound"), [(0.5, 0.01), (1.0, 0.006), (3.0, 0.006), (6.0, 0.003)])
def test_a_ray_beside_a_spot_with_a_size(height, bound, blend):
    """Its cone's edge is blurred by the angle that the disk fills. Four rings of the disk know how much of
    each lies in the cone, but not how sharply the phase function turns within a radius."""
    along, cone = np.array([0.96, 0.0, -0.28]), {"cos_cone": math.cos(0.45), "blend": blend}
    exact = _beside_a_disk(0.02 * height, 8.0, 0.35, 0.02, along, **cone)
    spot = source(2, axis=along, radius=0.02, **cone)
    value = along_y((0.02 * height, -4.0, 0.0), 8.0, medium(1e-4, 1e-4, 0.35), spot) * 1e4
    assert value[0] == pytest.approx(exact, rel=bound)


def test_a_wide_spot_with_a_hard_edge_is_finite():
    """Rays past, through and inside a spot's disk, in cones from a hair's breadth to all around."""
    rays, depth = lattice((0.0, -4.0, 0.0), 8, 8, (-0.5, 0.5, -0.5, 0.5)), np.full((8, 8), 8.0, np.float32)
    for angle in (1e-3, 0.3, 1.5, 3.1):
        for blend in (0.0, 1.0):
            for place in ((0.0, 0.0, 0.0), (0.0, -4.0, 0.0), (0.3, -4.0, 0.1)):
                for axis in ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.0, -0.8)):
                    spot = source(2, place, axis, 0.5, math.cos(angle), blend)
                    image = strata_kernels.airlight(depth, rays, medium(0.1, 0.1, 0.4), spot, [])
                    assert np.isfinite(image).all()
                    assert (image >= 0.0).all()


@pytest.mark.parametrize("orthographic", [False, True])
def test_rays_of_pixels_with_places_of_their_own(orthographic):
    """Each ray is that of a lattice moved to it, its length too. Rays that share their jitter may go through
    another walk, in single precision."""
    rng = np.random.default_rng(5)
    offsets = (rng.integers(-384, 385, (7, 9, 2)) / 256.0).astype(np.float32)
    depth = rng.uniform(2.0, 9.0, (7, 9)).astype(np.float32)
    rays = lattice((0.1, -4.0, 0.2), 9, 7, (-0.6, 0.5, -0.4, 0.3), 0.1)
    rays[-1] = orthographic
    fog, lamp = medium(0.2, 0.3, 0.4), source(position=(0.5, 0.3, 0.4))
    axes, window = ((1, 0, 0), (0, 0, 1), (0, 1, 0)), (-0.6, 0.5, -0.4, 0.3)
    view = View((0.1, -4.0, 0.2), *axes, window, 0.1, 99.0, orthographic)
    whole = strata_kernels.airlight(depth, rays, fog, lamp, [], offsets=offsets)
    lengths = Lattice(view, tuple(rays[12:14]), tuple(rays[14:16]), 9, 7).lengths(offsets)
    for y, x in np.ndindex(7, 9):
        own = rays.copy()
        own[12:14] += (np.array([x, y]) + offsets[y, x]) * rays[14:16]
        alone = strata_kernels.airlight(depth[y : y + 1, x : x + 1], own, fog, lamp, [])
        np.testing.assert_allclose(whole[y, x], alone[0, 0], rtol=2e-5)
        slopes = 0.0 if orthographic else (own[12:14] ** 2).sum()
        assert lengths[y, x] == pytest.approx(math.sqrt(1.0 + slopes), rel=1e-6)
    with pytest.raises(ValueError, match="offsets are"):
        strata_kernels.airlight(depth, rays, fog, lamp, [], offsets=offsets[:3])
