"""Settings that an older Strata saved, brought up to date when a file is opened or appended from.

`scene.strata.version` says which step they are at. A change of meaning adds a step to the end of `_STEPS`;
nothing is ever taken out of it. Steps see the stored values by name, also of properties that are gone: what
was never changed from its default is not stored.
"""

from __future__ import annotations

import sys
import zlib
from collections.abc import Callable, Iterable
from enum import Enum
from typing import Any

import bpy
from bpy.app.handlers import blend_import_post, load_post, persistent, save_pre

from ..core.errors import told_once
from ..effects.registry import EFFECTS
from ..scene.lamp_names import LampNames

# What Blender keeps properties in: names to numbers, texts and further groups.
Stored = Any


def _choose_where_to_save(stored: Stored, _scene: bpy.types.Scene) -> None:
    """One choice (images 0, file 1, both 2) for a switch for images and a file name that might be empty."""
    has_images = bool(stored.pop("make_images", True))
    has_file = stored.get("output", "//") != ""
    if not has_file:
        stored.pop("output")
    if not (has_images and has_file):
        stored["save_to"] = 1 if has_file else 0


def _renumber_choices(stored: Stored, _scene: bpy.types.Scene) -> None:
    """Numbers of choices that an animation can hold: 22 bits of the word's hash instead of 31."""
    for effect in EFFECTS:
        group = stored.get(effect.id)
        for spec in effect.params.specs() if group is not None else ():
            if issubclass(spec.kind, Enum) and spec.name in group:
                group[spec.name] &= 0x3FFFFF


def _keep_output(stored: Stored, _scene: bpy.types.Scene) -> None:
    """What was the default, so that a compositor's nodes find the file again; braces were only braces."""
    output = stored.get("output", "//strata_####.exr")
    stored["output"] = output.replace("{", "{{").replace("}", "}}")


def _point_at_key_light(stored: Stored, scene: bpy.types.Scene) -> None:
    """The lamp itself for its name."""
    toon = stored.get("toon")
    name = toon.pop("key_light", None) if toon is not None else None
    if not isinstance(name, str) or not name:
        return
    if lamp := LampNames().called(name, scene):
        toon["key_light"] = lamp
    else:
        told = f"toon's key light '{name}' is no lamp of it, so all lamps count now"
        print(f"strata: scene '{scene.name}': {told}", file=sys.stderr)


def _keep_samples(stored: Stored, _scene: bpy.types.Scene) -> None:
    """A target error is the default: who had set samples, or a time, keeps that alone."""
    if "samples" in stored or "time_budget_s" in stored:
        stored["target_error"] = stored.get("target_error", 0.0)


def _keep_maps(stored: Stored, _scene: bpy.types.Scene) -> None:
    """The bitmask was the default method of soft shadows: who had set anything of its maps keeps it."""
    shadow = stored.get("soft_shadow")
    if shadow is None or "method" in shadow:
        return
    of_maps = {
        "layers",
        "resolution",
        "max_samples",
        "refinements",
        "gradient_scale",
        "gradient_cap_m",
        "rays",
    }
    if of_maps & set(shadow.keys()):
        shadow["method"] = zlib.crc32(b"bitmask") & 0x3FFFFF


_STEPS: tuple[Callable[[Stored, bpy.types.Scene], None], ...] = (
    _choose_where_to_save,
    _renumber_choices,
    _keep_output,
    _point_at_key_light,
    _keep_samples,
    _keep_maps,
)
VERSION = len(_STEPS)


def migrate(scenes: Iterable[bpy.types.Scene]) -> None:
    """Brings settings up to date; scenes that have none, and settings of this or a later Strata, are left
    alone."""
    for scene in scenes:
        properties = scene.bl_system_properties_get()
        stored = properties.get("strata") if properties else None
        if not stored or not stored.keys() or not scene.is_editable:
            continue
        for step in _STEPS[stored.get("version", 0) :]:
            step(stored, scene)
        stored["version"] = max(stored.get("version", 0), VERSION)


@persistent
@told_once
def _after_opening(*_) -> None:
    migrate(bpy.data.scenes)


@persistent
@told_once
def _after_appending(context, *_) -> None:
    migrate(item.id for item in context.import_items if isinstance(item.id, bpy.types.Scene))


@persistent
@told_once
def _before_saving(*_) -> None:
    """New settings are of this version."""
    for scene in bpy.data.scenes:
        properties = scene.bl_system_properties_get()
        if properties and "strata" in properties and scene.is_editable:
            stored = properties["strata"]
            stored["version"] = max(stored.get("version", 0), VERSION)


_HANDLERS = ((load_post, _after_opening), (blend_import_post, _after_appending), (save_pre, _before_saving))


def register() -> None:
    for handlers, function in _HANDLERS:
        if function not in handlers:
            handlers.append(function)


def unregister() -> None:
    for handlers, function in _HANDLERS:
        if function in handlers:
            handlers.remove(function)
