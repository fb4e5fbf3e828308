"""Meshes that are being edited, as object mode would show them."""

from __future__ import annotations

import bpy

# Modifiers that Blender never runs on Edit Mode's own data.
_NEVER_IN_EDIT_MODE = frozenset({"MULTIRES"})


def is_edited(shown: bpy.types.Object) -> bool:
    """Whether an evaluated object's mesh is a shell around Blender's editing data, without arrays."""
    return shown.data.is_editmode


def edited_mesh(shown: bpy.types.Object) -> bpy.types.Mesh:
    """The evaluated mesh with arrays. Blender keeps it until the object is evaluated again."""
    return shown.to_mesh()


def unseen_modifiers(original: bpy.types.Object, is_render: bool) -> list[str]:
    """Names of the modifiers that object mode would run and Edit Mode does not."""
    return [
        modifier.name
        for modifier in original.modifiers
        if (modifier.show_render if is_render else modifier.show_viewport)
        and (not modifier.show_in_editmode or modifier.type in _NEVER_IN_EDIT_MODE)
    ]


def sculpted_modifiers(original: bpy.types.Object) -> list[str]:
    """Names of the modifiers that a viewport's mesh lacks in Sculpt Mode: Blender keeps the brush's levels
    apart until it is left, or rendered."""
    if original.mode != "SCULPT":
        return []
    return [m.name for m in original.modifiers if m.type == "MULTIRES" and m.show_viewport]
