"""What a person is told before a bake, above everything else. One row, whatever there is to say, so that what
stands below stays under the mouse; it opens."""

from __future__ import annotations

import bpy

from ..core.errors import sentence
from .draw import text
from .state import STATE


def draw_bake_warnings(layout: bpy.types.UILayout, context) -> None:
    """What of the scene was not read, and whatever else a bake will warn of."""
    scene = context.scene.session_uid
    warnings = STATE.warnings.get(scene, ())
    # The same header whatever there is to say: a row of its own is some pixels higher.
    header, body = layout.panel("STRATA_told", default_closed=True)
    line = header.row()
    if len(warnings) > 1:
        line.label(text=f"{len(warnings)} warnings before a bake", icon="ERROR")
    elif warnings:
        line.label(text=sentence(warnings[0]), icon="ERROR")
    else:
        line.active = False
        is_read = scene in STATE.plans
        words, icon = ("All of the scene is read", "CHECKMARK") if is_read else ("Reading the scene", "TIME")
        line.label(text=words, icon=icon)
    if scene in STATE.outdated:
        header.operator("strata.plan", text="", icon="FILE_REFRESH")
    if body is None:
        return
    if scene in STATE.outdated:
        text(body, context, "The scene has changed since it was read, which takes long", "TIME")
    for warning in warnings:
        text(body, context, sentence(warning), "DOT")
