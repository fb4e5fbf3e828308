"""Presets of each effect's settings, Blender's own kind: a list in the effect's header.

Those that Strata brings are the files in `presets/`, which scripts/build/effect_presets.py makes of what the
effects declare.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..core.effect import Effect
from ..core.errors import StrataError
from ..core.params import Lamp
from ..effects.registry import EFFECTS
from ..scene.lamp_names import LampNames
from .registration import Classes

FOLDER = str(Path(__file__).parent)  # of `presets`


def panel_name(effect: Effect) -> str:
    return f"STRATA_PT_{effect.id}_presets"


def draw_list_button(effect: Effect, layout: bpy.types.UILayout) -> None:
    getattr(bpy.types, panel_name(effect)).draw_panel_header(layout)


class STRATA_OT_take_preset(bpy.types.Operator):
    """Take the settings of this preset"""

    # Blender's own runs the file, which ends at the first setting that is not what it was when it was saved.
    bl_idname = "strata.take_preset"
    bl_label = "Take Preset"
    bl_options = {"UNDO", "INTERNAL"}

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})

    def execute(self, context):
        path = Path(self.filepath)
        try:
            effect = EFFECTS.named(path.parent.name)
            values = _values_in(path.read_text(encoding="utf-8"))
        except (OSError, SyntaxError, ValueError, StrataError) as error:
            self.report({"ERROR"}, f"Preset '{path.stem}' cannot be read: {error}")
            return {"CANCELLED"}
        if unfit := [name for name, value in values.items() if not _take(context.scene, effect, name, value)]:
            told = f"Preset '{path.stem}' has what there is none of here: {', '.join(unfit)}"
            self.report({"WARNING"}, told)
        return {"FINISHED"}


def _values_in(text: str) -> dict[str, Any]:
    """Of a preset's file, as Blender writes them: `settings.name = value`, a line each. Raises SyntaxError,
    and ValueError for what is no plain value."""
    return {
        line.targets[0].attr: ast.literal_eval(line.value)
        for line in ast.parse(text).body
        if isinstance(line, ast.Assign) and ast.unparse(line.targets[0]).startswith("settings.")
    }


def _take(scene: bpy.types.Scene, effect: Effect, name: str, value: Any) -> bool:
    """Whether there is such a setting now, and it took the value. Lamps were kept by their names once."""
    spec = next((spec for spec in effect.params.specs() if spec.name == name), None)
    if spec is None:
        return False
    if spec.kind is Lamp:
        name_of_lamp, value = value, LampNames().called(value, scene) if value else None
        if name_of_lamp and value is None:
            return False
    try:
        setattr(getattr(scene.strata, effect.id), name, value)
    except (TypeError, ValueError):
        return False
    return True


def _operator(effect: Effect) -> type:
    group = f"bpy.context.scene.strata.{effect.id}"
    members = {
        "__doc__": f"Add or remove a preset of {effect.title}",
        "bl_idname": f"strata.{effect.id}_preset_add",
        "bl_label": f"Add {effect.title} Preset",
        "preset_menu": panel_name(effect),
        "preset_defines": [f"settings = {group}"],
        "preset_values": [f"settings.{s.name}" for s in effect.params.specs() if not s.is_of_file],
        "preset_subdir": f"strata/{effect.id}",
    }
    return type(f"STRATA_OT_{effect.id}_preset_add", (AddPresetBase, bpy.types.Operator), members)


def _panel(effect: Effect) -> type:
    members = {
        "bl_label": f"{effect.title} Presets",
        "preset_subdir": f"strata/{effect.id}",
        "preset_operator": STRATA_OT_take_preset.bl_idname,
        "preset_extensions": {".py"},
        "preset_add_operator": f"strata.{effect.id}_preset_add",
    }
    return type(panel_name(effect), (PresetPanel, bpy.types.Panel), members)


_classes = Classes(STRATA_OT_take_preset, *map(_operator, EFFECTS), *map(_panel, EFFECTS))
_has_path = False


def register() -> None:
    global _has_path
    _classes.register()
    if not _has_path:
        _has_path = bpy.utils.register_preset_path(FOLDER)


def unregister() -> None:
    global _has_path
    if _has_path:
        bpy.utils.unregister_preset_path(FOLDER)
        _has_path = False
    _classes.unregister()
