"""The buttons that join baked shadows to a render, and take them away again."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import bpy

from ..addon.core.errors import StrataError
from ..addon.layers.compositor import Built, build, can_take_away, take_away
from ..addon.layers.fitting import rendering, unfit_file, unfit_render, unlike
from ..addon.layers.numbered import Placeholder
from ..addon.scene.changing import may_change
from ..addon.scene.light_groups import marked
from ..addon.ui.output import output_of
from ..addon.ui.registration import Classes
from .reported import reported


class STRATA_OT_build_compositor(bpy.types.Operator):
    """Put the baked shadows onto the render: make compositor nodes that multiply the light of each lamp by
    its shadow, give each lamp a light group where it has none, and switch off its own shadow, whose place
    Strata's takes. Strata goes on baking it. Your own nodes and light groups stay. Undo takes all of it
    back"""

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
        if reason := unfit_render(context.scene):
            cls.poll_message_set(reason)
        return not reason

    @reported
    def execute(self, context):
        scene = context.scene
        is_relative = (self.filepath or scene.strata.output).startswith("//")
        layers = rendering(scene, context.view_layer)
        outputs = {layer: output_of(scene, layer, self.filepath) for layer in layers}
        paths = {layer: output.path(scene.frame_current) for layer, output in outputs.items()}
        for path in paths.values():
            # Of view layers that have none of their own, lamps are told by name.
            if (path == paths[layers[0]] or path.is_file()) and (reason := unfit_file(scene, path)):
                raise StrataError(reason)
        path, frames = paths[layers[0]], _frames(scene, outputs[layers[0]])
        built = build(scene, paths, bool(frames), is_relative)
        if built.others:
            self.report({"INFO"}, f"Not joined, as they are no shadows: {', '.join(built.others)}")
        for warning in unlike(scene, path, frames):
            self.report({"WARNING"}, warning[0].upper() + warning[1:])
        for name, reason in built.apart.items():
            self.report({"WARNING"}, f"Not joined: {name}: {reason}")
        for name in built.elsewhere:
            self.report({"WARNING"}, f"Scene '{name}' shows some of these lamps too, now without shadows")
        if built.given_back:
            self.report({"WARNING"}, f"Cast their own shadows again: {', '.join(built.given_back)}")
        for name in built.twice:
            self.report({"WARNING"}, _shadowed_twice(name))
        self.report({"INFO"}, _summary(built))
        return {"FINISHED"}


def _frames(scene: bpy.types.Scene, output: Placeholder) -> dict[int, Path]:
    """Files by frame, where each frame has its own; otherwise empty: one file does for all."""
    if not output.is_numbered or scene.frame_start == scene.frame_end or not may_change(scene):
        return {}
    numbers = range(scene.frame_start, scene.frame_end + 1, scene.frame_step)
    return {number: output.path(number) for number in numbers}


def _shadowed_twice(scene: str) -> str:
    return f"Scene '{scene}' shadows some of these lamps twice now: give lamps their shadows back there too"


def _summary(built: Built) -> str:
    count = len(built.joined)
    words = f"Joined {count} shadow{'s' if count != 1 else ''}"
    if built.apart:
        words += f", {len(built.apart)} not"
    if built.switched:
        words += f"; the lights' own are now off: {', '.join(built.switched)}"
    return words


def _without(lights: Iterable[str]) -> str:
    return (
        f"Still without a shadow: {', '.join(lights)}: linked from a library and cannot be changed here. "
        "Give lamps their shadows back in its file, or make a library override"
    )


class STRATA_OT_restore_shadows(bpy.types.Operator):
    """Switch the lamps' own shadows on again and take away the compositor nodes that stand in for them. Light
    groups stay"""

    bl_idname = "strata.restore_shadows"
    bl_label = "Give Lamps Their Shadows Back"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        found = can_take_away(context.scene)
        if not found:
            without = [light.name for light in marked(context.scene)]
            cls.poll_message_set(
                _without(without) if without else "Every lamp of this scene has its own shadow"
            )
        return found

    @reported
    def execute(self, context):
        taken = take_away(context.scene)
        for name in taken.twice:
            self.report({"WARNING"}, _shadowed_twice(name))
        if taken.without:
            self.report({"WARNING"}, _without(taken.without))
        if taken.given_back:
            self.report({"INFO"}, f"Cast their own shadows again: {', '.join(taken.given_back)}")
        elif not taken.without:
            self.report({"INFO"}, "Shadow nodes are away; no lamp had its own shadow switched off")
        return {"FINISHED"}


_classes = Classes(STRATA_OT_build_compositor, STRATA_OT_restore_shadows)
register, unregister = _classes.register, _classes.unregister
