"""A scene as it is being watched: read when it has changed, planned for a viewport, run by one executor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from typing import Any

import bpy
import numpy as np

from ..core.arrays import Arrays, reusing
from ..core.culling import around
from ..core.effect import Effect
from ..core.executor import Executor
from ..core.free_memory import free_bytes
from ..core.graph import Graph
from ..core.material import Image
from ..core.outline import Light, Mesh, Outline
from ..core.read import MOST_TEXELS, Read
from ..core.shot import Shot
from ..devices.start import Devices, start_devices
from ..effects.shared.coarse_picture import seen_boxes
from ..planning import Options, plan_scene
from ..scene.exact.reading import Exact
from ..scene.exact.store import STORE
from ..scene.extract import extract, with_known_clips
from ..scene.known_texels import KnownTexels
from ..scene.rescan import Changes, patched
from ..scene.scan import Scan, ScanOptions, scan
from ..scene.viewport import Placement, hides_objects, shown_in

MOST_SURFACE_BYTES = 1 << 30
MOST_SCENE_BYTES = 2 << 30  # maps, trees and geometry
MOST_SCENE_VALUES = 128
_versions = count(1)  # of all sessions, so that no two ever share a value by mistake


class Session:
    """What all viewports of one scene and view layer share that show the same objects.

    `version` changes with everything that is read from Blender, `outline.version` with what is more than
    lights. Only on the main thread.
    """

    def __init__(self, backend: str):
        self.devices: Devices = start_devices(backend)
        self.executor = Executor(
            self.devices.primary,
            self.devices.fallback,
            most_scene_values=MOST_SCENE_VALUES,
            most_surface_bytes=MOST_SURFACE_BYTES,
            most_scene_bytes=min(MOST_SCENE_BYTES, free_bytes() // 2),
        )
        self.outline: Outline | None = None
        self.version = 0
        self.changes = Changes(all=True)
        self._scan: Scan | None = None
        self._arrays: Arrays | None = None
        self._texels = KnownTexels()
        self._content: tuple | None = None
        self.wanted: dict[int, tuple[Graph, ...]] = {}  # what each viewport may run again, by its id
        self._coarse_pictures: dict[tuple, np.ndarray] = {}

    def read(
        self,
        depsgraph: bpy.types.Depsgraph,
        space: bpy.types.SpaceView3D,
        placement: Placement,
        seed: int,
        read: str = Read.FAST.value,
    ) -> None:
        """Reads what has changed; `space` is the viewport whose visibility counts. `read`: how materials are;
        only what is baked already is read exactly."""
        hides = hides_objects(space)
        reads_exactly = read == Read.EXACT.value
        # Blender's updates do not tell of what is hidden or shown, nor of frames.
        content = (
            depsgraph.scene.frame_current_final,
            len(depsgraph.objects),
            _shown(space, depsgraph) if hides else None,
            STORE.version if reads_exactly else None,  # what is baked meanwhile shows
        )
        is_other = content != self._content
        if not (self.changes or is_other):
            return
        changes, self.changes, self._content = self.changes, Changes(), content
        if is_other or not self._patch(changes, depsgraph):
            shows = (lambda thing: shown_in(space, thing)) if hides else None
            exact = Exact(MOST_TEXELS, can_bake=False) if reads_exactly else None
            asked = ScanOptions(size=(2, 2), camera=placement.camera, seed=seed, shows=shows, exact=exact)
            self._take(scan(depsgraph, asked))
        self.version = next(_versions)

    def _patch(self, changes: Changes, depsgraph: bpy.types.Depsgraph) -> bool:
        """Reads only lights and places again, if that is all."""
        outline = patched(self._scan, changes, depsgraph)
        if outline is None:
            return False
        if changes.moved:
            outline = replace(outline, version=next(_versions))
            self._feed(outline, replace(self._arrays, matrices=outline.instances.matrices))
        self._keep(replace(self._scan, outline=outline))
        return True

    def _take(self, found: Scan) -> None:
        """A whole new scan; meshes and textures that are still the same stay with the devices."""
        arrays = extract(found, known=self._texels)
        if self._arrays is not None:
            meshes = _pairs(found.outline.meshes, self.outline.meshes)
            textures = _pairs(found.outline.images, self.outline.images)
            arrays = reusing(arrays, self._arrays, meshes, textures)
        outline = with_known_clips(replace(found.outline, version=next(_versions)), arrays)
        if self._arrays is not None and _same(outline, arrays, self.outline, self._arrays):
            # Told of, and yet all as before; then what is known of the instances still holds.
            outline = replace(outline, version=self.outline.version, instances=self.outline.instances)
        self._feed(outline, arrays)
        # Blender's own data is not to be kept, and not needed: what it is made of is in `arrays`.
        self._keep(replace(found.without_sources(), outline=outline))

    def _feed(self, outline: Outline, arrays: Arrays) -> None:
        self._arrays = arrays
        for device in {self.devices.primary, self.devices.fallback}:
            device.set_scene(outline, arrays)

    def _keep(self, found: Scan) -> None:
        self.outline = replace(found.outline, distance_m=self.devices.fallback.distance_m)
        self._scan = replace(found, outline=self.outline)
        self.executor.outline = self.outline

    def _shot(self, placement: Placement, scale: float) -> Shot:
        return replace(self._scan.shot, name=placement.camera.name, source=placement.raster(scale))

    def moving_plan(self, placement: Placement, scale: float, options: Options, share: float) -> Graph:
        """For a frame while something moves, with about `share` of the work in its maps. None of those
        depends on where the camera is, so that a moved camera runs none again."""
        chosen = options.chosen()
        values = {effect.id: params.lighter(share).as_dict() for effect, params in chosen.items()}
        options = replace(options, values=values, samples=1, probes=0)
        lights = tuple(
            _lighter(light, chosen, share) if light.own_settings else light for light in self.outline.lights
        )
        outline, shot = replace(self.outline, lights=lights), self._shot(placement, scale)
        instances = outline.instances
        if instances.shown.any():
            seen = instances.memo(("around shown",), lambda: around(instances.boxes[instances.shown])[None])
            shot = replace(shot, seen=seen)
        return plan_scene(outline, shot, options)

    def still_plan(self, placement: Placement, options: Options) -> Graph:
        """The bake's own, with its coarse picture, for a pixel of the picture to each of the viewport's."""
        outline, shot = self.outline, self._shot(placement, 1.0)
        graph = plan_scene(outline, shot, options)
        if graph.surface is None:
            return graph
        params = graph.surface.params
        who = params["visible"], params.get("holdouts", frozenset())
        key = (outline.version, shot.view, shot.computed_size, *who)
        if key not in self._coarse_pictures:
            geometry = self.executor.value(graph.surface.inputs[0], self.devices.fallback)
            self._coarse_pictures.clear()
            self._coarse_pictures[key] = seen_boxes(self.devices.fallback, geometry, outline, shot, *who)
        boxes = self._coarse_pictures[key]
        if len(boxes):
            graph = plan_scene(outline, replace(shot, seen=boxes), options)
        return graph

    def want(self, viewport: int, *graphs: Graph) -> None:
        """Keeps what these graphs made, and what other viewports want, and frees the rest: where a light has
        been, nobody asks again."""
        self.wanted[viewport] = graphs
        self.executor.keep_only(*(graph for wanted in self.wanted.values() for graph in wanted))

    def release(self) -> None:
        self.executor.release()


def _pairs(new: Sequence[Mesh | Image], old: Sequence[Mesh | Image]) -> list[tuple[int, int]]:
    """Indices of those with the same key, in the one and in the other."""
    before = {each.key: index for index, each in enumerate(old)}
    return [(index, before[each.key]) for index, each in enumerate(new) if each.key in before]


def _same(new: Outline, arrays: Arrays, old: Outline, before: Arrays) -> bool:
    """Whether geometry would be made of the same things; `arrays` reuses those of `before`."""
    return (
        len(arrays.meshes) == len(before.meshes)
        and all(a is b for a, b in zip(arrays.meshes, before.meshes, strict=True))
        and arrays.textures.keys() == before.textures.keys()
        and all(arrays.textures[index] is before.textures[index] for index in arrays.textures)
        and new.materials == old.materials
        and new.instances == old.instances
    )


def _shown(space: bpy.types.SpaceView3D, depsgraph: bpy.types.Depsgraph) -> frozenset[int]:
    things = depsgraph.view_layer.objects
    return frozenset(thing.session_uid for thing in things if shown_in(space, thing))


def _lighter(light: Light, chosen: dict[Effect, Any], share: float) -> Light:
    """With its own values as the scene's are while something moves."""
    own_settings = [
        (effect.id, name, value)
        for effect, params in chosen.items()
        for name, value in light.params_for(effect.id, params).lighter(share).as_dict().items()
    ]
    return replace(light, own_settings=tuple(own_settings))
