"""Settings of the preview, saved with the scene. The panel places them."""

from __future__ import annotations

import bpy


class StrataPreviewSettings(bpy.types.PropertyGroup):
    """`scene.strata.preview`."""

    layer: bpy.props.StringProperty(
        name="Layer",
        description="Name of the layer to show; empty shows the composite of all",
    )
    frame_budget_ms: bpy.props.FloatProperty(
        name="Frame (ms)",
        description="Milliseconds that a frame may take while something moves. Resolution and map sizes drop "
        "to keep to it, and come back when everything is still",
        default=33.0,
        min=1.0,
        max=1e5,
        soft_max=250.0,
    )
    show_statistics: bpy.props.BoolProperty(
        name="Statistics",
        description="Frame time, scale, samples and estimated error in a corner of the viewport",
        default=True,
    )  # fmt: skip
