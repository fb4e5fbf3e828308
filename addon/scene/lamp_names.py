"""What lamps are called in passes: decided for all lamps of the file at once, from what they and their
instancers are called. No frame, order, power or visibility counts, so that a lamp has the same pass in every
frame, on every machine, in a bake, in the render engine and in compositor nodes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import bpy

from ..core.errors import StrataError
from ..core.naming import hashed, is_short, pass_safe
from .render_depsgraph import with_render_depsgraph

DEEPEST = 8  # levels of collection instances in one another; Blender itself stops there
_NO_NUMBER = 2**31 - 1


@dataclass(frozen=True, eq=False)
class NamedLamp:
    """`path`: the lamp's object, and the instancers that show it, the innermost first. `name` is for people,
    `key` tells it from every other lamp, `pass_name` is its part of a pass's name."""

    path: tuple[bpy.types.Object, ...]
    name: str
    key: str
    pass_name: str

    @property
    def lamp(self) -> bpy.types.Object:
        return self.path[0]

    @property
    def outermost(self) -> bpy.types.Object:
        """The object that stands in the scene."""
        return self.path[-1]


class LampNames:
    """Of the open file as it is now."""

    def __init__(self):
        self._inside: dict[int, tuple[bpy.types.Object, ...]] = {}
        paths = [(thing,) for thing in bpy.data.objects if thing.type == "LIGHT"]
        for thing in bpy.data.objects:
            if _is_collection_instance(thing):
                paths += ((*path, thing) for path in self._lamps_in(thing.instance_collection))
        groups: dict[str, list[tuple[bpy.types.Object, ...]]] = {}
        for path in paths:
            groups.setdefault(pass_safe(_name_of(path)), []).append(path)
        self._by_path: dict[tuple[int, ...], NamedLamp] = {}
        for safe, members in groups.items():
            for path in members:
                name, key = _name_of(path), _key_of(path)
                keeps = is_short(safe) and (len(members) == 1 or _is_really(path, safe))
                pass_name = safe if keeps else hashed(safe, key)
                self._by_path[_ids_of(path)] = NamedLamp(path, name, key, pass_name)

    def _lamps_in(self, collection, depth: int = DEEPEST) -> Iterator[tuple[bpy.types.Object, ...]]:
        """Paths of the lamps in a collection, also through instances of other collections."""
        for thing in self._objects_in(collection):
            if thing.type == "LIGHT":
                yield (thing,)
            elif depth > 1 and _is_collection_instance(thing):
                for path in self._lamps_in(thing.instance_collection, depth - 1):
                    yield (*path, thing)

    def _objects_in(self, collection) -> tuple[bpy.types.Object, ...]:
        """Those that may show a lamp, in the collection's own order."""
        uid = collection.session_uid
        if uid not in self._inside:
            self._inside[uid] = tuple(
                t for t in collection.all_objects if t.type == "LIGHT" or _is_collection_instance(t)
            )
        return self._inside[uid]

    def of(self, instance: bpy.types.DepsgraphObjectInstance) -> NamedLamp:
        """The name of a lamp that a depsgraph shows."""
        lamp = instance.object.original
        if not instance.is_instance:
            return self._by_path[(lamp.session_uid,)]
        outer = instance.parent.original
        numbers = [number for number in instance.persistent_id if number != _NO_NUMBER]
        path = _collection_path(outer, numbers)
        if path and path[0] == lamp and (found := self._by_path.get(_ids_of(path))):
            return found
        # Geometry nodes, particles or faces: they may show the lamp many times.
        name = f"{lamp.name} {outer.name}"
        key = f"{_key_of((lamp, outer))}#{'.'.join(map(str, numbers))}"
        return NamedLamp((lamp, outer), name, key, hashed(pass_safe(name), key))

    def standing(self, view_layer: bpy.types.ViewLayer) -> Iterator[NamedLamp]:
        """Those of a view layer that are there without an evaluation: all but what geometry nodes, particles
        or faces make."""
        objects = {thing.session_uid for thing in view_layer.objects}
        for named in self._by_path.values():
            if named.outermost.session_uid in objects:
                yield named

    def called(self, name: str, scene: bpy.types.Scene) -> bpy.types.Object | None:
        """The object behind what a lamp of the scene is called, its own name before what its layers are
        called; None where no lamp is called so, but for what geometry nodes, particles or faces make."""
        lamps = [named for view_layer in scene.view_layers for named in self.standing(view_layer)]
        for names_of in (
            lambda named: (named.lamp.name, named.lamp.name_full),
            lambda named: (named.name, named.key, named.pass_name),
        ):
            if found := next((named.lamp for named in lamps if name in names_of(named)), None):
                return found
        return next((t for t in scene.objects if t.type == "LIGHT" and name in (t.name, t.name_full)), None)

    def chosen(
        self, names: Iterable[str], scene: bpy.types.Scene, view_layers: Iterable[bpy.types.ViewLayer]
    ) -> tuple[str, ...]:
        """Pass names of the lamps of view layers that are called so: by their own name, with those of their
        instancers or as the pass is. Raises StrataError for a name that no lamp has."""
        lamps = [named for view_layer in view_layers for named in self.standing(view_layer)]
        called = _by_name(lamps)
        for view_layer in view_layers:
            if any(name not in called for name in names):
                lamps += with_render_depsgraph(scene, view_layer, lambda d: list(self.shown(d)))
                called = _by_name(lamps)
        for name in names:
            if name not in called:
                known = ", ".join(sorted({f"'{named.name}'" for named in lamps})) or "none"
                raise StrataError(f"--lights: there is no lamp '{name}' (there is {known})")
        return tuple(dict.fromkeys(found for name in names for found in called[name]))

    def shown(self, depsgraph: bpy.types.Depsgraph) -> Iterator[NamedLamp]:
        """Those that a depsgraph shows."""
        for instance in depsgraph.object_instances:
            if instance.object.type == "LIGHT":
                yield self.of(instance)


def _by_name(lamps: Iterable[NamedLamp]) -> dict[str, list[str]]:
    """Pass names by all that a lamp can be called."""
    called: dict[str, list[str]] = {}
    for named in lamps:
        for name in {named.lamp.name, named.name, named.pass_name}:
            called.setdefault(name, []).append(named.pass_name)
    return called


def _is_collection_instance(thing: bpy.types.Object) -> bool:
    return thing.instance_type == "COLLECTION" and thing.instance_collection is not None


def _collection_path(outer: bpy.types.Object, numbers: list[int]) -> tuple[bpy.types.Object, ...] | None:
    """Who shows whom: an instance's numbers are places in collections, the innermost first. None where
    something else than a collection instance is among them."""
    path = [outer]
    for number in reversed(numbers):
        if not _is_collection_instance(path[0]):
            return None
        things = path[0].instance_collection.all_objects
        if not 0 <= number < len(things):
            return None
        path.insert(0, things[number])
    return tuple(path)


def _ids_of(path: tuple[bpy.types.Object, ...]) -> tuple[int, ...]:
    return tuple(thing.session_uid for thing in path)


def _name_of(path: tuple[bpy.types.Object, ...]) -> str:
    return " ".join(thing.name for thing in path)


def _key_of(path: tuple[bpy.types.Object, ...]) -> str:
    """With libraries: the same on every machine that has the file."""
    return "/".join(thing.name_full for thing in reversed(path))


def _is_really(path: tuple[bpy.types.Object, ...], safe: str) -> bool:
    """The one object of the file itself that is called just so; others are taken for it only once their names
    are made safe, or come from libraries, or are put together from several names."""
    return len(path) == 1 and path[0].library is None and path[0].name == safe
