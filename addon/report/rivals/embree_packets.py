"""Embree's packets of 16 rays through its C interface, by ctypes on the library that the `embreex` wheel
brings."""

from __future__ import annotations

import ctypes
import os
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ...core.arrays import MeshArrays

LANES = 16
# RTCRay16 of Embree 4: twelve fields of sixteen four-byte lanes.
ORIGIN, T_NEAR, DIRECTION, TIME, T_FAR, MASK, ID, FLAGS = 0, 3, 4, 7, 8, 9, 10, 11
TRIANGLE_GEOMETRY, INDEX_BUFFER, VERTEX_BUFFER, UINT3, FLOAT3 = 0, 0, 1, 0x5003, 0x9003
COHERENT = 1 << 16


def triangles_of(mesh: MeshArrays) -> np.ndarray:
    """(T, 3) int32 vertices of the fans of a mesh's polygons."""
    starts, sizes = mesh.face_starts[:-1], np.diff(mesh.face_starts)
    pieces = []
    for size in np.unique(sizes):
        first = starts[sizes == size]
        pieces += [np.stack([first, first + k, first + k + 1], axis=1) for k in range(1, size - 1)]
    corners = np.concatenate(pieces) if pieces else np.zeros((0, 3), np.int32)
    return mesh.corner_vertices[corners].astype(np.int32)


def flattened(arrays, outline, instances, eye: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All triangles of `instances` as vertices (V, 3) float32 relative to `eye` and indices (T, 3) int32."""
    vertices, indices, first = [], [], 0
    triangles = {index: triangles_of(mesh) for index, mesh in enumerate(arrays.meshes)}
    for number in sorted(instances):
        mesh, matrix = outline.instances[number].mesh, arrays.matrices[number]
        world = arrays.meshes[mesh].positions.astype(np.float64) @ matrix[:3, :3].T + (matrix[:3, 3] - eye)
        vertices.append(world.astype(np.float32))
        indices.append(triangles[mesh] + np.int32(first))
        first += len(world)
    return np.concatenate(vertices), np.ascontiguousarray(np.concatenate(indices))


def libraries() -> list[Path]:
    """What the package `embreex` brings, as its wheel for Linux has it: threads, then Embree 4; empty where
    it is not so."""
    found = find_spec("embreex")
    folder = Path(found.origin).parents[1] / "embreex.libs" if found and found.origin else Path()
    files = [next(folder.glob(name), None) for name in ("libtbb*", "libembree4*")] if found else [None]
    return [] if None in files else files


def _library() -> ctypes.CDLL:
    threads, embree = libraries()
    ctypes.CDLL(str(threads), mode=ctypes.RTLD_GLOBAL)
    library = ctypes.CDLL(str(embree))
    for name in ("rtcNewDevice", "rtcNewScene", "rtcNewGeometry", "rtcSetNewGeometryBuffer"):
        getattr(library, name).restype = ctypes.c_void_p
    return library


class Packets:
    """Triangles in an Embree scene, asked by packets of 16 rays."""

    def __init__(self, vertices: np.ndarray, indices: np.ndarray):
        self._library = library = _library()
        started = time.perf_counter()
        self._device = ctypes.c_void_p(library.rtcNewDevice(f"threads={os.cpu_count()}".encode()))
        self._scene = ctypes.c_void_p(library.rtcNewScene(self._device))
        geometry = ctypes.c_void_p(library.rtcNewGeometry(self._device, TRIANGLE_GEOMETRY))
        self._fill(geometry, VERTEX_BUFFER, FLOAT3, np.ascontiguousarray(vertices, np.float32))
        self._fill(geometry, INDEX_BUFFER, UINT3, np.ascontiguousarray(indices, np.uint32))
        library.rtcCommitGeometry(geometry)
        library.rtcAttachGeometry(self._scene, geometry)
        library.rtcReleaseGeometry(geometry)
        library.rtcCommitScene(self._scene)
        self.build_seconds = time.perf_counter() - started
        # RTCOccludedArguments: flags, features, then three pointers.
        self._arguments = (ctypes.c_uint64 * 5)(COHERENT | (0xFFFFFFFF << 32))

    def _fill(self, geometry, buffer: int, layout: int, rows: np.ndarray) -> None:
        size = ctypes.c_size_t
        memory = self._library.rtcSetNewGeometryBuffer(
            geometry, buffer, ctypes.c_uint(0), layout, size(12), size(len(rows))
        )
        ctypes.memmove(memory, rows.ctypes.data, rows.nbytes)

    def close(self) -> None:
        self._library.rtcReleaseScene(self._scene)
        self._library.rtcReleaseDevice(self._device)

    def occluded(self, packets: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, float]:
        """(P, 16) bool of packets (P, 12, 16) float32, in place, and the seconds of this thread in Embree;
        `valid` (P, 16) int32, -1 for a ray to trace."""
        seconds = self._call(packets, valid) - self._call(packets, aligned(valid.shape, np.int32))
        return packets[:, T_FAR] == -np.inf, seconds

    def _call(self, packets: np.ndarray, valid: np.ndarray) -> float:
        occluded = self._library.rtcOccluded16
        pointer = ctypes.c_void_p
        occluded.argtypes, occluded.restype = [pointer, pointer, pointer, pointer], None
        scene, arguments = self._scene.value, ctypes.addressof(self._arguments)
        first, first_valid, count = packets.ctypes.data, valid.ctypes.data, len(packets)
        rays = range(first, first + 768 * count, 768)
        masks = range(first_valid, first_valid + 64 * count, 64)
        started = time.thread_time()
        for ray, mask in zip(rays, masks, strict=True):
            occluded(mask, scene, ray, arguments)
        return time.thread_time() - started


def packed(
    origins: np.ndarray, directions: np.ndarray, far: np.ndarray, traced: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rays (R, 3), (R, 3), (R,) float32, those `traced` (R,) bool, as `Packets.occluded` takes them."""
    count, whole = len(far), -(-len(far) // LANES) * LANES
    lanes = np.zeros((whole, 12), np.float32)
    used = lanes[:count]
    used[:, ORIGIN : ORIGIN + 3], used[:, DIRECTION : DIRECTION + 3] = origins, directions
    used[:, T_FAR] = far
    packets = aligned((whole // LANES, 12, LANES), np.float32)
    packets[:] = lanes.reshape(-1, LANES, 12).transpose(0, 2, 1)
    packets.view(np.uint32)[:, MASK] = 0xFFFFFFFF
    valid = aligned((whole // LANES, LANES), np.int32)
    valid.reshape(-1)[:count] = -traced.astype(np.int32)
    return packets, valid


def aligned(shape: tuple[int, ...], dtype) -> np.ndarray:
    """Zeros at a multiple of 64 bytes, as packets have to be."""
    count = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(count + 64, np.uint8)
    first = -memory.ctypes.data % 64
    return memory[first : first + count].view(dtype).reshape(shape)
