"""Panels of Blender and of other add-ons that are right for Strata's engine too."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..core.naming import ENGINE_ID

# What every engine has, except for settings that this one does not read, and the simple light panels that
# EEVEE's replace.
_GENERAL = "BLENDER_RENDER"
_UNREAD = frozenset(
    (
        "DATA_PT_light",
        "NODE_DATA_PT_light",
        "DATA_PT_spot",
        "MATERIAL_PT_freestyle_line",
        "RENDER_PT_freestyle",
    )
)
_UNREAD_MODULES = ("bl_ui.properties_freestyle", "bl_ui.properties_data_lightprobe")
# EEVEE's panels of settings that Strata reads: lamps, and materials with their nodes.
_EEVEE = frozenset(
    (
        "DATA_PT_EEVEE_light",
        "NODE_DATA_PT_EEVEE_light",
        "DATA_PT_spot",
        "MATERIAL_PT_preview",
        "EEVEE_MATERIAL_PT_context_material",
        "EEVEE_MATERIAL_PT_surface",
        "VIEWLAYER_PT_override",
    )
)


def _panels() -> Iterator[type]:
    """Every registered panel that says which engines it is for, with subclasses of subclasses."""
    found = [bpy.types.Panel]
    for cls in found:
        found += [child for child in cls.__subclasses__() if child not in found]
        if isinstance(getattr(cls, "COMPAT_ENGINES", None), set):
            yield cls


def _is_compatible(panel: type) -> bool:
    if panel.__name__ in _EEVEE:
        return True
    if panel.__name__ in _UNREAD or panel.__module__.startswith(_UNREAD_MODULES):
        return False
    return _GENERAL in panel.COMPAT_ENGINES


_joined: list[type] = []


def register() -> None:
    for panel in _panels():
        if _is_compatible(panel) and ENGINE_ID not in panel.COMPAT_ENGINES:
            panel.COMPAT_ENGINES.add(ENGINE_ID)
            _joined.append(panel)


def unregister() -> None:
    """Panels that were Strata's from the start, its own, stay so."""
    while _joined:
        _joined.pop().COMPAT_ENGINES.discard(ENGINE_ID)
