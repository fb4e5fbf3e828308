"""Which objects a light lights, and which ones shadow it."""

from __future__ import annotations

import bpy


class LinkedObjects:
    """What a receiver or blocker collection means, as Blender's depsgraph resolves it (`light_linking.cc`).

    Where anything is included, only what is included counts; where things are only excluded, all else counts.
    Of an object that is both, the later entry wins: child collections come before the objects.
    """

    def __init__(self, collection: bpy.types.Collection):
        states: dict[bpy.types.Object, str] = {}
        for child, link in zip(collection.children, collection.collection_children, strict=True):
            for linked in child.all_objects:
                states[linked.original] = link.light_linking.link_state
        for linked, link in zip(collection.objects, collection.collection_objects, strict=True):
            states[linked.original] = link.light_linking.link_state
        self._states = states
        self._default = "INCLUDE" not in states.values()

    def __contains__(self, linked: bpy.types.Object) -> bool:
        state = self._states.get(linked)
        return self._default if state is None else state == "INCLUDE"


def linked_objects(collection: bpy.types.Collection | None) -> LinkedObjects | None:
    """None: every object."""
    return None if collection is None else LinkedObjects(collection.original)
