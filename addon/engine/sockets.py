"""Keeps the Render Layers node's sockets as many as there are passes, while the engine is Strata.

Blender asks an engine for its passes when the engine is chosen or a node made, and not when a light is added.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import depsgraph_update_post, persistent

from ..core.errors import told_once
from ..core.naming import ENGINE_ID
from . import passes

# By scene (session id) and view layer: the passes that Blender was last told, and the lamps and instancers
# looked at then.
_told: dict[tuple[int, str], tuple[passes.PassKind, ...]] = {}
_named: dict[tuple[int, str], frozenset[str]] = {}


@persistent
@told_once
def _follow(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """After every edit, so nearly always it has to end at once: what is added, deleted, hidden or switched
    marks the scene as changed, and a rename its own object only."""
    if scene.render.engine != ENGINE_ID:
        return
    if not depsgraph.id_type_updated("SCENE") and not any(map(_is_renamed, depsgraph.updates)):
        return
    for view_layer in scene.view_layers:
        key = (scene.session_uid, view_layer.name)
        _named[key] = frozenset(shown.name for shown in bpy.data.objects if _gives_names(shown))
        kinds = tuple(passes.registered(scene, view_layer))
        if _told.get(key) != kinds:
            _told[key] = kinds
            view_layer.update_render_passes()


def _gives_names(shown: bpy.types.Object) -> bool:
    return shown.type == "LIGHT" or shown.instance_type == "COLLECTION"


def _is_renamed(update: bpy.types.DepsgraphUpdate) -> bool:
    counts = isinstance(update.id, bpy.types.Object) and _gives_names(update.id)
    return counts and not any(update.id.name in names for names in _named.values())


def register() -> None:
    if _follow not in depsgraph_update_post:
        depsgraph_update_post.append(_follow)


def unregister() -> None:
    if _follow in depsgraph_update_post:
        depsgraph_update_post.remove(_follow)
    _told.clear()
    _named.clear()
