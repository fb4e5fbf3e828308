"""Embree's rays in Strata's own film: all is as in a bake with the method `rays` but who traces them.

Everything is in Embree's favour: laying rays out, the coarse picture and Python's overhead of the calls are
not counted, the tree is built on all cores, and the time of one thread is divided by the number of cores as
though it scaled without loss.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from ...bake import BakeJob
from ...core.errors import StrataError
from ...core.executor import Executor
from ...core.graph import Graph, Node
from ...core.random import hash_bits
from ...core.surface import SurfacePoints
from ...devices.cpu import CpuDevice
from ...effects.shared.terminator import lifts_of
from ...effects.shared.visibility_truth import laid_out
from ...effects.soft_shadow.params import Method
from ...effects.soft_shadow.steps import POINTS, RAYS_ALONE
from ...job import run_to_end
from ...planning import sampling_of
from ..cost import Cost, counted
from ..setting import Setting
from .embree_packets import Packets, flattened, libraries, packed
from .rival import Case, Found

SAMPLES = (4, 8, 16, 32)
CURVE = "its rays in this film"
POINTS_AT_ONCE = 1 << 14
SHORT = 1e-4
"""Rays end such a share before the light."""


class Embree:
    """Takes every surface for opaque. Lamps that have a method of their own are not its, nor those that some
    things cast no shadow of."""

    id = "embree"
    title = "Embree"
    told = (
        "It traces the rays of a bake of ours by the method rays; laying them out, the coarse picture and "
        "Python's calls are not counted."
    )

    def why_not(self) -> str:
        return "" if libraries() else "the Python package embreex, with Embree 4, is not installed"

    def settings(self, case: Case) -> list[Setting]:
        values = (("soft_shadow", "method", Method.RAYS.value),)
        return [Setting(self.id, CURVE, each, each, values) for each in SAMPLES]

    def run(self, case: Case, setting: Setting, wants_images: bool, look: Callable[[], None]) -> Found:
        asked = case.job(setting)
        job = BakeJob(asked.outline, asked.graph, asked.arrays, replace(asked.options, samples=1))
        run_to_end(job, show=lambda *_: look())
        tracer = _Tracer(job.outline, asked.arrays)
        try:
            with counted() as cost:
                graph, device = tracer.put_into(job.graph), CpuDevice()
                device.set_scene(job.outline, asked.arrays)
                executor = Executor(device, device, keeps_inputs=False)
                for _ in executor.run(graph, sampling_of(graph, asked.options)):
                    look()
                executor.release()
        finally:
            tracer.close()
        cost.cpu += asked.read_seconds - tracer.spent.cpu + tracer.tree.cpu + tracer.traced_seconds
        cost.wall += asked.read_seconds - tracer.spent.wall + tracer.tree.wall
        cost.wall += tracer.traced_seconds / (os.process_cpu_count() or 1)
        images, made = executor.execution.images, tracer.layers & case.lamps.keys()
        if not made:
            raise StrataError("no lamp takes the method rays with all that casts")
        return Found(cost, {name: {"": images[name]} for name in case.lamps if name in made})


class _Tracer:
    """The step of rays, by Embree. `spent` is what the step took as it is, of which only the `tree` counts,
    and `traced_seconds`, of one thread."""

    def __init__(self, outline: Any, arrays: Any):
        self._outline, self._arrays = outline, arrays
        self._packets: Packets | None = None
        self._casters: frozenset[int] = frozenset()
        self.layers: set[str] = set()
        self.traced_seconds, self.spent, self.tree = 0.0, Cost(), Cost()

    def put_into(self, graph: Graph) -> Graph:
        """The same with rays by Embree, of one tree of all that casts; `layers` have them."""
        step, new = replace(RAYS_ALONE, name="embree/rays", cpu=self._rays), {}
        swapped: set[Node] = set()
        for node in graph.nodes():
            inputs = tuple(new[each] for each in node.inputs)
            if node.step == RAYS_ALONE:
                self._casters |= node.params["casters"]
                new[node] = Node(step, node.instance, inputs[:1], node.params)
                swapped.add(node)
            else:
                new[node] = Node(node.step, node.instance, inputs, node.params)
                swapped |= {node} if swapped & set(node.inputs) else set()
        layers = [
            replace(layer, node=new[layer.node], weight=layer.weight and new[layer.weight])
            for layer in graph.layers
        ]
        lights = self._outline.lights
        self.layers = {
            layer.name
            for layer in graph.layers
            if layer.node in swapped and lights[layer.of.index].casters is None
        }
        return replace(graph, layers=tuple(layers))

    def close(self) -> None:
        if self._packets is not None:
            self._packets.close()

    def _rays(self, *inputs, **params):
        with _added(self.spent):
            return self._traced(*inputs, **params)

    def _traced(self, device, surface, eye, emitter, casters, rays, seed, chunk, offsets=None):
        eye, everywhere = np.array(eye), np.arange(np.prod(chunk.shape))
        if self._packets is None:
            triangles = flattened(self._arrays, self._outline, self._casters, eye)
            with _added(self.tree):
                self._packets = Packets(*triangles)
        vectors = [surface[name].reshape(-1, 3) for name in POINTS]
        lifts = None if offsets is None else lifts_of(surface, offsets, everywhere)
        points = SurfacePoints(*vectors, eye, lifts)
        bits = reversed_bits(sobol(chunk.sample * rays, rays))
        visibility = np.empty(len(everywhere), np.float32)
        for start in range(0, len(everywhere), POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            numbers = chunk.numbers(everywhere[part])
            seeds = np.stack([hash_bits(seed, numbers, axis) for axis in range(2)])
            squares = reversed_bits(scrambled(bits.T[:, :, None], seeds[:, None])) * 2.0**-32
            visibility[part] = self._visible(laid_out(emitter, points, part, squares, eye))
        return visibility.reshape(chunk.shape)

    def _visible(self, laid) -> np.ndarray:
        """(N,) the weighted share of rays that arrive."""
        traced = laid.traced.T.reshape(-1)
        # A sun's have no end, which Embree takes too.
        packets, valid = packed(laid.origins, laid.directions, laid.reach * np.float32(1.0 - SHORT), traced)
        occluded, seconds = self._packets.occluded(packets, valid)
        self.traced_seconds += seconds
        arrives = laid.traced & ~occluded.reshape(-1)[: len(traced)].reshape(laid.traced.T.shape).T
        total = laid.weight.sum(axis=0)
        lit = total > 0.0
        return np.where(lit, (laid.weight * arrives).sum(axis=0) / np.where(lit, total, 1.0), 1.0)


@contextmanager
def _added(cost: Cost) -> Iterator[None]:
    """What is done inside."""
    wall, cpu = time.perf_counter(), time.process_time()
    yield
    cost.wall, cost.cpu = cost.wall + time.perf_counter() - wall, cost.cpu + time.process_time() - cpu


def sobol(first: int, count: int) -> np.ndarray:
    """(count, 2) uint32: from `first` on of Sobol's (0, 2)-sequence."""
    index = np.arange(first, first + count, dtype=np.uint32)
    bits = np.zeros((count, 2), np.uint32)
    column = 1 << 31
    for bit in range(32):
        there = (index >> np.uint32(bit) & np.uint32(1)).astype(bool)
        bits[there, 0] |= np.uint32(1 << (31 - bit))
        bits[there, 1] ^= np.uint32(column)
        column ^= column >> 1
    return bits


def scrambled(bits: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """Owen scrambling of reversed bits (Laine and Karras 2011, constants of Vegdahl 2021), uint32."""
    bits = bits ^ bits * np.uint32(0x3D20ADEA)
    bits = (bits + seeds) * (seeds >> np.uint32(16) | np.uint32(1))
    bits ^= bits * np.uint32(0x05526C56)
    return bits ^ bits * np.uint32(0x53A22864)


def reversed_bits(bits: np.ndarray) -> np.ndarray:
    """Of uint32, the last first."""
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF)):
        bits = bits >> np.uint32(shift) & np.uint32(mask) | (bits & np.uint32(mask)) << np.uint32(shift)
    return bits >> np.uint32(16) | bits << np.uint32(16)


EMBREE = Embree()
