"""Runs a graph: shared nodes once, cached by content, tile by tile, timed, cancellable, on either device."""

from __future__ import annotations

import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from .device import Device
from .errors import Cancelled, StrataError
from .execution import Execution
from .free_memory import check_room
from .graph import Graph, Node, PlannedLayer
from .outline import Outline
from .sampling import Sampling
from .surface import Chunk


class Collector(Protocol):
    """Sees every tile of every sample as it is made; measuring draws its probes here."""

    def add(
        self, chunk: Chunk, surface: dict[str, np.ndarray], layers: dict[str, np.ndarray]
    ) -> Iterator[None]:
        """`surface` and `layers` are host arrays (rows, width[, channels]). Yields between slices of work."""


@dataclass
class _Context:
    """What the nodes being run belong to. `passing` holds values at the surface of `chunk`; None: a frame's,
    which outlive it."""

    graph: Graph | None = None
    chunk: Chunk | None = None
    passing: dict[tuple, Any] | None = field(default_factory=dict)
    epoch: int = 0
    execution: Execution = field(default_factory=Execution)


class Executor:
    """Keeps values of nodes that do not depend on the surface from run to run, most recent first, so that
    what did not change does not run again.

    `fallback` is the CPU device, taken where the primary lacks a twin or fails; it may be the primary.
    `keeps_inputs`: values that only other kept values were made of stay too (a preview's slider may want
    them again); if not, they are freed as soon as nothing of the graph needs them. `kept_surface_bytes`
    bounds what `frame` keeps of values that do depend on the surface, `kept_bytes` what it keeps of those
    that do not, also while it works. `outline` is what sizes follow from (Step.bytes_of), if it is known.

    Several runs and frames may be under way at once, a step of one after a step of another, and any may be
    abandoned between two nodes.
    """

    def __init__(
        self,
        primary: Device,
        fallback: Device,
        kept_values: int = 64,
        keeps_inputs: bool = True,
        kept_surface_bytes: int = 0,
        kept_bytes: int | None = None,
    ):
        self.primary = primary
        self.fallback = fallback
        self.kept_values = kept_values
        self.keeps_inputs = keeps_inputs
        self.kept_surface_bytes = kept_surface_bytes
        self.kept_bytes = kept_bytes
        self.outline: Outline | None = None
        self._sizes: dict[str, int] = {}  # of kept values that have any, by node
        self._kept: OrderedDict[tuple[str, str], Any] = OrderedDict()
        self._framed: OrderedDict[tuple, Any] = OrderedDict()
        self._framed_bytes: dict[tuple, tuple[int, int]] = {}  # bytes, and the epoch that used it last
        self._broken: dict[tuple[str, str], str] = {}
        self._now = _Context()

    @property
    def execution(self) -> Execution:
        """Of the run or frame that worked last."""
        return self._now.execution

    def run(
        self,
        graph: Graph,
        sampling: Sampling,
        collector: Collector | None = None,
        execution: Execution | None = None,
        sampled: Callable[[Chunk], None] | None = None,
    ) -> Iterator[float]:
        """A generator of the share done so far, one value a node; `self.execution` holds the result at its
        end. `execution` goes on with an earlier run's. `sampled` is called after each sample of a tile.
        Raises Cancelled when the flag of either device is set."""
        context = self._now = _Context(graph, execution=execution or Execution())
        if not graph.layers:
            return
        nodes = graph.nodes()
        scene_nodes = [node for node in nodes if not node.per_surface]
        surface_nodes = [node for node in nodes if node.per_surface]
        spent = _last_uses(graph, surface_nodes)
        total = len(scene_nodes) + len(surface_nodes) * sampling.chunk_count
        readers = Counter(item.key for node in nodes for item in node.inputs)
        done = 0
        try:
            for node in scene_nodes:
                # A node that only the other device's nodes read is made there, when they ask for it.
                if node.step.twin(self.primary.name) or self.primary is self.fallback:
                    self._now = context
                    self.value(node, self.primary)
                    self._free_inputs(node, readers)
                done += 1
                yield done / total
            for chunk in sampling.chunks():
                context.chunk = chunk
                collected: dict[str, np.ndarray] = {}
                watching = collector is not None and chunk.sample == 0
                for node in surface_nodes:
                    self._now = context
                    self.value(node, self._home(node))
                    for layer in graph.layers:
                        if layer.node == node:
                            tile = self._collect(layer, sampling, chunk)
                            if watching:
                                collected[layer.name] = tile
                    self._forget(context, spent.get(node, ()))
                    done += 1
                    yield done / total
                self._now = context
                if watching:
                    device = self._home(graph.surface)
                    surface = device.to_host(self.value(graph.surface, device))
                    for _ in collector.add(chunk, surface, collected):
                        yield done / total
                        self._raise_if_cancelled()
                        self._now = context
                self._drop_passing(context)
                if chunk.y1 == sampling.height:
                    context.execution.samples = chunk.sample + 1
                if sampled is not None:
                    sampled(chunk)
        finally:
            self._drop_passing(context)
            self._trim()
        for layer in graph.layers:
            if layer.is_whole:
                context.execution.finish(layer, sampling.samples)

    def frame(
        self, graph: Graph, chunk: Chunk, epoch: int = 0, execution: Execution | None = None
    ) -> Iterator[float]:
        """A generator as `run`, of one chunk: a preview's frame. Values at its surface are kept too, so that
        the next frame of the same camera runs only what has changed. When it has ended, `layer_value` gives
        the images, and `self.execution` tells what ran.

        Frames of one `epoch` make one picture (its tiles and samples): where not all fits into
        `kept_surface_bytes`, what older epochs used goes first, and then what was made last, since the next
        picture asks for all of it in the same order. `execution` goes on counting an earlier one's nodes.
        """
        context = self._now = _Context(graph, chunk, None, epoch, execution or Execution())
        missing = self._missing(graph)
        nodes = [node for node in graph.nodes() if node in missing]
        try:
            for done, node in enumerate(nodes, start=1):
                self._now = context
                if node.per_surface:
                    self.value(node, self._home(node))
                    self._trim_kept()
                elif node.step.twin(self.primary.name) or self.primary is self.fallback:
                    self.value(node, self.primary)
                yield done / len(nodes)
        finally:
            self._now = context
            self._trim()

    def _missing(self, graph: Graph) -> set[Node]:
        """Nodes of a frame that are still to be made: not those whose every reader is there already."""
        missing: set[Node] = set()
        queue = [layer.node for layer in graph.layers]
        while queue:
            node = queue.pop()
            store, key = self._place(node, self._home(node))
            if node in missing:
                continue
            if key in store:
                self.value(node, self._home(node))  # it is in use
                continue
            missing.add(node)
            queue.extend(node.inputs)
        return missing

    def layer_value(self, layer: PlannedLayer) -> tuple[Device, Any]:
        """A layer of the last frame, and the device that holds it."""
        device = self._home(layer.node)
        return device, self.value(layer.node, device)

    def value(self, node: Node, device: Device) -> Any:
        """The node's value on `device`, running or moving what that takes."""
        store, key = self._place(node, device)
        if key in store:
            if store is self._kept:
                self._kept.move_to_end(key)
            elif store is self._framed:
                self._framed_bytes[key] = self._framed_bytes[key][0], self._now.epoch
            return store[key]
        self._raise_if_cancelled()
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
        if store is self._framed:
            self._framed_bytes[key] = device.size_of(value), self._now.epoch
        return value

    def _raise_if_cancelled(self) -> None:
        if any(device.cancel_flag.is_set() for device in (self.primary, self.fallback)):
            raise Cancelled()

    def keep_only(self, *graphs: Graph) -> None:
        """Frees kept values that no node of these graphs has, such as the maps of where a light was."""
        devices = {device.name: device for device in (self.primary, self.fallback)}
        used = {node.key for graph in graphs for node in graph.nodes()}
        self._sizes = {key: size for key, size in self._sizes.items() if key in used}
        for name, key in [place for place in self._kept if place[1] not in used]:
            devices[name].release(self._kept.pop((name, key)))

    def release(self) -> None:
        """Frees everything that was kept."""
        self._framed.clear()
        self._framed_bytes.clear()
        self._drop_passing(self._now)
        self.kept_values, kept = 0, self.kept_values
        self._trim()
        self.kept_values = kept

    def _place(self, node: Node, device: Device) -> tuple[dict, tuple]:
        """Where the node's value is kept, and under which key."""
        if not node.per_surface:
            return self._kept, (device.name, node.key)
        now = self._now
        if now.passing is not None:
            return now.passing, (device.name, node.key)
        # What the surface carries is the graph's to say, and no part of the node's key.
        attributes = now.graph.surface_attributes if node == now.graph.surface else None
        return self._framed, (device.name, node.key, now.chunk, attributes)

    def _home(self, node: Node) -> Device:
        return self.primary if self._usable(node, self.primary) else self.fallback

    def _usable(self, node: Node, device: Device) -> bool:
        """Whether the node can run there, with all its inputs that cannot be moved there."""
        runs = node.step.twin(device.name) is not None and (device.name, node.step.name) not in self._broken
        return runs and all(item.step.copyable or self._usable(item, device) for item in node.inputs)

    def _run(self, node: Node, device: Device) -> Any:
        inputs = [self.value(item, device) for item in node.inputs]
        if not self._usable(node, device):
            return self._fallen_back(node, device)  # an input has just failed
        graph, chunk = self._now.graph, self._now.chunk
        extra: dict[str, Any] = {}
        if graph is not None and node == graph.surface:
            extra = {"chunk": chunk, "attributes": graph.surface_attributes}
        elif node.step.told_chunk:
            extra = {"chunk": chunk}
        size = node.step.bytes_of(node, self.outline) if node.step.bytes_of and self.outline else 0
        started = time.perf_counter()
        compiling = device.compile_seconds
        try:
            check_room(size)
            value = node.step.twin(device.name)(device, *inputs, **node.params, **extra)
            device.finish()
        except device.cancelled:
            raise Cancelled() from None
        except MemoryError as error:
            whose = f" for {node.instance}" if node.instance else ""
            raise StrataError(f"not enough memory for step '{node.step.name}'{whose}: {error}") from error
        except Exception as error:
            if device is self.fallback or not node.step.twin(self.fallback.name):
                raise
            self._broken[device.name, node.step.name] = str(error)
            self.execution.warnings.append(
                f"step '{node.step.name}' failed on {device.name} and ran on {self.fallback.name}: {error}"
            )
            return self._fallen_back(node, device)
        if size:
            self._sizes[node.key] = size
        compiling = device.compile_seconds - compiling
        self._time(node, device.name, time.perf_counter() - started - compiling)
        return value

    def _fallen_back(self, node: Node, device: Device) -> Any:
        """The fallback's value for `device`; None where it cannot be moved: then what reads it runs there."""
        value = self.value(node, self.fallback)
        return device.from_host(self.fallback.to_host(value)) if node.step.copyable else None

    def _time(self, node: Node, device: str, seconds: float) -> None:
        self.execution.add_time(node, device, seconds)

    def _collect(self, layer: PlannedLayer, sampling: Sampling, chunk: Chunk) -> np.ndarray:
        """Adds a layer's tile to its image; returns the tile on the host."""
        started = time.perf_counter()
        device = self._home(layer.node)
        tile = device.to_host(self.value(layer.node, device))
        self.execution.begin(layer, (sampling.height, *tile.shape[1:]), sampling.samples)
        self.execution.add(layer, slice(chunk.y0, chunk.y1), tile)
        self.execution.add_time(layer.node, device.name, time.perf_counter() - started, runs=0)
        return tile

    @staticmethod
    def _forget(context: _Context, nodes: Iterable[Node]) -> None:
        """Drops values at the surface. Not freed by force: a step may hand on what it was given, so that
        another value shares it."""
        keys = {node.key for node in nodes}
        for place in [place for place in context.passing if place[1] in keys]:
            del context.passing[place]

    def _free_inputs(self, node: Node, readers: Counter) -> None:
        """Frees what `node` was the last to read."""
        for item in node.inputs:
            readers[item.key] -= 1
            if readers[item.key] == 0 and not self.keeps_inputs:
                for device in {self.primary, self.fallback}:
                    value = self._kept.pop((device.name, item.key), None)
                    if value is not None:
                        device.release(value)

    def _drop_passing(self, context: _Context) -> None:
        devices = {device.name: device for device in (self.primary, self.fallback)}
        for (name, _), value in (context.passing or {}).items():
            devices[name].release(value)
        if context.passing:
            context.passing.clear()

    def _trim_kept(self) -> None:
        """Drops those values that were used longest ago and are too many. In a frame each lamp's maps are
        read before the next lamp's are made; what is wanted again is made again."""
        devices = {device.name: device for device in (self.primary, self.fallback)}
        while len(self._kept) > self.kept_values:
            (name, _), value = self._kept.popitem(last=False)
            devices[name].release(value)
        if self.kept_bytes is None:
            return
        excess = sum(self._sizes.get(key, 0) for _, key in self._kept) - self.kept_bytes
        for name, key in [place for place in self._kept if place[1] in self._sizes]:
            if excess <= 0:
                break
            excess -= self._sizes[key]
            devices[name].release(self._kept.pop((name, key)))

    def _trim(self) -> None:
        self._trim_kept()
        excess = sum(size for size, _epoch in self._framed_bytes.values()) - self.kept_surface_bytes
        if excess <= 0:
            return
        now = self._now.epoch
        keys = list(self._framed)
        older = [key for key in keys if self._framed_bytes[key][1] != now]
        current = [key for key in keys if self._framed_bytes[key][1] == now]
        for key in (*older, *reversed(current)):
            if excess <= 0:
                break
            # Not freed by force: a step may hand on what it was given, so that another value shares it.
            del self._framed[key]
            excess -= self._framed_bytes.pop(key)[0]


def _last_uses(graph: Graph, nodes: list[Node]) -> dict[Node, list[Node]]:
    """Of nodes at the surface in their order: what no later one reads, by the last that does. The surface
    itself stays, for the collector."""
    last = {item: node for node in nodes for item in (*node.inputs, node) if item.per_surface}
    spent: dict[Node, list[Node]] = {}
    for item, node in last.items():
        if item != graph.surface:
            spent.setdefault(node, []).append(item)
    return spent


def drain(steps: Iterator[float], progress: Callable[[float], None] | None = None) -> None:
    """Runs a generator of shares to its end."""
    for share in steps:
        if progress:
            progress(share)
