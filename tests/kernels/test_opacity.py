"""What gets through surfaces that are partly opaque, and which of them are there."""

from __future__ import annotations

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.random import pcg
from strata.tests.kernels.ray_scenes import LIGHTS

SQUARE = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], np.float32)
UVS = 0.5 * SQUARE + 0.5
LAYOUT = np.arange(4, dtype=np.int32), np.array([0, 4], np.int32)
INFINITE = np.float32(np.inf)


def card(geometry, z: float, front: dict, back: dict | None = None, seen=None, matrix=None, corners=None):
    """A square of half side 1, whose front looks down on the origin's plane from `z`."""
    points = np.concatenate([SQUARE[::-1], np.full((4, 1), z, np.float32)], axis=1)
    mesh = geometry.add_mesh(points, *LAYOUT, corner_uvs=UVS[::-1].copy(), corner_opacity=corners)
    casts = kernels.Opacity(**front), kernels.Opacity(**(front if back is None else back))
    seen = casts if seen is None else (kernels.Opacity(**seen),) * 2
    material = geometry.add_material(seen, casts)
    return geometry.add_instance(mesh, np.eye(4) if matrix is None else matrix, 0, [material])


def upright(count: int, half: float = 0.9) -> np.ndarray:
    """(count^2, 3) places on the plane z = 0, among them all on the squares' diagonals."""
    at = np.linspace(-half, half, count, dtype=np.float32)
    x, y = np.meshgrid(at, at)
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size, np.float32)], axis=1)


def through(accel, origins, direction=(0.0, 0.0, 1.0), casters=None) -> np.ndarray:
    directions = np.tile(np.array(direction, np.float32), (len(origins), 1))
    return accel.transmittance(casters, origins, directions, np.full(len(origins), INFINITE))


def accel_of(geometry):
    return kernels.Accel(geometry, np.zeros(3))


def bilinear(texels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Repeated, in float64."""
    height, width = texels.shape
    at = uv.astype(np.float64) % 1.0 * (width, height) - 0.5
    low = np.floor(at).astype(int)
    part = at - low

    def texel(x: int, y: int) -> np.ndarray:
        return texels[(low[:, 1] + y) % height, (low[:, 0] + x) % width].astype(np.float64)

    bottom = texel(0, 0) * (1.0 - part[:, 0]) + texel(1, 0) * part[:, 0]
    top = texel(0, 1) * (1.0 - part[:, 0]) + texel(1, 1) * part[:, 0]
    return bottom * (1.0 - part[:, 1]) + top * part[:, 1]


def test_light_gets_through_in_proportion():
    """Through five cards, also along their diagonals, where two triangles meet: each counts once."""
    geometry, expected = kernels.Geometry(), 1.0
    for number, value in enumerate((0.3, 0.5, 0.7, 0.1, 0.9)):
        card(geometry, 1.0 + number, {"value": value})
        expected *= 1.0 - value
    found = through(accel_of(geometry), upright(33))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_many_instances_of_one_tree_let_light_through_too():
    """Meshes beyond what is copied into one tree: here by so many triangles that it does not fit."""
    geometry = kernels.Geometry()
    side = 1450  # 4.2 million triangles, used twice
    at = np.linspace(-1.0, 1.0, side + 1, dtype=np.float32)
    x, y = np.meshgrid(at, at)
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size, np.float32)], axis=1)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    faces = np.stack([first, first + 1, first + side + 2, first + side + 1], axis=1).astype(np.int32)
    mesh = geometry.add_mesh(points, faces.ravel(), np.arange(0, faces.size + 1, 4, dtype=np.int32))
    opacity = kernels.Opacity(0.25)
    material = geometry.add_material((opacity, opacity), (opacity, opacity))
    for z in (1.0, 2.0):
        matrix = np.eye(4)
        matrix[2, 3] = z
        geometry.add_instance(mesh, matrix, 0, [material])
    accel = accel_of(geometry)
    assert accel.instanced_count() == 2
    found = through(accel, upright(40, 0.87))
    np.testing.assert_allclose(found, 0.75**2, rtol=1e-5)


def test_textures_and_corners_multiply_and_clips_clip():
    rng = np.random.default_rng(4)
    texels = rng.random((5, 7)).astype(np.float32)
    corners = np.array([0.2, 0.9, 0.6, 1.0], np.float32)  # in the order of the turned square
    origins = upright(29) * 0.7 + np.float32(0.013)
    origins[:, 2] = 0.0
    uv = 0.5 * origins[:, :2] + 0.5
    picture = bilinear(texels, uv)
    geometry = kernels.Geometry()
    card(geometry, 1.0, {"texels": texels})
    np.testing.assert_allclose(through(accel_of(geometry), origins), 1.0 - picture, atol=2e-6)
    geometry = kernels.Geometry()
    card(geometry, 1.0, {"texels": texels, "threshold": 0.5})
    np.testing.assert_array_equal(through(accel_of(geometry), origins), picture < 0.5)
    geometry = kernels.Geometry()
    card(geometry, 1.0, {"value": 0.8, "by_corner": True}, corners=corners)
    found = through(accel_of(geometry), origins)
    # Linear over each of the quad's two triangles: of corners 3, 2, 1 and 3, 1, 0 of the square.
    of = {tuple(place): factor for place, factor in zip(SQUARE[::-1].tolist(), corners, strict=True)}
    x, y = origins[:, :2].astype(np.float64).T
    a, b, c, d = (of[place] for place in ((-1, -1), (1, -1), (1, 1), (-1, 1)))

    def corner(at, along_x, along_y, from_x, from_y):
        """The plane through a corner's factor and those of its two neighbours."""
        return at + (along_x - at) * np.abs(x - from_x) / 2 + (along_y - at) * np.abs(y - from_y) / 2

    halves = [
        np.where(x + y < 0.0, corner(a, b, d, -1, -1), corner(c, d, b, 1, 1)),
        np.where(x > y, corner(b, a, c, 1, -1), corner(d, c, a, -1, 1)),
    ]
    off = min(np.abs(found - (1.0 - 0.8 * half)).max() for half in halves)
    assert off < 2e-6


@pytest.mark.parametrize("mirrored", [False, True])
def test_front_and_back_are_told_apart(mirrored):
    """The front stays where it is in object space, also of a mirrored instance, as in Cycles."""
    geometry = kernels.Geometry()
    matrix = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0, 1.0])
    card(geometry, 1.0, {"value": 0.2}, {"value": 0.6}, matrix=matrix)
    accel = accel_of(geometry)
    from_below = through(accel, upright(9))
    np.testing.assert_allclose(from_below, 0.8, rtol=1e-6)
    from_above = through(accel, upright(9) + np.array([0, 0, 3], np.float32), (0.0, 0.0, -1.0))
    np.testing.assert_allclose(from_above, 0.4, rtol=1e-6)
    # A map's rays of shadow come the other way.
    for z, expected in ((0.0, 0.6), (3.0, 0.2)):
        assert np.isfinite(drawn_depths(geometry, z, 4096)).mean() == pytest.approx(expected, abs=0.01)


def drawn_depths(geometry, z: float, samples: int) -> np.ndarray:
    """Depths of a map of 8 x 8 texels, straight up from below the cards or down from above."""
    forward = (0.0, 0.0, 1.0) if z == 0.0 else (0.0, 0.0, -1.0)
    right = (1.0, 0.0, 0.0)
    up = tuple(np.cross(forward, right).tolist())
    view = np.array([0, 0, z, *right, *up, *forward, -0.5, 0.5, -0.5, 0.5, 0.01, 10.0, 1.0])
    mask = np.ones(geometry.instance_count(), np.uint8)
    return np.array(
        [
            kernels.layered_depth(geometry, mask, view, 1, 8, 8, kept="drawn", draw=(7, sample))
            for sample in range(samples // 64)
        ]
    )


def test_visibility_weighs_each_ray_with_what_gets_through():
    geometry = kernels.Geometry()
    card(geometry, 1.0, {"value": 0.25}, matrix=np.diag([9.0, 9.0, 1.0, 1.0]))
    accel, points = accel_of(geometry), upright(5, 0.2)
    up = np.tile(np.array([0, 0, 1], np.float32), (len(points), 1))
    for light in LIGHTS:
        for count in (4, 64):
            arguments = accel, None, light.packed(), np.zeros(3), points, up, up, count, 5
            visibility, _ = kernels.ray_visibility(*arguments)
            np.testing.assert_allclose(visibility, 0.75, rtol=1e-5)
        many = np.tile(points, (400, 1)), np.tile(up, (400, 1)), np.tile(up, (400, 1))
        halves = kernels.ray_screen(accel, None, light.packed(), np.zeros(3), *many, 3)
        assert halves.mean() == pytest.approx(0.75, abs=0.015)  # five sigma of 20000 coins


def test_draws_are_those_that_are_written_down():
    """A fragment is there where an Owen-scrambled van der Corput sequence is below its opacity: as here, in
    numpy, and nowhere else."""
    geometry = kernels.Geometry()
    card(geometry, 1.0, {"value": 0.4})
    view = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, -0.5, 0.5, -0.5, 0.5, 0.01, 10.0, 1.0], np.float64)
    rows, columns = np.mgrid[:8, :8]
    seed, mask = 12345, np.ones(1, np.uint8)
    for sample in range(16):
        draw = seed, sample
        found = kernels.raster_surface(
            geometry, mask, view, 8, 8, attributes=["triangle", "depth"], draw=draw
        )
        everything = [chance(seed, sample, triangle, columns, rows) < 0.4 for triangle in (0, 1)]
        there = np.isfinite(found["depth"])
        # Whichever of the two triangles a pixel is in.
        assert ((there == everything[0]) | (there == everything[1])).all()
        hit = found["triangle"][there]
        assert np.take_along_axis(np.array(everything)[:, there], hit[None], axis=0).all()


def chance(seed: int, sample: int, triangle: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    state = pcg(pcg(seed ^ 0) ^ triangle)
    key = pcg(pcg(state ^ x.astype(np.uint32)) ^ y.astype(np.uint32))
    index = reverse(scrambled(reverse(np.full(key.shape, sample, np.uint32)), pcg(key)))
    bits = reverse(scrambled(index, key))
    return ((bits >> np.uint32(9)).astype(np.float32) + np.float32(0.5)) * np.float32(2.0**-23)


def reverse(bits: np.ndarray) -> np.ndarray:
    return sum(((bits >> np.uint32(i)) & np.uint32(1)) << np.uint32(31 - i) for i in range(32))


def scrambled(word: np.ndarray, key: np.ndarray) -> np.ndarray:
    word = word ^ word * np.uint32(0x3D20ADEA)
    word = (word + key) * ((key >> np.uint32(16)) | np.uint32(1))
    word ^= word * np.uint32(0x05526C56)
    return word ^ word * np.uint32(0x53A22864)


def test_maps_keep_what_is_whole_or_partial_or_drawn():
    """A wholly opaque card under a partial one and a clear one."""
    geometry = kernels.Geometry()
    for z, value in ((3.0, 1.0), (2.0, 0.5), (1.0, 0.0)):
        card(geometry, z, {"value": value})
    view = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, -0.5, 0.5, -0.5, 0.5, 0.01, 10.0, 1.0], np.float64)

    def layers(**kept) -> np.ndarray:
        return kernels.layered_depth(geometry, np.ones(3, np.uint8), view, 2, 32, 32, **kept)

    for kept, depth in (("whole", 3.0), ("partial", 2.0)):
        nearest, next_one = layers(kept=kept)
        assert (nearest == depth).all()
        assert np.isinf(next_one).all()
    drawn = np.array([layers(kept="drawn", draw=(3, sample)) for sample in range(8)])
    # Of two samples just one, of each texel.
    assert (((drawn[::2, 0] == 2.0) + (drawn[1::2, 0] == 2.0)) == 1).all()
    assert ((drawn[:, 0] == 2.0) == (drawn[:, 1] == 3.0)).all()
    assert ((drawn[:, 0] == 3.0) == np.isinf(drawn[:, 1])).all()
    with pytest.raises(ValueError, match="none of whole"):
        layers(kept="half")


def test_what_lies_over_one_another_is_drawn_by_itself():
    geometry = kernels.Geometry()
    for z, value in ((2.0, 0.5), (1.0, 0.3)):
        card(geometry, z, {"value": value})
    depths = drawn_depths(geometry, 0.0, 64 * 256)[:, 0]
    shares = [(depths == 1.0).mean(), (depths == 2.0).mean(), np.isinf(depths).mean()]
    np.testing.assert_allclose(shares, [0.3, 0.35, 0.35], atol=0.005)


def test_seen_and_casting_are_told_apart():
    geometry = kernels.Geometry()
    card(geometry, 1.0, {"value": 1.0}, seen={"value": 0.0})
    view = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, -0.5, 0.5, -0.5, 0.5, 0.01, 10.0, 1.0], np.float64)
    mask = np.ones(1, np.uint8)
    seen = kernels.raster_surface(geometry, mask, view, 8, 8, attributes=["depth"])
    assert np.isinf(seen["depth"]).all()
    assert (kernels.layered_depth(geometry, mask, view, 1, 8, 8) == 1.0).all()
    assert (through(accel_of(geometry), upright(5)) == 0.0).all()
