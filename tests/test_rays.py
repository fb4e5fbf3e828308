"""Rays against Embree, against closed forms, and at the edges of what float32 holds."""

import closed_forms
import numpy as np
import pytest
import strata_kernels as kernels
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from strata.addon.core.emitter import Emitter, EmitterKind

AXES = {"right": (1.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0), "forward": (0.0, 0.0, -1.0)}
LIGHTS = [
    Emitter(EmitterKind.RECTANGLE, (0, 0, 3), **AXES, half_width=0.75, half_height=0.5),
    Emitter(EmitterKind.ELLIPSE, (0, 0, 3), **AXES, half_width=0.75, half_height=0.5),
    Emitter(EmitterKind.SPHERE, (0, 0, 3), **AXES, half_width=0.75, half_height=0.75),
    Emitter(EmitterKind.FACING_DISK, (0, 0, 3), **AXES, half_width=0.75, half_height=0.75),
    Emitter(EmitterKind.DISTANT_DISK, (0, 0, 0), **AXES, half_width=0.3, half_height=0.3),
]
UP = np.array([[0.0, 0.0, 1.0]])


def add_triangles(geometry, triangles, matrix=None, **material):
    """Adds (T, 3, 3) triangles as a mesh of their own; returns the instance's index."""
    triangles = np.ascontiguousarray(triangles, np.float32)
    count = len(triangles)
    mesh = geometry.add_mesh(
        triangles.reshape(-1, 3),
        np.arange(3 * count, dtype=np.int32),
        np.arange(0, 3 * count + 1, 3, dtype=np.int32),
        corner_uvs=material.pop("uvs", None),
    )
    slot = geometry.add_material(**material)
    return geometry.add_instance(mesh, np.eye(4) if matrix is None else matrix, 0, [slot])


def accel_of(triangles, origin=(0.0, 0.0, 0.0)):
    geometry = kernels.Geometry()
    add_triangles(geometry, triangles)
    return kernels.Accel(geometry, np.array(origin, np.float64))


def quad(corners):
    corners = np.asarray(corners, np.float64)
    return corners[[[0, 1, 2], [0, 2, 3]]]


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

    occluded = accel.occluded(None, origins, d, t_max)
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
        assert accel.occluded(None, origins, d, np.full(len(d), np.inf, np.float32)).all()


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
        accel.occluded(subset, o, d, t_max)[same], flat.occluded(None, o, d, t_max)[same]
    )


def test_only_casters_cast():
    geometry = kernels.Geometry()
    plate = quad([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])
    add_triangles(geometry, plate)
    add_triangles(geometry, plate + UP)
    accel = kernels.Accel(geometry, np.zeros(3))
    ray = np.zeros((1, 3), np.float32), np.array([[0, 0.1, 1]], np.float32), np.array([1.5], np.float32)
    assert accel.occluded(None, *ray)[0]
    assert accel.occluded(np.array([1, 0], np.uint8), *ray)[0]
    assert not accel.occluded(np.array([0, 1], np.uint8), *ray)[0]  # t_max ends before the second
    assert accel.nearest(np.array([0, 1], np.uint8), *ray[:2], np.array([3], np.float32))[1][0] == 1
    only_second = kernels.Accel(geometry, np.zeros(3), np.array([0, 1], np.uint8))
    assert only_second.triangle_count() == 2
    with pytest.raises(ValueError, match="2 instances"):
        accel.occluded(np.array([1], np.uint8), *ray)


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
    shadow = accel.occluded(None, np.zeros_like(d), d, np.full(32, 9, np.float32))
    np.testing.assert_array_equal(shadow, x < 0)


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
    np.testing.assert_array_equal(accel.occluded(None, o, d, t_max), [True, False, False, False])
    assert not empty.occluded(None, o, d, t_max).any()
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


def plate_scene():
    plates = [
        np.array([[-0.5, -0.3, 1.0], [0.5, -0.3, 1.0], [0.5, 0.6, 1.2], [-0.5, 0.6, 1.2]]),
        np.array([[-0.1, -0.6, 1.6], [0.4, -0.6, 1.6], [0.4, 0.2, 1.6], [-0.1, 0.2, 1.6]]),
    ]
    eye = np.array([2.0, 3.0, 4.0])
    return plates, eye, accel_of(np.concatenate([quad(p) for p in plates]), eye)


@pytest.mark.parametrize("light", LIGHTS, ids=lambda light: light.kind.name)
def test_visibility_of_two_plates_converges_to_the_closed_form(light):
    plates, eye, accel = plate_scene()
    generator = np.random.default_rng(6)
    count = 600
    points = np.concatenate([generator.uniform(-1, 1, (count, 2)), np.zeros((count, 1))], 1)
    # Tilted shading normals put the light partly below their horizon.
    shading = UP + generator.uniform(-0.6, 0.6, (count, 3)) * [1, 1, 0]
    shading /= np.linalg.norm(shading, axis=1)[:, None]
    expected, irradiance = closed_forms.visibility(light, points, shading, plates)
    position = (points - eye).astype(np.float32)
    geometric = np.tile(UP, (count, 1)).astype(np.float32)
    errors = []
    for samples in (16, 256):
        v, w = kernels.ray_visibility(
            accel, None, light.packed(), eye, position, geometric, shading.astype(np.float32), samples, 7
        )
        errors.append(np.sqrt(np.mean((v - expected) ** 2)))
    # Random samples would err by 0.1 and 0.025; these are stratified. No bias: the mean is four sigmas close.
    assert errors[0] < 0.045
    assert errors[1] < 0.007
    assert abs(np.mean(v - expected)) < 4 * errors[1] / np.sqrt(count)
    np.testing.assert_allclose(w.mean(), irradiance.mean(), rtol=3e-4)


@pytest.mark.parametrize("samples", [1, 4, 7, 8, 16, 100])
def test_any_number_of_samples_is_free_of_bias(samples):
    plates, eye, accel = plate_scene()
    point = np.array([[0.6, 0.4, 0.0]])
    expected, irradiance = closed_forms.visibility(LIGHTS[0], point, UP, plates)
    assert 0.3 < expected[0] < 0.7
    count = 40000 // samples
    position = np.repeat(point - eye, count, axis=0).astype(np.float32)
    up = np.repeat(UP, count, axis=0).astype(np.float32)
    v, w = kernels.ray_visibility(accel, None, LIGHTS[0].packed(), eye, position, up, up, samples, 3)
    arrived = (v.astype(np.float64) * w).mean()
    sigma = (v * w).std() / np.sqrt(count)
    # The ratio of the sums is biased for few samples; numerator and denominator are not.
    assert abs(arrived - expected[0] * irradiance[0]) < 4 * sigma
    assert abs(w.mean() - irradiance[0]) < 4 * w.std() / np.sqrt(count) + 1e-4 * irradiance[0]


def test_two_single_rays_estimate_a_mean_square_error():
    plates, eye, accel = plate_scene()
    generator = np.random.default_rng(8)
    count = 60000
    points = np.concatenate([generator.uniform(-1, 1, (count, 2)), np.zeros((count, 1))], 1)
    position, up = (points - eye).astype(np.float32), np.tile(UP, (count, 1)).astype(np.float32)
    some = slice(0, 1000)
    for light in LIGHTS[0], LIGHTS[3]:
        true, _ = closed_forms.visibility(light, points[some], np.tile(UP, (1000, 1)), plates)
        v, _ = kernels.ray_visibility(accel, None, light.packed(), eye, position, up, up, 256, 1)
        both = kernels.ray_screen(accel, None, light.packed(), eye, position, up, up, 2).astype(np.float64)
        assert both.shape == (count, 2)
        # A wrong layer: every shadow 0.05 too dark. v stands in for the truth, to 0.005.
        layer = v - 0.05
        estimate = ((layer[:, None] - both).prod(1)).mean()
        assert abs(estimate - 0.05**2) < 1e-3
        assert abs(both.mean() - v.mean()) < 4 * 0.5 / np.sqrt(2 * count)
        assert abs(true.mean() - v[some].mean()) < 1e-3


def test_screening_rays_are_not_biased_by_their_candidates():
    """The hardest case: a large near light, half of it hidden, so that weight and visibility go together."""
    light = Emitter(EmitterKind.RECTANGLE, (0.6, 0, 0.4), **AXES, half_width=1.0, half_height=1.0)
    plate = np.array([[0.0, -1, 0.2], [1, -1, 0.2], [1, 1, 0.2], [0.0, 1, 0.2]])
    eye = np.array([0.0, 0.0, 1.0])
    accel = accel_of(quad(plate), eye)
    point = np.array([[0.0, 0.0, 0.0]])
    expected, _ = closed_forms.visibility(light, point, UP, [plate])
    assert 0.1 < expected[0] < 0.9
    count = 200000
    position = np.repeat(point - eye, count, axis=0).astype(np.float32)
    up = np.repeat(UP, count, axis=0).astype(np.float32)
    both = kernels.ray_screen(accel, None, light.packed(), eye, position, up, up, 2)
    sigma = 0.5 / np.sqrt(2 * count)
    assert abs(both.mean() - expected[0]) < 1e-3 + 3 * sigma
    # Independent: the product's mean is the means' product.
    assert abs(both.prod(1).mean() - both.mean() ** 2) < 4 * 0.5 / np.sqrt(count)


def test_what_the_definition_says_about_odd_points():
    _, eye, accel = plate_scene()
    lamp = LIGHTS[0].packed()
    position = np.array([[0, 0, 0], [np.nan, 0, 0], [0, 0, 5], [0, 0, 0]], np.float64) - eye
    geometric = np.array([UP[0], UP[0], UP[0], -UP[0]], np.float32)
    shading = np.tile(UP, (4, 1)).astype(np.float32)
    v, w = kernels.ray_visibility(
        accel, None, lamp, eye, position.astype(np.float32), geometric, shading, 64, 1
    )
    assert 0 <= v[0] < 0.5
    assert w[0] > 0
    assert (v[1], w[1]) == (1, 0)  # a miss
    assert (v[2], w[2]) == (1, 0)  # behind the light
    assert v[3] == 0  # the light is below the geometric horizon but not below the shading normal's
    assert w[3] > 0
    with pytest.raises(ValueError, match="samples"):
        kernels.ray_visibility(accel, None, lamp, eye, position.astype(np.float32), geometric, shading, 0, 1)


def test_a_light_of_no_size_casts_a_hard_shadow():
    _, eye, accel = plate_scene()
    lamp = Emitter(EmitterKind.SPHERE, (0, 0, 3), **AXES, half_width=0.0, half_height=0.0)
    x = np.linspace(-1.5, 1.5, 301)
    points = np.stack([x, np.zeros_like(x), np.zeros_like(x)], 1)
    up = np.tile(UP, (301, 1)).astype(np.float32)
    v, w = kernels.ray_visibility(
        accel, None, lamp.packed(), eye, (points - eye).astype(np.float32), up, up, 64, 1
    )
    assert set(v) == {0.0, 1.0}
    distance = np.hypot(x, 3.0)
    np.testing.assert_allclose(w, 3.0 / distance**3, rtol=1e-4)  # cos / d^2, intensity 1


def test_same_bits_whatever_the_company():
    """A point's result depends on its index and seed, not on chunks or threads."""
    _, eye, accel = plate_scene()
    generator = np.random.default_rng(9)
    points = np.concatenate([generator.uniform(-1, 1, (3000, 2)), np.zeros((3000, 1))], 1)
    position, up = (points - eye).astype(np.float32), np.tile(UP, (3000, 1)).astype(np.float32)
    lamp = LIGHTS[0].packed()
    for samples in (4, 16):
        a, _ = kernels.ray_visibility(accel, None, lamp, eye, position, up, up, samples, 1)
        b, _ = kernels.ray_visibility(accel, None, lamp, eye, position[:700], up[:700], up[:700], samples, 1)
        c, _ = kernels.ray_visibility(accel, None, lamp, eye, position, up, up, samples, 2)
        np.testing.assert_array_equal(a[:700], b)
        assert (a != c).any()


def test_cancelling():
    _, eye, accel = plate_scene()
    flag = kernels.CancelFlag()
    flag.set()
    rays = np.zeros((9, 3), np.float32), np.ones((9, 3), np.float32), np.ones(9, np.float32)
    with pytest.raises(kernels.Cancelled):
        accel.occluded(None, *rays, cancel=flag)
    with pytest.raises(kernels.Cancelled):
        kernels.ray_visibility(accel, None, LIGHTS[0].packed(), eye, *[rays[1]] * 3, 4, 1, cancel=flag)
