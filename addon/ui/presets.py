"""Presets of each effect's settings, Blender's own kind: a list in the effect's header.

Those that Strata brings are the files in `presets/`, written by scripts/effect_presets.py.
"""

from __future__ import annotations

from pathlib import Path

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..core.effect import Effect
from ..effects.registry import EFFECTS
from .registration import Classes

FOLDER = str(Path(__file__).parent)  # of `presets`


def panel_name(effect: Effect) -> str:
    return f"STRATA_PT_{effect.id}_presets"


def draw_list_button(effect: Effect, layout: bpy.types.UILayout) -> None:
    getattr(bpy.types, panel_name(effect)).draw_panel_header(layout)


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
        "preset_operator": "script.execute_preset",
        "preset_add_operator": f"strata.{effect.id}_preset_add",
    }
    return type(panel_name(effect), (PresetPanel, bpy.types.Panel), members)


_classes = Classes(*map(_operator, EFFECTS), *map(_panel, EFFECTS))
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
