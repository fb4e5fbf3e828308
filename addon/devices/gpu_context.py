"""Blender's gpu module with a context, in a window and in background."""

from __future__ import annotations

import ctypes
import os
import sys

from ..core.errors import DeviceUnavailable
from .gpu_shader import captured_output


def started():
    """The gpu module, ready. Raises DeviceUnavailable saying why not."""
    if os.environ.get("STRATA_DISABLE_GPU") == "1":
        raise DeviceUnavailable("STRATA_DISABLE_GPU=1 is set")
    if "bpy" not in sys.modules:
        raise DeviceUnavailable("Blender is not running in this Python (import bpy first)")
    import gpu

    if _answers(gpu):
        return gpu
    if not hasattr(gpu, "init"):
        raise DeviceUnavailable("Blender before 5.2 has no GPU in background")
    if sys.platform == "linux" and "vulkan" not in sys.argv and not _loads("libEGL.so.1"):
        raise DeviceUnavailable("libEGL.so.1 is missing")  # gpu.init() would end the process, not raise
    said = []
    try:
        with captured_output() as said:  # Mesa grumbles about EGL configurations that it skips
            gpu.init()
    except SystemError as error:
        reason = ((said[0] if said else "") or str(error)).strip().splitlines()
        raise DeviceUnavailable(reason[-1] if reason else "no context") from None
    if not _answers(gpu):
        raise DeviceUnavailable("the GPU module does not start")
    return gpu


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _answers(gpu) -> bool:
    """Whether the module is ready: with an interface from the start, in background after `gpu.init()`."""
    try:
        gpu.platform.renderer_get()
    except SystemError:
        return False
    return True
