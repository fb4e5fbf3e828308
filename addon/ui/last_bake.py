"""What panels show of the last bake, whatever editor they are in. Drawing only reads; operators work."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core.effect import Effect
from ..core.errors import StrataError, sentence
from ..effects.registry import EFFECTS
from ..layers.compositor import can_take_away
from ..layers.fitting import rendering, unfit_file, unfit_render
from ..measure.report import LayerError, NotMeasured, error_of
from ..measure.verdict import causes, interval_words, off_by, percent
from . import plot
from .draw import text
from .output import output_of, waits_for_saving
from .state import STATE


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
    layout.operator("strata.report", text="Report...", icon="GRAPH")


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
