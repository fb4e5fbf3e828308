"""Toon kernels against closed forms and counted points, each by itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.placement import Places
from strata.addon.core.ramp import Ramp
from strata.addon.core.shot import Camera, PixelFilter, Raster, Shot
from strata.addon.core.surface import Chunk
from strata.addon.effects.toon.params import Anchor, ToonParams
from strata.addon.effects.toon.pattern import packed_pattern, settings
from strata.addon.effects.toon.ramp_table import table_of

SIDE = 96
CAMERA = Camera("Camera", (0.0, 0.0, 0.0), (1, 0, 0), (0, 1, 0), (0, 0, -1), orthographic=True)


def _sphere():
    """Position and normal (SIDE, SIDE, 3) of a unit sphere seen along -z, and where it is."""
    at = (np.arange(SIDE) + 0.5) / SIDE * 2.4 - 1.2
    x, y = np.meshgrid(at, at)
    z = np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    hit = x * x + y * y < 1.0
    normal = np.where(hit[..., None], np.stack([x, y, z], axis=-1), 0.0)
    return np.ascontiguousarray(normal - (0.0, 0.0, 4.0), np.float32), normal.astype(np.float32), hit


def _sun(direction) -> np.ndarray:
    return np.array([[0, 0, 0, 1, *direction, 2, -2, 1e6, 0, 0]], np.float32)


def _shaded(light, ramp: Ramp, base=(0.5, 0.5, 0.5), mix=2, material=None, rim=(0.3, 0.0, 1, 1, 1), **more):
    table = table_of(ramp)
    material = np.zeros(light.shape, np.int32) if material is None else material
    return kernels.toon_shade(
        light, material, np.array([[*base, 0, 0, 0]], np.float32), np.zeros(1, np.int32), table.packed(),
        np.array([0, len(table.starts)], np.int32), np.array([table.clamps], np.uint8), mix, 1.0, rim, **more,
    )  # fmt: skip


# Light


def test_a_sphere_under_a_sun_is_lit_by_the_cosine():
    position, normal, hit = _sphere()
    to_sun = np.array([0.48, 0.6, 0.64])
    light = kernels.toon_facing(position, normal, _sun(-to_sun), [None])
    # float32: one product of three terms.
    np.testing.assert_allclose(light[hit], np.maximum(normal[hit] @ to_sun, 0.0), atol=2e-7)
    assert not light[~hit].any()


def test_one_lamp_has_the_cosine_whatever_its_distance():
    position, normal, hit = _sphere()
    lamp = np.array([[3, -1, 2, 0.01, 0, 0, -1, 0, -2, 1e6, 0, 0]], np.float32)
    to = lamp[0, :3] - position[hit].astype(np.float64)
    cosine = np.einsum("ni,ni->n", to / np.linalg.norm(to, axis=1)[:, None], normal[hit].astype(np.float64))
    light = kernels.toon_facing(position, normal, lamp, [None])
    np.testing.assert_allclose(light[hit], cosine.clip(0.0), atol=1e-6)


def test_two_lamps_count_by_strength_and_distance():
    position = np.zeros((1, 1, 3), np.float32)
    normal = np.array([[[0.0, 0.0, 1.0]]], np.float32)
    # Straight above at 1 m, and at 60 degrees, 2 m away, three times as strong: weights 1 and 3/4.
    slanted = 2.0 * np.array([math.sin(math.pi / 3), 0.0, 0.5])
    lamps = np.array(
        [[0, 0, 1, 1, 0, 0, -1, 0, -2, 1e6, 0, 0], [*slanted, 3, 0, 0, -1, 0, -2, 1e6, 0, 0]], np.float32
    )
    light = kernels.toon_facing(position, normal, lamps, [None, None])
    assert light[0, 0] == pytest.approx((1.0 + 0.75 * 0.5) / 1.75, abs=1e-6)
    half = np.full((1, 1), 0.5, np.float32)
    shadowed = kernels.toon_facing(position, normal, lamps, [half, None])
    assert shadowed[0, 0] == pytest.approx((0.5 + 0.75 * 0.5) / 1.75, abs=1e-6)
    # A light that does not light the instance counts nothing, on either side of the fraction.
    instance, receives = np.zeros((1, 1), np.int32), np.array([[1], [0]], np.uint8)
    linked = kernels.toon_facing(position, normal, lamps, [None, None], instance, receives)
    assert linked[0, 0] == pytest.approx(1.0, abs=1e-6)


def test_a_cone_and_an_area_light_shape_what_arrives():
    position = np.zeros((1, 1, 3), np.float32)
    normal = np.array([[[0.0, 0.0, 1.0]]], np.float32)
    axis = (math.sin(0.3), 0.0, -math.cos(0.3))  # shines 0.3 rad past the point
    cone, blend = math.cos(0.4), 0.5
    spot = np.array([[0, 0, 2, 1, *axis, 0, cone, 1 / ((1 - cone) * blend), 0, 0]], np.float32)
    x = min((math.cos(0.3) - cone) / ((1 - cone) * blend), 1.0)
    light = kernels.toon_facing(position, normal, spot, [None])
    assert light[0, 0] == pytest.approx(x * x * (3 - 2 * x), abs=1e-5)
    area = np.array([[0, 0, 2, 1, *axis, 1, -2, 1e6, 0.5, 0]], np.float32)
    light = kernels.toon_facing(position, normal, area, [None])
    assert light[0, 0] == pytest.approx(math.cos(0.3) * (1 - 0.5 * math.tan(0.3)), abs=1e-5)


# The ramp


def test_the_terminator_lies_where_the_cosine_crosses_the_stop():
    position, normal, hit = _sphere()
    to_sun = np.array([0.48, 0.6, 0.64])
    light = kernels.toon_facing(position, normal, _sun(-to_sun), [None])
    ramp = Ramp.parse("0:#000000,0.3:#808080,0.8:#ffffff;constant")
    image = _shaded(light, ramp, material=np.where(hit, 0, -1).astype(np.int32))
    cosine = normal.astype(np.float64) @ to_sun
    band = np.searchsorted([0.3, 0.8], cosine, side="right")
    colours = np.array([0.0, 0.2158605, 1.0])[band]
    clear = hit & (np.abs(cosine - 0.3) > 1e-6) & (np.abs(cosine - 0.8) > 1e-6)
    np.testing.assert_allclose(image[clear][:, 0], colours[clear], atol=1e-6)
    assert (image[..., 3] == hit).all()
    # Of the whole sphere, points with cosine above c fill (1 - c) / 2: seen from the sun, a disc of 1 - c^2.
    position, normal, hit = _sphere()
    frontal = kernels.toon_facing(position, normal, _sun((0.0, 0.0, -1.0)), [None])
    share = (frontal[hit] > 0.8).mean()
    assert share == pytest.approx(1 - 0.8**2, abs=0.01)  # counted over some 5000 pixels


@pytest.mark.parametrize(
    "text",
    [
        "0:#102030,0.5:#ff8000,1:#ffffff;ease",
        "0:#ff0000,1:#00ff80;hsv;far",
        "0:#ff0000,0.4:#10ff20,1:#2000ff;b_spline",
        "0.2:#ff0000,0.4:#10ff20,0.9:#ffffff;cardinal",
        "0:#804020,1:#20c0ff;hsl;cw",
        "0.3:#ffffff",
    ],
)
def test_the_kernel_evaluates_every_ramp(text):
    ramp = Ramp.parse(text)
    light = np.linspace(0.0, 1.0, 1001, dtype=np.float32)[None]
    image = _shaded(light, ramp)
    # Cubics in float32 whose coefficients reach some hundreds where a piece is short.
    np.testing.assert_allclose(image[0, :, :3], table_of(ramp).evaluate(light[0])[:, :3], atol=2e-5)


def test_soft_light_is_the_corrected_one():
    light = np.array([[0.0, 0.5, 1.0]], np.float32)
    ramp = Ramp.parse("0:#000000,1:#ffffff")
    base = 0.5
    image = _shaded(light, ramp, base=(base,) * 3, mix=0)
    # b = 0: a^2; b = 1/4: a/2 + a^2/2; b = 1/2: a itself. The printed formula gives -a^2 at b = 0.
    np.testing.assert_allclose(image[0, :, 0], [base**2, 0.5 * base + 0.5 * base**2, base], atol=1e-6)
    multiplied = _shaded(light, ramp, base=(base,) * 3, mix=1)
    np.testing.assert_allclose(multiplied[0, :, 0], base * light[0], atol=1e-6)


def test_the_rim_is_a_ring_of_its_own_width():
    position, normal, hit = _sphere()
    light = np.zeros((SIDE, SIDE), np.float32)
    image = _shaded(
        light, Ramp.parse("0:#000000"), material=np.where(hit, 0, -1).astype(np.int32),
        rim=(0.6, 1.0, 1, 1, 1), position=position, normal=normal, forward=(0.0, 0.0, -1.0),
    )  # fmt: skip
    # The cosine to the eye is below 0.6 beyond the radius sqrt(1 - 0.36) = 0.8.
    radius = np.hypot(normal[..., 0], normal[..., 1])
    np.testing.assert_array_equal(image[..., 0] > 0.5, hit & (radius > 0.8))


# Dots


def _dots(s: float, cell: float, angle: float = 0.0, samples: int = 1, side: int = 128) -> np.ndarray:
    """Ink (side, side) of dots of size `s`, cells `cell` pixels wide."""
    params = ToonParams(
        halftone_scale=s, halftone_cutoff=0.0, halftone_angle=angle, halftone_repeat=side / cell
    )
    box = PixelFilter("BOX", 0.5)  # one pixel wide
    shot = Shot("Camera", Raster(CAMERA, (side, side)), box)
    chunk = Chunk(side, side, 0, side, 0, (0.0, 0.0), samples)
    nothing = np.zeros((side, side), np.float32)
    paper = kernels.toon_halftone(
        nothing, nothing.astype(np.int32), packed_pattern(chunk, **settings(params, shot)),
        b"\1", np.zeros((1, 12), np.float32),
    )  # fmt: skip
    return 1.0 - paper


def coverage(s: float) -> float:
    """Share of its cell that a dot of size `s` covers, cut off at the cell (closed form)."""
    if s <= 1.0:
        return math.pi * s * s / 4
    if s >= math.sqrt(2.0):
        return 1.0
    return math.pi * s * s / 4 - s * s * math.acos(1 / s) + math.sqrt(s * s - 1)


@pytest.mark.parametrize("s", [0.05, 0.25, 0.5, 0.9, 1.0, 1.1, 1.3, 1.41, 1.5])
@pytest.mark.parametrize("cell", [16.0, 4.0, 1.0, 0.4])
def test_dots_cover_what_they_should(s, cell):
    # Cells of 16, 4 and 1 pixels fill the image exactly: the mean is exact but for float32.
    ink = _dots(s, cell)
    assert ink.mean() == pytest.approx(coverage(s), abs=3e-5 if cell >= 1.0 else 1e-4)


def test_turned_dots_cover_as_much():
    # 128 pixels hold some 60 cells across, cut anywhere at the border: 1/60 of a cell's share.
    for s in (0.5, 1.2):
        assert _dots(s, 2.13, 0.7).mean() == pytest.approx(coverage(s), abs=0.01)


@pytest.mark.parametrize("s", [0.3, 0.8, 1.2])
@pytest.mark.parametrize("samples", [1, 4])
def test_each_pixel_holds_the_dots_share_of_its_footprint(s, samples):
    cell, side, fine = 9.3, 24, 64
    ink = _dots(s, cell * side / 24, samples=samples, side=side)
    offset = ((np.arange(fine) + 0.5) / fine - 0.5) / math.sqrt(samples)
    at = (np.arange(side)[:, None] + 0.5 + offset).reshape(-1) / cell
    x, y = np.meshgrid(at, at)
    away = np.hypot(x - np.floor(x) - 0.5, y - np.floor(y) - 0.5)
    counted = (away < 0.5 * s).reshape(side, fine, side, fine).mean(axis=(1, 3))
    # 64 x 64 points a pixel count an edge to about 1/64 / sqrt(64).
    np.testing.assert_allclose(ink, counted, atol=0.006)


def test_dots_end_at_the_cutoff_and_fade_with_distance():
    light = np.linspace(0.0, 1.0, 64, dtype=np.float32)[None].repeat(64, axis=0)
    shot = Shot("Camera", Raster(CAMERA, (64, 64)))
    chunk = Chunk(64, 64, 0, 64, 0, (0.0, 0.0))
    position = np.zeros((64, 64, 3), np.float32)
    position[..., 2] = -np.linspace(1.0, 9.0, 64)[:, None]

    def ink(**values):
        pattern = packed_pattern(chunk, **settings(ToonParams(**values), shot))
        instance = np.zeros((64, 64), np.int32)
        return 1.0 - kernels.toon_halftone(
            light, instance, pattern, b"\1", np.zeros((1, 12), np.float32), position
        )

    sized = ink(halftone_scale=2.0, halftone_cutoff=1.0)
    assert not sized[:, light[0] > 0.501].any()
    assert sized[:, light[0] < 0.2].all()
    full = ink(halftone_scale=2.0, halftone_cutoff=0.0)
    faded = ink(halftone_scale=2.0, halftone_cutoff=0.0, halftone_fade_start_m=3.0, halftone_fade_end_m=7.0)
    x = ((-position[..., 2] - 7.0) / (3.0 - 7.0)).clip(0.0, 1.0)
    np.testing.assert_allclose(faded, full * x * x * (3 - 2 * x), atol=1e-6)


def test_dots_stay_on_a_surface_that_the_camera_passes():
    """The same plane seen from two places: its points have the same ink where their footprints are small."""
    params = ToonParams(
        halftone_anchor=Anchor.SURFACE, halftone_cell_m=0.5, halftone_scale=0.8, halftone_cutoff=0.0
    )
    images = []
    for moved in (0.0, 0.3):
        camera = Camera("Camera", (moved, 0, 2.0), (1, 0, 0), (0, 1, 0), (0, 0, -1), lens=36.0)
        shot = Shot("Camera", Raster(camera, (200, 200)))
        x = (np.arange(200) + 0.5) / 200 - 0.5
        ray = np.stack([*np.meshgrid(x, x), np.full((200, 200), -1.0)], axis=-1)
        position = (2.0 * ray).astype(np.float32)
        row = np.array([[1, 0, 0, moved, 0, 1, 0, 0, 0, 0, 1, 2.0]], np.float32)
        normal = np.zeros_like(position)
        normal[..., 2] = 1.0
        chunk = Chunk(200, 200, 0, 200, 0, (0.0, 0.0))
        images.append(
            kernels.toon_halftone(
                np.zeros((200, 200), np.float32), np.zeros((200, 200), np.int32),
                packed_pattern(chunk, **settings(params, shot)), b"\1", row, position, normal,
            )
        )  # fmt: skip
    # 0.3 m are 30 pixels at 2 m.
    np.testing.assert_allclose(images[0][:, 30:], images[1][:, :-30], atol=2e-4)
    assert 0.3 < images[0].mean() < 0.7


# Lines within


def test_inner_lines_are_as_wide_as_asked():
    marked = np.zeros((40, 60), np.int32)
    marked[:, 30:] = 1
    for width in (1, 2, 3, 5):
        lines = kernels.toon_edges(marked, 0, 40, width, object=marked)
        assert (lines.sum(axis=1) == width).all()
    whole = kernels.toon_edges(marked, 0, 40, 3, object=marked)
    part = kernels.toon_edges(marked[8:32], 2, 20, 3, object=marked[8:32])
    np.testing.assert_array_equal(part, whole[10:28])
    alone = np.where(marked == 1, -1, 0).astype(np.int32)
    assert not kernels.toon_edges(alone, 0, 40, 3, object=marked).any()


def test_creases_count_within_an_object_only():
    normal = np.zeros((8, 8, 3), np.float32)
    normal[:, :4, 0], normal[:, 4:, 1] = 1.0, 1.0
    one, two = np.zeros((8, 8), np.int32), np.zeros((8, 8), np.int32)
    two[:, 4:] = 1
    assert kernels.toon_edges(one, 0, 8, 1, normal=normal, crease=0.5).any()
    assert not kernels.toon_edges(one, 0, 8, 1, normal=normal, crease=-0.5).any()
    assert not kernels.toon_edges(two, 0, 8, 1, normal=normal, crease=0.5).any()


def test_dots_are_met_where_each_pixel_is_sampled():
    """Of one size on the screen: a pixel's ink at its place is that of a picture moved there."""
    params, side = ToonParams(halftone_scale=0.8, halftone_cutoff=0.0, halftone_repeat=64 / 9.3), 64
    shot, nothing = Shot("Camera", Raster(CAMERA, (side, side))), np.zeros((side, side), np.float32)
    places = Places(1, shot.pixel_filter)

    def ink(jitter, offsets=None):
        chunk = Chunk(side, side, 0, side, 0, jitter, 4, places=places)
        pattern = packed_pattern(chunk, **settings(params, shot))
        return kernels.toon_halftone(
            nothing, nothing.astype(np.int32), pattern, b"\1", np.zeros((1, 12), np.float32), offsets=offsets
        )

    which = np.random.default_rng(2).integers(0, 3, (side, side))
    moves = np.array([(0.0, 0.0), (1.25, -0.5), (-0.75, 1.0)], np.float32)
    expected = np.choose(which, [ink(tuple(map(float, move))) for move in moves])
    np.testing.assert_allclose(ink((0.0, 0.0), moves[which]), expected, atol=1e-4)
    assert len(np.unique(expected)) > 100
