"""Strata: light and style effects for Blender, baked into layers that say how wrong they are."""

from __future__ import annotations


def _modules() -> tuple:
    """What registers, in order. Imported here: without Blender the package is importable too."""
    from .addon import preview
    from .addon.devices import start as devices
    from .addon.engine import engine
    from .addon.ui import panels, preferences, properties
    from .ops import bake, command, compositor, ramp, reporting, result
    from .ops import preview as preview_operators

    operators = bake, compositor, preview_operators, ramp, reporting, result
    return devices, preferences, properties, preview, engine, *operators, panels, command


def register() -> None:
    try:
        for module in _modules():
            module.register()
    except BaseException:
        unregister()
        raise


def unregister() -> None:
    for module in reversed(_modules()):
        module.unregister()
