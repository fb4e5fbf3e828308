"""What a socket carries, as an expression over what a node tree cannot fold: texture coordinates, attributes
of the mesh, and nodes that are not read. What is constant is folded at once, in float64.

Kinds and shapes: 'float' (N,), 'colour' and 'vector' (N, 3), 'texel' (N, 4); of a constant without the N.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..pixels import luminance_weights

FLOAT, COLOUR, VECTOR, TEXEL = "float", "colour", "vector", "texel"


@dataclass(frozen=True)
class Uv:
    """Texture coordinates of a UV map; without a name of the one for rendering."""

    name: str = ""


@dataclass(frozen=True)
class Attribute:
    """One output ('Color', 'Vector', 'Fac' or 'Alpha') of a mesh's attribute; without a name of the colour
    attribute for rendering."""

    name: str
    output: str


@dataclass(frozen=True)
class Unread:
    """Anything: `what` is not read."""

    what: str


Source = Uv | Attribute | Unread


class Context(Protocol):
    """Where an expression is evaluated: N places."""

    def source(self, source: Source) -> np.ndarray:
        """(N, 3) or (N,) float64."""

    def look_up(self, texture: Any, coordinates: np.ndarray) -> np.ndarray:
        """(N, 4) float64 of a texture (textures.py) at coordinates (N, 3)."""


@dataclass(frozen=True, eq=False)
class Value:
    """An expression. `key` is the same for equal ones. `low` and `high`: no number of it is beyond them.
    `texture` is set where it looks one up; its one input then are the coordinates."""

    kind: str
    key: str
    constant: np.ndarray | None = None
    name: str = ""
    operation: Callable[..., np.ndarray] | None = None
    inputs: tuple[Value, ...] = ()
    sources: frozenset[Source] = frozenset()
    low: float = -math.inf
    high: float = math.inf
    texture: Any = None

    @property
    def is_constant(self) -> bool:
        return self.constant is not None

    @property
    def is_share(self) -> bool:
        """Whether it is between 0 and 1 for certain."""
        return self.low >= 0.0 and self.high <= 1.0

    @property
    def unread(self) -> list[str]:
        """What of it is not read."""
        if not self.sources:
            return []
        return sorted(source.what for source in self.sources if isinstance(source, Unread))

    def hangs_on(self, kind: type) -> bool:
        return any(isinstance(source, kind) for source in self.sources)

    def equals(self, number: float) -> bool:
        """Whether it is that number, or that in all its components."""
        return self.constant is not None and self.low == number == self.high

    def number(self) -> float:
        """Of a constant of kind 'float'."""
        return float(self.constant)

    def at(self, context: Context, known: dict[int, np.ndarray] | None = None) -> np.ndarray:
        """Its numbers, float64; `known` are those of expressions by their id."""
        known = {} if known is None else known
        if self.is_constant:
            return self.constant
        if id(self) not in known:
            if not self.inputs:
                found = context.source(next(iter(self.sources)))
            else:
                arguments = [value.at(context, known) for value in self.inputs]
                with np.errstate(all="ignore"):
                    if self.texture is not None:
                        found = context.look_up(self.texture, arguments[0])
                    else:
                        found = self.operation(*arguments)
            known[id(self)] = found
        return known[id(self)]

    def parts(self) -> Iterator[Value]:
        """All expressions in it, itself first, each once."""
        seen, stack = set(), [self]
        while stack:
            value = stack.pop()
            if id(value) not in seen:
                seen.add(id(value))
                yield value
                stack.extend(value.inputs)


def constant(kind: str, numbers) -> Value:
    array = np.asarray(numbers, np.float64)
    listed = array.tolist()
    low, high = (listed, listed) if kind == FLOAT else (min(listed), max(listed))
    if not (math.isfinite(low) and math.isfinite(high)) or listed != listed:
        low, high = -math.inf, math.inf
    return Value(kind, f"{kind}{listed}", array, low=low, high=high)


def number(value: float) -> Value:
    return constant(FLOAT, value)


def variable(kind: str, source: Source, low: float = -math.inf, high: float = math.inf) -> Value:
    return Value(kind, f"{kind} {source}", sources=frozenset([source]), low=low, high=high)


def unread(kind: str, what: str) -> Value:
    return variable(kind, Unread(what))


def apply(
    name: str,
    kind: str,
    operation: Callable[..., np.ndarray],
    *inputs: Value,
    low: float = -math.inf,
    high: float = math.inf,
) -> Value:
    """`operation` on the numbers of `inputs`. `name` tells it from all other operations."""
    if all(value.is_constant for value in inputs):
        with np.errstate(all="ignore"):
            return constant(kind, operation(*(value.constant for value in inputs)))
    return Value(kind, _key(name, inputs), None, name, operation, inputs, _sources(inputs), low, high)


def looked_up(texture: Any, coordinates: Value) -> Value:
    """A texture's texels at coordinates of kind 'vector'."""
    key = _key(f"texture {texture.key}", (coordinates,))
    return Value(TEXEL, key, None, "texture", None, (coordinates,), coordinates.sources, texture=texture)


def _key(name: str, inputs: tuple[Value, ...]) -> str:
    return hashlib.sha1("\n".join([name, *(value.key for value in inputs)]).encode()).hexdigest()


def _sources(inputs: tuple[Value, ...]) -> frozenset[Source]:
    return frozenset().union(*(value.sources for value in inputs))


def wide(numbers: np.ndarray) -> np.ndarray:
    """A float's, to be multiplied with a colour's."""
    return np.asarray(numbers)[..., None]


# Sockets of one kind linked to another (Cycles' kernel/svm/convert.h).


def converted(value: Value, kind: str) -> Value:
    if value.kind == kind:
        return value
    if kind == FLOAT:
        if value.name == "spread":
            return value.inputs[0]
        bounds = {"low": value.low, "high": value.high}
        if value.kind == COLOUR:
            weights = luminance_weights()
            return apply("luminance", FLOAT, lambda c: np.asarray(c) @ weights, value, **bounds)
        return apply("mean", FLOAT, lambda v: np.mean(v, axis=-1), value, **bounds)
    if value.kind == FLOAT:
        return apply(
            "spread", kind, lambda f: np.repeat(wide(f), 3, axis=-1), value, low=value.low, high=value.high
        )
    return apply(f"as {kind}", kind, lambda v: v, value, low=value.low, high=value.high)


# What closures are made with: kept as plain as it can be, so that constants and products are found.


def saturated(value: Value) -> Value:
    """Between 0 and 1."""
    if value.is_share:
        return value
    return apply("saturate", value.kind, lambda v: np.clip(v, 0.0, 1.0), value, low=0.0, high=1.0)


def product(a: Value, b: Value) -> Value:
    """Of floats, of colours, or of a float with a colour."""
    if a.kind == FLOAT and b.kind != FLOAT:
        a, b = b, a
    if a.equals(0.0) or b.equals(0.0):
        return constant(a.kind, 0.0 if a.kind == FLOAT else [0.0] * 3)
    if b.equals(1.0):
        return a
    if a.equals(1.0):
        return converted(b, a.kind)
    share = {"low": 0.0, "high": 1.0} if a.is_share and b.is_share else {}
    if a.kind == b.kind:
        return apply("product", a.kind, lambda x, y: x * y, a, b, **share)
    return apply("product", a.kind, lambda x, y: x * wide(y), a, b, **share)


def complement(value: Value) -> Value:
    """1 minus it."""
    if value.name == "complement":
        return value.inputs[0]
    return apply(
        "complement", value.kind, lambda v: 1.0 - v, value, low=1.0 - value.high, high=1.0 - value.low
    )


def total(a: Value, b: Value) -> Value:
    """The sum of two of one kind."""
    if a.equals(0.0) or b.equals(0.0):
        return b if a.equals(0.0) else a
    return apply("sum", a.kind, lambda x, y: x + y, a, b, low=a.low + b.low, high=a.high + b.high)


def mixed(a: Value, b: Value, share: Value) -> Value:
    """(1 - share) a + share b, of one kind; `share` is a float between 0 and 1."""
    if share.equals(0.0) or a.key == b.key:
        return a
    if share.equals(1.0):
        return b
    if a.equals(0.0):
        return product(b, share)
    if b.equals(0.0):
        return product(a, complement(share))
    if a.kind == FLOAT and a.equals(1.0) and b.is_constant:
        # 1 - share (1 - b): a product is found in it.
        return complement(product(complement(b), share))
    widened = (lambda s: s) if a.kind == FLOAT else wide
    bounds = {"low": min(a.low, b.low), "high": max(a.high, b.high)}
    return apply(
        "mix", a.kind, lambda x, y, s: (1.0 - widened(s)) * x + widened(s) * y, a, b, share, **bounds
    )


def quotient(a: Value, b: Value) -> Value:
    """A colour or a float over a float; 0 where that is 0."""
    if b.equals(1.0):
        return a
    if a.name == "product" and a.inputs[1].key == b.key and b.kind == FLOAT:
        return a.inputs[0]

    def divide(x, y):
        y = y if a.kind == FLOAT else wide(y)
        return np.where(y != 0.0, x / np.where(y != 0.0, y, 1.0), 0.0)

    return apply("quotient", a.kind, divide, a, b)
