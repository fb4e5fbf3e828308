"""Runs a graph: shared nodes once, cached by content, tile by tile, timed, cancellable, on either device."""

from __future__ import annotations

import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from .device import Device
from .errors import Cancelled
from .graph import Graph, Node
from .sampling import Sampling
from .surface import Chunk


class Collector(Protocol):
    """Sees every tile of every sample as it is made; measuring draws its probes here."""

    def add(self, chunk: Chunk, surface: dict[str, np.ndarray], layers: dict[str, np.ndarray]) -> None:
        """`surface` and `layers` are host arrays (rows, width[, channels])."""


@dataclass
class Timing:
    """Time of one node on one device, summed over its runs."""

    node: Node
    device: str
    seconds: float = 0.0
    runs: int = 0


@dataclass
class Execution:
    """What came out. `images`: (height, width[, channels]) float32 by layer name, row 0 at the bottom.
    `spread`: the same shape, the mean over pixels' samples of the squared deviation from their mean."""

    images: dict[str, np.ndarray] = field(default_factory=dict)
    timings: dict[tuple[str, str], Timing] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    spread: dict[str, np.ndarray] = field(default_factory=dict)

    def seconds(self, nodes) -> float:
        keys = {node.key for node in nodes}
        return sum(timing.seconds for timing in self.timings.values() if timing.node.key in keys)


class Executor:
    """Keeps values of nodes that do not depend on the surface from run to run, most recent first, so that
    what did not change does not run again.

    `fallback` is the CPU device, taken where the primary lacks a twin or fails; it may be the primary.
    `keeps_inputs`: values that only other kept values were made of stay too (a preview's slider may want
    them again); if not, they are freed as soon as nothing of the graph needs them.
    """

    def __init__(self, primary: Device, fallback: Device, kept_values: int = 64, keeps_inputs: bool = True):
        self.primary = primary
        self.fallback = fallback
        self.kept_values = kept_values
        self.keeps_inputs = keeps_inputs
        self._kept: OrderedDict[tuple[str, str], Any] = OrderedDict()
        self._passing: dict[tuple[str, str], Any] = {}
        self._broken: dict[tuple[str, str], str] = {}
        self._chunk: Chunk | None = None
        self._graph: Graph | None = None
        self.execution = Execution()

    def run(self, graph: Graph, sampling: Sampling, collector: Collector | None = None) -> Iterator[float]:
        """A generator of the share done so far, one value a node; `self.execution` holds the result at its
        end. Raises Cancelled when the flag of either device is set."""
        self.execution = Execution()
        self._graph = graph
        if not graph.layers:
            return
        nodes = graph.nodes()
        scene_nodes = [node for node in nodes if not node.per_surface]
        surface_nodes = [node for node in nodes if node.per_surface]
        total = len(scene_nodes) + len(surface_nodes) * sampling.chunk_count
        readers = Counter(item.key for node in nodes for item in node.inputs)
        done = 0
        try:
            for node in scene_nodes:
                # A node that only the other device's nodes read is made there, when they ask for it.
                if node.step.twin(self.primary.name) or self.primary is self.fallback:
                    self.value(node, self.primary)
                    self._free_inputs(node, readers)
                done += 1
                yield done / total
            for chunk in sampling.chunks():
                self._chunk = chunk
                for node in surface_nodes:
                    self.value(node, self._home(node))
                    done += 1
                    yield done / total
                self._collect(graph, sampling, chunk, collector)
                self._drop_passing()
        finally:
            self._drop_passing()
            self._trim()
        for name, image in self.execution.images.items():
            image /= np.float32(sampling.samples)
            spread = self.execution.spread[name]
            spread /= np.float32(sampling.samples)
            np.maximum(spread - image * image, 0.0, out=spread)

    def value(self, node: Node, device: Device) -> Any:
        """The node's value on `device`, running or moving what that takes."""
        store = self._passing if node.per_surface else self._kept
        key = (device.name, node.key)
        if key in store:
            if store is self._kept:
                self._kept.move_to_end(key)
            return store[key]
        for flagged in (self.primary, self.fallback):
            if flagged.cancel_flag.is_set():
                raise Cancelled()
        # What can be copied is made once, where it is at home; what cannot is made again where it is wanted.
        if self._usable(node, device) and (self._home(node) is device or not node.step.copyable):
            value = self._run(node, device)
        else:
            other = self.fallback if device is self.primary else self.primary
            if other is device or not self._usable(node, other):
                raise RuntimeError(f"step '{node.step.name}' has no usable twin: {node.step.hole}")
            source = self.value(node, other)
            started = time.perf_counter()
            value = device.from_host(other.to_host(source))
            device.finish()
            self._time(node, f"{other.name} to {device.name}", time.perf_counter() - started)
        store[key] = value
        return value

    def release(self) -> None:
        """Frees everything that was kept."""
        self._drop_passing()
        self.kept_values, kept = 0, self.kept_values
        self._trim()
        self.kept_values = kept

    def _home(self, node: Node) -> Device:
        return self.primary if self._usable(node, self.primary) else self.fallback

    def _usable(self, node: Node, device: Device) -> bool:
        return node.step.twin(device.name) is not None and (device.name, node.step.name) not in self._broken

    def _run(self, node: Node, device: Device) -> Any:
        inputs = [self.value(item, device) for item in node.inputs]
        extra: dict[str, Any] = {}
        if self._graph is not None and node == self._graph.surface:
            extra = {"chunk": self._chunk, "attributes": self._graph.surface_attributes}
        elif node.step.told_chunk:
            extra = {"chunk": self._chunk}
        started = time.perf_counter()
        compiling = device.compile_seconds
        try:
            value = node.step.twin(device.name)(device, *inputs, **node.params, **extra)
            device.finish()
        except device.cancelled:
            raise Cancelled() from None
        except Exception as error:
            if device is self.fallback or not node.step.twin(self.fallback.name):
                raise
            self._broken[device.name, node.step.name] = str(error)
            self.execution.warnings.append(
                f"step '{node.step.name}' failed on {device.name} and ran on {self.fallback.name}: {error}"
            )
            return device.from_host(self.fallback.to_host(self.value(node, self.fallback)))
        compiling = device.compile_seconds - compiling
        self._time(node, device.name, time.perf_counter() - started - compiling)
        return value

    def _time(self, node: Node, device: str, seconds: float) -> None:
        timing = self.execution.timings.setdefault((node.key, device), Timing(node, device))
        timing.seconds += seconds
        timing.runs += 1

    def _collect(self, graph: Graph, sampling: Sampling, chunk: Chunk, collector: Collector | None) -> None:
        layers = {}
        for layer in graph.layers:
            device = self._home(layer.node)
            tile = layers[layer.name] = device.to_host(self.value(layer.node, device))
            shape = (sampling.height, *tile.shape[1:])
            rows = slice(chunk.y0, chunk.y1)
            image = self.execution.images.setdefault(layer.name, np.zeros(shape, np.float32))
            spread = self.execution.spread.setdefault(layer.name, np.zeros(shape, np.float32))
            image[rows] += tile
            spread[rows] += tile * tile
        if collector is not None and chunk.sample == 0:
            device = self._home(graph.surface)
            collector.add(chunk, device.to_host(self.value(graph.surface, device)), layers)

    def _free_inputs(self, node: Node, readers: Counter) -> None:
        """Frees what `node` was the last to read."""
        for item in node.inputs:
            readers[item.key] -= 1
            if readers[item.key] == 0 and not self.keeps_inputs:
                for device in {self.primary, self.fallback}:
                    value = self._kept.pop((device.name, item.key), None)
                    if value is not None:
                        device.release(value)

    def _drop_passing(self) -> None:
        devices = {device.name: device for device in (self.primary, self.fallback)}
        for (name, _), value in self._passing.items():
            devices[name].release(value)
        self._passing.clear()

    def _trim(self) -> None:
        devices = {device.name: device for device in (self.primary, self.fallback)}
        while len(self._kept) > self.kept_values:
            (name, _), value = self._kept.popitem(last=False)
            devices[name].release(value)


def drain(steps: Iterator[float], progress: Callable[[float], None] | None = None) -> None:
    """Runs a generator of shares to its end."""
    for share in steps:
        if progress:
            progress(share)
