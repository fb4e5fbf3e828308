"""The button that joins baked shadows to a render."""

from __future__ import annotations

import bpy

from ..addon.core.naming import ENGINE_ID
from ..addon.layers.compositor import build
from ..addon.ui.registration import Classes
from .arguments import Placeholder
from .bake import output_of
from .reported import reported


class STRATA_OT_build_compositor(bpy.types.Operator):
    """Make compositor nodes that load the baked file and multiply the render by its shadows. With light
    groups each group's image is multiplied by the shadows of its own lights, and the rest of the image stays
    as it is; without, the whole image by every shadow. Render with the lights' own shadows switched off.
    Nodes that are there already stay, and get the image with its shadows"""

    bl_idname = "strata.build_compositor"
    bl_label = "Build Compositor Nodes"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(
        name="File Path",
        description="Baked multilayer EXR, instead of the scene's Strata output",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context):
        if context.scene.render.engine == ENGINE_ID:
            cls.poll_message_set("What Strata renders has its shadows already")
            return False
        return True

    @reported
    def execute(self, context):
        scene = context.scene
        given = self.filepath or scene.strata.output
        path = output_of(scene, given)
        is_sequence = Placeholder(given).is_numbered and scene.frame_start != scene.frame_end
        built = build(scene, context.view_layer, path, is_sequence)
        if built.apart:
            self.report(
                {"WARNING"}, f"Not joined, as their lights are in no light group: {', '.join(built.apart)}"
            )
        if built.unknown:
            names = ", ".join(built.unknown)
            self.report({"WARNING"}, f"Not joined, as no lamp of the scene has them: {names}")
        self.report({"INFO"}, f"Joined {len(built.joined)} shadows")
        return {"FINISHED"}


_classes = Classes(STRATA_OT_build_compositor)
register, unregister = _classes.register, _classes.unregister
