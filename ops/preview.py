"""The preview's switch, and what it shows."""

from __future__ import annotations

import bpy

from ..addon import preview
from ..addon.core.errors import sentence
from ..addon.core.observer import NOBODY
from ..addon.layers.files import check_writable
from ..addon.measure.trace import Trace
from ..addon.ui.registration import Classes
from .reported import reported
from .tracing import written


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


class STRATA_OT_trace_preview(bpy.types.Operator):
    """Begin a trace of all previews; with a file path, end it and write it there (docs/trace.md)"""

    bl_idname = "strata.trace_preview"
    bl_label = "Trace Preview"
    bl_options = {"INTERNAL"}

    filepath: bpy.props.StringProperty(name="File Path", subtype="FILE_PATH", options={"SKIP_SAVE"})

    _trace: Trace | None = None  # the operator class's own: there is one at a time

    @reported
    def execute(self, context):
        kind = type(self)
        if not self.filepath:
            kind._trace = Trace()
            preview.observe(kind._trace)
            return {"FINISHED"}
        if kind._trace is None:
            self.report({"ERROR"}, "No trace was begun")
            return {"CANCELLED"}
        path = bpy.path.abspath(self.filepath)
        check_writable(path)  # else it goes on
        preview.observe(NOBODY)
        trace, kind._trace = kind._trace, None
        for line in written(trace, path):
            print(line)
        self.report({"INFO"}, f"Wrote {path}")
        return {"FINISHED"}


_classes = Classes(STRATA_OT_preview, STRATA_OT_preview_layer, STRATA_OT_trace_preview)
register, unregister = _classes.register, _classes.unregister
