"""Embree as the rival that counts, twice: its packets of 16 rays through its C interface, and the `embreex`
binding's one ray at a time as a Python program would use it.

The C interface is called by ctypes on the library that the `embreex` wheel brings. Everything is in Embree's
favour: the tree is built on all cores, rays are laid out in packets beforehand (that time is reported apart),
Python's overhead of the calls is measured with empty packets and taken off, and the time of one thread is
divided by the number of cores as though it scaled without loss.
"""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from strata.addon.core.arrays import MeshArrays
from strata.addon.core.emitter import Emitter, EmitterKind

LANES = 16
POINTS_AT_ONCE = 1 << 14
OFFSET = 2e-4  # metres that rays start off the surface, and end before the light
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


def _library() -> ctypes.CDLL:
    folder = Path(find_spec("embreex").origin).parents[1] / "embreex.libs"
    ctypes.CDLL(str(next(folder.glob("libtbb*"))), mode=ctypes.RTLD_GLOBAL)
    library = ctypes.CDLL(str(next(folder.glob("libembree4*"))))
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
        """(P, 16) bool of packets (P, 12, 16) float32, in place, and the seconds in Embree; `valid` (P, 16)
        int32, -1 for a ray to trace."""
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
        started = time.perf_counter()
        for ray, mask in zip(rays, masks, strict=True):
            occluded(mask, scene, ray, arguments)
        return time.perf_counter() - started


def aligned(shape: tuple[int, ...], dtype) -> np.ndarray:
    """Zeros at a multiple of 64 bytes, as packets have to be."""
    count = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(count + 64, np.uint8)
    first = -memory.ctypes.data % 64
    return memory[first : first + count].view(dtype).reshape(shape)


def sequence(samples: int) -> np.ndarray:
    """(samples, 2) uint32: the first of Sobol's (0, 2)-sequence, near neighbours in one packet."""
    index = np.arange(samples, dtype=np.uint32)
    bits = np.zeros((samples, 2), np.uint32)
    column = 1 << 31
    for bit in range(32):
        there = (index >> bit & 1).astype(bool)
        bits[there, 0] |= np.uint32(1 << (31 - bit))
        bits[there, 1] ^= np.uint32(column)
        column ^= column >> 1
    order = np.zeros(samples, np.uint64)
    for bit in range(16):
        for axis in range(2):
            order |= (bits[:, axis] >> (31 - bit) & 1).astype(np.uint64) << np.uint64(31 - 2 * bit - axis)
    return bits[np.argsort(order)]


@dataclass(frozen=True)
class Batch:
    """Rays of some points: `packets` (P, 12, 16), `valid` (P, 16), `weights` (points, samples) float32."""

    points: slice
    packets: np.ndarray
    valid: np.ndarray
    weights: np.ndarray


def batches(surface, emitter: Emitter, eye: np.ndarray, samples: int, seed: int) -> Iterator[Batch]:
    """Stratified rays from each point to a RECTANGLE without spread, weighted by cosines and distance; each
    point's samples are the sequence, digitally shifted."""
    assert emitter.kind == EmitterKind.RECTANGLE, "the benchmark's light"
    bits, random = sequence(samples), np.random.default_rng(seed)
    centre = (np.array(emitter.centre) - eye).astype(np.float32)
    right = np.array(emitter.right, np.float32) * np.float32(emitter.half_width)
    up = np.array(emitter.up, np.float32) * np.float32(emitter.half_height)
    forward = np.array(emitter.forward, np.float32)
    area = np.float32(4.0 * emitter.half_width * emitter.half_height)
    for start in range(0, len(surface), POINTS_AT_ONCE):
        points = slice(start, min(start + POINTS_AT_ONCE, len(surface)))
        position, geometric, shading = (part[points] for part in surface.points)
        count = len(position)
        shift = random.integers(0, 1 << 32, (count, 1, 2), np.uint32)
        uv = ((bits[None] ^ shift) >> 8).astype(np.float32) * np.float32(2.0**-23) - np.float32(1.0)
        origin = position + np.float32(OFFSET) * geometric
        spoke = centre + uv[..., :1] * right + uv[..., 1:] * up - origin[:, None]
        square = np.einsum("psc,psc->ps", spoke, spoke)
        cosine = np.maximum(np.einsum("psc,pc->ps", spoke, shading), 0.0)
        weights = cosine * np.maximum(-(spoke @ forward), 0.0) / (square * square) * area
        above = np.einsum("psc,pc->ps", spoke, geometric) > 0.0
        rays = -(-count * samples // LANES) * LANES
        lanes = np.zeros((rays, 12), np.float32)
        used = lanes[: count * samples].reshape(count, samples, 12)
        used[..., ORIGIN : ORIGIN + 3] = origin[:, None]
        used[..., DIRECTION : DIRECTION + 3] = spoke
        used[..., T_FAR] = np.float32(1.0 - 1e-4)
        packets = aligned((rays // LANES, 12, LANES), np.float32)
        packets[:] = lanes.reshape(-1, LANES, 12).transpose(0, 2, 1)
        packets.view(np.uint32)[:, MASK] = 0xFFFFFFFF
        valid = aligned((rays // LANES, LANES), np.int32)
        valid.reshape(-1)[: count * samples] = -((weights > 0.0) & above).reshape(-1).astype(np.int32)
        yield Batch(points, packets, valid, weights)


def _visible(batch: Batch, occluded: np.ndarray) -> np.ndarray:
    """Weighted share of the rays that arrive; rays that were not traced do not."""
    count, samples = batch.weights.shape
    arrives = (~occluded & (batch.valid != 0)).reshape(-1)[: count * samples].reshape(count, samples)
    total = batch.weights.sum(axis=1)
    return np.where(
        total > 0.0, (batch.weights * arrives).sum(axis=1) / np.where(total > 0.0, total, 1.0), 1.0
    )


@dataclass(frozen=True)
class Traced:
    """`visibility` (N,) float32; `build`, `trace` and `generate` in seconds: of the tree (all cores), of the
    rays (one core's, divided by the cores), and of laying the rays out with numpy (one core)."""

    visibility: np.ndarray
    build: float
    trace: float
    generate: float

    @property
    def seconds(self) -> float:
        return self.build + self.trace


def by_packets(triangles, surface, emitter: Emitter, eye: np.ndarray, samples: int, seed: int = 3) -> Traced:
    """Visibility of every point by rtcOccluded16. `triangles` as `flattened` gives them."""
    packets = Packets(*triangles)
    visibility = np.empty(len(surface), np.float32)
    trace, started = 0.0, time.perf_counter()
    tracing = 0.0
    for batch in batches(surface, emitter, eye, samples, seed):
        before = time.perf_counter()
        occluded, seconds = packets.occluded(batch.packets, batch.valid)
        tracing += time.perf_counter() - before
        trace += seconds
        visibility[batch.points] = _visible(batch, occluded)
    generate = time.perf_counter() - started - tracing
    packets.close()
    return Traced(visibility, packets.build_seconds, trace / os.cpu_count(), generate)


class Binding:
    """The same by `embreex`: numpy arrays of rays in, hits out, one thread for each core."""

    def __init__(self, triangles):
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        vertices, indices = triangles
        started = time.perf_counter()
        self.scene = EmbreeScene()
        self.mesh = TriangleMesh(self.scene, vertices, indices)
        # The scene is committed by its first query.
        self.scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32), query="OCCLUDED")
        self.build_seconds = time.perf_counter() - started

    def occluded(self, packets: np.ndarray, valid: np.ndarray, pool: ThreadPoolExecutor | None):
        """(P, 16) bool and seconds. `pool` splits the rays among its threads, where the binding lets it."""
        lanes = packets.transpose(0, 2, 1).reshape(-1, 12)
        chosen = np.flatnonzero(valid)
        origins = np.ascontiguousarray(lanes[chosen, ORIGIN : ORIGIN + 3])
        directions = np.ascontiguousarray(lanes[chosen, DIRECTION : DIRECTION + 3])
        reach = np.ascontiguousarray(lanes[chosen, T_FAR])

        def run(part):
            return self.scene.run(origins[part], directions[part], dists=reach[part], query="OCCLUDED")

        started = time.perf_counter()
        if pool:
            half = len(chosen) // 2
            hits = np.concatenate(list(pool.map(run, (slice(0, half), slice(half, None)))))
        else:
            hits = run(slice(None))
        seconds = time.perf_counter() - started
        occluded = np.zeros(valid.size, bool)
        occluded[chosen] = hits != -1
        return occluded.reshape(valid.shape), seconds


def by_binding(triangles, surface, emitter: Emitter, eye: np.ndarray, samples: int, seed: int = 3) -> Traced:
    """Visibility of every point through `embreex`; `trace` is as measured, on as many threads as it bears."""
    binding = Binding(triangles)
    visibility = np.empty(len(surface), np.float32)
    trace, started, tracing = 0.0, time.perf_counter(), 0.0
    with ThreadPoolExecutor(2) as pool:
        for batch in batches(surface, emitter, eye, samples, seed):
            before = time.perf_counter()
            occluded, seconds = binding.occluded(batch.packets, batch.valid, pool)
            tracing += time.perf_counter() - before
            trace += seconds
            visibility[batch.points] = _visible(batch, occluded)
    generate = time.perf_counter() - started - tracing
    return Traced(visibility, binding.build_seconds, trace, generate)
