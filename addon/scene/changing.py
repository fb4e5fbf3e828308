"""What may change with time. Whatever is not known not to counts as changing."""

from __future__ import annotations

from collections.abc import Iterable

import bpy


def is_animated(data: bpy.types.ID | None) -> bool:
    """Whether keyframes, drivers or NLA tracks may move a property of it or of its own node tree."""
    if data is None:
        return False
    animation = data.animation_data
    if animation is not None and (animation.action or animation.nla_tracks or animation.drivers):
        return True
    tree = getattr(data, "node_tree", None)
    return tree is not None and is_animated(tree)


def is_surely_hidden(path: Iterable[bpy.types.Object]) -> bool:
    """Whether an object, or one that shows it, is switched off for renders in every frame."""
    return any(thing.hide_render and not is_animated(thing) for thing in path)
