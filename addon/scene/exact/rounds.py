"""Reading a scene until nothing of its materials has to be baked any more."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ..render_depsgraph import with_render_depsgraph
from .reading import Exact

MOST_ROUNDS = 3
"""One mostly does, and what folds to a constant may show more. A scene that is another one each time it is
evaluated (by a driver's random number, or a handler) would never end."""


def with_exact[Result](
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    read: Callable[[bpy.types.Depsgraph, Exact], Result],
    frame: int | None = None,
    camera: bpy.types.Object | None = None,
    show: Callable[[float], None] | None = None,
) -> Result:
    """`with_render_depsgraph`, again and again while `read(depsgraph, exact)` leaves `exact` waiting: Blender
    bakes nothing inside of a render. After MOST_ROUNDS what is known by then has to do. `show` is told the
    share of a round that is baked; what it raises ends it. What was baked stays in the cache."""
    exact = Exact()
    try:
        for _round in range(MOST_ROUNDS):
            outcome = with_render_depsgraph(scene, view_layer, lambda each: read(each, exact), frame, camera)
            if not exact.is_waiting:
                return outcome
            exact.bake(scene, scene.frame_current if frame is None else frame, show)
        exact.can_bake = False
        return with_render_depsgraph(scene, view_layer, lambda each: read(each, exact), frame, camera)
    finally:
        exact.discard()
