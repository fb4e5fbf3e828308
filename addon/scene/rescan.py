"""What has changed in a scene that was scanned before: often one light or one object, among thousands."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from ..core.outline import Bounds, Instances, Outline
from .lights import light_of
from .own_settings import own_settings_of
from .scan import Scan
from .transforms import are_usable, matrix_of

# Data that nothing is read from but through objects, whose own updates come with it.
_UNREAD = ("Camera", "Action", "WindowManager", "Screen", "WorkSpace", "Text", "Brush", "Sound", "Speaker")


@dataclass
class Changes:
    """Session ids of objects: `lights` of which only the lamp or its place changed, `moved` meshes,
    `reshaped` objects whose mesh did. `all`: anything else, so that the scene has to be scanned again."""

    lights: set[int] = field(default_factory=set)
    moved: set[int] = field(default_factory=set)
    reshaped: set[int] = field(default_factory=set)
    all: bool = False

    def __bool__(self) -> bool:
        return self.all or bool(self.lights or self.moved or self.reshaped)

    def take(self, other: Changes) -> None:
        """What `other` tells of too."""
        self.lights |= other.lights
        self.moved |= other.moved
        self.reshaped |= other.reshaped
        self.all = self.all or other.all

    @property
    def is_simple(self) -> bool:
        """Whether `patched` may do."""
        return not self.all and not self.reshaped

    def add(self, depsgraph: bpy.types.Depsgraph) -> None:
        """What Blender says in a depsgraph update handler."""
        lamps = set()
        for update in depsgraph.updates:
            found = update.id.original
            if isinstance(found, bpy.types.Light):
                lamps.add(found)
            elif isinstance(found, bpy.types.Object):
                self._add_object(found, update)
            elif isinstance(found, bpy.types.Mesh) or (
                isinstance(found, bpy.types.NodeTree) and found.is_embedded_data
            ):
                continue  # the objects that show it, the material or lamp that it is part of, say so too
            elif isinstance(found, bpy.types.Scene):
                # Told of with every change of anything in it; what of it matters is compared when drawing.
                continue
            elif type(found).__name__ not in _UNREAD:
                self.all = True
        if lamps:
            self.lights.update(thing.session_uid for thing in depsgraph.scene.objects if thing.data in lamps)

    def _add_object(self, thing: bpy.types.Object, update: bpy.types.DepsgraphUpdate) -> None:
        if thing.type == "CAMERA":
            return
        # Blender flags nothing where a name is changed, or what shadows do at the terminator.
        is_other = not (update.is_updated_transform or update.is_updated_geometry)
        if thing.type == "LIGHT" and not is_other:
            self.lights.add(thing.session_uid)
        elif thing.type == "MESH" and not update.is_updated_shading and not is_other:
            if update.is_updated_geometry:
                self.reshaped.add(thing.session_uid)
            if update.is_updated_transform:
                self.moved.add(thing.session_uid)
        else:
            self.all = True


def patched(scan: Scan, changes: Changes, depsgraph: bpy.types.Depsgraph) -> Outline | None:
    """The outline with lights and places read again, or None where that is not all there is to do."""
    if not changes.is_simple:
        return None
    scene = depsgraph.scene
    objects = {
        thing.session_uid: thing
        for thing in scene.objects
        if thing.session_uid in changes.lights or thing.session_uid in changes.moved
    }
    if len(objects) < len(changes.lights | changes.moved):
        return None
    outline = _with_lights(scan, scan.outline, changes.lights, objects, depsgraph)
    if outline is None or not changes.moved:
        return outline
    return _with_places(scan, outline, changes.moved, objects, depsgraph)


def _with_lights(scan: Scan, outline: Outline, changed: Iterable[int], objects, depsgraph) -> Outline | None:
    lights = list(outline.lights)
    for uid in changed:
        if scan.light_owners.count(uid) != 1:
            return None  # left out so far, or instanced
        index = scan.light_owners.index(uid)
        thing = objects[uid].evaluated_get(depsgraph)
        before = lights[index]
        light, warnings = light_of(thing.data, thing.matrix_world, before.name, before.key)
        if light is None or any(warning not in outline.warnings for warning in warnings):
            return None
        own_settings = own_settings_of(thing.data, "Light")
        lights[index] = replace(
            light,
            receivers=before.receivers,
            casters=before.casters,
            lights_media=before.lights_media,
            own_settings=own_settings,
            pass_name=before.pass_name,
            lamp=before.lamp,
        )
    return replace(outline, lights=tuple(lights))


def _with_places(scan: Scan, outline: Outline, moved: Iterable[int], objects, depsgraph) -> Outline | None:
    instances = list(outline.instances)
    for uid in moved:
        if scan.instance_owners.count(uid) != 1:
            return None
        thing = objects[uid]
        if thing.is_instancer or thing.children:
            return None  # what it carries along is not told of one by one
        index = scan.instance_owners.index(uid)
        if instances[index].mesh in scan.own_boxes:
            return None
        if scan.exactly is not None and scan.exactly.are_of_object(instances[index].materials):
            return None  # what is baked of them may hang on the place
        evaluated = thing.evaluated_get(depsgraph)
        matrix = matrix_of(evaluated.matrix_world)
        if not are_usable(matrix[None])[0]:
            return None
        box = np.array([corner[:] for corner in evaluated.bound_box], np.float64)
        if not np.isfinite(box).all():
            return None
        low, high = box.min(axis=0), box.max(axis=0)
        centre = matrix[:3, :3] @ (0.5 * (low + high)) + matrix[:3, 3]
        extent = np.abs(matrix[:3, :3]) @ (0.5 * (high - low))
        bounds = Bounds(tuple((centre - extent).tolist()), tuple((centre + extent).tolist()))
        rows = tuple(map(tuple, matrix.tolist()))
        instances[index] = replace(instances[index], matrix=rows, bounds=bounds)
    return replace(outline, instances=Instances(instances))
