"""Pixels that are sampled at places of their own: where those are, and what the rasteriser finds there."""

from __future__ import annotations

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.pixel_filter import filter_weight
from strata.addon.core.placement import Places
from strata.addon.core.shot import PixelFilter
from strata.tests.kernels.raster_scenes import (
    ALL_ATTRIBUTES,
    add_triangles,
    brute_force,
    cone_about_the_eye,
    down,
    everything,
    opacity,
    pixel_rays,
    random_triangles,
    sheet,
    turned_view,
)

BOX, USUAL = PixelFilter("BOX", 0.5), PixelFilter()
EXACT = PixelFilter("BOX", 16.0)
"""Two subpixels to a share of the table: places tell their shares."""


def offsets_of(width, height, sample=0, seed=7, pixel_filter=USUAL, first=(0, 0)):
    x, y = first
    return kernels.pixel_offsets(
        seed, sample, Places(seed, pixel_filter).table, (y, y + height), (x, x + width)
    )


def surface(geometry, view, offsets, attributes=ALL_ATTRIBUTES, **keywords):
    height, width = offsets.shape[:2]
    return kernels.raster_surface(
        geometry,
        everything(geometry),
        view.packed(),
        *keywords.pop("size", (width, height)),
        attributes=attributes,
        offsets=offsets,
        **keywords,
    )


def layered(geometry, view, layers, offsets):
    height, width = offsets.shape[:2]
    return kernels.layered_depth(
        geometry, everything(geometry), view.packed(), layers, width, height, offsets=offsets
    )


def add_sheet(geometry, positions, triangles, matrix=None):
    starts = np.arange(0, triangles.size + 1, 3, dtype=np.int32)
    mesh = geometry.add_mesh(positions, triangles.ravel(), starts)
    geometry.add_instance(mesh, np.eye(4) if matrix is None else matrix, 0, [geometry.add_material()])


# Where


@pytest.mark.parametrize("pixel_filter", [BOX, USUAL, PixelFilter("GAUSSIAN", 2.25), PixelFilter("BOX", 0.0)])
@pytest.mark.parametrize("sample", [0, 1, 6, 4095])
def test_both_twins_have_the_same_bits(pixel_filter, sample):
    found = offsets_of(21, 13, sample, 0xFEDCBA98, pixel_filter, first=(-9, 40))
    rows, columns = np.indices((13, 21))
    pixels = np.stack([columns - 9, rows + 40], axis=-1).reshape(-1, 2)
    told = Places(0xFEDCBA98, pixel_filter).offsets(pixels, sample)
    np.testing.assert_array_equal(found.reshape(-1, 2), told)
    np.testing.assert_array_equal(found * 256.0, np.rint(found * 256.0))


def test_a_place_hangs_on_pixel_seed_and_sample_alone():
    whole = offsets_of(200, 90)
    np.testing.assert_array_equal(offsets_of(30, 20, first=(100, 60)), whole[60:80, 100:130])
    for other in (offsets_of(200, 90, seed=8), offsets_of(200, 90, sample=1), whole[::-1], whole[:, ::-1]):
        assert (other == whole).all(-1).mean() < 0.01


@pytest.mark.parametrize("power", range(7))
def test_the_first_samples_of_every_pixel_are_strata_however_they_are_cut(power):
    samples = 1 << power
    taken = np.stack([offsets_of(8, 8, s, pixel_filter=EXACT).reshape(-1, 2) for s in range(samples)], axis=1)
    shares = (taken + 16.0) / 32.0
    for along in range(power + 1):
        cells = np.floor(shares * (1 << along, 1 << (power - along))).astype(int)
        numbers = np.sort(cells[..., 0] + (cells[..., 1] << along), axis=1)
        np.testing.assert_array_equal(numbers, np.broadcast_to(np.arange(samples), numbers.shape))


@pytest.mark.parametrize("samples", [3, 5, 6, 10, 12, 20, 28])
def test_other_numbers_of_samples_are_nearly_strata(samples):
    """Each half of the first of 2^n holds as many as it can to two; of independent ones half as many again
    as a whole quarter of them would lie beside that."""
    taken = np.stack(
        [offsets_of(16, 16, s, pixel_filter=EXACT).reshape(-1, 2) for s in range(samples)], axis=1
    )
    below = (taken < 0.0).sum(axis=1)
    assert np.abs(below - samples / 2).max() <= 1.0


@pytest.mark.parametrize("pixel_filter", [BOX, USUAL, PixelFilter("GAUSSIAN", 2.25)])
def test_places_follow_the_filter(pixel_filter):
    """40,000 pixels by one sample know a mean to .005 of the filter's width, and a variance to .7%."""
    found = offsets_of(200, 200, 3, pixel_filter=pixel_filter).reshape(-1, 2)
    x = np.linspace(-pixel_filter.radius, pixel_filter.radius, 200_001)
    weight = filter_weight(pixel_filter, x)
    variance = (weight * x * x).sum() / weight.sum()
    assert np.abs(found.mean(axis=0)).max() < 4.0 * np.sqrt(variance / len(found))
    np.testing.assert_allclose(found.var(axis=0), variance, rtol=0.03)
    assert abs(np.corrcoef(found.T)[0, 1]) < 0.02
    beside = offsets_of(200, 200, 3, pixel_filter=pixel_filter)[..., 0]
    assert abs(np.corrcoef(beside[:, 1:].ravel(), beside[:, :-1].ravel())[0, 1]) < 0.02


def test_wrong_places_are_told():
    geometry = kernels.Geometry()
    add_triangles(geometry, [[[-9, -9, -2], [9, -9, -2], [0, 9, -2]]])
    for wrong in (np.zeros((4, 5, 2), "f"), np.full((4, 4, 2), np.nan, "f"), np.full((4, 4, 2), 65.0, "f")):
        with pytest.raises(ValueError, match="offsets are"):
            surface(geometry, down(), wrong, size=(4, 4))
    table = Places(0, USUAL).table
    for bad in ((table[:1], (0, 4), (0, 4)), (table[:100], (0, 4), (0, 4)), (table, (4, 4), (0, 4))):
        with pytest.raises(ValueError, match=r"quantiles|no rows"):
            kernels.pixel_offsets(0, 0, *bad)


# What is found there


@pytest.mark.parametrize("mirror", [1.0, -1.0])
@pytest.mark.parametrize("cells", [3, 17, 60, 150])
def test_a_sheet_covers_every_place_exactly_once(cells, mirror):
    rng, matrix = np.random.default_rng(cells), np.diag([mirror, 1.0, 1.0, 1.0])
    geometry = kernels.Geometry()
    add_sheet(geometry, *sheet(rng, cells, cells + 2), matrix)
    for sample in range(3):
        layers = layered(geometry, down(orthographic=True), 16, offsets_of(130, 101, sample))
        assert (np.isfinite(layers).sum(0) == 1).all()


@pytest.mark.parametrize("scale", [1e-5, 1.0, 1e7])
def test_a_sheet_far_from_the_origin_has_no_cracks(scale):
    """At 10,000,000 m single precision moves corners by 1 m, all triangles around them alike."""
    positions, triangles = sheet(np.random.default_rng(7), 80, 70, extent=1.9)
    matrix = np.diag([scale, scale, scale, 1.0])
    matrix[:3, 3] = 1e7
    geometry = kernels.Geometry()
    add_sheet(geometry, positions, triangles, matrix)
    half = 1.0 * scale
    view = down((-half, half, -half, half), near=1e-6, far=1e9, eye=(1e7, 1e7, 1e7), orthographic=True)
    layers = layered(geometry, view, 16, offsets_of(130, 101))
    assert (np.isfinite(layers).sum(0) == 1).all()


def test_an_image_of_16384_pixels_has_no_cracks():
    """Edge functions there are too large for single precision, and for 32 bits."""
    positions, triangles = sheet(np.random.default_rng(3), 9, 3)
    geometry = kernels.Geometry()
    add_sheet(geometry, positions, triangles)
    layers = layered(geometry, down(orthographic=True), 2, offsets_of(16384, 40))
    assert np.isfinite(layers[0]).all()
    assert np.isinf(layers[1]).all()


def test_corners_on_places_cover_every_one_once():
    """Every corner and every diagonal of the sheet runs through a place: all the ties of the fill rule."""
    n = 32
    x, y = np.meshgrid(np.arange(-2, n + 3), np.arange(-2, n + 3))
    positions = np.stack([(x + 0.5) / n * 2 - 1, (y + 0.5) / n * 2 - 1, np.full(x.shape, -1.0)], -1)
    a = (np.arange(n + 4)[:, None] * (n + 5) + np.arange(n + 4)).ravel()
    triangles = np.concatenate([np.stack([a, a + 1, a + n + 6], -1), np.stack([a, a + n + 6, a + n + 5], -1)])
    geometry = kernels.Geometry()
    add_sheet(geometry, positions.reshape(-1, 3).astype(np.float32), triangles.astype(np.int32))
    whole = np.random.default_rng(1).integers(-1, 2, (n, n, 2)).astype(np.float32)
    for offsets in (whole, 0.5 * whole):
        layers = layered(geometry, down(orthographic=True), 16, offsets)
        assert (np.isfinite(layers).sum(0) == 1).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_fan_through_the_near_plane_leaves_no_holes(seed):
    triangles = cone_about_the_eye(seed)
    geometry = kernels.Geometry()
    add_triangles(geometry, triangles)
    view, offsets = down(near=1e-4), offsets_of(97, 83)
    depths, doubtful = brute_force(view, triangles, 97, 83, np.moveaxis(offsets, -1, 0))
    clear = ~doubtful.any(0)
    count = np.isfinite(layered(geometry, view, 16, offsets)).sum(0)
    np.testing.assert_array_equal(count[clear], np.isfinite(depths).sum(0)[clear])
    assert (count == 1).mean() > 0.95


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("kind", ["ordinary", "sliver", "near", "tiny", "huge"])
def test_points_lie_where_a_float64_ray_meets_them(kind, orthographic):
    rng = np.random.default_rng(11)
    width, height = 80, 60
    far = 1e6 if kind == "huge" else 40.0
    view = turned_view(rng, near=0.3, far=far, orthographic=orthographic, half=2.0 if orthographic else 0.7)
    triangles = random_triangles(rng, view, kind, 2000 if kind == "tiny" else 60)
    geometry = kernels.Geometry()
    add_triangles(geometry, triangles)
    offsets = offsets_of(width, height, pixel_filter=PixelFilter("GAUSSIAN", 2.25))
    s, jitter = surface(geometry, view, offsets), np.moveaxis(offsets, -1, 0).astype(np.float64)
    seen = s["triangle"] >= 0
    origin, direction = pixel_rays(view, width, height, jitter)
    local = s["position"][seen].astype(np.float64) @ np.array([view.right, view.up, view.forward]).T
    off = np.linalg.norm(local - origin[seen] - direction[seen] * local[:, 2:], axis=-1)
    size, pixel = np.linalg.norm(local, axis=-1), (view.window[1] - view.window[0]) / width
    assert (off < pixel * 1.5 / 256 * (1.0 if orthographic else local[:, 2]) + 1e-6 * size).all()
    depths, doubtful = brute_force(view, triangles, width, height, jitter)
    nearest, clear = depths.min(0), ~doubtful.any(0)
    assert clear.mean() > 0.6
    np.testing.assert_array_equal(seen[clear], np.isfinite(nearest)[clear])
    clear &= seen
    assert clear.sum() > 300
    np.testing.assert_allclose(s["depth"][clear], nearest[clear], rtol=5e-6)


def scene(rng, view):
    """Triangles of which some are partly opaque, and some show pictures."""
    geometry = kernels.Geometry()
    clip = opacity(geometry, texels=rng.random((8, 8)).astype(np.float32), threshold=0.5)
    for number, material in enumerate((None, clip, opacity(geometry, value=0.4))):
        triangles = random_triangles(np.random.default_rng(number), view, "ordinary", 100)
        add_triangles(geometry, triangles, None, material, corner_uvs=rng.random((300, 2)).astype(np.float32))
    return geometry


@pytest.mark.parametrize("orthographic", [False, True])
def test_one_place_for_all_is_the_shared_jitter(orthographic):
    """What is shared by all pixels has its own code: the same surface, but for the last bits."""
    rng = np.random.default_rng(4)
    view = turned_view(rng, orthographic=orthographic)
    geometry, jitter = scene(rng, view), (0.25, -1.125)
    offsets = np.tile(np.array(jitter, np.float32), (90, 150, 1))
    found = surface(geometry, view, offsets, draw=(5, 1))
    shared = surface(geometry, view, np.zeros_like(offsets), draw=(5, 1), jitter=jitter)
    plain = kernels.raster_surface(
        geometry, everything(geometry), view.packed(), 150, 90, jitter=jitter, attributes=ALL_ATTRIBUTES,
        draw=(5, 1),
    )  # fmt: skip
    assert (plain["triangle"] >= 0).mean() > 0.5
    for other in (found, shared):
        # Of what meets in one line rounding decides.
        same = other["triangle"] == plain["triangle"]
        assert same.mean() > 0.9999
        np.testing.assert_allclose(other["depth"][same], plain["depth"][same], rtol=1e-6)
        np.testing.assert_allclose(other["uv"][same], plain["uv"][same], atol=1e-5)


def test_parts_are_those_of_the_whole():
    rng = np.random.default_rng(2)
    view = turned_view(rng)
    geometry = scene(rng, view)
    around = offsets_of(170, 220, first=(-10, -10))
    rows, columns = (-10, 210), (-10, 160)
    whole = surface(geometry, view, around, size=(150, 200), rows=rows, columns=columns, draw=(3, 2))
    for (y0, y1), (x0, x1) in (
        ((0, 64), (0, 150)),
        ((3, 5), (1, 2)),
        ((63, 131), (60, 70)),
        ((-9, 205), (-3, 9)),
    ):
        part = surface(
            geometry,
            view,
            np.ascontiguousarray(around[y0 + 10 : y1 + 10, x0 + 10 : x1 + 10]),
            size=(150, 200),
            rows=(y0, y1),
            columns=(x0, x1),
            draw=(3, 2),
        )
        for name in ALL_ATTRIBUTES:
            expected = whole[name][y0 + 10 : y1 + 10, x0 + 10 : x1 + 10]
            np.testing.assert_array_equal(part[name], expected)


def test_what_lies_before_a_surface_is_found_at_the_same_places():
    rng = np.random.default_rng(6)
    view = turned_view(rng)
    geometry = kernels.Geometry()
    add_triangles(geometry, random_triangles(rng, view, "ordinary", 100))
    offsets = offsets_of(150, 90)
    seen = surface(geometry, view, offsets)
    arguments = geometry, everything(geometry), view.packed(), 150, 90
    at_it = kernels.raster_before(*arguments, seen["depth"], offsets=offsets)
    assert (at_it == -1).all()
    behind = kernels.raster_before(*arguments, seen["depth"] * np.float32(1.01), offsets=offsets)
    np.testing.assert_array_equal(behind, seen["object_id"])
    assert (kernels.raster_before(*arguments, seen["depth"]) != -1).any()
