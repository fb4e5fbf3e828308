"""What panels show, whatever editor they are in. Drawing only reads; operators work."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

import bpy

from .. import preview
from ..core.effect import Effect
from ..core.errors import sentence
from ..core.read import Read
from ..effects.registry import EFFECTS
from ..expected import about_seconds
from ..layers.exr_params import ExrParams
from . import boxes
from .output import told_output, waits_for_saving
from .rows import has_own_targets, parameters
from .state import STATE, PlanRow

LETTER_PIXELS = 7.2  # of the interface's font at scale 1, on average
COMPOSITE = "Composite"
_CHOOSES = ("target_error", "time_budget_s")
_BAKED = ("backend", *_CHOOSES, "samples", "most_samples", "read", "read_texels")
_FILM = ("weight", "placement", "rgb_layers", "memory_gb")
_MEASURED = ("probes", "error_images", "audit")
_LIGHT_ICONS = {"POINT": "LIGHT_POINT", "SUN": "LIGHT_SUN", "SPOT": "LIGHT_SPOT", "AREA": "LIGHT_AREA"}


def settings_layout(panel: bpy.types.Panel) -> bpy.types.UILayout:
    layout = panel.layout
    layout.use_property_split = True
    return layout


def text(layout: bpy.types.UILayout, context, words: str, icon: str = "NONE", indent: int = 2) -> None:
    """Several labels, as wide as the region: one would be cut off. `indent`: letters that icons take."""
    scale = context.preferences.system.ui_scale
    letters = max(int(context.region.width / (LETTER_PIXELS * scale)) - 4 - 2 * indent, 16)
    column = layout.column(align=True)
    column.scale_y = 0.75
    for number, line in enumerate(textwrap.wrap(words, letters)):
        column.label(text=line, icon=icon if number == 0 else ("NONE" if icon == "NONE" else "BLANK1"))


# The preview


def preview_switch(layout: bpy.types.UILayout, context) -> None:
    scene = context.scene
    reason = preview.available()
    is_on = preview.is_on(scene)
    row = layout.row(align=True)
    row.scale_y = 1.3
    row.enabled = not reason
    row.operator("strata.preview", icon="HIDE_OFF" if is_on else "HIDE_ON", depress=is_on)
    row.menu("STRATA_MT_preview_layer", text=scene.strata.preview.layer or COMPOSITE)
    row.prop(scene.strata.preview, "shows_noise", text="", icon="SEQ_HISTOGRAM")
    if reason:
        column = layout.column()
        column.active = False
        text(column, context, sentence(reason), "INFO")
    elif is_on and (failure := preview.failure()):
        text(layout, context, failure, "ERROR")


def preview_settings(layout: bpy.types.UILayout, context) -> None:
    settings = context.scene.strata.preview
    column = layout.column()
    boxes.row(column, settings, "samples", "As the bake")
    boxes.row(column, settings, "longest_s", "Unlimited")
    boxes.row(column, settings, "frame_budget_ms", "Preferences")
    column.prop(settings, "show_statistics")
    column.prop(settings, "on_opening")


def preview_layers(layout: bpy.types.UILayout, context) -> None:
    """Choices of what to show: the layers of the plan, and those that a viewport has found besides, which may
    look from elsewhere."""
    scene = context.scene
    shown = scene.strata.preview.layer
    planned = (row.what for row in _plan(context) if row.kept)
    for name in dict.fromkeys(("", *planned, *preview.layers_of(scene), shown)):
        icon = "RADIOBUT_ON" if name == shown else "RADIOBUT_OFF"
        layout.operator("strata.preview_layer", text=name or COMPOSITE, icon=icon).layer = name


# Baking


def bake_button(layout: bpy.types.UILayout, context) -> None:
    if STATE.is_baking:
        column = layout.column(align=True)
        column.scale_y = 1.4
        row = column.row(align=True)
        row.progress(factor=STATE.share, text=STATE.doing)
        row.operator("strata.cancel_bake", text="", icon="X")
        row = layout.row()
        row.active = False
        row.label(text="Esc cancels", icon="EVENT_ESC")
        return
    if context.scene.camera is None:
        layout.label(text="The scene has no camera", icon="ERROR")
    row = layout.row()
    row.scale_y = 1.5
    row.operator("strata.bake", icon="RENDER_STILL")


def report_under_way(layout: bpy.types.UILayout) -> None:
    """By another Blender; nothing where there is none."""
    if not STATE.is_reporting:
        return
    row = layout.row(align=True)
    row.label(text=f"Report: {STATE.report_doing}", icon="TIME")
    row.operator("strata.cancel_report", text="", icon="X")


def bake_settings(layout: bpy.types.UILayout, context) -> None:
    settings = context.scene.strata
    column = layout.column()
    column.active = not STATE.is_baking
    hidden = {"read_texels"} if settings.read != Read.EXACT.value else set()
    is_chosen = any(getattr(settings, name) for name in _CHOOSES)
    hidden |= {"samples"} if is_chosen else set()
    hidden |= set() if is_chosen or has_own_targets(context.scene) else {"most_samples"}
    for name in (*_BAKED, *_MEASURED):
        if name in hidden:
            continue
        row = column.row()
        row.active = name != "error_images" or settings.probes > 0
        row.prop(settings, name)
        if name == _CHOOSES[0]:
            expected_time(column, context)
    column.separator()
    column.prop(settings, "save_to")
    if settings.save_to != "IMAGES":
        output(column, context)


def film_settings(layout: bpy.types.UILayout, context) -> None:
    """How samples become pixels: what hardly anybody has to change."""
    column = layout.column()
    column.active = not STATE.is_baking
    for name in _FILM:
        column.prop(context.scene.strata, name)


def expected_time(layout: bpy.types.UILayout, context) -> None:
    """Of the next bake, as far as a plan is known."""
    if seconds := STATE.expected_s.get(context.scene.session_uid):
        row = layout.row()
        row.active = False
        row.alignment = "RIGHT"
        row.label(text=sentence(about_seconds(seconds)), icon="TIME")


def output(layout: bpy.types.UILayout, context) -> None:
    """The field, and which file that is now, or why none."""
    row, told = layout.row(), []
    if waits_for_saving(context.scene):
        told = [("This file is not saved yet: layers go to images", "INFO")]
    else:
        path, reason = told_output(context.scene, context.view_layer)
        if path:
            told = [(path.name, "FILE"), (str(path.parent), "FILE_FOLDER")]
        elif reason:
            row.alert = True  # before the field is made
            told = [(sentence(reason), "ERROR")]
    row.prop(context.scene.strata, "output")
    for words, icon in told:
        text(layout, context, words, icon)


def writes_file(context) -> bool:
    return context.scene.strata.save_to != "IMAGES"


def exr_settings(layout: bpy.types.UILayout, context) -> None:
    settings = context.scene.strata.exr
    column = layout.column()
    column.active = not STATE.is_baking
    for spec in ExrParams.specs():
        column.prop(settings, spec.name)


# Effects


def effects(layout: bpy.types.UILayout, context) -> None:
    """One row, so that the panels below it stay in place: which effects do nothing here, and why."""
    uid, settings = context.scene.session_uid, context.scene.strata
    on = [effect for effect in EFFECTS if getattr(settings, effect.id).enabled]
    idle = {effect.title: reason for effect in on if (reason := STATE.idle_reason(uid, effect.id))}
    count = sum(row.kept for row in _plan(context))
    words = f"{count} layers" if count != 1 else "1 layer"
    if idle:
        names, reasons = ", ".join(idle), set(idle.values())
        words = f"{names}: {reasons.pop().partition(' (')[0] if len(reasons) == 1 else 'nothing here'}"
    row = layout.row()
    row.active = bool(idle) or not on
    if not on:
        row.label(text="No effect is switched on", icon="INFO")
    else:
        row.label(text=words if uid in STATE.plans else "", icon="INFO" if idle else "BLANK1")


def effect_header(layout: bpy.types.UILayout, context, effect: Effect) -> None:
    layout.active = not STATE.idle_reason(context.scene.session_uid, effect.id)
    layout.prop(getattr(context.scene.strata, effect.id), "enabled", text="")


def effect_settings(layout: bpy.types.UILayout, context, effect: Effect) -> None:
    group = getattr(context.scene.strata, effect.id)
    parameters(layout, group, effect.params.specs(), f"scene.strata.{effect.id}", group.enabled)
    rows = [row for row in _plan(context) if row.effect == effect.id and not row.light and not row.kept]
    if rows and group.enabled:
        layout.separator()
        left_out(layout, context, rows)


def left_out(layout: bpy.types.UILayout, context, rows: Iterable[PlanRow]) -> None:
    column = layout.column()
    column.active = False
    for row in rows:
        text(column, context, f"Left out: {row.what}, {row.reason}", "REMOVE")


# Lights


def _plan(context) -> tuple[PlanRow, ...]:
    return STATE.plans.get(context.scene.session_uid, ())


def lights(layout: bpy.types.UILayout, context) -> None:
    """Each light of the plan: its layers, and what of it is left out, and why."""
    rows = [row for row in _plan(context) if row.light]
    names = list(dict.fromkeys(row.light for row in rows))
    for name in names:
        light(layout, context, name, [row for row in rows if row.light == name])
    if not names and context.scene.session_uid in STATE.plans:
        layout.label(text="No lamp lights this scene", icon="INFO")
    left_out(layout, context, [row for row in _plan(context) if not (row.kept or row.effect or row.light)])
    # Below what a mouse may be on its way to.
    if memory := STATE.memory.get(context.scene.session_uid):
        words = memory.shortage or memory.sentence
        text(layout, context, sentence(words), "MEMORY")
    for line in STATE.baked.get(context.scene.session_uid, ()):
        text(layout, context, sentence(line), "NODE_MATERIAL")


def light(layout: bpy.types.UILayout, context, name: str, rows: list[PlanRow]) -> None:
    shown = context.scene.objects.get(name)
    is_light = shown is not None and shown.type == "LIGHT"
    kept = [row for row in rows if row.kept]
    box = layout.box()
    column = box.column(align=True)
    header = column.row()
    header.active = bool(kept)
    # Each has its share, so that a long name is cut off where it ends, and pushes nothing out.
    split = header.split(factor=0.5)
    split.label(text=name, icon=_LIGHT_ICONS[shown.data.type] if is_light else "LIGHT")
    end = split.row()
    end.alignment = "RIGHT"
    if is_light and shown.data.strata.use_own:
        end.label(text="", icon="MODIFIER")
    count = len(kept)
    words = f"{count} layers" if count > 1 else "1 layer" if count else "No layer"
    end.label(text=words, icon="CHECKMARK" if kept else "REMOVE")
    reasons = column.column()
    reasons.active = False
    for row in rows:
        if not row.kept:
            what = row.what.replace(f" {name}", "", 1)
            text(reasons, context, f"{what}: {row.reason}", "BLANK1")
