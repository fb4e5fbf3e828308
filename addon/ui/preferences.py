"""What a person sets once for this machine, and scenes take unless they say otherwise. Where Strata is no
add-on, as in a program of its own, there is none of it, and the defaults count."""

from __future__ import annotations

from pathlib import Path

import bpy

from .registration import Classes

PACKAGE = __package__.removesuffix(".addon.ui")
DOCUMENTATION = Path(__file__).resolve().parents[2] / "docs" / "index.html"
"""Only in the extension: scripts/build/extension.py makes it."""

DEVICES = [
    ("auto", "Automatic", "The GPU where there is one, the CPU otherwise", 0),
    ("cpu", "CPU", "Rust kernels on all cores", 1),
    ("gpu", "GPU", "Compute shaders", 2),
]
FRAME_BUDGET_MS = 33.0


class STRATA_preferences(bpy.types.AddonPreferences):
    bl_idname = PACKAGE

    backend: bpy.props.EnumProperty(
        name="Device",
        description="Where effects run, in scenes that do not say",
        items=DEVICES,
        default="auto",
    )
    frame_budget_ms: bpy.props.FloatProperty(
        name="Preview Frame (ms)",
        description="Milliseconds that a frame of the preview may take while something moves, in scenes that "
        "do not say",
        default=FRAME_BUDGET_MS,
        min=1.0,
        max=1e5,
        soft_max=250.0,
    )  # fmt: skip

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "backend")
        layout.prop(self, "frame_budget_ms")
        layout.operator("strata.documentation", icon="HELP")


class STRATA_OT_documentation(bpy.types.Operator):
    """Open the pages that came with Strata in a browser"""

    bl_idname = "strata.documentation"
    bl_label = "Open Documentation"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        cls.poll_message_set("Only the installed extension has them")
        return DOCUMENTATION.exists()

    def execute(self, context):
        return bpy.ops.wm.url_open(url=DOCUMENTATION.as_uri())


def _own() -> STRATA_preferences | None:
    addon = bpy.context.preferences.addons.get(PACKAGE)
    return addon.preferences if addon else None


def backend_of(settings) -> str:
    """The device that a scene's settings ask for: auto, cpu or gpu."""
    if settings.backend != "preferences":
        return settings.backend
    own = _own()
    return own.backend if own else "auto"


def frame_budget_ms() -> float:
    """Of scenes that have none of their own."""
    own = _own()
    return own.frame_budget_ms if own else FRAME_BUDGET_MS


_classes = Classes(STRATA_preferences, STRATA_OT_documentation)
register, unregister = _classes.register, _classes.unregister
