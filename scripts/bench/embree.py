"""Embree as the rival that counts, twice: its packets of 16 rays through its C interface, and the `embreex`
binding's one ray at a time as a Python program would use it.

Everything is in Embree's favour: the tree is built on all cores, rays are laid out beforehand (that
time is reported apart), Python's overhead of the calls is measured with empty packets and taken off, and the
time of one thread is divided by the number of cores as though it scaled without loss.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.report.rivals.embree import sobol
from strata.addon.report.rivals.embree_packets import DIRECTION, ORIGIN, T_FAR, Packets, packed

POINTS_AT_ONCE = 1 << 14
OFFSET = 2e-4  # metres that rays start off the surface, and end before the light


def sequence(samples: int) -> np.ndarray:
    """(samples, 2) uint32: the first of Sobol's (0, 2)-sequence, near neighbours in one packet."""
    bits = sobol(0, samples)
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
        origins = np.broadcast_to(origin[:, None], spoke.shape).reshape(-1, 3)
        far = np.full(count * samples, 1.0 - 1e-4, np.float32)
        traced = ((weights > 0.0) & above).reshape(-1)
        packets, valid = packed(origins, spoke.reshape(-1, 3), far, traced)
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
