"""What F12 shows of a view layer, told without evaluating it for rendering."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..core.naming import named_some

_SEEN = ("MESH", "LIGHT", "CURVE", "SURFACE", "META", "FONT", "VOLUME", "CURVES", "POINTCLOUD")


def rendered_objects(view_layer: bpy.types.ViewLayer) -> frozenset[int]:
    """Session ids of the objects that are rendered, as far as their own switches and their collections'
    tell."""
    return frozenset(
        thing.session_uid
        for collection in _rendered(view_layer.layer_collection)
        for thing in collection.objects
        if not thing.hide_render
    )


def _rendered(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.Collection]:
    if layer.collection.hide_render:
        return
    if not layer.exclude:
        yield layer.collection
    for child in layer.children:
        yield from _rendered(child)


def told_hidden(view_layer: bpy.types.ViewLayer, rendered: frozenset[int]) -> str:
    """What a viewport does not show and a bake does, in one line; empty where nothing is so."""
    hidden = [
        thing.name
        for thing in view_layer.objects
        if thing.type in _SEEN
        and thing.session_uid in rendered
        and not thing.visible_get(view_layer=view_layer)
    ]
    return f"hidden in the viewport, and baked: {named_some(hidden)}" if hidden else ""
