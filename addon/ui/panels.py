"""The sidebar of the 3D View. Drawing only reads; operators work."""

from __future__ import annotations

import bpy

from ..core.ramp import Ramp
from ..effects.registry import EFFECTS
from .registration import Classes
from .state import STATE


class _Sidebar:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Strata"


class STRATA_PT_bake(_Sidebar, bpy.types.Panel):
    bl_label = "Strata"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.strata
        column = layout.column()
        column.active = not STATE.is_baking
        for name in ("backend", "samples", "probes", "output", "make_images"):
            column.prop(settings, name)
        if STATE.is_baking:
            layout.progress(factor=STATE.share, text=f"{STATE.doing}   Esc cancels")
            return
        if context.scene.camera is None:
            layout.label(text="The scene has no camera", icon="ERROR")
        row = layout.row()
        row.scale_y = 1.4
        row.operator("strata.bake", icon="RENDER_STILL")


class STRATA_PT_plan(_Sidebar, bpy.types.Panel):
    bl_label = "Plan"
    bl_parent_id = "STRATA_PT_bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        layout.operator("strata.plan", icon="FILE_REFRESH")
        if STATE.plan_of != context.scene.session_uid:
            return
        column = layout.column(align=True)
        for row in STATE.plan:
            split = column.split(factor=0.4)
            split.label(text=row.light or "Effect", icon="LIGHT" if row.light else "SHADERFX")
            line = split.row()
            line.active = row.kept
            line.label(text=row.text, icon="CHECKMARK" if row.kept else "REMOVE")


class STRATA_PT_result(_Sidebar, bpy.types.Panel):
    bl_label = "Last Bake"
    bl_parent_id = "STRATA_PT_bake"

    @classmethod
    def poll(cls, context):
        return STATE.report_of == context.scene.session_uid

    def draw(self, context):
        layout = self.layout
        report = STATE.report
        layout.label(text=f"{report['backend'].upper()}, {report['seconds']:.2f} s")
        for layer in report["layers"]:
            box = layout.box().column(align=True)
            split = box.split(factor=0.75)
            split.label(text=layer["name"], icon="RENDERLAYERS")
            split.label(text=f"{layer['seconds']:.2f} s")
            error = layer.get("error")
            if error:
                low, high = error["ci95"]
                box.label(text=f"{error['metric']}: {error['value']:.4f}")
                box.label(text=f"95% between {low:.4f} and {high:.4f}")
        for warning in report["warnings"]:
            layout.label(text=warning, icon="ERROR")


def _draw_ramp(layout, group, path: str, name: str) -> None:
    """A texture to take the ramp of, and that ramp; without one, a button that makes it."""
    row = layout.row(align=True)
    row.prop(group, name)
    texture = getattr(group, name)
    if texture is None:
        new = row.operator("strata.new_ramp", text="", icon="ADD")
        new.path, new.name = path, name
    elif texture.use_color_ramp:
        layout.template_color_ramp(texture, "color_ramp", expand=True)
    else:
        layout.prop(texture, "use_color_ramp")


def _effect_panel(effect) -> type:
    """An effect's sub-panel: a checkbox in the header, its parameters below."""

    def draw_header(self, context):
        self.layout.prop(getattr(context.scene.strata, effect.id), "enabled", text="")

    def draw(self, context):
        group = getattr(context.scene.strata, effect.id)
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.active = group.enabled
        for spec in effect.params.specs():
            if spec.kind is Ramp:
                _draw_ramp(layout, group, f"scene.strata.{effect.id}", spec.name)
            else:
                layout.prop(group, spec.name)

    members = {
        "bl_label": effect.title,
        "bl_parent_id": "STRATA_PT_bake",
        "bl_options": {"DEFAULT_CLOSED"},
        "draw_header": draw_header,
        "draw": draw,
    }
    return type(f"STRATA_PT_{effect.id}", (_Sidebar, bpy.types.Panel), members)


_classes = Classes(STRATA_PT_bake, *map(_effect_panel, EFFECTS), STRATA_PT_plan, STRATA_PT_result)
register, unregister = _classes.register, _classes.unregister
