"""`blender -b SCENE.blend --command strata ...`"""

from __future__ import annotations

import bpy

from .cli import blender_command

_handles: list[object] = []


def register() -> None:
    if not _handles:
        _handles.append(bpy.utils.register_cli_command("strata", blender_command))


def unregister() -> None:
    while _handles:
        bpy.utils.unregister_cli_command(_handles.pop())
