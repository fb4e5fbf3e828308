"""Rays against Embree, and at the edges of what float32 holds."""

import numpy as np
import pytest
import strata_kernels as kernels
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.tests.kernels.ray_scenes import accel_of, add_triangles, quad

UP = np.array([[0.0, 0.0, 1.0]])


def torus(major, minor, rings, sides):
    """Triangles (T, 3, 3) of a closed torus whose neighbours share their vertices' bits."""
    a, b = np.meshgrid(np.arange(rings), np.arange(sides), indexing="ij")
    angle, turn = 2.0 * np.pi * a / rings, 2.0 * np.pi * b / sides
    radius = major + minor * np.cos(turn)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), minor * np.sin(turn)], -1)
    points = points.astype(np.float32).reshape(-1, 3)
    corner = [
        ((a + i) % rings * sides + (b + j) % sides).ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    p, q, r, s = corner
    return points[np.concatenate([np.stack([p, q, r], 1), np.stack([p, r, s], 1)])]


def rotation(generator):
    q, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    return q


def directions(generator, count):
    d = generator.normal(size=(count, 3))
    return (d / np.linalg.norm(d, axis=1)[:, None]).astype(np.float32)


def exact_edge_distance(triangles, origins, directions):
    """Smallest sine between each ray and the planes through its origin and any triangle's edge, near the
    triangle; float64. Below float32's rounding the answer is anybody's."""
    o, d = origins.astype(np.float64), directions.astype(np.float64)
    nearest = np.full(len(o), np.inf)
    for corners in triangles.astype(np.float64):
        a = corners[None] - o[:, None]
        n = np.cross(a, np.roll(a, -1, 1))
        n /= np.maximum(np.linalg.norm(n, axis=2, keepdims=True), 1e-300)
        side = np.einsum("nkc,nc->nk", n, d)
        signed = np.sign(np.einsum("nc,nc->n", a[:, 0], np.cross(a[:, 1], a[:, 2])))[:, None] * side
        # Only rays that pass this edge while inside, or nearly, of the other two.
        nearest = np.minimum(nearest, np.where(np.sort(signed, 1)[:, 1] > -1e-5, np.abs(side).min(1), np.inf))
    return nearest


def embree_of(triangles):
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(triangles, np.float32))
    return scene


@pytest.mark.parametrize("shared_origin", [False, True])
def test_hits_of_a_triangle_soup_are_embrees(shared_origin):
    generator = np.random.default_rng(2)
    soup = (generator.uniform(-1, 1, (400, 1, 3)) + generator.normal(0, 0.2, (400, 3, 3))).astype(np.float32)
    count = 32768
    origins = generator.uniform(-1.5, 1.5, (count, 3)).astype(np.float32)
    if shared_origin:  # runs of sixteen take another path
        origins = np.repeat(origins[: count // 16], 16, axis=0)
    d = directions(generator, count)
    t_max = generator.uniform(0.1, 3.0, count).astype(np.float32)
    accel, scene = accel_of(soup), embree_of(soup)
    free = np.full(count, np.inf, np.float32)

    occluded = accel.transmittance(None, origins, d, t_max) == 0.0
    t, instance, triangle = accel.nearest(None, origins, d, free)
    expected = scene.run(origins, d, query="INTERSECT")
    distance = scene.run(origins, d, query="DISTANCE")

    wrong = np.flatnonzero(triangle != expected)
    # All disagreements are rays that pass an edge within float32's rounding (or two hits at one distance).
    assert len(wrong) <= 3
    assert np.all(exact_edge_distance(soup, origins[wrong], d[wrong]) < 1e-6)
    hit = (expected >= 0) & (triangle == expected)
    assert 0.2 < hit.mean() < 0.9
    # Grazing hits lose digits in both, and near ones keep the origin's absolute rounding.
    np.testing.assert_allclose(t[hit], distance[hit], rtol=2e-4, atol=1e-6)
    assert np.all(instance[hit] == 0)
    clear = np.abs(distance - t_max) > 1e-4
    np.testing.assert_array_equal(occluded[clear & hit], (distance < t_max)[clear & hit])
    assert not occluded[expected < 0].any() or len(wrong)


def test_a_closed_surface_leaks_nothing():
    """Rays from the hollow of a tube, aimed at vertices, at edges and anywhere, all hit."""
    surface = torus(1.0, 0.3, 64, 32)
    generator = np.random.default_rng(3)
    angle = generator.uniform(0, 2 * np.pi, 200000)
    inside = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], 1)
    inside += generator.uniform(-0.05, 0.05, inside.shape)
    pick = surface[generator.integers(0, len(surface), 200000)].astype(np.float64)
    share = generator.uniform(0, 1, len(inside))[:, None]
    vertex, edge = pick[:, 0], pick[:, 0] * share + pick[:, 1] * (1 - share)
    accel = accel_of(surface)
    for target in (vertex, edge, inside + directions(generator, len(inside))):
        origins = inside.astype(np.float32)
        d = (target - origins).astype(np.float32)
        assert not accel.transmittance(None, origins, d, np.full(len(d), np.inf, np.float32)).any()


def test_instances_give_the_hits_of_their_copies():
    """More triangles than the flat tree takes, so that the mesh gets its own tree; a few copies do not."""
    generator = np.random.default_rng(4)
    shape = torus(0.5, 0.2, 384, 192)  # 147,456 triangles, 40 times: above the budget of 4 million
    origin = np.array([1e4, 0.0, 0.0])
    placed = kernels.Geometry()
    placed.add_material()
    mesh = placed.add_mesh(
        shape.reshape(-1, 3),
        np.arange(3 * len(shape), dtype=np.int32),
        np.arange(0, 3 * len(shape) + 1, 3, dtype=np.int32),
    )
    for _ in range(40):
        matrix = np.eye(4)
        matrix[:3, :3] = rotation(generator) * generator.uniform(0.3, 1.5, 3)
        matrix[:3, 3] = generator.uniform(-4, 4, 3) + origin
        placed.add_instance(mesh, matrix, 0, [0])
    accel = kernels.Accel(placed, origin)
    assert accel.instanced_count() == 40
    assert accel.triangle_count() == len(shape)

    subset = np.zeros(40, np.uint8)
    subset[:4] = 1  # few enough to be copied
    flat = kernels.Accel(placed, origin, subset)
    assert flat.instanced_count() == 0
    count = 16384
    o = generator.uniform(-4, 4, (count, 3)).astype(np.float32)
    o = np.concatenate([o, np.repeat(o[: count // 16], 16, axis=0)])
    d = directions(generator, len(o))
    t_max = np.full(len(o), np.inf, np.float32)
    t, instance, _ = accel.nearest(subset, o, d, t_max)
    t_flat, instance_flat, _ = flat.nearest(None, o, d, t_max)
    same = instance == instance_flat
    # Silhouettes: the two round vertices differently, in object space and relative to the origin.
    assert (~same).sum() <= 4
    hit = same & (instance >= 0)
    assert 0.02 < hit.mean() < 0.9
    np.testing.assert_allclose(t[hit], t_flat[hit], rtol=1e-3)
    np.testing.assert_array_equal(
        accel.transmittance(subset, o, d, t_max)[same], flat.transmittance(None, o, d, t_max)[same]
    )


def test_only_casters_cast():
    geometry = kernels.Geometry()
    plate = quad([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])
    add_triangles(geometry, plate)
    add_triangles(geometry, plate + UP)
    accel = kernels.Accel(geometry, np.zeros(3))
    ray = np.zeros((1, 3), np.float32), np.array([[0, 0.1, 1]], np.float32), np.array([1.5], np.float32)
    assert accel.transmittance(None, *ray)[0] == 0.0
    assert accel.transmittance(np.array([1, 0], np.uint8), *ray)[0] == 0.0
    assert accel.transmittance(np.array([0, 1], np.uint8), *ray)[0] == 1.0  # t_max ends before the second
    assert accel.nearest(np.array([0, 1], np.uint8), *ray[:2], np.array([3], np.float32))[1][0] == 1
    only_second = kernels.Accel(geometry, np.zeros(3), np.array([0, 1], np.uint8))
    assert only_second.triangle_count() == 2
    with pytest.raises(ValueError, match="2 instances"):
        accel.transmittance(np.array([1], np.uint8), *ray)


def test_alpha_clip_lets_light_through():
    """A plate whose texture is opaque in its left half only."""
    geometry = kernels.Geometry()
    corners = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], np.float64)
    uvs = ((corners[:, :2] + 1) / 2)[[0, 1, 2, 0, 2, 3]].astype(np.float32)
    texels = np.repeat(np.array([[1, 1, 0, 0]], np.float32), 4, axis=0)
    add_triangles(geometry, quad(corners), uvs=uvs, threshold=0.5, texels=texels)
    accel = kernels.Accel(geometry, np.zeros(3))
    x = np.linspace(-0.7, 0.7, 32, dtype=np.float32)
    d = np.stack([x, 0.3 * np.ones_like(x), np.ones_like(x)], 1)
    through = accel.transmittance(None, np.zeros_like(d), d, np.full(32, 9, np.float32))
    np.testing.assert_array_equal(through, x >= 0)


def test_bad_geometry_is_left_out():
    geometry = kernels.Geometry()
    far = quad([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])
    line = np.array([[[0, 0, 1], [1, 0, 1], [2, 0, 1]]], np.float64)
    add_triangles(geometry, np.concatenate([far, line, line * np.nan, line * 1e20]))
    singular = np.eye(4)
    singular[2, 2] = 0.0
    add_triangles(geometry, far, singular)
    accel = kernels.Accel(geometry, np.zeros(3))
    assert accel.triangle_count() == 2
    empty = kernels.Accel(kernels.Geometry(), np.zeros(3))
    o = np.array([[0, 0, 0], [np.nan, 0, 0], [0, 0, 0], [0, 0, 0]], np.float32)
    d = np.array([[0, 0.1, 1], [0, 0, 1], [np.inf, 0, 1], [0, 0, 0]], np.float32)
    t_max = np.array([np.inf, 9, 9, 9], np.float32)
    np.testing.assert_array_equal(accel.transmittance(None, o, d, t_max), [0.0, 1.0, 1.0, 1.0])
    assert (empty.transmittance(None, o, d, t_max) == 1.0).all()
    with pytest.raises(ValueError, match="finite"):
        kernels.Accel(geometry, np.array([0, np.inf, 0]))


@pytest.mark.parametrize("offset", [0.0, 1e7])
@pytest.mark.parametrize("size", [1.0, 1e5])
def test_surfaces_do_not_shadow_themselves(offset, size):
    """A dense or huge floor and a tilted one, seen from 5 m, rays leaving at grazing angles."""
    generator = np.random.default_rng(5)
    frame = rotation(generator)
    cells = 24
    line = (np.arange(cells + 1) / cells * 2 - 1) * size
    x, y = np.meshgrid(line, line)
    grid = np.stack([x, y, 0 * x], -1) @ frame.T + offset
    floor = np.concatenate(
        [
            np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:]], 2).reshape(-1, 3, 3),
            np.stack([grid[:-1, :-1], grid[1:, 1:], grid[1:, :-1]], 2).reshape(-1, 3, 3),
        ]
    )
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    geometry = kernels.Geometry()
    add_triangles(geometry, floor - offset, matrix)
    normal = frame[:, 2]
    eye = frame @ [0.3, 0.2, 5.0] + offset
    count = 4000
    at = np.concatenate([generator.uniform(-0.9, 0.9, (count, 2)), np.zeros((count, 1))], 1)
    points = at @ frame.T + offset
    position = (points - eye).astype(np.float32)
    normals = np.tile(normal, (count, 1)).astype(np.float32)
    # A sun one degree above the horizon.
    forward = -(frame @ [np.cos(0.017), 0, np.sin(0.017)])
    right = frame[:, 1]
    sun = Emitter(EmitterKind.DISTANT_DISK, (0, 0, 0), right, np.cross(right, forward), forward, 0.005, 0.005)
    accel = kernels.Accel(geometry, eye)
    v, w = kernels.ray_visibility(accel, None, sun.packed(), eye, position, normals, normals, 16, 1)
    assert np.all(w > 0)
    assert np.all(v == 1)


@pytest.mark.parametrize("is_distant", [False, True])
def test_rays_towards_a_place_end_there_and_ask_only_where_it_matters(is_distant):
    """Points on a floor under a square plate, 1 m up, and another above the lamp."""
    plates = [quad([[-a, -a, z], [a, -a, z], [a, a, z], [-a, a, z]]) for a, z in ((0.5, 1.0), (0.7, 4.0))]
    accel = accel_of(np.concatenate(plates))
    generator = np.random.default_rng(3)
    position = generator.uniform(-2.0, 2.0, (40, 50, 3)).astype(np.float32)
    position[..., 2] = 0.0
    up = np.broadcast_to(UP[0].astype(np.float32), position.shape).copy()
    place = np.array([0.6, 0.0, 0.8]) if is_distant else np.array([0.3, -0.2, 2.0])
    towards = np.broadcast_to(place, position.shape) if is_distant else place - position
    at_plate = position + towards / towards[..., 2:]
    hidden = (np.abs(at_plate[..., :2]) < 0.5).all(axis=-1)
    if is_distant:
        hidden |= (np.abs((position + 4.0 * towards / towards[..., 2:])[..., :2]) < 0.7).all(axis=-1)
    seen = kernels.rays_towards(accel, None, place, is_distant, position, up, up)
    np.testing.assert_array_equal(seen, np.where(hidden, 0.0, 1.0))
    assert 50 < hidden.sum() < 500
    # No shadow where shading looks away, nothing but shadow where only the geometry does.
    assert (kernels.rays_towards(accel, None, place, is_distant, position, up, -up) == 1.0).all()
    assert (kernels.rays_towards(accel, None, place, is_distant, position, -up, up) == 0.0).all()
    assert (
        kernels.rays_towards(accel, np.zeros(1, np.uint8), place, is_distant, position, up, up) == 1.0
    ).all()
    with pytest.raises(ValueError, match="one size"):
        kernels.rays_towards(accel, None, place, is_distant, position, up[1:], up)
    flag = kernels.CancelFlag()
    flag.set()
    with pytest.raises(kernels.Cancelled):
        kernels.rays_towards(accel, None, place, is_distant, position, up, up, cancel=flag)


@pytest.mark.parametrize("shared", [False, True])  # one mesh for all, a tree of its own, or a mesh each
@pytest.mark.parametrize("count", [2, 40])
def test_of_copies_at_one_place_the_first_is_hit(count, shared):
    """As the rasteriser has it: the lowest instance of those equally near, wherever a tree puts them."""
    generator = np.random.default_rng(8)
    triangles = torus(1.5, 0.5, 24, 16)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation(generator), (0.2, -0.1, -6.0)
    corners = np.arange(3 * len(triangles), dtype=np.int32)
    starts = np.arange(0, 3 * len(triangles) + 1, 3, dtype=np.int32)
    geometry = kernels.Geometry()
    material = geometry.add_material()
    for index in range(count):
        if index == 0 or not shared:
            mesh = geometry.add_mesh(triangles.reshape(-1, 3), corners, starts)
        geometry.add_instance(mesh, matrix, 1, [material])
    accel = kernels.Accel(geometry, np.zeros(3))
    towards = np.concatenate([generator.uniform(-0.3, 0.3, (4000, 2)), np.full((4000, 1), -1.0)], axis=1)
    rays = np.zeros((4000, 3), np.float32), towards.astype(np.float32), np.full(4000, np.inf, np.float32)
    for first in (0, 1):
        some = (np.arange(count) >= first).astype(np.uint8)
        t, instance, _ = accel.nearest(some, *rays)
        assert np.isfinite(t).mean() > 0.5
        assert (instance[np.isfinite(t)] == first).all()
