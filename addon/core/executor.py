"""Runs a graph: shared nodes once, cached by content, tile by tile, timed, cancellable, on either device."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .device import Device
from .errors import Cancelled, StrataError
from .execution import Execution
from .film import Take, takes_of
from .free_memory import check_room
from .graph import Graph, Node, PlannedLayer, Rate
from .observer import NOBODY, Observer
from .outline import Outline
from .reach import margins_of, reach_of
from .sampling import Sampling
from .surface import Chunk
from .value_stores import FrameValues, SceneValues, TileValues


@dataclass
class _Context:
    """What the nodes being run belong to. `store`: where their values at the surface of `chunk` are;
    `margins`: how far around it they are wanted; `images`: finished ones, by node, while steps read them."""

    graph: Graph | None = None
    chunk: Chunk | None = None
    store: TileValues | FrameValues | None = None
    epoch: int = 0
    execution: Execution = field(default_factory=Execution)
    margins: dict[Node, tuple[int, ...]] = field(default_factory=dict)
    images: dict[Node, np.ndarray] | None = None


class Executor:
    """Keeps values of nodes that do not depend on the surface from run to run, most recent first, so that
    what did not change does not run again.

    `fallback` is the CPU device, taken where the primary lacks a twin or fails; it may be the primary.
    `keeps_inputs`: values that only other kept values were made of stay too (a preview's slider may want them
    again); if not, they are freed as soon as nothing of the graph needs them. `most_surface_bytes` bounds
    what `frame` keeps of values that do depend on the surface, `most_scene_bytes` what it keeps of those that
    do not, also while it works. `outline` is what sizes follow from (Step.bytes_of), if it is known.
    `observer` is told of every node.

    Several runs and frames may be under way at once, a step of one after a step of another, and any may be
    abandoned between two nodes.
    """

    def __init__(
        self,
        primary: Device,
        fallback: Device,
        most_scene_values: int = 64,
        keeps_inputs: bool = True,
        most_surface_bytes: int = 0,
        most_scene_bytes: int | None = None,
    ):
        self.primary = primary
        self.fallback = fallback
        self.keeps_inputs = keeps_inputs
        self.outline: Outline | None = None
        self.observer: Observer = NOBODY
        self._devices = {device.name: device for device in (fallback, primary)}.values()
        self.scene_values = SceneValues(self._devices, most_scene_values, most_scene_bytes)
        self._frame_values = FrameValues(most_surface_bytes)
        self._broken: dict[tuple[str, str], str] = {}
        self._now = _Context(store=TileValues(self._devices))

    @property
    def execution(self) -> Execution:
        """Of the run or frame that worked last."""
        return self._now.execution

    def run(
        self,
        graph: Graph,
        sampling: Sampling,
        execution: Execution | None = None,
        sampled: Callable[[Chunk], None] | None = None,
        finishes: bool = True,
    ) -> Iterator[float]:
        """A generator of the share done so far, one value a node; `self.execution` holds the result at its
        end. `execution` goes on with an earlier run's. `sampled` is called after each sample of a tile.
        Unless it `finishes`, more samples may follow, and values of the scene stay until `finish`. Raises
        Cancelled when the flag of either device is set."""
        tile_values = TileValues(self._devices)
        context = _Context(graph, store=tile_values, execution=execution or Execution())
        self._go_on(context)
        if not graph.layers:
            return
        nodes, takes = graph.nodes(), takes_of(graph)
        context.margins = margins_of(graph, takes)
        at = {rate: [node for node in nodes if node.rate == rate] for rate in Rate}
        taken = _taken_after(at[Rate.SAMPLE], takes)
        spent = _last_uses(at[Rate.SAMPLE], taken)
        total = len(at[Rate.SCENE]) + len(at[Rate.SAMPLE]) * sampling.chunk_count + len(at[Rate.PICTURE])
        missing = self._missing(
            [*at[Rate.SAMPLE], *at[Rate.PICTURE], *(layer.node for layer in graph.layers)]
        )
        readers = Counter(item.key for node in nodes if node in missing for item in node.inputs)
        done = 0
        try:
            for node in at[Rate.SCENE]:
                # A node that only the other device's nodes read is made there, when they ask for it.
                if node in missing and (node.step.twin(self.primary.name) or self.primary is self.fallback):
                    self._go_on(context)
                    self.value(node, self.primary)
                    self._free_inputs(node, readers)
                done += 1
                yield done / total
            for chunk in sampling.chunks():
                context.chunk = chunk
                for node in at[Rate.SAMPLE]:
                    self._go_on(context)
                    self._make(node)
                    for take in taken.get(node, ()):
                        self.collect(take, chunk)
                    tile_values.forget({each.key for each in spent.get(node, ())})
                    done += 1
                    yield done / total
                tile_values.clear()
                if chunk.y1 == sampling.height:
                    context.execution.samples = chunk.sample + 1
                if sampled is not None:
                    sampled(chunk)
            if finishes:
                for _ in self.finish(graph, context.execution):
                    done += 1
                    yield done / total
        finally:
            tile_values.clear()
            if finishes:
                self._trim()

    def finish(self, graph: Graph, execution: Execution) -> Iterator[None]:
        """Makes images of the films of all samples, and what steps make of those. Yields after each step."""
        takes = takes_of(graph)
        for take in takes:
            if take.is_whole:
                execution.finish(take)
        yield from self.develop(graph, takes, execution)
        for name in {take.name for take in takes} - {layer.name for layer in graph.layers}:
            del execution.images[name]
        self._trim()

    def frame(
        self, graph: Graph, chunk: Chunk, epoch: int = 0, execution: Execution | None = None
    ) -> Iterator[float]:
        """A generator as `run`, of one chunk: a preview's frame. Values at its surface are kept too, so that
        the next frame of the same camera runs only what has changed (FrameValues says what `epoch` is). When
        it has ended, `layer_value` gives the images, and `self.execution` tells what ran; `execution` goes on
        counting an earlier one's nodes. Steps on finished images run only where the chunk is one."""
        takes = takes_of(graph)
        margins = margins_of(graph, takes)
        context = _Context(graph, chunk, self._frame_values, epoch, execution or Execution(), margins)
        self._go_on(context)
        roots = [node for take in takes for node in (take.node, take.weight) if node]
        roots = [layer.node for layer in graph.layers] if chunk.is_picture else roots
        missing = self._missing(roots)
        nodes = [node for node in graph.nodes(roots) if node in missing]
        try:
            for done, node in enumerate(nodes, start=1):
                self._go_on(context)
                if node.rate != Rate.SCENE:
                    self._make(node)
                    self.scene_values.trim()
                elif node.step.twin(self.primary.name) or self.primary is self.fallback:
                    self.value(node, self.primary)
                yield done / len(nodes)
        finally:
            self._go_on(context)
            self.scene_values.trim()
            self._frame_values.trim({self._place(node, self._home(node), 0)[1] for node in roots})

    def develop(self, graph: Graph, takes: Iterable[Take], execution: Execution) -> Iterator[None]:
        """Runs the steps that read finished images, on those of `execution` or what its films hold so far,
        and puts the layers that they make among its images. Yields after each."""
        nodes = [node for node in graph.nodes() if node.rate == Rate.PICTURE]
        if not nodes:
            return
        tile_values = TileValues(self._devices)
        images = {
            take.node: execution.image(take.name) for take in takes if take.is_whole and not take.spread
        }
        context = _Context(graph, store=tile_values, execution=execution, images=images)
        try:
            for node in nodes:
                self._go_on(context)
                value = self.value(node, self._home(node))
                for layer in graph.layers:
                    if layer.node == node:
                        execution.images[layer.name] = self._home(node).to_host(value)
                yield
        finally:
            tile_values.clear()

    def collect(self, take: Take, chunk: Chunk) -> None:
        """Adds a film's tile of the run or frame that worked last."""
        started = time.perf_counter()
        device = self._home(take.node)
        span = self.observer.node(take.node, device, "films")
        tile, weight = device.to_host(self.value(take.node, device)), None
        if take.weight is not None:
            weight = self._home(take.weight).to_host(self.value(take.weight, self._home(take.weight)))
        self.execution.add(take, chunk, tile, weight)
        span.ended(tile)
        self.execution.add_time(take.node, device.name, time.perf_counter() - started, runs=0)

    def _go_on(self, context: _Context) -> None:
        self._now = context
        self._frame_values.epoch = context.epoch

    def _make(self, node: Node) -> None:
        """The node's values as far around the chunk as anybody wants them, while their inputs are there."""
        for margin in self._now.margins.get(node, (0,)):
            self.value(node, self._home(node), margin)

    def _missing(self, roots: Iterable[Node]) -> set[Node]:
        """Nodes that are still to be made: not those whose every reader is there already."""
        missing: set[Node] = set()
        queue = list(roots)
        while queue:
            node = queue.pop()
            if node in missing:
                continue
            device, margins = self._home(node), self._now.margins.get(node, (0,))
            if all(key in store for store, key in (self._place(node, device, m) for m in margins)):
                self._make(node)  # it is in use
                continue
            missing.add(node)
            queue.extend(node.inputs)
        return missing

    def layer_value(self, layer: PlannedLayer) -> tuple[Device, Any]:
        """A layer of the last frame, and the device that holds it."""
        device = self._home(layer.node)
        return device, self.value(layer.node, device)

    def value(self, node: Node, device: Device, margin: int = 0) -> Any:
        """The node's value on `device`, running or moving what that takes; at the surface with so many pixels
        around the chunk."""
        store, key = self._place(node, device, margin)
        if key in store:
            return store.get(key)
        self._raise_if_cancelled()
        # What can be copied is made once, where it is at home; what cannot is made again where it is wanted.
        if node.rate == Rate.SAMPLE and self._now.images is not None:
            value = device.from_host(self._now.images[node])
        elif self._usable(node, device) and (self._home(node) is device or not node.step.copyable):
            most = self._now.margins.get(node, (margin,))[0]
            if margin < most and node.step.croppable:
                value = self._cropped(node, device, most, margin)
            else:
                value = self._run(node, device, margin)
        else:
            other = self.fallback if device is self.primary else self.primary
            if other is device or not self._usable(node, other):
                raise RuntimeError(f"step '{node.step.name}' has no usable twin: {node.step.hole}")
            source = self.value(node, other, margin)
            way = f"{other.name} to {device.name}"
            value = self._timed(node, device, way, 1, lambda: device.from_host(other.to_host(source)))
        store.put(key, value, device)
        return value

    def _cropped(self, node: Node, device: Device, most: int, margin: int) -> Any:
        """The part that is wanted of a value with more pixels around the chunk."""
        whole, first = self.value(node, device, most), (most - margin, most - margin)
        shape = self._now.chunk.grown(margin).shape
        return self._timed(node, device, device.name, 0, lambda: device.cropped(whole, first, shape))

    def _timed(self, node: Node, device: Device, where: str, runs: int, work: Callable[[], Any]) -> Any:
        """What `work` returns, a copy of the node's value."""
        started = time.perf_counter()
        span = self.observer.node(node, device, where, chunk=self._now.chunk)
        value = work()
        span.issued()
        device.finish()
        span.ended(value)
        self.execution.add_time(node, where, time.perf_counter() - started, runs)
        return value

    def _raise_if_cancelled(self) -> None:
        if any(device.cancel_flag.is_set() for device in (self.primary, self.fallback)):
            raise Cancelled()

    def keep_only(self, *graphs: Graph) -> None:
        """Frees kept values that no node of these graphs has, such as the maps of where a light was."""
        self.scene_values.keep_only({node.key for graph in graphs for node in graph.nodes()})

    def release(self) -> None:
        """Frees everything that was kept."""
        self._frame_values.clear()
        if self._now.store is not None:
            self._now.store.clear()
        self.scene_values.keep_only(())

    def _place(
        self, node: Node, device: Device, margin: int
    ) -> tuple[SceneValues | TileValues | FrameValues, tuple]:
        """Where the node's value is kept, and under which key."""
        if node.rate == Rate.SCENE:
            return self.scene_values, (device.name, node.key)
        now = self._now
        # What the surface carries is the graph's to say, and no part of the node's key.
        attributes = now.graph.surfaces.get(node)
        return now.store, (device.name, node.key, now.chunk, margin, attributes)

    def _home(self, node: Node) -> Device:
        return self.primary if self._usable(node, self.primary) else self.fallback

    def _usable(self, node: Node, device: Device) -> bool:
        """Whether the node can run there, with all its inputs that cannot be moved there."""
        runs = node.step.twin(device.name) is not None and (device.name, node.step.name) not in self._broken
        return runs and all(item.step.copyable or self._usable(item, device) for item in node.inputs)

    def _run(self, node: Node, device: Device, margin: int) -> Any:
        inputs = [self.value(item, device, margin + reach_of(node)) for item in node.inputs]
        if not self._usable(node, device):
            return self._fallen_back(node, device, margin)  # an input has just failed
        graph = self._now.graph
        extra: dict[str, Any] = {}
        if node.step.rate == Rate.SAMPLE:
            extra["chunk"] = self._now.chunk.grown(margin)
        if graph is not None and node in graph.surfaces:
            extra["attributes"] = graph.surfaces[node]
        size = node.step.bytes_of(node, self.outline) if node.step.bytes_of and self.outline else 0
        started = time.perf_counter()
        compiling = device.compile_seconds
        span = self.observer.node(node, device, device.name, inputs, self._now.chunk)
        try:
            check_room(size)
            value = node.step.twin(device.name)(device, *inputs, **node.params, **extra)
            span.issued()
            device.finish()
            span.ended(value)
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
            return self._fallen_back(node, device, margin)
        if size:
            self.scene_values.sizes[node.key] = size
        compiling = device.compile_seconds - compiling
        self.execution.add_time(node, device.name, time.perf_counter() - started - compiling)
        return value

    def _fallen_back(self, node: Node, device: Device, margin: int) -> Any:
        """The fallback's value for `device`; None where it cannot be moved: then what reads it runs there."""
        value = self.value(node, self.fallback, margin)
        return device.from_host(self.fallback.to_host(value)) if node.step.copyable else None

    def _free_inputs(self, node: Node, readers: Counter) -> None:
        """Frees what `node` was the last to read."""
        for item in node.inputs:
            readers[item.key] -= 1
            if readers[item.key] == 0 and not self.keeps_inputs:
                self.scene_values.free(item.key)

    def _trim(self) -> None:
        self.scene_values.trim()
        self._frame_values.trim()


def _taken_after(nodes: Sequence[Node], takes: Iterable[Take]) -> dict[Node, list[Take]]:
    """What is taken once a node has run: the last of what the film is made of."""
    order = {node: number for number, node in enumerate(nodes)}
    taken: dict[Node, list[Take]] = {}
    for take in takes:
        parts = [node for node in (take.node, take.weight) if node in order]
        if parts:
            taken.setdefault(max(parts, key=order.__getitem__), []).append(take)
    return taken


def _last_uses(nodes: Sequence[Node], taken: dict[Node, list[Take]]) -> dict[Node, list[Node]]:
    """Of nodes at the surface in their order: what no later one reads, by the last that does."""
    last: dict[Node, Node] = {}
    for node in nodes:
        read = (each for take in taken.get(node, ()) for each in (take.node, take.weight) if each)
        last |= {item: node for item in (*node.inputs, node, *read) if item.rate == Rate.SAMPLE}
    spent: dict[Node, list[Node]] = {}
    for item, node in last.items():
        spent.setdefault(node, []).append(item)
    return spent
