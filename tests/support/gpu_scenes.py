"""Scenes that both devices are given, and how their images are compared."""

from __future__ import annotations

import os
from types import SimpleNamespace

import bpy  # noqa: F401 (the gpu module comes with it)
import numpy as np
import pytest
from strata.addon.core.arrays import Arrays, MeshArrays, Opacities
from strata.addon.core.errors import DeviceUnavailable
from strata.addon.devices.cpu import CpuDevice
from strata.addon.devices.gpu import GpuDevice

EPSILON = float(np.finfo(np.float32).eps)
_started: list[GpuDevice] = []


def gpu_device() -> GpuDevice:
    """One device for all tests. Where none starts: fails if STRATA_EXPECT_GPU=1, else skips."""
    if not _started:
        try:
            _started.append(GpuDevice())
        except DeviceUnavailable as reason:
            if os.environ.get("STRATA_EXPECT_GPU") == "1":
                pytest.fail(f"STRATA_EXPECT_GPU=1, but no GPU: {reason}")
            pytest.skip(f"no GPU: {reason}")
    return _started[0]


def triangle_mesh(triangles: np.ndarray, **more) -> MeshArrays:
    """(T, 3, 3) positions as separate triangles."""
    positions = np.ascontiguousarray(np.reshape(triangles, (-1, 3)), np.float32)
    corners = np.arange(len(positions), dtype=np.int32)
    return MeshArrays(positions, corners, np.arange(0, len(positions) + 1, 3, dtype=np.int32), **more)


OPAQUE = (Opacities(),)


def scene_of(meshes, instances=None, opacities=OPAQUE):
    """An outline, as far as devices read it, and its arrays. `instances`: (mesh, matrix, object id,
    materials); one of each mesh if None."""
    if instances is None:
        instances = [(index, np.eye(4), 5, (0,)) for index in range(len(meshes))]
    parts = tuple(
        SimpleNamespace(mesh=mesh, object_id=object_id, materials=materials)
        for mesh, _, object_id, materials in instances
    )
    matrices = np.array([matrix for _, matrix, _, _ in instances], np.float64).reshape(-1, 4, 4)
    return SimpleNamespace(instances=parts), Arrays(tuple(meshes), matrices, tuple(opacities))


def on_both(outline, arrays):
    """Both devices and the geometry that each made of the scene: (cpu, its geometry), (gpu, its geometry)."""
    devices = CpuDevice(), gpu_device()
    for device in devices:
        device.set_scene(outline, arrays)
    return tuple((device, device.geometry()) for device in devices)


def rotation(rng) -> np.ndarray:
    """(3, 3), proper."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return axes * np.sign(np.linalg.det(axes))


def matrix_of(linear: np.ndarray, moved) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = moved
    return matrix


def bumpy_sheet(rng, cells: int, **more) -> MeshArrays:
    """A unit square of quads and, in every fifth cell, a pentagon's worth of triangle and quad; wavy, with
    smooth corner normals, uvs and colours, and material slots 0 and 1 by turns of a row."""
    x, y = np.meshgrid(np.linspace(-1, 1, cells + 1), np.linspace(-1, 1, cells + 1))
    z = 0.15 * np.sin(4 * x + 1) * np.cos(3 * y)
    positions = np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32)
    positions += rng.uniform(-0.2, 0.2, positions.shape).astype(np.float32) / cells
    row, column = np.divmod(np.arange(cells * cells), cells)
    a = row * (cells + 1) + column
    faces = []
    for index, corner in enumerate(a.tolist()):
        quad = [corner, corner + 1, corner + cells + 2, corner + cells + 1]
        faces += [quad[:3], [quad[0], *quad[2:]]] if index % 5 == 0 else [quad]
    corners = np.concatenate(faces).astype(np.int32)
    starts = np.concatenate([[0], np.cumsum([len(face) for face in faces])]).astype(np.int32)
    normal = np.stack(
        [-0.6 * np.cos(4 * x + 1) * np.cos(3 * y), 0.45 * np.sin(4 * x + 1) * np.sin(3 * y)], -1
    )
    normal = np.concatenate([normal.reshape(-1, 2), np.ones(((cells + 1) ** 2, 1))], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    uvs = np.stack([1.7 * x, 1.3 * y], -1).reshape(-1, 2)
    slots = np.array([(corner_list[0] // (cells + 1)) % 2 for corner_list in faces], np.int32)
    return MeshArrays(
        positions,
        corners,
        starts,
        corner_normals=normal[corners].astype(np.float32),
        corner_uvs=uvs[corners].astype(np.float32),
        corner_colours=(0.5 + 0.5 * normal[corners]).astype(np.float32),
        face_slots=slots,
        **more,
    )


def sheets_over_ground(count: int, materials: tuple[int, ...]):
    """`count` bumpy sheets over a ground that no light's plane is parallel to: meshes, and instances as
    `scene_of` takes them."""
    rng = np.random.default_rng(3)
    corners = np.array([[-9, -9, 0.1], [9, -9, -0.2], [9, 9, 0.15], [-9, 9, 0.3]])
    instances = [(1, np.eye(4), 0, (0,))]
    for index in range(count):
        moved = rng.uniform((-2, -2, 0.8), (2, 2, 2.0))
        instances.append((0, matrix_of(0.6 * rotation(rng), moved), index + 1, materials))
    return [bumpy_sheet(rng, 16), triangle_mesh(corners[[[0, 1, 2], [0, 2, 3]]])], instances


def share_beyond(a: np.ndarray, b: np.ndarray, tolerance) -> float:
    """Share of elements that differ by more than `tolerance`, or that only one of the two has finite."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    both = np.isfinite(a) & np.isfinite(b)
    with np.errstate(invalid="ignore"):
        far = both & (np.abs(a - b) > tolerance)
    return float((far | (np.isfinite(a) != np.isfinite(b))).mean())
