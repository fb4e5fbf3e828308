"""Tubes and spheres: as wide as what they stand for, smooth, whole, and finite whatever they are made of."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from strata.addon.scene.made_mesh import SIDES, Spheres, Strands, Tubes


def strands_of(points, radii=0.01, lengths=None):
    points = np.asarray(points, np.float32).reshape(-1, 3)
    lengths = [len(points)] if lengths is None else lengths
    radii = np.broadcast_to(np.asarray(radii, np.float32), len(points)).copy()
    return Strands(points, radii, np.concatenate([[0], np.cumsum(lengths)]))


def triangles(mesh):
    """(T, 3) vertices, of faces that all have as many corners."""
    sides = mesh.face_starts[1]
    faces = mesh.corner_vertices.reshape(-1, sides)
    assert (np.diff(mesh.face_starts) == sides).all()
    return np.concatenate([faces[:, [0, k, k + 1]] for k in range(1, sides - 1)])


def face_normals(mesh):
    """(T, 3), twice the areas long."""
    a, b, c = np.moveaxis(mesh.positions[triangles(mesh)].astype(np.float64), 1, 0)
    return np.cross(b - a, c - a)


@pytest.mark.parametrize(("count", "sides"), [(5000, 8), (20_000, 5), (210_000, 3)])
def test_a_tube_is_as_wide_as_a_round_one_on_the_mean(count, sides):
    """Straight strands along z: for any one light across them."""
    points = np.zeros((count, 2, 3))
    points[:, 1, 2] = 1.0
    tubes = Tubes("straight", strands_of(points, 0.25, [2] * count))
    assert (tubes.sides, tubes.triangles, tubes.vertices) == (sides, 2 * sides * count, 2 * sides * count)
    mesh = tubes.arrays(True, False)
    assert len(triangles(mesh)) == tubes.triangles
    assert len(mesh.positions) == tubes.vertices
    rings = mesh.positions.reshape(count, 2, sides, 3)
    for direction in ((1.0, 0.0, 0.0), (0.6, 0.8, 0.0)):
        along = rings @ np.float32(direction)
        widths = along.max(axis=(1, 2)) - along.min(axis=(1, 2))
        assert widths.mean() == pytest.approx(0.5, rel=1e-3)
        # The project's goal for soft shadows is .03 of the light; a single hair is off by less than its rim.
        assert np.abs(widths / 0.5 - 1.0).max() < 0.12


@pytest.mark.parametrize(("count", "faces"), [(500, 320), (1000, 80), (30_000, 20)])
def test_a_sphere_takes_as_much_light_as_a_round_one_on_the_mean(count, faces):
    points = np.random.default_rng(1).normal(size=(count, 3)).astype(np.float32)
    spheres = Spheres("points", points, np.full(count, 0.25, np.float32))
    mesh = spheres.arrays(True, False)
    assert spheres.triangles == len(triangles(mesh)) == faces * count
    assert len(mesh.positions) == spheres.vertices
    for direction in ((0.0, 0.0, 1.0), (0.48, 0.6, 0.64)):
        facing = 0.5 * (face_normals(mesh) @ np.array(direction))
        assert facing[facing > 0.0].sum() / count == pytest.approx(math.pi * 0.25**2, rel=1e-3)
    centres = np.repeat(points, len(mesh.positions) // count, axis=0)
    assert np.linalg.norm(mesh.positions - centres, axis=1).max() < 0.25 * 1.16
    outward = np.repeat(points, faces, axis=0)
    middles = mesh.positions[triangles(mesh)].mean(axis=1) - outward
    assert (np.einsum("ni,ni->n", face_normals(mesh), middles) > 0.0).all()
    assert np.linalg.norm(mesh.corner_normals, axis=1) == pytest.approx(1.0, abs=1e-5)
    assert np.allclose(spheres.box, [mesh.positions.min(axis=0), mesh.positions.max(axis=0)], atol=0.05)
    assert (spheres.box[0] <= mesh.positions.min(axis=0)).all()


def knot(count=400):
    """(count, 3): a trefoil, which goes in every direction."""
    t = np.linspace(0.0, math.tau, count)
    return np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1)


@pytest.mark.parametrize("turned", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_a_tube_is_nowhere_pinched(turned):
    """Sides stay as far from the strand as they are at rest, whichever way it goes."""
    points = knot()[:, turned]
    mesh = Tubes("knot", strands_of(points, 0.01)).arrays(True, False)
    sides = SIDES[0]
    around = math.pi / (sides * math.sin(math.pi / sides)) * 0.01
    rings = mesh.positions.reshape(len(points), sides, 3)
    assert np.linalg.norm(rings - points[:, None], axis=2) == pytest.approx(around, rel=1e-3)
    middles = 0.5 * (rings[1:] + rings[:-1]) - 0.5 * (points[1:] + points[:-1])[:, None]
    assert np.linalg.norm(middles, axis=2).min() > 0.9 * around
    # Faces look outward, and normals are those of the round tube.
    outward = (mesh.positions - np.repeat(points, sides, axis=0)) / around
    assert np.allclose(mesh.corner_normals, outward[mesh.corner_vertices], atol=1e-3)
    a = triangles(mesh)
    assert (np.einsum("ni,ni->n", face_normals(mesh), outward[a].mean(axis=1)) > 0.0).all()


def test_strands_do_not_touch_each_other():
    lengths = [2, 5, 3]
    points = np.random.default_rng(2).normal(size=(10, 3))
    together = Tubes("all", strands_of(points, 0.01, lengths)).arrays(False, False)
    assert together.corner_normals is None
    at = np.repeat(np.arange(3), lengths)
    of_face = at[together.corner_vertices.reshape(-1, 4) // SIDES[0]]
    assert (of_face == of_face[:, :1]).all()
    assert np.bincount(of_face[:, 0]).tolist() == [SIDES[0] * (length - 1) for length in lengths]


def catmull_rom(p, t):
    """By Barry's and Goldman's pyramid, float64, of four points at knots -1, 0, 1, 2."""
    knots = (-1.0, 0.0, 1.0, 2.0)

    def mixed(a, b, low, high):
        return ((high - t) * a + (t - low) * b) / (high - low)

    a = [mixed(p[i], p[i + 1], knots[i], knots[i + 1]) for i in range(3)]
    b = [mixed(a[i], a[i + 1], knots[i], knots[i + 2]) for i in range(2)]
    return mixed(b[0], b[1], knots[1], knots[2])


def test_bent_strands_are_rounded_as_catmull_rom():
    lengths = [4, 2, 5]
    points = np.random.default_rng(3).normal(size=(11, 3))
    radii = np.linspace(0.01, 0.02, 11)
    found = strands_of(points, radii, lengths).rounded(4)
    assert found.lengths.tolist() == [13, 5, 17]
    values = np.column_stack([points, radii])
    first = np.concatenate([[0], np.cumsum(lengths)])
    for strand, (low, high) in enumerate(pairwise(first)):
        own = np.concatenate([values[low : low + 1], values[low:high], values[high - 1 : high]])
        expected = [catmull_rom(own[k : k + 4], t) for k in range(len(own) - 3) for t in (0, 0.25, 0.5, 0.75)]
        expected.append(own[-1])
        made = slice(found.starts[strand], found.starts[strand + 1])
        assert np.allclose(found.points[made], np.array(expected)[:, :3], atol=1e-5)
        assert np.allclose(found.radii[made], np.array(expected)[:, 3], atol=1e-5)


def test_straight_strands_stay_as_they_are():
    """Those that bend by little of their width too."""
    straight = strands_of(np.linspace((0, 0, 0), (1, 2, 3), 9))
    assert straight.rounded(8) is straight
    bent = np.linspace((0, 0, 0), (1, 0, 0), 9)
    bent[:, 2] = 0.1 * bent[:, 0] ** 2
    assert len(strands_of(bent, 0.05).rounded(8).points) == 9
    assert len(strands_of(bent, 1e-5).rounded(8).points) > 9


@pytest.mark.parametrize(
    ("bend", "points"),
    [(0.0, 2), (3e-3, 3), (0.02, 5), (0.3, 17), (5.0, 33)],
)
def test_many_hairs_lose_points_that_tell_nothing(bend, points):
    """Parabolas of 33 points, which are off their chord by a quarter of `bend`; ends stay."""
    count, t = 20_000, np.linspace(0.0, 1.0, 33)
    whole = np.zeros((count, 33, 3))
    whole[..., 0], whole[..., 1] = t, bend * t**2
    whole[..., 2] = np.arange(count)[:, None]
    strands = strands_of(whole, 1e-3, [33] * count)
    thin = strands.thinned()
    assert thin.lengths.tolist() == [points] * count
    assert np.allclose(thin.points.reshape(count, points, 3), whole[:, :: 32 // (points - 1)])
    assert thin.rounded(4) is thin or points == 33
    assert strands_of(whole[:100], 1e-3, [33] * 100).thinned().lengths[0] == 33  # few: all are kept


def test_hairs_keep_points_that_widths_hang_on():
    count = 20_000
    whole = np.zeros((count, 9, 3))
    whole[..., 0] = np.linspace(0.0, 1.0, 9)
    for widths, points in ((np.linspace(2.0, 1.0, 9), 2), (np.array([1.0] * 4 + [3.0] + [1.0] * 4), 9)):
        assert strands_of(whole, np.tile(widths, count), [9] * count).thinned().lengths[0] == points


def test_what_cannot_be_used_is_left_out():
    points = np.arange(33.0).reshape(11, 3)
    points[3, 1] = math.nan
    radii = np.full(11, 0.1)
    radii[4:6] = 0.0
    radii[9] = math.inf
    strands = strands_of(points, radii, [2, 2, 2, 1, 2, 2])
    strands = Strands(strands.points, strands.radii, strands.starts, lambda: np.arange(12.0).reshape(6, 2))
    usable = strands.usable()
    assert usable.points.tolist() == points[[0, 1, 7, 8]].tolist()
    assert usable.lengths.tolist() == [2, 2]
    assert usable.uvs().tolist() == [[0.0, 1.0], [8.0, 9.0]]


def test_extreme_strands_are_finite():
    """Points in one place, far away, next to nothing wide, back and forth."""
    points = (
        [(0, 0, 0)] * 4
        + [(1e7, 0, 0), (1e7, 1, 0), (1e7, 0, 0), (1e7, 1, 0)]
        + [(0, 0, 1e-30), (0, 0, 2e-30)]
    )
    strands = strands_of(points, [0.1] * 4 + [1e-20] * 4 + [1e20] * 2, [4, 4, 2]).rounded(8)
    mesh = Tubes("extreme", strands).arrays(True, False)
    assert np.isfinite(mesh.positions).all()
    assert np.isfinite(mesh.corner_normals).all()


def test_many_hairs_are_few_triangles_each():
    """300,000 hairs of nine points, which bend: six triangles a segment, 24 MB for a million of them without
    normals; more pieces than points there are not."""
    count, steps = 300_000, 9
    t = np.linspace(0.0, 1.0, steps, dtype=np.float32)
    points = np.zeros((count, steps, 3), np.float32)
    points[..., 0] = np.arange(count)[:, None]
    points[..., 1], points[..., 2] = np.sin(5.0 * t), t
    strands = strands_of(points, 0.001, [steps] * count).rounded(4)
    tubes = Tubes("fur", strands)
    assert tubes.triangles == 6 * count * (steps - 1)
    mesh = tubes.arrays(False, False)
    assert len(mesh.corner_vertices) == 2 * tubes.triangles
    assert mesh.nbytes < 24.0 * tubes.triangles


def test_attributes_are_linear_between_the_points_that_there_were():
    """Values that count points: of what is left out, rounded and thinned they tell where it was."""
    points = np.random.default_rng(4).normal(size=(12, 3))
    points[4] = math.nan
    strands = strands_of(points, 0.01, [3, 3, 2, 4])
    values = {"point": (np.arange(12.0)[:, None], True), "curve": (10.0 * np.arange(4.0)[:, None], False)}
    rounded = replace(strands, attributes=values.get).usable().rounded(4)
    assert rounded.lengths.tolist() == [9, 5, 13]
    expected = [*np.linspace(0, 2, 9), *np.linspace(6, 7, 5), *np.linspace(8, 11, 13)]
    assert rounded.attribute("point")[:, 0] == pytest.approx(expected)
    assert rounded.attribute("curve")[:, 0].tolist() == [0.0] * 9 + [20.0] * 5 + [30.0] * 13
    assert rounded.attribute("other") is None
    tubes = Tubes("some", rounded)
    mesh = tubes.arrays(False, False)
    found = tubes.attribute("point", mesh.corner_vertices)[:, 0]
    along = mesh.positions.reshape(-1, tubes.sides, 3).mean(axis=1)  # the point of each ring
    places = {tuple(np.round(place, 4)): value for place, value in zip(along, expected, strict=True)}
    corners = along[mesh.corner_vertices // tubes.sides]
    assert found == pytest.approx([places[tuple(np.round(place, 4))] for place in corners])
    count, line = 20_000, np.zeros((20_000, 9, 3))
    line[..., 0] = np.linspace(0.0, 1.0, 9)
    values = {"point": (np.arange(9.0 * count)[:, None], True)}
    many = replace(strands_of(line, 1e-3, [9] * count), attributes=values.get).thinned()
    assert many.attribute("point").reshape(count, 2).tolist() == [[9 * n, 9 * n + 8] for n in range(count)]


def test_attributes_of_spheres_are_those_of_their_points():
    points = 3.0 * np.arange(15, dtype=np.float32).reshape(5, 3)
    values = {"size": (np.arange(5.0)[:, None], True)}
    spheres = Spheres("some", points, np.full(5, 0.1, np.float32), values.get)
    mesh = spheres.arrays(False, False)
    found = spheres.attribute("size", mesh.corner_vertices)[:, 0].astype(int)
    away = np.linalg.norm(mesh.positions[mesh.corner_vertices] - points[found], axis=1)
    assert away.max() < 0.2
    assert spheres.attribute("other", mesh.corner_vertices) is None
