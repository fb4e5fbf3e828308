"""From a socket through links, reroutes, muted nodes and node groups to what it carries."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import bpy

from .registry import VALUES
from .values import COLOUR, FLOAT, VECTOR, Attribute, Value, constant, converted, number, unread

DEEPEST = 100
"""Nodes in a chain: each takes some levels of Python's stack, when it is read and when it is evaluated."""

_KINDS = {"VALUE": FLOAT, "INT": FLOAT, "BOOLEAN": FLOAT, "RGBA": COLOUR, "VECTOR": VECTOR}
_ZERO = {FLOAT: 0.0, COLOUR: [0.0] * 3, VECTOR: [0.0] * 3}

Path = tuple[bpy.types.Node, ...]
"""The group nodes that a node is inside of, outermost first."""


@dataclass(frozen=True)
class Situation:
    """Who looks: a camera's ray or a shadow's, at the front or the back."""

    is_shadow: bool = False
    is_back: bool = False


class Leaves(Protocol):
    """Who may know what a node gives where only its place on a surface tells."""

    def value(
        self, graph: Graph, node: bpy.types.Node, output: bpy.types.NodeSocket, path: Path, read: Value
    ) -> Value:
        """Of an output; `read` is what is made of it otherwise: a source, or a texture."""


@dataclass(eq=False)
class Graph:
    """Reads the nodes of one material, light or volume in one situation, each once. `asked` names what the
    answers hang on: 'ray', 'side'. `warnings` keep their order; `tints` are nodes that colour what they let
    through. `leaves` are asked for what is not folded. `lacking` are the uses for which a socket's own number
    stands in."""

    situation: Situation = Situation()
    asked: set[str] = field(default_factory=set)
    warnings: dict[str, None] = field(default_factory=dict)
    tints: dict[str, None] = field(default_factory=dict)
    leaves: Leaves | None = None
    lacking: dict[str, None] = field(default_factory=dict)
    _known: dict[tuple, Value] = field(default_factory=dict)
    _depth: int = 0

    def tell(self, warning: str) -> None:
        self.warnings[warning] = None

    def input(self, socket: bpy.types.NodeSocket, path: Path = ()) -> Value:
        """What comes in, as the socket's own kind."""
        link = link_of(socket)
        if link is None:
            return unlinked(socket)
        value = self._output(link.from_node, link.from_socket, path)
        kind = _KINDS.get(socket.type)
        return unread(FLOAT, f"node '{socket.node.name}'") if kind is None else converted(value, kind)

    def follow(self, node: bpy.types.Node, output: bpy.types.NodeSocket, path: Path):
        """Where an output of a muted node, a group or a group's input comes from: an input socket and the
        path it is on; None: from nowhere. Of any other node: False."""
        if node.mute:
            inner = next((link for link in node.internal_links if link.to_socket == output), None)
            return None if inner is None else (inner.from_socket, path)
        if node.type == "GROUP":
            if node.node_tree is None:
                return None
            ends = [each for each in node.node_tree.nodes if each.bl_idname == "NodeGroupOutput"]
            end = next((each for each in ends if each.is_active_output), None)
            inner = None if end is None else named(end.inputs, output.identifier)
            return None if inner is None else (inner, (*path, node))
        if node.bl_idname == "NodeGroupInput":
            outer = named(path[-1].inputs, output.identifier) if path else None
            return None if outer is None else (outer, path[:-1])
        return False

    def _output(self, node: bpy.types.Node, output: bpy.types.NodeSocket, path: Path) -> Value:
        key = (node.as_pointer(), output.identifier, *(group.as_pointer() for group in path))
        if key not in self._known:
            if self._depth >= DEEPEST:
                return unread(
                    _KINDS.get(output.type, FLOAT), f"node '{node.name}' (more than {DEEPEST} in a chain)"
                )
            self._depth += 1
            try:
                self._known[key] = self._read(node, output, path)
            finally:
                self._depth -= 1
        return self._known[key]

    def _read(self, node: bpy.types.Node, output: bpy.types.NodeSocket, path: Path) -> Value:
        kind = _KINDS.get(output.type, FLOAT)
        origin = self.follow(node, output, path)
        if origin is None:
            return constant(kind, _ZERO[kind])
        if origin is not False:
            return converted(self.input(*origin), kind)
        reading = VALUES.get(node.bl_idname)
        if reading is None:
            value = unread(kind, f"node '{node.name}'")
        else:
            value = reading.read(At(self, node, path), output)
        if self.leaves is not None and _is_leaf(node, value):
            value = self.leaves.value(self, node, output, path, value)
        return converted(value, kind)


@dataclass(eq=False)
class At:
    """A node where it is: in a graph, inside of groups."""

    graph: Graph
    node: bpy.types.Node
    path: Path = ()

    def socket(self, identifier: str) -> bpy.types.NodeSocket:
        """Most are called as they are identified: those are found without a look at the others."""
        socket = self.node.inputs.get(identifier)
        if socket is None or socket.identifier != identifier:
            socket = named(self.node.inputs, identifier)
        return socket

    def input(self, identifier: str) -> Value:
        return self.graph.input(self.socket(identifier), self.path)

    def is_linked(self, identifier: str) -> bool:
        return link_of(self.socket(identifier)) is not None

    def unread(self, kind: str, why: str = "") -> Value:
        return unread(kind, f"node '{self.node.name}'" + (f" ({why})" if why else ""))

    def known(self, identifier: str, use: str) -> Value:
        """An input; the socket's own number, and a warning, where it is not read, nor baked."""
        value = self.input(identifier)
        if not value.unread:
            return value
        self.graph.lacking[use] = None
        self.graph.tell(f"{origins(value)} not read for {use}")
        return unlinked(self.socket(identifier))


def _is_leaf(node: bpy.types.Node, value: Value) -> bool:
    """Whether an output hangs on something else than other nodes' outputs."""
    return not value.is_constant and (not value.inputs or node.bl_idname == "ShaderNodeTexImage")


def origins(value: Value) -> str:
    """What an expression that is no constant comes from, in words, with 'is' or 'are'."""
    found = value.unread
    if not found:
        attributes = {source.name for source in value.sources if isinstance(source, Attribute)}
        found = sorted({part.texture.words for part in value.parts() if part.texture is not None})
        found += [f"attribute '{name}'" for name in sorted(attributes)]
        found = found or ["the UV map"]
    return " and ".join(found) + (" is" if len(found) == 1 else " are")


def named(sockets, identifier: str) -> bpy.types.NodeSocket | None:
    return next((socket for socket in sockets if socket.identifier == identifier), None)


def link_of(socket: bpy.types.NodeSocket) -> bpy.types.NodeLink | None:
    """What feeds an input, behind all reroutes; None where nothing does."""
    for _hop in range(256):
        if not socket.is_linked:
            return None
        link = next((link for link in socket.links if link.is_valid and not link.is_muted), None)
        if link is None or link.from_node.bl_idname != "NodeReroute":
            return link
        socket = link.from_node.inputs[0]
    return None


def unlinked(socket: bpy.types.NodeSocket) -> Value:
    """What an input carries where nothing is linked to it."""
    kind = _KINDS.get(socket.type)
    if kind is None:
        return unread(FLOAT, f"input '{socket.name}' of node '{socket.node.name}'")
    if not hasattr(socket, "default_value"):
        return constant(kind, _ZERO[kind])
    if kind == FLOAT:
        return number(float(socket.default_value))
    numbers = [*socket.default_value, 0.0, 0.0][:3]
    return constant(kind, numbers)
