"""Settings in the scene, generated from what the effects declare."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from enum import Enum
from itertools import chain
from typing import Any

import bpy

from ..core.effect import Effect
from ..core.params import Colour, Lamp, ParamSpec, in_words
from ..core.placement import Placement
from ..core.ramp import Ramp
from ..core.read import MOST_TEXELS, TEXELS, Read
from ..core.sampling import MOST_SAMPLES
from ..core.weight import Weight
from ..effects.registry import EFFECTS
from ..layers.exr_params import ExrParams
from ..planning import ENOUGH_SAMPLES, TARGET_ERROR, USUAL_SAMPLES, Options
from ..scene.own_settings import OWNERS, own_specs, value_of
from . import migration, preferences
from .boxes import box, box_name
from .output import default_output
from .preview_settings import StrataPreviewSettings

_FLOAT_LIMIT = 3.4e38  # of float32, which Blender keeps properties in
_INT_LIMIT = 2**31 - 1
# The RNA property type that shows a unit, by ParamSpec.unit; others are named in labels or the tooltip.
_SUBTYPES = {"m": ("DISTANCE", "LENGTH"), "rad": ("ANGLE", "ROTATION"), "pixel": ("PIXEL", "NONE")}


def options_of(scene: bpy.types.Scene, **overrides: Any) -> Options:
    """How the scene wants to be baked: the effects that it has switched on, and its values. A scene that has
    never seen Strata has everything on, at the defaults.

    `overrides` go over that, except those that are None; `values` goes over it parameter by parameter.
    Raises StrataError for wrong ones.
    """
    settings = scene.strata
    values = {
        effect.id: {
            spec.name: value_of(spec, getattr(getattr(settings, effect.id), spec.name))
            for spec in effect.params.specs()
        }
        for effect in EFFECTS
    }
    given_values = overrides.pop("values", None) or {}
    for effect_id, given in given_values.items():
        values[effect_id] = values.get(effect_id, {}) | given
    samples = overrides.get("samples")
    given_targets = _targets_in(given_values)
    # Who says how many, and nothing of an error or a time, gets so many.
    is_said = samples is not None and not (
        overrides.get("target_error") or overrides.get("time_budget_s") or given_targets
    )
    # Who says how close all is to be means lamps and effects too, but those named in the same breath.
    rules_all = is_said or bool(overrides.get("target_error"))
    # Who says how long, and never said how close, gets what there is time for.
    is_of_time = bool(overrides.get("time_budget_s")) and not settings.is_property_set("target_error")
    has_aim = not is_said and not is_of_time
    options = {
        "effects": tuple(effect.id for effect in EFFECTS if getattr(settings, effect.id).enabled),
        "backend": preferences.backend_of(settings),
        "samples": settings.samples,
        "most_samples": settings.most_samples if samples is None else samples,
        "target_error": settings.target_error if has_aim else 0.0,
        "time_budget_s": 0.0 if is_said else settings.time_budget_s,
        "own_targets": given_targets if rules_all else None,
        "weight": settings.weight,
        "placement": settings.placement,
        "rgb_layers": settings.rgb_layers,
        "read": settings.read,
        "read_texels": settings.read_texels,
        # Only a number that somebody set is kept whatever it takes.
        "probes": settings.probes if settings.is_property_set("probes") else None,
        "error_images": settings.error_images,
        "memory_bytes": round(settings.memory_gb * 1e9),
        # What somebody names is what they get, also where the picture has it from another effect.
        "keeps_unused": overrides.get("effects") is not None,
    }
    return Options(values=values, **options | {k: v for k, v in overrides.items() if v is not None})


def _targets_in(values: dict[str, dict[str, Any]]) -> dict[str, float]:
    """By effect, those above 0 of `values` that somebody gave."""
    found = {}
    for effect_id, given in values.items():
        if "target_error" in given:
            only = {"target_error": given["target_error"]}
            found[effect_id] = EFFECTS.named(effect_id).params.checked(effect_id, only).target_error
    return {effect_id: target for effect_id, target in found.items() if target}


def exr_of(scene: bpy.types.Scene, **overrides: Any) -> ExrParams:
    """How the scene wants its EXR; `overrides` go over that, except those that are None."""
    values = {spec.name: getattr(scene.strata.exr, spec.name) for spec in ExrParams.specs()}
    return ExrParams.checked("exr", values | {k: v for k, v in overrides.items() if v is not None})


def fill_ramp(ramp: bpy.types.ColorRamp, value: Ramp) -> None:
    """The inverse of scene/own_settings.py `ramp_of`."""
    ramp.interpolation, ramp.color_mode = value.interpolation.name, value.mode.name
    ramp.hue_interpolation = value.hue.name
    while len(ramp.elements) > 1:
        ramp.elements.remove(ramp.elements[-1])
    for index, (position, colour) in enumerate(value.stops):
        element = ramp.elements.new(position) if index else ramp.elements[0]
        element.position, element.color = position, colour


def _tooltip(spec: ParamSpec, called: dict[str, str]) -> str:
    """`called`: labels of the parameters that stand beside it."""
    text = spec.doc.rstrip(".")
    if spec.unit and spec.unit not in _SUBTYPES:
        text += f" (unit: {spec.unit})"
    if used_when := spec.used_when.words(called.__getitem__):
        text += f". Counts where {used_when}"
    return text + (". More is slower and more exact" if spec.trades_time and not spec.choices else "")


def _enum_items(spec: ParamSpec) -> list[tuple[str, str, str, int]]:
    """Numbers made from the words themselves: a file keeps the number, and stays right when a choice is
    added before another. Of 22 bits: an animation keeps them as float32, and adds a half."""
    return [
        (word, spec.words.get(word, in_words(word)), "", zlib.crc32(word.encode()) & 0x3FFFFF)
        for word in spec.choices
    ]


def _ranges(spec: ParamSpec, limit: float) -> dict[str, float]:
    hard = spec.hard or (-limit, limit)
    soft = spec.soft or hard
    clamp = lambda value: max(-limit, min(limit, value))  # noqa: E731
    return dict(zip(("min", "max", "soft_min", "soft_max"), map(clamp, (*hard, *soft)), strict=True))


def _properties(specs: Iterable[ParamSpec]) -> dict[str, Any]:
    """The bpy properties of parameters, by name."""
    specs = tuple(specs)
    called = {spec.name: spec.label for spec in specs}
    found = {spec.name: _property(spec, _tooltip(spec, called)) for spec in specs}
    return found | {box_name(spec.name): _limit_box(spec) for spec in specs if spec.unlimited}


def _limit_box(spec: ParamSpec):
    """Whether there is a limit."""
    told = f"{spec.doc.rstrip('.')}. Off: {spec.unlimited.lower()}"
    return box(spec.name, spec.hard[1], 0.5 * spec.soft[1], spec.label, told)


def _is_lamp(group: bpy.types.PropertyGroup, thing: bpy.types.Object) -> bool:
    return thing.type == "LIGHT"


def _property(spec: ParamSpec, tooltip: str):
    """The bpy property of one parameter."""
    common = {"name": spec.label, "description": tooltip}
    if issubclass(spec.kind, Enum):
        return bpy.props.EnumProperty(items=_enum_items(spec), default=spec.default.value, **common)
    if spec.kind is bool:
        return bpy.props.BoolProperty(default=spec.default, **common)
    if spec.kind is Lamp:
        return bpy.props.PointerProperty(type=bpy.types.Object, poll=_is_lamp, **common)
    if spec.kind is str:
        return bpy.props.StringProperty(default=spec.default, **common)
    if spec.kind is Ramp:
        # Blender has no property for a ramp, but textures have one.
        return bpy.props.PointerProperty(type=bpy.types.Texture, **common)
    subtype, unit = _SUBTYPES.get(spec.unit, ("NONE", "NONE"))
    if spec.kind is Colour:
        return bpy.props.FloatVectorProperty(
            default=tuple(spec.default), size=3, subtype="COLOR", **_ranges(spec, _FLOAT_LIMIT), **common
        )
    if spec.kind is int:
        subtype = "PIXEL" if subtype == "PIXEL" else "NONE"
        return bpy.props.IntProperty(
            default=spec.default, subtype=subtype, **_ranges(spec, _INT_LIMIT), **common
        )
    return bpy.props.FloatProperty(
        default=spec.default, subtype=subtype, unit=unit, precision=3, **_ranges(spec, _FLOAT_LIMIT), **common
    )


def _keep_samples(group: bpy.types.PropertyGroup, context) -> None:
    """Whoever sets a number, and nothing of an error, gets that."""
    if not group.is_property_set("target_error"):
        group.target_error = 0.0


def _update_passes(group: bpy.types.PropertyGroup, context) -> None:
    """The compositor's sockets follow what is switched on."""
    for view_layer in group.id_data.view_layers:
        view_layer.update_render_passes()


def _effect_group(effect: Effect) -> type:
    """The PropertyGroup of an effect: `enabled` and its parameters."""
    on = bpy.props.BoolProperty(
        name=effect.title,
        description=effect.doc.rstrip("."),
        default=effect.on_by_default,
        update=_update_passes,
    )
    properties = {"enabled": on, **_properties(effect.params.specs())}
    return _group(f"Strata{effect.title.replace(' ', '')}Settings", properties)


def _own_groups(owner: str, specs: dict[Effect, tuple[ParamSpec, ...]]) -> tuple[type, ...]:
    """The PropertyGroups of what a light, an object or a material (`owner`) may have of its own: one an
    effect, and last that of the owner, which holds them."""
    groups = {
        effect.id: _group(f"Strata{effect.title.replace(' ', '')}{owner}Settings", _properties(own))
        for effect, own in specs.items()
    }
    use = bpy.props.BoolProperty(
        name="Own Settings",
        description=f"This {owner.lower()} has settings of its own, instead of the scene's",
    )
    pointers = {effect_id: bpy.props.PointerProperty(type=group) for effect_id, group in groups.items()}
    return (*groups.values(), _group(f"Strata{owner}Settings", {"use_own": use, **pointers}))


def _group(name: str, properties: dict) -> type:
    return type(name, (bpy.types.PropertyGroup,), {"__annotations__": properties})


def _scene_group(groups: dict[str, type], exr: type) -> type:
    """The PropertyGroup of a scene: how to bake, how to write, and a group an effect."""
    properties = {
        "version": bpy.props.IntProperty(
            name="Settings Version",
            description="Which Strata these settings were saved by (addon/ui/migration.py); 0: none yet",
            options={"HIDDEN"},
        ),
        "backend": bpy.props.EnumProperty(
            name="Device",
            description="Where the effects run",
            items=[*preferences.DEVICES, ("preferences", "Preferences", "What Strata's preferences say", 3)],
            default="preferences",
        ),
        "samples": bpy.props.IntProperty(
            name="Samples",
            description="Jittered surfaces per pixel, of layers without a target error. More is slower, and "
            "edges are smoother",
            default=USUAL_SAMPLES, min=1, max=MOST_SAMPLES, soft_max=64, update=_keep_samples,
        ),
        "target_error": bpy.props.FloatProperty(
            name="Target Error",
            description="Each layer gets as many samples as bring its error down to this share of the "
            "brightness. Effects and lights may have their own. 0: as many samples as are set",
            default=TARGET_ERROR, min=0.0, max=0.99, soft_max=0.1, step=1, precision=3,
        ),
        "time_budget_s": bpy.props.FloatProperty(
            name="Time Budget (s)",
            description="As many samples as there is time for in one bake, measuring included. What it gets "
            "hangs on the machine. 0: it may take any time",
            default=0.0, min=0.0, max=1e6, soft_max=600.0, precision=1,
        ),
        "most_samples": bpy.props.IntProperty(
            name="Most Samples",
            description="No layer that has a target error, or a time budget, gets more samples than this",
            default=ENOUGH_SAMPLES, min=1, max=MOST_SAMPLES, soft_max=256,
        ),
        "weight": bpy.props.EnumProperty(
            name="Weight",
            description="What the samples of a pixel weigh in layers that multiply",
            items=[(each.value, each.name.capitalize(), each.doc) for each in Weight],
            default=Weight.RADIANCE.value,
        ),
        "placement": bpy.props.EnumProperty(
            name="Placement",
            description="Where in a pixel its samples lie",
            items=[(each.value, in_words(each.value), each.doc) for each in Placement],
            default=Placement.SHARED.value,
        ),
        "rgb_layers": bpy.props.BoolProperty(
            name="RGB Shadows",
            description="Shadows are weighed channel by channel, and have three: right in colour too where "
            "surfaces of several colours share a pixel",
            default=False,
        ),
        "read": bpy.props.EnumProperty(
            name="Materials",
            description="How materials are read. F12 and previews take what a bake has kept",
            items=[(each.value, each.name.capitalize(), each.doc) for each in Read],
            default=Read.FAST.value,
        ),
        "read_texels": bpy.props.IntProperty(
            name="Texels",
            description="Most texels a side of what Blender bakes of a mesh's materials, rounded up to a "
            "power of two. As few are taken as the camera asks for, and more where there are many faces",
            default=TEXELS, min=1, max=MOST_TEXELS, soft_min=128,
        ),
        "probes": bpy.props.IntProperty(
            name="Error Probes",
            description="Pixels that each layer's error is measured at; 0 measures nothing. "
            "Until it is set, at most 2048, and so few that measuring takes 15% of a bake",
            default=2048, min=0, max=1 << 20, soft_max=16384,
        ),
        "error_images": bpy.props.BoolProperty(
            name="Error Images",
            description="Beside each measured layer a bake makes an image of how far it is off at each "
            "pixel, as a share of the brightness there. Rays at every pixel: often slower than the bake",
            default=False,
        ),
        "audit": bpy.props.BoolProperty(
            name="Audit",
            description="After a bake, another Blender renders some thousand pixels with Cycles, and the "
            "report says how far lamps' layers are from them: what Strata reads otherwise shows there",
            default=False,
        ),
        "memory_gb": bpy.props.FloatProperty(
            name="Memory (GB)",
            description="What a bake may take beside Blender itself. Lamps are worked off in groups that "
            "fit. 0: half of what is free, or less where more is of no use",
            default=0.0, min=0.0, max=1e6, soft_max=64.0, precision=1,
        ),
        "save_to": bpy.props.EnumProperty(
            name="Save To",
            description="What a bake makes of its layers",
            items=[
                ("IMAGES", "Images", "An image of this file for each layer, filled anew by every bake", 0),
                ("FILE", "File", "A multilayer OpenEXR file", 1),
                ("BOTH", "Both", "Images of this file, and a multilayer OpenEXR file", 2),
            ],
            default="BOTH",
        ),
        "output": bpy.props.StringProperty(
            name="File",
            description="Multilayer EXR to write, or its folder. #### is the frame number; {blend_name}, "
            "{scene_name}, {view_layer_name}, {camera_name}, {resolution_x}, {resolution_y} and {fps} are "
            "what they say. Left empty, it is named after the Blender file",
            subtype="FILE_PATH",
            # Without SUPPORTS_TEMPLATES: in a property of an extension Blender knows none of these names but
            # the first, and would mark the field red.
            get_transform=lambda self, value, is_set: value or default_output(self.id_data),
            options={"OUTPUT_PATH", "PATH_SUPPORTS_BLEND_RELATIVE"},
        ),
    }  # fmt: skip
    for effect_id, group in groups.items():
        properties[effect_id] = bpy.props.PointerProperty(type=group)
    properties["exr"] = bpy.props.PointerProperty(type=exr)
    properties["preview"] = bpy.props.PointerProperty(type=StrataPreviewSettings)
    return _group("StrataSettings", properties)


_registered: list[type] = []


def register() -> None:
    """Makes `strata` of scenes, lights, objects and materials; a second time changes nothing."""
    if _registered:
        return
    of_owners = {owner: _own_groups(owner, own_specs(owner)) for owner in OWNERS}
    of_scenes = {effect.id: _effect_group(effect) for effect in EFFECTS}
    exr = _group("StrataExrSettings", _properties(ExrParams.specs()))
    scene = _scene_group(of_scenes, exr)
    for cls in (*chain(*of_owners.values()), *of_scenes.values(), exr, StrataPreviewSettings, scene):
        bpy.utils.register_class(cls)
        _registered.append(cls)
    for owner, groups in of_owners.items():
        getattr(bpy.types, owner).strata = bpy.props.PointerProperty(type=groups[-1])
    bpy.types.Scene.strata = bpy.props.PointerProperty(type=scene)
    # Not in `strata`: a library override keeps values, but no groups of them.
    bpy.types.Light.strata_shadow_composited = bpy.props.BoolProperty(
        name="Shadow in the Compositor",
        description="Strata's compositor nodes give this light its shadow, which Strata goes on baking "
        "though the light's own is switched off. While its own is on, this does not count",
        options=set(),
        override={"LIBRARY_OVERRIDABLE"},
    )
    migration.register()


def unregister() -> None:
    if not _registered:
        return
    migration.unregister()
    del bpy.types.Scene.strata, bpy.types.Light.strata_shadow_composited
    for owner in OWNERS:
        del getattr(bpy.types, owner).strata
    while _registered:
        bpy.utils.unregister_class(_registered.pop())
