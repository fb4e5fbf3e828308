"""Strata: light and style effects for Blender, baked into layers that say how wrong they are."""

from __future__ import annotations


def _modules() -> tuple:
    """What registers, in order. Imported here: without Blender the package is importable too."""
    from .addon import preview
    from .addon.engine import engine
    from .addon.ui import panels, properties
    from .ops import bake, command, ramp

    return properties, preview, engine, bake, ramp, panels, command


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
