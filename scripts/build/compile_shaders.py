"""Compiles every shader variant on the GPU backend at hand and fails where one does not compile.

python -m strata.scripts.build.compile_shaders      with bpy installed: OpenGL
blender -b --gpu-backend vulkan --python-exit-code 1 --python scripts/in_blender.py -- \
  strata.scripts.build.compile_shaders
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import bpy  # noqa: F401 (the gpu module comes with it)
from strata.addon.core.errors import ShaderError
from strata.addon.core.shader import Shader
from strata.addon.devices.gpu import BARRIER, OFFSETS, SPLIT_TO_INTEGER, GpuDevice
from strata.addon.devices.gpu_meshes import COPY_PAIRS, COPY_ROWS
from strata.addon.effects.registry import EFFECTS
from strata.addon.effects.shared import gpu_lit as lit
from strata.addon.effects.shared import gpu_steps as shared


def all_shaders() -> Iterator[Shader]:
    """Every program that Strata may compile, each once."""
    yield from (BARRIER, OFFSETS, SPLIT_TO_INTEGER, COPY_ROWS, COPY_PAIRS)
    yield from shared.variants()
    yield from lit.variants()
    for effect in EFFECTS:
        yield from effect.shaders()


def main() -> int:
    """Prints each failure with its log; returns how many there are."""
    device, failures = GpuDevice(), 0
    programs = list(all_shaders())
    for program in programs:
        try:
            device.compile(program)
        except ShaderError as error:
            failures += 1
            print(f"{error}\n{error.log}", file=sys.stderr)
    done = len(programs) - failures
    print(f"{done} of {len(programs)} compiled on {device.description} in {device.compile_seconds:.1f} s")
    return failures


if __name__ == "__main__":
    if main():
        sys.exit(1)
