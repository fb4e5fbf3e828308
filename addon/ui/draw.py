"""What panels show, whatever editor they are in. Drawing only reads; operators work."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from pathlib import Path

import bpy

from .. import preview
from ..core.effect import Effect
from ..core.errors import StrataError, sentence
from ..core.read import Read
from ..effects.registry import EFFECTS
from ..layers.compositor import can_take_away
from ..layers.exr_params import ExrParams
from ..layers.fitting import rendering, unfit_file, unfit_render
from ..measure.report import LayerError, NotMeasured, error_of
from ..measure.verdict import causes, interval_words, off_by, percent
from . import boxes, plot
from .output import output_of, told_output, waits_for_saving
from .rows import parameters
from .state import STATE, PlanRow

LETTER_PIXELS = 7.2  # of the interface's font at scale 1, on average
COMPOSITE = "Composite"
_CHOOSES = ("target_error", "time_budget_s")
_BAKED = ("backend", *_CHOOSES, "samples", "weight", "rgb_layers", "read", "read_texels")
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


def bake_settings(layout: bpy.types.UILayout, context) -> None:
    settings = context.scene.strata
    column = layout.column()
    column.active = not STATE.is_baking
    chooses = any(getattr(settings, name) for name in _CHOOSES)
    for name in (*_BAKED, *_MEASURED, "memory_gb"):
        if name == "read_texels" and settings.read != Read.EXACT.value:
            continue
        row = column.row()
        row.active = name != "error_images" or settings.probes > 0
        row.prop(settings, "most_samples" if name == "samples" and chooses else name)
    column.separator()
    column.prop(settings, "save_to")
    if settings.save_to != "IMAGES":
        output(column, context)


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


# The last bake


def _report(context) -> dict:
    return STATE.reports[context.scene.session_uid]


def has_report(context) -> bool:
    return context.scene.session_uid in STATE.reports


def result(layout: bpy.types.UILayout, context) -> None:
    report = _report(context)
    row = layout.row()
    row.label(text=f"{report['seconds']:.2f} s in all on the {report['backend'].upper()}", icon="TIME")
    numbers = {name: number for number, name in enumerate(STATE.marks.get(context.scene.session_uid, ()))}
    for effect in EFFECTS:
        made = [layer for layer in report["layers"] if layer["effect"] == effect.id]
        grid = layout.column(align=True)
        if made:
            _result_row(grid, "Error", "Time", is_active=False).label(text=effect.title)
        for layer in made:
            _layer_result(grid, context, layer, numbers)
        _told(grid, context, effect, made)
    for warning in report["warnings"]:
        text(layout, context, warning, "ERROR")
    show_buttons(layout, context)
    compositor_button(layout, context)


def show_buttons(layout: bpy.types.UILayout, context) -> None:
    made = STATE.made.get(context.scene.session_uid)
    if made is None:
        return
    row = layout.row(align=True)
    row.operator("strata.show_baked", icon="IMAGE_DATA")
    if made.file:
        folder = row.operator("wm.path_open", text="Open Folder", icon="FILE_FOLDER")
        folder.filepath = str(made.file.parent)


def _told(layout: bpy.types.UILayout, context, effect: Effect, made: list[dict]) -> None:
    """What the figures are of, where they come from and what lowers them: what holds for all layers once,
    else with their names."""
    errors = [(layer, error_of(layer.get("error"))) for layer in made]
    errors = [(layer, error) for layer, error in errors if isinstance(error, LayerError)]
    said: dict[str, list[str]] = {}
    for layer in (layer for layer in made if layer.get("target_words")):
        text(layout, context, f"{layer.get('light') or layer['name']}: {layer['target_words']}", "INFO")
    for layer, error in errors:
        light = layer.get("light", "")
        clauses = causes(error, layer.get("lowered_by", ()), effect.params)
        for clause in (off_by(error.metric, "this share", light), *clauses):
            said.setdefault(clause, []).append(light or layer["name"])
    for clause, names in said.items():
        is_of_all = len(names) == len(errors)
        text(layout, context, sentence(clause) if is_of_all else f"{', '.join(names)}: {clause}", "INFO")


def unjoinable(context) -> str:
    """Why no compositor nodes can be built; empty where nothing is known to be in the way."""
    scene = context.scene
    if waits_for_saving(scene):
        return "Compositor nodes read the baked file: save this Blender file, then bake again"
    try:
        return unfit_render(scene) or unfit_file(scene, _file_to_join(context))
    except StrataError as error:
        return str(error)


def _file_to_join(context) -> Path:
    """Of the first view layer that renders, which the operator asks for too."""
    scene = context.scene
    return output_of(scene, rendering(scene, context.view_layer)[0]).path(scene.frame_current)


def compositor_button(layout: bpy.types.UILayout, context) -> None:
    """With the reason where it cannot be pressed."""
    scene, reason = context.scene, unjoinable(context)
    row = layout.row()
    row.enabled = not reason
    row.operator("strata.build_compositor", icon="NODE_COMPOSITING")
    if reason:
        text(layout, context, reason[0].upper() + reason[1:], "INFO")
    if can_take_away(scene):
        layout.operator("strata.restore_shadows", icon="LOOP_BACK")


def _layer_result(layout: bpy.types.UILayout, context, layer: dict, numbers: dict[str, int]) -> None:
    name, error = layer["name"], error_of(layer.get("error"))
    icon = plot.dot_icon(numbers[name]) if name in numbers else 0
    # A cell of a narrow column has no room for "below".
    shown = percent(error.value).replace("below ", "<") if isinstance(error, LayerError) else ""
    row = _result_row(layout, shown, f"{layer['seconds']:.2f} s")
    light = layer.get("light", "")
    button = row.operator("strata.show_layer", text=light or name, icon_value=icon, emboss=False)
    button.layer, button.light = name, light
    if isinstance(error, NotMeasured):
        text(layout, context, f"not measured: {error.why}", "ERROR")
    elif error:
        column = layout.column()
        column.active = False
        sure = f"95% sure: {interval_words(*error.ci95)}"
        text(column, context, f"{layer.get('verdict', '')} ({sure})", "BLANK1")
    if found := layer.get("audit"):
        words = f"Cycles: off by {percent(found['value'])} ({interval_words(*found['ci95'])})"
        text(layout, context, words, "BLANK1")


def _result_row(layout, error: str, seconds: str, is_active: bool = True) -> bpy.types.UILayout:
    """Where a name goes, before the figures."""
    row = layout.row(align=True)
    row.active = is_active
    split = row.split(factor=0.52)
    name = split.row()
    name.alignment = "LEFT"
    figures = split.row()
    for figure in (error, seconds):
        cell = figures.row()
        cell.alignment = "RIGHT"
        cell.label(text=figure)
    return name


def has_marks(context) -> bool:
    return bool(STATE.marks.get(context.scene.session_uid))


def error_plot(layout: bpy.types.UILayout, context) -> None:
    """Every bake of this session: how wrong a layer was over what it cost."""
    scene = context.scene.session_uid
    across, up = plot.ranges(list(STATE.marks[scene].values()))
    column = layout.column(align=True)
    _ends(column, f"error {100.0 * up[1]:.2g}%", "")
    column.template_icon(icon_value=plot.plot_icon(scene), scale=9.0)
    _ends(column, f"{100.0 * up[0]:.2g}%", "")
    _ends(column, f"{across[0]:.2g} s", f"{across[1]:.2g} s")


def _ends(layout: bpy.types.UILayout, left: str, right: str) -> None:
    row = layout.row()
    row.active = False
    row.scale_y = 0.7
    row.label(text=left)
    end = row.row()
    end.alignment = "RIGHT"
    end.label(text=right)


def step_times(layout: bpy.types.UILayout, context) -> None:
    """The dearest first; a bar is the share of all steps."""
    seconds: dict[str, float] = {}
    for step in _report(context)["steps"]:
        seconds[step["name"]] = seconds.get(step["name"], 0.0) + step["seconds"]
    whole = sum(seconds.values()) or 1.0
    column = layout.column(align=True)
    for name, spent in sorted(seconds.items(), key=lambda item: -item[1]):
        split = column.split(factor=0.5)
        split.label(text=name.rpartition("/")[2].replace("_", " ").capitalize())
        split.progress(factor=spent / whole, text=f"{spent:.2f} s")
