"""Settings of the preview, saved with the scene. The panel places them."""

from __future__ import annotations

import bpy

from . import preferences
from .boxes import box, box_name

FIRST_SAMPLES = 4
FIRST_SECONDS = 10.0


class StrataPreviewSettings(bpy.types.PropertyGroup):
    """`scene.strata.preview`."""

    layer: bpy.props.StringProperty(
        name="Layer",
        description="Name of the layer to show; empty shows the composite of all",
    )
    samples: bpy.props.IntProperty(
        name="Samples",
        description="Jittered surfaces per pixel that the preview refines to; 0: as many as a bake has, and "
        "then it ends at the bake's picture",
        default=0,
        min=0,
        max=4096,
        soft_max=64,
    )
    longest_s: bpy.props.FloatProperty(
        name="Time Limit",
        description="The preview refines no longer than this, once all is still; 0: until it has all samples",
        default=0.0,
        min=0.0,
        max=1e5,
        soft_max=120.0,
        subtype="TIME_ABSOLUTE",
        unit="TIME_ABSOLUTE",
    )
    frame_budget_ms: bpy.props.FloatProperty(
        name="Frame (ms)",
        description="Milliseconds that a frame may take while something moves; 0: as Strata's preferences "
        "say. Resolution and map sizes drop to keep to it, and come back when everything is still",
        default=0.0,
        min=0.0,
        max=1e5,
        soft_max=250.0,
    )
    shows_noise: bpy.props.BoolProperty(
        name="Noise Map",
        description="Shows in place of the picture how uncertain each of its pixels still is, as a share "
        "of its brightness: the noise of its samples. How far a layer is off besides, only a bake measures",
        default=False,
    )
    on_opening: bpy.props.BoolProperty(
        name="On Opening",
        description="The preview is switched on when this file is opened",
        default=False,
    )
    show_statistics: bpy.props.BoolProperty(
        name="Statistics",
        description="Frame time, scale, samples and noise in a corner of the viewport",
        default=True,
    )  # fmt: skip


# What may be off has a box beside it.
for _name, _first, _told in (
    ("samples", FIRST_SAMPLES, "The preview has samples of its own. Off: those of a bake"),
    ("longest_s", FIRST_SECONDS, "Refining stops after a time. Off: with the last sample"),
    ("frame_budget_ms", preferences.FRAME_BUDGET_MS, "The scene has a budget of its own. Off: preferences"),
):
    StrataPreviewSettings.__annotations__[box_name(_name)] = box(_name, 0, _first, "Own", _told)


def frame_budget_ms_of(scene: bpy.types.Scene) -> float:
    """The scene's own, or the preferences'."""
    return scene.strata.preview.frame_budget_ms or preferences.frame_budget_ms()
