"""Where rays of shadows begin near the terminator of smooth surfaces: above their triangles, as in Cycles,
lest facets show. A surface's `terminator_lift` is the way there, the object's offset says from which cosine
to the light on a ray begins at the surface itself (kernels/src/rays/lift.rs)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...core.culling import receivers_in_view
from ...core.outline import Outline
from ...core.shot import Shot

READ = ("terminator_lift", "instance")
"""What of a surface tells it."""

EVERYWHERE = slice(None)
"""An index of all points, which copies nothing."""


def offsets_of(outline: Outline, shot: Shot | None = None) -> np.ndarray | None:
    """(N + 1,) float32, of each instance and, last, of a miss; None where no instance that the shot may show,
    of any if None, has one: then nothing need be known of it."""
    instances = outline.instances
    offsets = instances.memo(
        ("terminator offsets",),
        lambda: np.array([*(each.terminator_offset for each in instances), 0.0], np.float32),
    )
    shown = offsets[:-1] if shot is None else offsets[:-1][receivers_in_view(outline, shot)[0]]
    return offsets if (shown > 0.0).any() else None


def lifts_of(
    surface: Mapping[str, np.ndarray], offsets: np.ndarray, chosen: np.ndarray | slice = EVERYWHERE
) -> np.ndarray:
    """(N, 4) float32 of the surface's points `chosen` (an index), row by row: the way, metres in world axes,
    and the offset."""
    lift = surface["terminator_lift"].reshape(-1, 3)[chosen]
    lifts = np.empty((len(lift), 4), np.float32)
    lifts[:, :3] = lift
    lifts[:, 3] = offsets[surface["instance"].reshape(-1)[chosen]]
    return lifts
