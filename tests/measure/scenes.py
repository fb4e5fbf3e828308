"""Small random scenes, made without Blender: a floor, things on and above it, a light, a camera."""

from __future__ import annotations

import math

import numpy as np
from strata.addon.core.arrays import Arrays, MeshArrays, Opacities, OpacityArrays
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.material import Material, Opacity
from strata.addon.core.outline import Bounds, Instance, Light, Mesh, Outline
from strata.addon.core.shot import Camera, Raster, Shot

SIZE = (48, 48)


def floor(rng):
    corners = np.array([(-6, -6, 0), (6, -6, 0), (6, 6, 0), (-6, 6, 0)], np.float32)
    return corners, np.array([[0, 1, 2, 3]])


def box(rng):
    low, high = np.array([-0.5, -0.5, -0.5]), rng.uniform(0.1, 0.9, 3) - 0.5 + 0.1
    corners = np.array([[(low, high)[i >> a & 1][a] for a in range(3)] for i in range(8)], np.float32)
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return corners, np.array(faces)


def ball(rng):
    """A sphere of 24 x 12 quads, the poles' of no area."""
    u, v = np.meshgrid(np.arange(24) / 24 * 2 * np.pi, np.linspace(0, np.pi, 13), indexing="ij")
    points = 0.5 * np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1)
    i, j = np.meshgrid(np.arange(24), np.arange(12), indexing="ij")
    a, b = i * 13 + j, (i + 1) % 24 * 13 + j
    return points.reshape(-1, 3).astype(np.float32), np.stack([a, a + 1, b + 1, b], -1).reshape(-1, 4)


def spikes(rng):
    """Blades a few millimetres wide: shadows much thinner than a pixel."""
    base = rng.uniform(-0.5, 0.5, (12, 1, 2))
    offsets = np.array([(0, 0), (0.006, 0.0), (0.006, 0.0), (0, 0)])
    points = np.concatenate([base + offsets, np.tile([[-0.5], [-0.5], [0.6], [0.6]], (12, 1, 1))], -1)
    return points.reshape(-1, 3).astype(np.float32), np.arange(48).reshape(12, 4)


def sieve(rng):
    """A plate of strips with narrow gaps between them: light leaks through in places."""
    edges = np.sort(rng.uniform(-0.6, 0.6, 16)).reshape(8, 2)
    x0, x1 = edges[:, 0], np.minimum(edges[:, 1], np.append(edges[1:, 0], 1.0) - 0.01)
    zero, low, high = np.zeros(8), np.full(8, -0.6), np.full(8, 0.6)
    corners = [
        np.stack(c, -1) for c in [(x0, low, zero), (x1, low, zero), (x1, high, zero), (x0, high, zero)]
    ]
    return np.stack(corners, 1).reshape(-1, 3).astype(np.float32), np.arange(32).reshape(8, 4)


def turned(rng, scale: float, place) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * scale
    matrix[:3, 3] = place
    return matrix


def lamp(rng) -> Emitter:
    kind = EmitterKind(rng.integers(5))
    place = np.array([*rng.uniform(-2.5, 2.5, 2), rng.uniform(3.0, 5.0)])
    down = np.array([*rng.uniform(-0.5, 0.5, 2), 0.0]) - place
    down /= np.linalg.norm(down)
    right = np.cross(down, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    size = float(np.exp(rng.uniform(math.log(0.05), math.log(0.8))))
    sizes = (size, size * float(rng.uniform(0.4, 1.0)))
    if kind not in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
        sizes = (size, size) if kind != EmitterKind.DISTANT_DISK else (0.2 * size, 0.2 * size)
    axes = (tuple(map(float, axis)) for axis in (place, right, np.cross(right, down), down))
    return Emitter(kind, *axes, *sizes)


CAMERA = Camera("Camera", (0.0, -3.5, 6.0), (1.0, 0.0, 0.0), (0.0, 0.864, 0.504), (0.0, 0.504, -0.864))


def shot_of(seed: int, size: tuple[int, int] = SIZE) -> Shot:
    """Of any random scene."""
    return Shot("Camera", Raster(CAMERA, size), seed=seed)


def random_scene(seed: int, opacity: float = 1.0) -> tuple[Outline, Arrays]:
    """Black things, so opaque, on a white floor, so that it matters what samples weigh."""
    rng = np.random.default_rng(seed)
    makers = [floor, *rng.choice([box, ball, spikes, sieve], rng.integers(2, 6))]
    meshes, matrices, instances = [], [], []
    for index, maker in enumerate(makers):
        points, faces = maker(rng)
        starts = np.arange(0, faces.size + 1, 4, dtype=np.int32)
        meshes.append(MeshArrays(points, faces.reshape(-1).astype(np.int32), starts))
        place = [*rng.uniform(-1.5, 1.5, 2), rng.uniform(0.5, 2.0)]
        matrix = np.eye(4) if maker is floor else turned(rng, rng.uniform(0.5, 1.5), place)
        world = points @ matrix[:3, :3].T + matrix[:3, 3]
        bounds = Bounds(tuple(world.min(0).tolist()), tuple(world.max(0).tolist()))
        rows = tuple(map(tuple, matrix.tolist()))
        instances.append(Instance(maker.__name__, index, rows, bounds, index, (int(maker is not floor),)))
        matrices.append(matrix)
    light = Light("Lamp", "Lamp", "AREA", lamp(rng), (1.0, 1.0, 1.0))
    headers = tuple(
        Mesh(instance.name, str(i), len(mesh.positions), 2 * (len(mesh.face_starts) - 1))
        for i, (instance, mesh) in enumerate(zip(instances, meshes, strict=True))
    )
    sides = (Opacity(opacity),) * 2
    materials = Material("White"), Material("Black", (0.02, 0.02, 0.02), seen=sides, casts=sides)
    outline = Outline("Scene", "Layer", 1, (light,), tuple(instances), headers, materials)
    opacities = Opacities(), Opacities.of(OpacityArrays(opacity))
    return outline, Arrays(tuple(meshes), np.array(matrices), opacities)
