"""Run inside a Blender program: draws and shadows what `inputs.npz` holds, and saves what came out.

blender -b --gpu-backend vulkan --python scripts/in_blender.py -- \
  strata.tests.devices.gpu_blender_check INPUTS.npz OUTPUTS.npz KERNELS
"""

from __future__ import annotations

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np


def main(source: str, target: str, kernels: str) -> None:
    """`kernels`: the folder that the kernels' package is in, which this Blender's Python does not know."""
    sys.path.append(kernels)
    from strata.addon.core.arrays import Arrays, MeshArrays, Opacities
    from strata.addon.core.emitter import Emitter, EmitterKind
    from strata.addon.core.placement import Places
    from strata.addon.core.shot import PixelFilter
    from strata.addon.core.surface import Chunk
    from strata.addon.core.view import View
    from strata.addon.devices.gpu import GpuDevice
    from strata.addon.effects.shared import gpu_steps as shared
    from strata.addon.effects.soft_shadow import gpu_steps as soft_shadow

    data = np.load(source)

    def view_of(numbers) -> View:
        three = [tuple(numbers[i : i + 3]) for i in (0, 3, 6, 9)]
        return View(*three, tuple(numbers[12:16]), *numbers[16:18], bool(numbers[18]))

    device = GpuDevice()
    mesh = MeshArrays(data["positions"], data["corners"], data["starts"])
    scene = SimpleNamespace(instances=(SimpleNamespace(mesh=0, object_id=1, materials=(0,)),))
    device.set_scene(scene, Arrays((mesh,), np.eye(4)[None], (Opacities(),)))
    geometry, drawn = device.geometry(), frozenset({0})
    camera, light = view_of(data["camera"]), view_of(data["light_view"])
    attributes = ("position", "geometric_normal", "shading_normal", "depth", "triangle")
    height, width = data["size"]
    chunk = Chunk(int(width), int(height), 0, int(height), 0, (0.0, 0.0))
    surface = shared.surface(device, geometry, camera, drawn, chunk, attributes)
    own = replace(chunk, places=Places(7, PixelFilter()))
    scattered = shared.surface(device, geometry, camera, drawn, own, attributes)
    depths = shared.layered_depth(device, geometry, light, drawn, 4, 96, 96)
    prepared = soft_shadow.prepare(device, depths, light, 1.0, 1e9)
    kind, numbers = EmitterKind(int(data["emitter"][0])), data["emitter"]
    emitter = Emitter(kind, *(tuple(numbers[i : i + 3]) for i in (1, 4, 7, 10)), *numbers[13:18])
    results = {"depths": depths, **surface}
    results |= {f"own {name}": image for name, image in scattered.items()}
    for method in ("bitmask", "area"):
        shadow = soft_shadow.backproject(
            device,
            surface,
            prepared,
            eye=camera.eye,
            emitter=emitter,
            method=method,
            maps=1,
            max_samples=512,
            refinements=2,
            spacing=1,
        )
        results[method] = shadow["visibility"]
    np.savez(target, description=device.description, **device.to_host(results))


if __name__ == "__main__":
    main(*sys.argv[sys.argv.index("--") + 1 :])
