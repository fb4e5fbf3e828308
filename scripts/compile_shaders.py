"""Compiles every shader variant on the GPU backend at hand and fails where one does not compile.

python scripts/compile_shaders.py                              with bpy installed: OpenGL
blender -b --gpu-backend vulkan --python-exit-code 1 --python scripts/compile_shaders.py
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import bpy  # noqa: F401 (the gpu module comes with it)

ROOT = Path(__file__).resolve().parent.parent


def as_package() -> None:
    """Makes the repository importable as `strata` in a Blender that has not installed it."""
    if importlib.util.find_spec("strata") is None:
        places = [str(ROOT)]
        spec = importlib.util.spec_from_file_location(
            "strata", ROOT / "__init__.py", submodule_search_locations=places
        )
        sys.modules["strata"] = importlib.util.module_from_spec(spec)


def main() -> int:
    """Prints each failure with its log; returns how many there are."""
    as_package()
    from strata.addon.core.errors import ShaderError
    from strata.addon.devices.gpu import GpuDevice
    from strata.addon.devices.gpu_programs import all_shaders

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
