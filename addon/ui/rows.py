"""Rows of parameters, as they are declared: in groups, grey where they do not count, with their units."""

from __future__ import annotations

from collections.abc import Iterable

import bpy

from ..core.conditions import Values
from ..core.effect import Effect
from ..core.params import NO_GROUP, Group, ParamSpec
from ..core.ramp import Ramp
from ..devices.start import traces_rays
from ..effects.registry import EFFECTS
from ..scene.own_settings import casts_shadow, is_composited, own_specs
from . import boxes
from .preferences import backend_of


def parameters(
    layout: bpy.types.UILayout, group, specs: Iterable[ParamSpec], path: str, is_active: bool = True
) -> None:
    """Rows for values of `group`, which Blender's context knows as `path`. Those that belong together fold up
    under a heading, so `layout` has to be a panel's own."""
    by_name = {spec.name: spec for spec in specs}
    is_traced = traces_rays(backend_of(bpy.context.scene.strata))

    def value_of(name: str):
        return by_name[name].settled(getattr(group, name), is_traced)

    grouped: dict[Group, list[ParamSpec]] = {}
    for spec in by_name.values():
        grouped.setdefault(spec.group, []).append(spec)
    _rows(layout, group, grouped.pop(NO_GROUP, ()), path, is_active, value_of)
    for each, members in grouped.items():
        header, body = layout.panel(f"{path}/{each.title}", default_closed=not each.is_open)
        header.active = is_active and each.used_when.holds(value_of)
        if each.switch:
            header.use_property_split = False
            header.prop(group, each.switch, text="")
        header.label(text=each.title)
        if body:
            shown = (spec for spec in members if spec.name != each.switch)
            _rows(body, group, shown, path, is_active, value_of)


def _rows(layout, group, specs: Iterable[ParamSpec], path: str, is_active: bool, value_of: Values) -> None:
    column = layout.column()
    for spec in specs:
        row = column.column()
        row.active = is_active and spec.used_when.holds(value_of)
        if spec.kind is Ramp:
            _ramp(row, group, path, spec.name)
        elif spec.unlimited:
            boxes.row(row, group, spec.name, spec.unlimited)
        else:
            row.prop(group, spec.name)


def _ramp(layout, group, path: str, name: str) -> None:
    """A texture to take the ramp of, and that ramp; without one, a button that makes it."""
    row = layout.row(align=True)
    row.prop(group, name)
    texture = getattr(group, name)
    if texture is None:
        new = row.operator("strata.new_ramp", text="", icon="ADD")
        new.path, new.name = path, name
    elif texture.use_color_ramp:
        layout.template_color_ramp(texture, "color_ramp", expand=True)
    else:
        layout.prop(texture, "use_color_ramp")


# What lights, objects and materials have of their own


def _own(scene: bpy.types.Scene, owner: str) -> dict[Effect, tuple[ParamSpec, ...]]:
    """Of effects that the scene has switched on: others would be read by nobody."""
    own = own_specs(owner)
    return {effect: specs for effect, specs in own.items() if getattr(scene.strata, effect.id).enabled}


def has_own(scene: bpy.types.Scene, owner: str) -> bool:
    """Whether one of OWNERS has settings of its own to show."""
    return bool(_own(scene, owner))


def has_own_targets(scene: bpy.types.Scene) -> bool:
    """Whether an effect or a light asks for a target error of its own."""
    lights = (light for light in bpy.data.lights if light.is_property_set("strata"))
    groups = [scene.strata, *(light.strata for light in lights if light.strata.use_own)]
    return any(getattr(getattr(each, e.id, None), "target_error", 0.0) for each in groups for e in EFFECTS)


def own_settings(layout: bpy.types.UILayout, data: bpy.types.ID, owner: str, scene: bpy.types.Scene) -> None:
    """What a light, an object or a material has of its own, by effect; grey while it has nothing."""
    is_active = data.strata.use_own
    if owner == "Light":
        layout.prop(data, "use_shadow", text="Cast Shadow")
        if is_composited(data):
            layout.label(text="Shadow from compositor", icon="NODE_COMPOSITING")
        elif data.strata_shadow_composited:
            layout.label(text="Shadowed twice: switch Cast Shadow", icon="ERROR")
            layout.label(text="off, or give the shadows back", icon="BLANK1")
        if data.strata_shadow_composited:
            layout.operator("strata.restore_shadows", text="Give All Shadows Back", icon="LOOP_BACK")
        is_active = is_active and casts_shadow(data)
    for effect, specs in _own(scene, owner).items():
        title = layout.column()
        title.active = is_active
        title.label(text=effect.title)
        group = getattr(data.strata, effect.id)
        parameters(layout, group, specs, f"{owner.lower()}.strata.{effect.id}", is_active)
