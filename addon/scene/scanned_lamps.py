"""The lamps that a scan finds."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import bpy

from ..core.outline import Light
from .lamp_names import LampNames
from .light_linking import linked_objects
from .lights import light_of
from .own_settings import own_settings_of


@dataclass(eq=False)
class ScannedLamps:
    """`owners` are session ids of the objects that stand for themselves, 0 for what an instancer makes."""

    lights: list[Light] = field(default_factory=list)
    owners: list[int] = field(default_factory=list)
    _objects: list[tuple[bpy.types.Object, bpy.types.Object]] = field(default_factory=list)

    @cached_property
    def _names(self) -> LampNames:
        """Made where there is a lamp."""
        return LampNames()

    def add(self, instance: bpy.types.DepsgraphObjectInstance, shown: bpy.types.Object) -> list[str]:
        """Takes what can be read, and returns warnings."""
        parent = instance.parent if instance.is_instance else shown
        named = self._names.of(instance)
        light, warnings = light_of(shown.data, instance.matrix_world, named.name, named.key)
        if light is not None:
            own_settings = own_settings_of(shown.data, "Light")
            called = {"pass_name": named.pass_name, "lamp": named.lamp.name_full}
            self.lights.append(replace(light, own_settings=own_settings, **called))
            self._objects.append((shown.original, parent.original))
            self.owners.append(0 if instance.is_instance else shown.original.session_uid)
        return warnings

    def linked(self, objects: Sequence[bpy.types.Object]) -> tuple[Light, ...]:
        """All, with what they light and what shadows them; `objects` are those of the instances."""
        pairs = zip(self.lights, self._objects, strict=True)
        return tuple(_linked(light, *lamp, objects) for light, lamp in pairs)


def _linked(
    light: Light, shown: bpy.types.Object, parent: bpy.types.Object, objects: Sequence[bpy.types.Object]
) -> Light:
    """An instancer's linking wins over its own."""
    receivers = linked_objects(
        parent.light_linking.receiver_collection or shown.light_linking.receiver_collection
    )
    blockers = linked_objects(
        parent.light_linking.blocker_collection or shown.light_linking.blocker_collection
    )
    # A light that diffuse surfaces do not see lights nothing that is baked.
    lit = frozenset() if not shown.visible_diffuse else _indices(receivers, objects)
    return replace(
        light,
        receivers=lit,
        casters=_indices(blockers, objects),
        lights_media=shown.visible_volume_scatter,
    )


def _indices(
    linked: Collection[bpy.types.Object] | None, objects: Sequence[bpy.types.Object]
) -> frozenset[int] | None:
    if linked is None:
        return None
    return frozenset(i for i, source in enumerate(objects) if source in linked)
