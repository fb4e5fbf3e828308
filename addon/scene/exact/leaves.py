"""Outputs of nodes that Blender bakes: which they are, and by what each is known again."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field

import bpy
import numpy as np

from ..nodes.baked import BakedTexture
from ..nodes.graph import Graph, Path
from ..nodes.values import FLOAT, Unread, Value, unread
from .upstream import Images, Upstream, upstream_of

FORMAT = 2
"""Of what is kept, and of how it is baked: another number, and all is baked anew."""


@dataclass(frozen=True)
class Appearance:
    """What nodes may ask of an object: its matrix to the world, its colour, its pass index, and its number
    between 0 and 1 that Cycles calls random."""

    matrix: tuple[tuple[float, ...], ...]
    colour: tuple[float, ...]
    pass_index: int
    random: float


@dataclass(frozen=True, eq=False)
class Leaf:
    """An output of a node of a material: `path` are the names of the groups around it, outermost first."""

    key: str
    node: str
    output: str
    path: tuple[str, ...]
    channels: int


@dataclass(eq=False)
class BakedLeaves:
    """Those of one material on some slots of one mesh. `mesh` and `slots` tell which; `appearance` is None
    where many instances show it. `material_index` is the material's pass index; `uses_osl`: Cycles runs
    scripts. `known(key)` gives what is baked, `failed` why something cannot be; `seen_upstream` is shared by
    all that read the same tree, `images` by all of a scan."""

    mesh: str
    slots: tuple[int, ...]
    size: int
    appearance: Appearance | None
    known: Callable[[str], np.ndarray | None]
    failed: dict[str, str]
    can_bake: bool
    material_index: int
    uses_osl: bool
    seen_upstream: dict[tuple, Upstream] = field(default_factory=dict)
    images: Images = field(default_factory=dict)
    found: dict[str, Leaf] = field(default_factory=dict)
    are_of_object: bool = False
    """Whether any hangs on more of an object than its mesh."""

    def value(
        self, graph: Graph, node: bpy.types.Node, output: bpy.types.NodeSocket, path: Path, read: Value
    ) -> Value:
        place = (node.as_pointer(), output.identifier, *(group.as_pointer() for group in path))
        if place not in self.seen_upstream:
            self.seen_upstream[place] = upstream_of(graph, node, output, path, self.images)
        upstream = self.seen_upstream[place]
        is_unread = read.hangs_on(Unread)
        if upstream.eye:
            return read if is_unread else unread(read.kind, f"node '{upstream.eye}'")
        if upstream.is_of_object and self.appearance is None:
            return unread(read.kind, f"node '{node.name}' (it differs between instances)")
        self.are_of_object = self.are_of_object or upstream.is_of_object
        # What is unread is of the socket's kind, a colour or a vector at least.
        made_of = [
            upstream.digest, output.identifier, read.kind, self.mesh, self.slots, self.size, FORMAT,
            bpy.app.version_string, bpy.data.colorspace.working_space,
            self.appearance if upstream.is_of_object else None,
            self.material_index if upstream.asks_material_index else None,
            self.uses_osl if upstream.runs_scripts else None,
        ]  # fmt: skip
        key = hashlib.sha256(repr(made_of).encode()).hexdigest()[:40]
        if key in self.failed:
            return unread(read.kind, f"node '{node.name}' ({self.failed[key]})")
        values = self.known(key)
        if values is None and not self.can_bake:
            return unread(read.kind, f"node '{node.name}' (not baked yet on this mesh)")
        channels = 1 if read.kind == FLOAT else 3
        self.found[key] = Leaf(key, node.name, output.identifier, tuple(each.name for each in path), channels)
        texture = BakedTexture(node.name, key, (self.size, self.size), values)
        return texture.value(read.kind)


def random_of(name: str) -> float:
    """What Cycles gives an object of that name as its random number (its util/hash.h and
    blender/object.cpp; Jenkins's lookup3)."""
    number = 0
    for byte in name.encode():
        number = (number * 37 + byte) & 0xFFFFFFFF
    return _jenkins(number, 0) / 0xFFFFFFFF


def _jenkins(x: int, y: int) -> int:
    mask = 0xFFFFFFFF

    def turned(value: int, by: int) -> int:
        return ((value << by) | (value >> (32 - by))) & mask

    a = b = c = (0xDEADBEEF + (2 << 2) + 13) & mask
    b, a = (b + y) & mask, (a + x) & mask
    for first, second, by in (("c", "b", 14), ("a", "c", 11), ("b", "a", 25), ("c", "b", 16),
                              ("a", "c", 4), ("b", "a", 14), ("c", "b", 24)):  # fmt: skip
        values = {"a": a, "b": b, "c": c}
        values[first] = ((values[first] ^ values[second]) - turned(values[second], by)) & mask
        a, b, c = values["a"], values["b"], values["c"]
    return c
