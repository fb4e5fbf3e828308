"""What can be done with the last bake: its image shown, its file's folder opened, a layer's lamp selected."""

from __future__ import annotations

import bpy

from ..addon.layers.images import file_image, image_of
from ..addon.scene.lamp_names import LampNames
from ..addon.ui.registration import Classes
from ..addon.ui.state import STATE, Made
from .reported import reported


class STRATA_OT_show_baked(bpy.types.Operator):
    """Show what was baked in an Image Editor, in a new window where none is open"""

    bl_idname = "strata.show_baked"
    bl_label = "Show"

    @classmethod
    def poll(cls, context):
        return context.scene.session_uid in STATE.made

    @reported
    def execute(self, context):
        made = STATE.made[context.scene.session_uid]
        image = file_image(made.file) if made.file else _first_image(context.scene, made)
        if image is None:
            self.report({"WARNING"}, "The images of this bake are gone")
            return {"CANCELLED"}
        editor = _image_editor(context) or _new_image_editor(context)
        editor.spaces.active.image = image
        return {"FINISHED"}


class STRATA_OT_show_layer(bpy.types.Operator):
    """Select this layer's lamp, and show its image in an Image Editor that is open"""

    bl_idname = "strata.show_layer"
    bl_label = "Show Layer"
    bl_options = {"UNDO"}

    layer: bpy.props.StringProperty(name="Layer", options={"SKIP_SAVE"})
    light: bpy.props.StringProperty(name="Light", options={"SKIP_SAVE"})

    @reported
    def execute(self, context):
        made = STATE.made.get(context.scene.session_uid)
        if made and made.has_images and (editor := _image_editor(context)):
            image = image_of(context.scene.name, made.view_layer, self.layer)
            if image is not None:
                editor.spaces.active.image = image
        lamp = _standing(context.view_layer, self.light) if self.light else None
        if lamp is not None:
            _select(context, lamp)
        elif self.light:
            self.report({"INFO"}, f"'{self.light}' is no object of its own in this view layer")
        return {"FINISHED"}


def _first_image(scene: bpy.types.Scene, made: Made) -> bpy.types.Image | None:
    layers = STATE.reports[scene.session_uid]["layers"]
    found = (image_of(scene.name, made.view_layer, layer["name"]) for layer in layers)
    return next(filter(None, found), None)


def _image_editor(context) -> bpy.types.Area | None:
    """The largest that is open, of this window if it has one."""
    windows = sorted(context.window_manager.windows, key=lambda window: window != context.window)
    for window in windows:
        areas = [area for area in window.screen.areas if area.ui_type == "IMAGE_EDITOR"]
        if areas:
            return max(areas, key=lambda area: area.width * area.height)
    return None


def _new_image_editor(context) -> bpy.types.Area:
    bpy.ops.wm.window_new()
    area = context.window_manager.windows[-1].screen.areas[0]
    area.ui_type = "IMAGE_EDITOR"
    return area


def _standing(view_layer: bpy.types.ViewLayer, light: str) -> bpy.types.Object | None:
    """The object that is, or that shows, the lamp of that name."""
    found = (named.outermost for named in LampNames().standing(view_layer) if named.name == light)
    return next(found, None)


def _select(context, thing: bpy.types.Object) -> None:
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    for other in context.selected_objects:
        other.select_set(False)
    thing.select_set(True)
    context.view_layer.objects.active = thing


_classes = Classes(STRATA_OT_show_baked, STRATA_OT_show_layer)
register, unregister = _classes.register, _classes.unregister
