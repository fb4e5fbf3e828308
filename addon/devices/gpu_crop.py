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


def cropped(device: GpuSteps, value: Any, first: tuple[int, int], shape: tuple[int, int]) -> Any:
    """See Device.cropped."""
    if isinstance(value, dict):
        return {name: cropped(device, each, first, shape) for name, each in value.items()}
    part = device.new_image((*shape, *value.shape[2:]), value.dtype)
    size = shape[::-1]
    device.dispatch(_crop(value), size, {"part": part}, {"whole": value}, {"size": (*size, *first[::-1])})
    return part
