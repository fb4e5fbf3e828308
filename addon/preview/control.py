"""The preview's life: which scenes are watched, what Blender tells about them, when to work on."""

from __future__ import annotations

import traceback
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..core.errors import StrataError
from ..scene.viewport import hides_objects, placement_of
from ..ui.properties import options_of
from . import caption, display, view_transform
from .session import Session
from .viewport import Statistics, Viewport

IDLE_SECONDS = 0.05


class _State:
    """Everything that lives while the preview is on; nothing of it is saved."""

    def __init__(self):
        self.scenes: set[int] = set()  # session ids of scenes that are watched
        self.rendered: set[int] = set()  # those that the engine draws, in viewports that are shaded so
        self.sessions: dict[tuple, Session] = {}
        self.viewports: dict[int, Viewport] = {}  # by region
        self.shown: dict[int, Session] = {}  # by region
        self.textures: dict[int, tuple[Any, Any]] = {}  # by region: picture and its texture
        self.tables: dict[tuple, Any] = {}  # view transforms by signature
        self.handles: list[Any] = []
        self.failure = ""


_state = _State()


def available() -> str:
    """Why the preview cannot work here, in words; empty where it can."""
    if bpy.app.background:
        return "Blender runs without a window"
    if _state.failure:
        return _state.failure
    try:
        import gpu

        gpu.platform.renderer_get()
    except SystemError as error:
        return f"no GPU drawing: {error}"
    return ""


def is_on(scene: bpy.types.Scene | None = None) -> bool:
    """Whether the scene (None: any) is watched."""
    return bool(_state.scenes) if scene is None else scene.session_uid in _state.scenes


def enable(scene: bpy.types.Scene) -> None:
    """Shows the scene's layers in all 3D viewports. Raises StrataError where that cannot work."""
    if reason := available():
        raise StrataError(f"no preview: {reason}")
    _state.scenes.add(scene.session_uid)
    if not _state.handles:
        add = bpy.types.SpaceView3D.draw_handler_add
        _state.handles = [
            add(_draw_view, (), "WINDOW", "POST_VIEW"),
            add(_draw_text, (), "WINDOW", "POST_PIXEL"),
        ]
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=0.0, persistent=True)
    _redraw()


def disable(scene: bpy.types.Scene | None = None) -> None:
    """Stops watching the scene (None: all), and frees everything with the last one."""
    if scene is None:
        _state.scenes.clear()
    else:
        _state.scenes.discard(scene.session_uid)
    if not _state.scenes:
        for handle in _state.handles:
            bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")
        _state.handles.clear()
    if not _watched():
        if bpy.app.timers.is_registered(_tick):
            bpy.app.timers.unregister(_tick)
        _forget()
    _redraw()


def follow(scene: bpy.types.Scene) -> None:
    """Refines what the engine draws of the scene, until `unfollow`. Costs nothing when asked again."""
    _state.rendered.add(scene.session_uid)
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=0.0, persistent=True)


def unfollow(scene: int) -> None:
    """By session id, since the scene may be gone; the next tick frees what nobody looks at any more."""
    _state.rendered.discard(scene)


def _watched() -> set[int]:
    return _state.scenes | _state.rendered


def state_of(region: bpy.types.Region) -> Statistics | None:
    """What the preview shows in a region, None where nothing."""
    viewport = _state.viewports.get(region.as_pointer())
    return viewport.statistics if viewport else None


def draw(context: bpy.types.Context, region: bpy.types.Region | None = None, encodes: bool = False) -> None:
    """Draws the picture of the viewport at hand into the bound framebuffer, making it first where something
    has changed; `encodes` as in `display.draw_picture`."""
    region = region or context.region
    space, region_3d = context.space_data, context.region_data
    if region is None or space is None or region_3d is None:
        return
    scene, layer = context.scene, context.view_layer
    settings = scene.strata.preview
    depsgraph = context.evaluated_depsgraph_get()
    placement = placement_of(scene, space, region_3d, (region.width, region.height), depsgraph)
    options = options_of(scene, composite=True, probes=0)
    session = _session_of(scene, layer, space, options.backend)
    viewport = _state.viewports.setdefault(region.as_pointer(), Viewport())
    _state.shown[region.as_pointer()] = session
    session.read(depsgraph, space, placement, options.seed)
    viewport.show(session, placement, options, settings.layer, settings.frame_budget_ms)
    picture = viewport.picture
    if picture is None:
        return
    kept = _state.textures.get(region.as_pointer())
    if kept is None or kept[0] is not picture:
        texture = getattr(picture.pixels, "texture", None) or display.picture_texture(picture.pixels)
        kept = _state.textures[region.as_pointer()] = (picture, texture)
    table = _state.tables.get(view_transform.signature(scene)) if picture.is_colour else None
    display.draw_picture(
        kept[1],
        4 if picture.is_colour else 1,
        picture.place,
        (region.width, region.height),
        table,
        view_transform.exposure_factor(scene),
        encodes,
    )


def register() -> None:
    for handlers, function in _handlers():
        if function not in handlers:
            handlers.append(function)


def unregister() -> None:
    _state.rendered.clear()
    disable()
    for handlers, function in _handlers():
        if function in handlers:
            handlers.remove(function)


def _handlers():
    """Blender's lists, and what belongs into each."""
    handlers = bpy.app.handlers
    return (handlers.depsgraph_update_post, _depsgraph_updated), (handlers.load_pre, _file_closing)


def _session_of(scene, layer, space, backend: str) -> Session:
    own = space.as_pointer() if hides_objects(space) else 0
    key = (scene.session_uid, layer.name, own, backend)
    if key not in _state.sessions:
        _state.sessions[key] = Session(backend)
    return _state.sessions[key]


def _forget() -> None:
    for session in _state.sessions.values():
        session.release()
    for viewport in _state.viewports.values():
        viewport.release()
    _state.sessions.clear()
    _state.viewports.clear()
    _state.shown.clear()
    _state.textures.clear()
    _state.tables.clear()
    display.release()


def _draw_view() -> None:
    context = bpy.context
    if context.scene is None or not is_on(context.scene) or _engine_draws(context):
        return
    try:
        draw(context, encodes=True)
    except Exception as error:
        _failed(error)


def _engine_draws(context: bpy.types.Context) -> bool:
    return context.space_data.shading.type == "RENDERED" and context.scene.render.engine == "STRATA"


def _draw_text() -> None:
    context = bpy.context
    if context.scene is None or not is_on(context.scene) or not context.scene.strata.preview.show_statistics:
        return
    statistics = state_of(context.region)
    if statistics is not None:
        toolbar = next((r.width for r in context.area.regions if r.type == "TOOLS"), 0)
        caption.draw(statistics, context.region.height, context.preferences.system.ui_scale, toolbar)


def _failed(error: Exception) -> None:
    traceback.print_exc()
    _state.failure = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    _state.scenes.clear()
    _state.rendered.clear()


@persistent
def _depsgraph_updated(scene, depsgraph) -> None:
    if scene.session_uid not in _watched():
        return
    for (uid, *_), session in _state.sessions.items():
        if uid == scene.session_uid:
            session.changes.add(depsgraph)


@persistent
def _file_closing(*_) -> None:
    _state.rendered.clear()
    disable()


def _redraw() -> None:
    for _window, area, region in _regions():
        del area
        region.tag_redraw()


def _regions():
    """Every 3D viewport: window, area, region."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "WINDOW":
                        yield window, area, region


def _tick() -> float | None:
    """Refines what is still, a slice of the budget at a time, and makes view transforms."""
    if not _watched():
        _forget()
        return None
    alive = {}
    wait = 1.0
    for window, _area, region in _regions():
        alive[region.as_pointer()] = region
        scene = window.scene
        if scene.session_uid not in _watched():
            continue
        signature = view_transform.signature(scene)
        if signature not in _state.tables:
            table = display.table_texture(view_transform.read(scene))
            if len(_state.tables) >= 4:
                _state.tables.pop(next(iter(_state.tables)))
            _state.tables[signature] = table
            region.tag_redraw()
        viewport = _state.viewports.get(region.as_pointer())
        if viewport is None or not viewport.has_work:
            continue
        still = viewport.wait()
        if still > 0.0:
            wait = min(wait, still)
            continue
        budget = scene.strata.preview.frame_budget_ms
        try:
            session = _state.shown[region.as_pointer()]
            if viewport.advance(1e-3 * budget, session.version, budget):
                region.tag_redraw()
        except Exception as error:
            _failed(error)
            return None
        if viewport.has_work:
            wait = 0.0
    for pointer in set(_state.viewports) - set(alive):
        _state.viewports.pop(pointer).release()
        _state.textures.pop(pointer, None)
        _state.shown.pop(pointer, None)
    return min(wait, IDLE_SECONDS)
