"""An expression as an Opacity: a constant or a picture, times what corners carry, clipped or not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .baked import BAKED_MAP
from .factors import product_of
from .values import FLOAT, Uv, Value, complement, product, saturated

_STEPS = 1024


@dataclass(frozen=True, eq=False)
class Parts:
    """`uniform` times what `picture` and `corners` are, if there are any; a clip with a `threshold` > 0."""

    uniform: float = 1.0
    picture: Value | None = None
    corners: Value | None = None
    threshold: float = 0.0


def parts_of(value: Value) -> Parts | None:
    """None where it is no product of a picture and what corners carry. Nothing in it may be unread."""
    if value.is_constant:
        return Parts(uniform=_share(value.number()))
    clip = _clip_of(value)
    if clip is not None:
        inner, threshold = clip
        parts = _split(inner)
        if parts is not None:
            return Parts(1.0, parts.picture, parts.corners, threshold)
    return _split(saturated(value))


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0) if value == value else 0.0


def _split(value: Value) -> Parts | None:
    found = product_of(value)
    if found is None:
        return None
    picture, corners = found.picture, found.corners
    # A constant goes where there is something to be multiplied.
    if not picture.is_constant:
        picture = product(picture, found.uniform)
    elif not corners.is_constant:
        corners = product(corners, found.uniform)
    return Parts(
        1.0,
        None if picture.is_constant else picture,
        None if corners.is_constant else corners,
    )


def _clip_of(value: Value) -> tuple[Value, float] | None:
    """What a value steps on from 0 to 1, and where: 1 exactly where that is at least so much. The innermost
    such, so that a texture is interpolated first and compared then, as in Cycles."""
    chain, part = [], value
    while part.texture is None:  # where it is looked up tells nothing of what is found there
        varying = {each.key: each for each in part.inputs if not each.is_constant}
        if len(varying) != 1:
            break
        (part,) = varying.values()
        if part.kind == FLOAT:
            chain.append(part)
    for inner in reversed(chain):
        if Uv(BAKED_MAP) in inner.sources and not inner.is_share:
            continue  # its numbers may be beyond those that are looked at
        threshold = _step_of(value, inner)
        if threshold is not None:
            return threshold
    return None


def _step_of(value: Value, inner: Value) -> tuple[Value, float] | None:
    def at(places: np.ndarray) -> np.ndarray:
        # Equal expressions may be different objects.
        known = {id(part): places for part in value.parts() if part.key == inner.key}
        return np.broadcast_to(value.at(None, known), places.shape)

    places = np.linspace(0.0, 1.0, _STEPS + 1)
    found = at(places)
    turns = np.flatnonzero(np.diff(found))
    if len(turns) != 1 or not np.isin(found, (0.0, 1.0)).all():
        return None
    low, high = places[turns[0]], places[turns[0] + 1]
    first = found[turns[0]]
    for _half in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if at(np.array([middle]))[0] == first else (low, middle)
    # In float32 the last bits are lost: what is exactly at the edge stays on its side.
    if first == 0.0:
        threshold, inner = np.float32(high), inner
        if threshold < high:
            threshold = np.nextafter(threshold, np.float32(2.0))
    else:
        threshold, inner = np.float32(1.0 - low), complement(inner)
    return inner, max(float(threshold), 1e-6)
