"""A scene as it is being watched: read when it has changed, planned for a viewport, run by one executor."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import bpy
import numpy as np

from ..bake import Options, plan_scene
from ..core.arrays import Arrays
from ..core.culling import around
from ..core.executor import Executor
from ..core.graph import Graph
from ..core.outline import Outline
from ..devices.start import Devices, start_devices
from ..scene.extract import extract
from ..scene.scan import ScanOptions, scan
from ..scene.viewport import Placement, hides_objects, shown_in

KEPT_SURFACE_BYTES = 512 << 20
KEPT_VALUES = 256
_versions = count(1)  # of all sessions, so that no two ever share a value by mistake


class Session:
    """What all viewports of one scene and view layer share that show the same objects.

    `version` changes with everything that is read from Blender. Only on the main thread.
    """

    def __init__(self, backend: str):
        self.backend = backend
        self.devices: Devices = start_devices(backend)
        self.executor = Executor(
            self.devices.primary,
            self.devices.fallback,
            kept_values=KEPT_VALUES,
            kept_surface_bytes=KEPT_SURFACE_BYTES,
        )
        self.outline: Outline | None = None
        self.arrays: Arrays | None = None
        self.version = 0
        self.is_stale = True

    def read(
        self,
        depsgraph: bpy.types.Depsgraph,
        space: bpy.types.SpaceView3D | None,
        placement: Placement,
        seed: int,
    ) -> None:
        """Reads the scene again if it was marked stale; `space` is the viewport whose visibility counts."""
        if not self.is_stale:
            return
        hides = space is not None and hides_objects(space)
        shows = (lambda thing: shown_in(space, thing)) if hides else None
        found = scan(depsgraph, ScanOptions(size=(2, 2), camera=placement.camera, seed=seed, shows=shows))
        self.arrays = extract(found)
        self.version = next(_versions)
        self.outline = replace(found.outline, version=self.version)
        self.is_stale = False

    def feed(self) -> None:
        """Tells the devices which scene geometry is made of: sessions may share devices."""
        for device in {self.devices.primary, self.devices.fallback}:
            device.set_scene(self.outline, self.arrays)

    def moving_plan(self, placement: Placement, scale: float, options: Options) -> tuple[Outline, Graph]:
        """For a frame while something moves: no map depends on where the camera is, so that a moved camera
        runs none again."""
        outline = placement.seen_from(self.outline, scale)
        shown = outline.instances.boxes[outline.instances.shown]
        if len(shown):
            outline = replace(outline, seen=around(shown)[None])
        return outline, plan_scene(outline, options)

    def still_plan(self, placement: Placement, options: Options) -> tuple[Outline, Graph]:
        """The bake's own first plan, for a picture of a pixel to each of the viewport's."""
        outline = placement.seen_from(self.outline, 1.0)
        return outline, plan_scene(outline, options)

    def release(self) -> None:
        self.executor.release()


def lighter(options: Options, share: float) -> Options:
    """Options for a frame of about `share` of the work."""
    values = {effect.id: params.lighter(share).as_dict() for effect, params in options.chosen().items()}
    return replace(options, values=values, samples=1, probes=0)


def mean_of(sums: np.ndarray, samples: int) -> np.ndarray:
    return sums / np.float32(samples)
