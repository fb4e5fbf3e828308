"""The sidebar of the 3D View; the same in the render properties while the engine is Strata; and lights."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ..core.effect import Effect
from ..core.naming import ENGINE_ID
from ..effects.registry import EFFECTS
from . import bake_warnings, draw, last_bake, plot, presets, rows, watching
from .registration import Classes
from .state import STATE

HAS_SURFACE = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
"""Types of objects that effects see, and that may have settings of their own."""


class _Sidebar:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Strata"


class _RenderProperties:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {ENGINE_ID}


def _in_both(
    name: str,
    label: str,
    body: Callable,
    header: Callable | None = None,
    presets_of: Effect | None = None,
    parent: str = "",
    needed: Callable = lambda context: True,
    is_open: bool = False,
    has_header: bool = True,
) -> tuple[type, type]:
    """A panel of the sidebar and its twin in the render properties; `body(layout, context)` draws both."""

    def is_shown(cls, context):
        return needed(context)

    def is_shown_in_render(cls, context):
        return context.scene.render.engine == ENGINE_ID and needed(context)

    members = {
        "bl_label": label,
        "bl_options": (set() if is_open else {"DEFAULT_CLOSED"}) | (set() if has_header else {"HIDE_HEADER"}),
        "draw": lambda self, context: body(draw.settings_layout(self), context),
    }
    if header:
        members["draw_header"] = lambda self, context: header(self.layout, context)
    if presets_of:
        members["draw_header_preset"] = lambda self, context: presets.draw_list_button(
            presets_of, self.layout
        )
    found = []
    for place, ending, poll in ((_Sidebar, "", is_shown), (_RenderProperties, "_render", is_shown_in_render)):
        own = {"poll": classmethod(poll)} | (
            {"bl_parent_id": f"STRATA_PT_{parent}{ending}"} if parent else {}
        )
        found.append(type(f"STRATA_PT_{name}{ending}", (place, bpy.types.Panel), members | own))
    return tuple(found)


def _bake(layout, context) -> None:
    draw.bake_button(layout, context)
    draw.report_under_way(layout)
    draw.bake_settings(layout, context)


class STRATA_PT_preview(_Sidebar, bpy.types.Panel):
    bl_label = "Preview"

    def draw(self, context):
        draw.preview_switch(self.layout, context)


class STRATA_PT_preview_settings(_Sidebar, bpy.types.Panel):
    bl_label = "Settings"
    bl_parent_id = "STRATA_PT_preview"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        draw.preview_settings(draw.settings_layout(self), context)


class STRATA_MT_preview_layer(bpy.types.Menu):
    bl_label = "Preview Layer"

    def draw(self, context):
        draw.preview_layers(self.layout, context)


def _effect(effect: Effect) -> tuple[type, type]:
    return _in_both(
        effect.id,
        effect.title,
        lambda layout, context: draw.effect_settings(layout, context, effect),
        header=lambda layout, context: draw.effect_header(layout, context, effect),
        presets_of=effect,
        parent="effects",
        is_open=len(EFFECTS) == 1,
    )


class _OwnSettings:
    """What something has of its own; `_owner(context)` says what, None where there is nothing, and which of
    OWNERS that is."""

    bl_label = "Strata"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        data, owner = cls._owner(context)
        return data is not None and rows.has_own(context.scene, owner)

    def draw_header(self, context):
        self.layout.prop(self._owner(context)[0].strata, "use_own", text="")

    def draw(self, context):
        rows.own_settings(draw.settings_layout(self), *self._owner(context), context.scene)


class _Properties(_OwnSettings):
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"


class STRATA_PT_light(_Properties, bpy.types.Panel):
    bl_context = "data"

    @staticmethod
    def _owner(context):
        return context.light, "Light"


class STRATA_PT_material(_Properties, bpy.types.Panel):
    bl_context = "material"

    @staticmethod
    def _owner(context):
        return context.material, "Material"


class STRATA_PT_object(_Properties, bpy.types.Panel):
    """Of a light object the light's, so that nobody has to know where they are."""

    bl_context = "object"

    @staticmethod
    def _owner(context):
        thing = context.object
        if thing is not None and thing.type == "LIGHT":
            return thing.data, "Light"
        return thing if thing is not None and thing.type in HAS_SURFACE else None, "Object"


class STRATA_PT_active_light(_OwnSettings, _Sidebar, bpy.types.Panel):
    bl_label = "Active Light"
    bl_parent_id = "STRATA_PT_lights"

    @staticmethod
    def _owner(context):
        active = context.active_object
        return active.data if active is not None and active.type == "LIGHT" else None, "Light"

    def draw(self, context):
        # Not in the header, which a long name would push out.
        self.layout.label(text=context.active_object.name, icon="OBJECT_DATA")
        super().draw(context)


_classes = Classes(
    STRATA_MT_preview_layer,
    *_in_both("told", "Scene", bake_warnings.draw_bake_warnings, is_open=True, has_header=False),
    STRATA_PT_preview,
    STRATA_PT_preview_settings,
    *_in_both("bake", "Bake", _bake, is_open=True),
    *_in_both("film", "Film", draw.film_settings, parent="bake"),
    *_in_both("exr", "OpenEXR", draw.exr_settings, parent="bake", needed=draw.writes_file),
    *_in_both("effects", "Effects", draw.effects, is_open=True),
    *(panel for effect in EFFECTS for panel in _effect(effect)),
    *_in_both("lights", "Lights", draw.lights, is_open=True),
    STRATA_PT_active_light,
    *_in_both("result", "Last Bake", last_bake.result, needed=last_bake.has_report, is_open=True),
    *_in_both(
        "error",
        "Error against Time",
        last_bake.error_plot,
        parent="result",
        needed=last_bake.has_marks,
        is_open=True,
    ),
    *_in_both("steps", "Time per Step", last_bake.step_times, parent="result", needed=last_bake.has_report),
    STRATA_PT_light,
    STRATA_PT_object,
    STRATA_PT_material,
)


def register() -> None:
    plot.register()
    presets.register()
    _classes.register()
    watching.register()


def unregister() -> None:
    watching.unregister()
    _classes.unregister()
    presets.unregister()
    plot.unregister()
    STATE.clear()
