"""What a bake takes of memory, told before it begins, and its layers in groups that fit into a budget."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .film import takes_of
from .graph import Graph, Node, PlannedLayer, Rate
from .outline import Outline
from .reach import fitted, margins_of, reads_whole
from .sampling import Sampling
from .surface import ATTRIBUTES

MEBIBYTE = 1 << 20
GIGABYTE = 10**9
MEGABYTE = 10**6

NUMBER_BYTES = 4
LIVE_VALUES = 5
"""Values of a tile that are there at once for each channel of a layer under way: what it is made of, itself,
and the rows that probes are drawn from. Measured."""
WEIGHT_VALUES = 6
"""The same of what samples weigh: albedo, irradiance and the weight of one layer after the other."""
KERNEL_BYTES = 40 * MEBIBYTE
"""Threads, their stacks and what kernels sort triangles into."""
ROOM_BYTES = 400 * MEBIBYTE
"""What a group takes at most of maps and tiles where the budget is automatic. More would hardly be faster,
since only the surface is made anew for each group."""


@dataclass(frozen=True)
class MemoryEstimate:
    """Bytes. `held`: what the process has before the bake; `layers`: the finished images; `shared`: geometry,
    trees and the surface, which all groups read; `group`: the largest group's maps and tiles; `budget`: what
    a bake may take beside what is held."""

    held: int
    layers: int
    shared: int
    group: int
    groups: int
    budget: int

    @property
    def total(self) -> int:
        """The most that the process will have."""
        return self.held + self.needed

    @property
    def needed(self) -> int:
        """What the bake takes of it."""
        return self.layers + self.shared + self.group

    @property
    def shortage(self) -> str | None:
        """Where even one layer at a time is over the budget: so, in one line."""
        if self.needed <= self.budget:
            return None
        return (
            f"memory: the bake takes about {size_of(self.needed)}, over its budget of "
            f"{size_of(self.budget)}, with as few layers at a time as it can"
        )

    @property
    def sentence(self) -> str:
        """For a person, in one line."""
        line = f"memory: about {size_of(self.total)}, of which layers {size_of(self.layers)}"
        return line + (f"; worked off in {self.groups} groups of lamps" if self.groups > 1 else "")

    def to_json(self) -> dict[str, int]:
        return {
            "bytes": self.total,
            "layers_bytes": self.layers,
            "shared_bytes": self.shared,
            "group_bytes": self.group,
            "held_bytes": self.held,
            "budget_bytes": self.budget,
            "groups": self.groups,
        }


def size_of(count: int) -> str:
    """For a person: "1.4 GB", "520 MB"."""
    if count >= 0.95 * GIGABYTE:
        return f"{count / GIGABYTE:.1f} GB"
    return f"{count / MEGABYTE:.0f} MB" if count >= MEGABYTE else "less than 1 MB"


def in_groups(
    graph: Graph,
    outline: Outline,
    sampling: Sampling,
    budget: int,
    held: int = 0,
    room: int | None = None,
    has_error_images: bool = False,
) -> tuple[tuple[Graph, ...], MemoryEstimate]:
    """The graph's layers in graphs that are to run one after the other, each with as many layers as fit into
    `budget` bytes beside the finished layers and what all share, and at least one; and what that takes. Of
    a layer that is a sum (Step.sum) each has a part, under the layer's name. `room`: a group's bytes are no
    more than this either. The layers of a lamp are beside each other. `has_error_images`: each measured layer
    has an image of its error besides."""
    sizes = _Sizes(graph, outline, sampling)
    layers = sum(map(sizes.image, graph.layers))
    if has_error_images:
        layers += sizes.plane * sum(layer.kind.score is not None for layer in graph.layers)
    free = budget - layers - sizes.shared
    free = free if room is None else min(free, room)
    groups: list[_Group] = []
    for unit in _units(graph):
        if not groups or not groups[-1].takes(unit, free):
            groups.append(_Group(sizes))
            groups[-1].takes(unit, None)
    last = {unit.layer.name: number for number, group in enumerate(groups) for unit in group.units}
    graphs = tuple(_graph_of(graph, group.units, number, last) for number, group in enumerate(groups))
    largest = max((group.bytes for group in groups), default=0)
    return graphs, MemoryEstimate(held, layers, sizes.shared, largest, max(len(groups), 1), budget)


def too_large(graph: Graph, outline: Outline, sampling: Sampling, budget: int) -> dict[str, str]:
    """By name, why layers have to be left out for which some step reads a whole image at once (Step.reach):
    where that does not fit into `budget` bytes."""
    if not reads_whole(graph.nodes()):
        return {}
    whole, found = fitted(sampling, graph.nodes()), {}
    for layer in graph.layers:
        if not reads_whole(graph.nodes(layer.roots)):
            continue
        sizes = _Sizes(replace(graph, layers=(layer,)), outline, whole)
        needed = sizes.shared + sizes.image(layer) + sizes.tiles(_Unit(layer, None, layer.roots))
        if needed > budget:
            what = f"{size_of(needed)}, over the budget of {size_of(budget)}"
            found[layer.name] = f"it reads a whole image at once: {what}"
    return found


@dataclass(frozen=True)
class _Unit:
    """What cannot be divided further: a layer, or a term of one that is a sum (`term`, None if it is not).
    `nodes`: its own, and what all terms read."""

    layer: PlannedLayer
    term: int | None
    nodes: tuple[Node, ...]


def _sum_of(layer: PlannedLayer) -> Node | None:
    """What of a layer may come in several groups, if anything: what its samples weigh, or a picture of no
    effect itself."""
    node = layer.weight
    if node is None and not layer.effect and not layer.of.is_lamp:
        node = layer.node
    return node if node is not None and node.step.sum and node.step.sum.terms(node) else None


def _units(graph: Graph) -> list[_Unit]:
    """First those that need no layer of a lamp, then lamp by lamp, then layers of no lamp."""
    units: list[tuple[float, _Unit]] = []
    lamps = {layer.node.key: layer.of.index if layer.of.is_lamp else np.inf for layer in graph.layers}
    for layer in graph.layers:
        node = _sum_of(layer)
        if node is None:
            units.append((lamps[layer.node.key], _Unit(layer, None, layer.roots)))
            continue
        weighed = (layer.node,) if node is layer.weight else ()
        for number, items in enumerate(node.step.sum.terms(node)):
            lamp = max((lamps[item.key] for item in items if item.key in lamps), default=-1)
            part = node.step.sum.part(node, (number,))
            units.append((lamp, _Unit(layer, number, (part, *weighed))))
    return [unit for _, unit in sorted(units, key=lambda pair: pair[0])]


def _graph_of(graph: Graph, units: list[_Unit], number: int, last: dict[str, int]) -> Graph:
    terms: dict[str, list[int | None]] = {}
    for unit in units:
        terms.setdefault(unit.layer.name, []).append(unit.term)
    layers = []
    for layer in (layer for layer in graph.layers if layer.name in terms):
        numbers, node = terms[layer.name], _sum_of(layer)
        if node is not None:
            part = {"node" if node is layer.node else "weight": node.step.sum.part(node, numbers)}
            layer = replace(layer, **part, is_whole=last[layer.name] == number)
        layers.append(layer)
    return replace(graph, layers=tuple(layers))


class _Group:
    """Units that run together, and what they take: maps, the largest of what a map is made of, tiles, and
    sums of samples."""

    def __init__(self, sizes: _Sizes):
        self.units: list[_Unit] = []
        self.bytes = 0
        self._sizes = sizes
        self._maps: set[Node] = set()
        self._stay = self._passing = self._tiles = 0

    def takes(self, unit: _Unit, limit: int | None) -> bool:
        """Takes it in, unless all are then over the limit."""
        sizes = self._sizes
        new = {node for each in unit.nodes for node in sizes.maps(each)} - self._maps
        stay = self._stay + sum(sizes.scene_bytes(node) for node in new if sizes.stays(node))
        passing = max([sizes.scene_bytes(node) for node in new if not sizes.stays(node)], default=0)
        passing = max(self._passing, passing)
        tiles = self._tiles + sizes.tiles(unit)
        if limit is not None and stay + passing + tiles > limit:
            return False
        self.units.append(unit)
        self._maps |= new
        self._stay, self._passing, self._tiles = stay, passing, tiles
        self.bytes = stay + passing + tiles
        return True


class _Sizes:
    """How many bytes things take."""

    def __init__(self, graph: Graph, outline: Outline, sampling: Sampling):
        self._graph, self._outline, self._sampling = graph, outline, sampling
        self._tile = sampling.tile_rows * sampling.width
        self._scene_bytes: dict[Node, int] = {}
        self._maps: dict[Node, frozenset[Node]] = {}
        nodes = graph.nodes()
        self._read_at_surface = {item for node in nodes if node.rate != Rate.SCENE for item in node.inputs}
        for_all = [node for node in nodes if node.rate == Rate.SCENE and not node.instance]
        margins, surfaces = margins_of(graph, takes_of(graph)), 0
        for node, attributes in graph.surfaces.items():
            carried = [ATTRIBUTES[name] for name in attributes]
            pixels = sum(
                (sampling.tile_rows + 2 * m) * (sampling.width + 2 * m) for m in margins.get(node, (0,))
            )
            surfaces += pixels * sum(np.dtype(each.dtype).itemsize * each.channels for each in carried)
        is_weighed = any(layer.weight is not None for layer in graph.layers)
        surfaces += WEIGHT_VALUES * NUMBER_BYTES * self._tile * is_weighed
        sums = sum(self.image(layer) for layer in graph.layers if layer.weight and _sum_of(layer))
        self.shared = sum(map(self.scene_bytes, for_all)) + surfaces + sums + KERNEL_BYTES

    def scene_bytes(self, node: Node) -> int:
        """Of its value, where it does not depend on the surface."""
        if node not in self._scene_bytes:
            measure = node.step.bytes_of
            self._scene_bytes[node] = int(measure(node, self._outline)) if measure else 0
        return self._scene_bytes[node]

    def stays(self, node: Node) -> bool:
        """Whether it is read at the surface, and not only by other maps."""
        return node in self._read_at_surface

    def maps(self, node: Node) -> frozenset[Node]:
        """What some lamp's light needs below `node` that does not depend on the surface."""
        if node not in self._maps:
            below = self._graph.nodes([node])
            self._maps[node] = frozenset(each for each in below if each.instance and each.rate == Rate.SCENE)
        return self._maps[node]

    def image(self, layer: PlannedLayer) -> int:
        return self.plane * len(layer.channels)

    @property
    def plane(self) -> int:
        """Of an image of one channel."""
        return self._sampling.width * self._sampling.height * NUMBER_BYTES

    def tiles(self, unit: _Unit) -> int:
        """Of what passes by at the surface, and of a sum of weights that no other group adds to."""
        if unit.term is not None:
            return 2 * sum(len(node.inputs) for node in unit.nodes) * NUMBER_BYTES * self._tile
        sums = self.image(unit.layer) if unit.layer.weight is not None else 0
        return LIVE_VALUES * len(unit.layer.channels) * NUMBER_BYTES * self._tile + sums
