"""The preview's switch, and what it shows."""

from __future__ import annotations

import bpy

from ..addon import preview
from ..addon.core.errors import sentence
from ..addon.ui.registration import Classes
from .reported import reported


class STRATA_OT_preview(bpy.types.Operator):
    """Show the layers live in all 3D viewports of this scene, whatever they are shaded with"""

    bl_idname = "strata.preview"
    bl_label = "Preview"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context):
        if reason := preview.available():
            cls.poll_message_set(sentence(reason))
            return False
        return True

    @reported
    def execute(self, context):
        if preview.is_on(context.scene):
            preview.disable(context.scene)
        else:
            preview.enable(context.scene)
        return {"FINISHED"}


class STRATA_OT_preview_layer(bpy.types.Operator):
    """Show this in the preview"""

    bl_idname = "strata.preview_layer"
    bl_label = "Preview Layer"
    bl_options = {"INTERNAL"}

    layer: bpy.props.StringProperty(name="Layer", description="Empty: the composite of all")

    def execute(self, context):
        context.scene.strata.preview.layer = self.layer
        return {"FINISHED"}


_classes = Classes(STRATA_OT_preview, STRATA_OT_preview_layer)
register, unregister = _classes.register, _classes.unregister
