"""What an error is not known for: surfaces whose opacity, or its colour, Strata does not read, and what is
missing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..core.material import Material
from ..core.outline import Instances
from .report import LayerError


def unread_materials(materials: tuple[Material, ...]) -> frozenset[int]:
    """Those that may be anything between clear and opaque, in some channel of colour at least."""
    return frozenset(index for index, each in enumerate(materials) if each.unread_opacity or each.tints)


def concerns(instances: Instances, met: np.ndarray, unread: frozenset[int]) -> bool:
    """Whether any of the instances that rays meet, `met` (instances,) bool, has an unread material."""
    if not unread:
        return False
    return any(not unread.isdisjoint(instances[index].materials) for index in np.flatnonzero(met))


def between(read: LayerError, clear: LayerError) -> LayerError:
    """The truth lies somewhere between what is as it was read (opaque) and what is as though nothing of the
    unread were there: the interval reaches from the nearest to the farthest. `unread` is what its upper end
    owes to that."""
    low, high = (limit(a, b) for limit, a, b in zip((min, max), read.ci95, clear.ci95, strict=True))
    unread = math.sqrt(max(high**2 - read.ci95[1] ** 2, 0.0))
    return replace(read, ci95=(low, high), unread=unread)


def without_end(error: LayerError, unknown: tuple[str, ...]) -> LayerError:
    """The same where the scene lacks something of unknown extent, as the lines `unknown` tell: rays do not
    meet it either, and no one knows how much of the light it takes."""
    return replace(error, ci95=(error.ci95[0], None), unread=None, unknown=unknown)
