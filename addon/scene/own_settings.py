"""Settings that lights, objects and materials have of their own, where Strata's properties are registered."""

from __future__ import annotations

from typing import Any

import bpy

from ..core.effect import Effect
from ..core.params import Colour, Lamp, OwnSettings, ParamSpec
from ..core.ramp import HuePath, Ramp, RampInterpolation, RampMode
from ..effects.registry import EFFECTS

OWNERS = ("Light", "Object", "Material")
"""Names of Blender's types that have them."""


def casts_shadow(light: bpy.types.Light) -> bool:
    """Whether a light has a shadow for Strata: its own, or one that Strata's compositor nodes put in place of
    its own, which is switched off."""
    return light.use_shadow or is_composited(light)


def is_composited(light: bpy.types.Light) -> bool:
    """Whether Strata's compositor nodes give a light its shadow. A shadow of its own that somebody has
    switched on again goes over that."""
    return not light.use_shadow and getattr(light, "strata_shadow_composited", False)


def own_specs(owner: str) -> dict[Effect, tuple[ParamSpec, ...]]:
    """What one of OWNERS may have of its own, by effect."""
    if owner == "Light":
        found = {effect: tuple(s for s in effect.params.specs() if s.per_light) for effect in EFFECTS}
    else:
        found = {
            effect: tuple(s for s in effect.object_params.specs() if owner == "Object" or not s.object_only)
            for effect in EFFECTS
            if effect.object_params
        }
    return {effect: specs for effect, specs in found.items() if specs}


def own_settings_of(data: bpy.types.ID | None, owner: str) -> OwnSettings:
    """Of an evaluated light, object or material; empty where it has none."""
    if data is None or "strata" not in data.bl_rna.properties or not data.is_property_set("strata"):
        return ()  # asked for, it would be made, and leak with a temporary object
    settings = data.strata
    if not settings.use_own:
        return ()
    return tuple(
        (effect.id, spec.name, value_of(spec, getattr(getattr(settings, effect.id), spec.name)))
        for effect, specs in own_specs(owner).items()
        for spec in specs
    )


def value_of(spec: ParamSpec, value: Any) -> Any:
    """What a property holds, as a parameter. A ramp is that of a texture, or the default without one; a lamp
    is the name of an object, with its library."""
    if spec.kind is Colour:
        return tuple(value)
    if spec.kind is Lamp:
        return Lamp("" if value is None else value.name_full)
    if spec.kind is not Ramp:
        return value
    return spec.default if value is None or not value.use_color_ramp else ramp_of(value.color_ramp)


def ramp_of(ramp: bpy.types.ColorRamp) -> Ramp:
    """Blender's own."""
    stops = sorted(((e.position, tuple(e.color)) for e in ramp.elements), key=lambda stop: stop[0])
    return Ramp(
        tuple(stops),
        RampInterpolation[ramp.interpolation],
        RampMode[ramp.color_mode],
        HuePath[ramp.hue_interpolation],
    )
