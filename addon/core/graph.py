"""Recorded work: steps, nodes, layers, and what was left out."""

from __future__ import annotations

import hashlib
import marshal
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from enum import IntEnum
from functools import lru_cache
from typing import Any

import numpy as np

from .effect import LayerKind
from .outline import Outline
from .params import Params
from .roles import THE_IMAGE, Of, Role
from .shot import Shot


class Rate(IntEnum):
    """How often a step runs: SCENE, once (maps, trees); SAMPLE, for every tile and sample (what reads shading
    points); PICTURE, once on finished images (core/film.py)."""

    SCENE = 0
    SAMPLE = 1
    PICTURE = 2


WHOLE = "whole"
"""Reach of a step that reads all of the image: its tile is the image."""


@dataclass(frozen=True)
class Sum:
    """How a step's value comes apart into nodes whose values add up to it, so that not all of its inputs have
    to be there at once.

    `terms(node)`: of each term, those nodes below that no other term needs; none at all where the node does
    not come apart. `part(node, numbers)`: a node that is the sum of the terms of these numbers; that of all
    is the node itself.
    """

    terms: Callable[[Node], tuple[tuple[Node, ...], ...]]
    part: Callable[[Node, Collection[int]], Node]


@dataclass(frozen=True)
class Step:
    """One kind of work, declared once, with a twin on each device.

    `cpu` and `gpu` are called as `twin(device, *inputs, **params)` and return the node's value. A missing
    twin is a hole, and `hole` says why; the executor then moves the node to the other device.
    `rate`: how often it runs, at least; more often where its inputs do. Twins of a step that is of SAMPLE
    rate by itself get the pixels and the sample as `chunk` (core/surface.py); what only works on its inputs'
    values needs neither. Inputs of a PICTURE step are finished images.
    `reach`: how many pixels, rows and columns, it reads of its inputs beyond its own pixel, or what gives
    that of a node, or WHOLE. Its inputs then have so many more at each side than `chunk`, also beyond the
    image, or are all of it and no more (core/reach.py).
    `copyable`: its value can be moved between devices; if not, the step runs again where it is wanted.
    `croppable`: its value is images (rows, columns[, channels]) of a pixel each; if not, it is made anew for
    a reader that wants fewer pixels around the chunk.
    `bytes_of(node, outline)`: about how many bytes a node's value takes while it is kept, None where it is
    next to nothing or one tile's. `sum`: how it comes apart, None where it does not.
    `work_of(node, outline)`: how many times as long as the least node of the step a run takes, None where all
    take about as long. `ordinary_seconds`: what the least run takes on an ordinary machine, at the surface a
    pixel of it, where that is not what most steps take (core/progress.py); only their ratios count.
    """

    name: str
    cpu: Callable | None = None
    gpu: Callable | None = None
    hole: str = ""
    rate: Rate = Rate.SCENE
    reach: int | str | Callable[[Node], int] = 0
    copyable: bool = True
    croppable: bool = True
    bytes_of: Callable[[Node, Outline], int] | None = None
    sum: Sum | None = None
    work_of: Callable[[Node, Outline], float] | None = None
    ordinary_seconds: float | None = None

    def twin(self, device_name: str) -> Callable | None:
        return self.cpu if device_name == "cpu" else self.gpu


def _feed(digest, value: Any) -> None:
    """Hashes a parameter by content: what the bits are, not which object holds them."""
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).data)
    elif isinstance(value, frozenset):
        digest.update(_digest_of(value))
    elif is_dataclass(value):
        digest.update(type(value).__name__.encode())
        _feed(digest, tuple(getattr(value, each.name) for each in fields(value)))
    else:
        try:
            # Numbers, words and tuples of such, to the last bit, at once: a table of materials has thousands.
            # The format's second version writes equal values alike, wherever they come from.
            digest.update(marshal.dumps(value, 2))
        except ValueError:
            if not isinstance(value, (tuple, list)):
                digest.update(f"{type(value).__name__}:{value!r};".encode())
                return
            digest.update(b"(")
            for item in value:
                _feed(digest, item)
            digest.update(b")")


@lru_cache(maxsize=1024)
def _digest_of(numbers: frozenset[int]) -> bytes:
    """Of indices, in whatever order. Kept, since a scene's thousands of casters are asked for by many nodes
    of every plan."""
    return hashlib.blake2b(np.sort(np.fromiter(numbers, np.int64, len(numbers))), digest_size=16).digest()


@dataclass(frozen=True, eq=False)
class Node:
    """A step to run. `instance` says for whom (a light, a cube face). `key` hashes the step, its parameters
    and the keys of its inputs: equal keys mean equal values."""

    step: Step
    instance: str
    inputs: tuple[Node, ...]
    params: dict[str, Any]
    key: str = field(init=False)
    rate: Rate = field(init=False)

    def __post_init__(self):
        digest = hashlib.blake2b(digest_size=16)
        _feed(digest, self.step.name)
        for name in sorted(self.params):
            _feed(digest, name)
            _feed(digest, self.params[name])
        for node in self.inputs:
            digest.update(node.key.encode())
        object.__setattr__(self, "key", digest.hexdigest())
        rate = max(self.step.rate, *(node.rate for node in self.inputs), Rate.SCENE)
        object.__setattr__(self, "rate", rate)

    def __hash__(self):
        return hash(self.key)

    def __eq__(self, other):
        return isinstance(other, Node) and self.key == other.key


@dataclass(frozen=True)
class LeftOut:
    """Something that does not run, and why, in words for a person."""

    what: str
    reason: str
    effect: str = ""
    light: str = ""


@dataclass(frozen=True)
class PlannedLayer:
    """An image that the graph makes. `name` is unique and safe for a file; `effect` is the effect's id, empty
    for a picture that is no baked layer; `params` are the effect's. `of`: the lamp that it is of, or what
    else, `light` that lamp's own name and `pass_name` that in passes; `casters` are the instances that can
    block its light into view. `weight`: what its samples weigh, None where all weigh the same, and
    `weighed_by` what that is (Weight in core/weight.py); `depth`: how far away an OVER layer is at each
    pixel, metres. `joins`: not so where the picture takes the same from another effect. `is_whole`: not so
    where other graphs' layers of that name are still to be added to it. `target_error`: what its lamp or its
    effect asks for, 0: nothing."""

    name: str
    effect: str
    node: Node
    kind: LayerKind
    params: Params | None = None
    light: str = ""
    of: Of = THE_IMAGE
    casters: frozenset[int] = frozenset()
    weight: Node | None = None
    weighed_by: str = "none"
    depth: Node | None = None
    joins: bool = True
    is_whole: bool = True
    pass_name: str = ""
    target_error: float = 0.0

    @property
    def roots(self) -> tuple[Node, ...]:
        """All that it is made of."""
        return (self.node,) if self.weight is None else (self.node, self.weight)

    @property
    def channels(self) -> str:
        """One letter each, "V" or "RGBA"."""
        return self.kind.channels

    @property
    def role(self) -> Role:
        """What it is to the picture."""
        return self.kind.role


@dataclass(frozen=True)
class Graph:
    """What runs for one shot. `surfaces`: nodes whose values are shading points, each with the attributes
    that are read of it; `surface`: the shot's own among them, None where nothing reads it. With `instances`
    that is the union of what the nodes read: nothing else is extracted or rasterised. `wants` names what the
    extraction has to bring besides positions."""

    layers: tuple[PlannedLayer, ...]
    left_out: tuple[LeftOut, ...]
    surfaces: dict[Node, frozenset[str]]
    instances: frozenset[int]
    wants: frozenset[str] = frozenset()
    shot: Shot | None = None
    surface: Node | None = None

    def nodes(self, roots: Iterable[Node] | None = None) -> tuple[Node, ...]:
        """Every node below `roots` (the layers', if None), inputs before users, each once."""
        order: dict[Node, None] = {}
        if roots is None:
            roots = [node for layer in self.layers for node in layer.roots]
        for root in roots:
            for node in _depth_first(root, order):
                order[node] = None
        return tuple(order)


def _depth_first(root: Node, done: dict[Node, None]) -> Iterator[Node]:
    """Inputs before users, without recursion: graphs may be deep."""
    stack = [(root, False)]
    seen = set()
    while stack:
        node, ready = stack.pop()
        if node in done or (node in seen and not ready):
            continue
        if ready:
            yield node
            continue
        seen.add(node)
        stack.append((node, True))
        stack.extend((item, False) for item in reversed(node.inputs))
