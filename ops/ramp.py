"""The button that makes a colour ramp for a setting."""

from __future__ import annotations

import bpy

from ..addon.core.ramp import Ramp
from ..addon.effects.registry import EFFECTS
from ..addon.ui.properties import fill_ramp
from ..addon.ui.registration import Classes
from .reported import reported


class STRATA_OT_new_ramp(bpy.types.Operator):
    """Make a texture whose colour ramp this setting takes, with the default's stops"""

    bl_idname = "strata.new_ramp"
    bl_label = "New Ramp"
    bl_options = {"REGISTER", "UNDO", "INTERNAL"}

    path: bpy.props.StringProperty(description="Settings, from the context", options={"HIDDEN"})
    name: bpy.props.StringProperty(description="Their ramp", options={"HIDDEN"})

    @reported
    def execute(self, context):
        try:
            settings = context.path_resolve(self.path)
            spec = _spec(self.path.rpartition(".")[2], self.name)
        except (ValueError, StopIteration):
            self.report({"ERROR"}, f"no ramp at {self.path}.{self.name}")
            return {"CANCELLED"}
        texture = bpy.data.textures.new(f"{spec.label} of Strata", "NONE")
        texture.use_color_ramp = True
        fill_ramp(texture.color_ramp, spec.default)
        setattr(settings, self.name, texture)
        return {"FINISHED"}


def _spec(effect_id: str, name: str):
    effect = EFFECTS.named(effect_id)
    specs = [*effect.params.specs(), *(effect.object_params.specs() if effect.object_params else ())]
    return next(spec for spec in specs if spec.name == name and spec.kind is Ramp)


_classes = Classes(STRATA_OT_new_ramp)
register, unregister = _classes.register, _classes.unregister
