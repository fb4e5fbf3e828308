"""Reading a scene until nothing of its materials has to be baked any more."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ..render_depsgraph import with_render_depsgraph
from .reading import Exact


def with_exact[Result](
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    read: Callable[[bpy.types.Depsgraph, Exact], Result],
    frame: int | None = None,
    camera: bpy.types.Object | None = None,
    show: Callable[[float], None] | None = None,
) -> Result:
    """`with_render_depsgraph`, again and again while `read(depsgraph, exact)` leaves `exact` waiting: Blender
    bakes nothing inside of a render. `show` is told the share of a round that is baked; what it raises ends
    it. What was baked stays in the cache."""
    exact = Exact()
    try:
        while True:
            outcome = with_render_depsgraph(scene, view_layer, lambda each: read(each, exact), frame, camera)
            if not exact.is_waiting:
                return outcome
            exact.bake(scene, scene.frame_current if frame is None else frame, show)
    finally:
        exact.discard()
