"""Images without what lies around a tile."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.device import GpuSteps
from ..core.shader import Shader
from .gpu_image import GpuImage


def _crop(image: GpuImage) -> Shader:
    sampler = "FLOAT_2D" if image.dtype == np.float32 else "UINT_2D"
    return Shader(
        "devices/crop.glsl",
        samplers=(("whole", sampler),),
        images=(("part", image.format, "WRITE"),),
        params=("size",),
    )


def cropped(device: GpuSteps, value: Any, margin: int) -> Any:
    """See Device.cropped."""
    if isinstance(value, dict):
        return {name: cropped(device, each, margin) for name, each in value.items()}
    height, width = (side - 2 * margin for side in value.shape[:2])
    part = device.new_image((height, width, *value.shape[2:]), value.dtype)
    params = {"size": (width, height, margin)}
    device.dispatch(_crop(value), (width, height), {"part": part}, {"whole": value}, params)
    return part
