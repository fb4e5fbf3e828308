"""The preview's life: which scenes are watched, what Blender tells about them, when to work on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..core.errors import StrataError, one_line, told_once
from ..core.naming import ENGINE_ID
from ..core.observer import NOBODY, Observer
from ..planning import Options
from ..scene.viewport import hides_objects, placement_of
from ..ui.preview_settings import frame_budget_ms_of
from ..ui.properties import options_of
from . import caption
from .picture_textures import PictureTextures
from .session import Session
from .viewport import Statistics, Viewport

IDLE_SECONDS = 0.05
REDRAW, REFINING, BLENDER = "Redraw", "Refining", "Blender"  # stages, where somebody observes


class _State:
    """Everything that lives while something is shown; nothing of it is saved."""

    def __init__(self):
        self.scenes: set[int] = set()  # session ids of scenes that are watched
        self.rendered: set[int] = set()  # those that the engine draws, in viewports that are shaded so
        self.sessions: dict[tuple, Session] = {}
        self.viewports: dict[int, Viewport] = {}  # by region, as what they show
        self.shown: dict[int, Session] = {}
        self.textures = PictureTextures()
        self.handles: list[Any] = []
        self.edits = 0  # counts what Blender tells of
        self.is_running = False
        self.observer: Observer = NOBODY


_state = _State()


def available() -> str:
    """Why the preview cannot work here, in words; empty where it can."""
    if bpy.app.background:
        return "Blender runs without a window"
    import gpu

    try:
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
    _start()
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
    _redraw()
    if scene is None:
        _stop()


def follow(scene: bpy.types.Scene) -> None:
    """Refines what the engine draws of the scene, until `unfollow`. Costs nothing when asked again."""
    _state.rendered.add(scene.session_uid)
    _start()


def unfollow(scene: int) -> None:
    """By session id, since the scene may be gone; the next tick frees what nobody looks at any more."""
    _state.rendered.discard(scene)


def state_of(region: bpy.types.Region) -> Statistics | None:
    """What is shown in a region, None where nothing is."""
    viewport = _state.viewports.get(region.as_pointer())
    return viewport.statistics if viewport else None


def observe(observer: Observer) -> None:
    """From now on it is told of all that is drawn and refined, of whatever scene; NOBODY ends that."""
    _state.observer = observer
    for session in _state.sessions.values():
        session.executor.observer = observer


def preview_options(scene: bpy.types.Scene) -> Options:
    """The bake's, without measuring, and with the preview's own samples where it has any."""
    return options_of(
        scene, composite=True, probes=0, error_images=False, samples=scene.strata.preview.samples or None
    )


def layers_of(scene: bpy.types.Scene) -> tuple[str, ...]:
    """What the scene's viewports could show, as their plans say."""
    if not is_on(scene):
        return ()
    told = (
        viewport.statistics.layers
        for pointer, viewport in _state.viewports.items()
        if _state.shown.get(pointer) in _sessions_of(scene)
    )
    return tuple(dict.fromkeys(name for names in told for name in names))


def _sessions_of(scene: bpy.types.Scene) -> list[Session]:
    return [session for (uid, *_), session in _state.sessions.items() if uid == scene.session_uid]


def draw(
    context: bpy.types.Context, region: bpy.types.Region | None = None, is_overlay: bool = False
) -> None:
    """Draws the picture of the viewport at hand into the bound framebuffer, making it first where something
    has changed. `is_overlay`: that is the one of a viewport's overlays; else it is a render engine's, of
    scene-linear light, to which Blender applies the scene's view transform. What keeps it from a picture,
    such as nothing in view, is in `state_of(region).message`; what fails is not tried again before something
    changes."""
    region = region or context.region
    space, region_3d = context.space_data, context.region_data
    if region is None or space is None or region_3d is None:
        return
    viewport = _state.viewports.setdefault(region.as_pointer(), Viewport())
    asked = _asked(context.scene, region, region_3d)
    if viewport.failed_at == asked:
        return
    if viewport.failed_at is not None:
        viewport.failed_at, viewport.statistics = None, Statistics()
    _state.observer.stage(REDRAW)
    try:
        picture = _picture(context, region, space, region_3d, viewport)
        if picture is not None:
            _state.textures.draw(context.scene, region, picture, is_overlay)
    except BaseException as error:  # a panic of the kernels is no Exception
        _failed(region.as_pointer(), error, asked)
    finally:
        _state.observer.stage(BLENDER)


def failure() -> str:
    """What keeps a viewport from its picture, in one line; empty where nothing does."""
    told = (viewport.statistics for viewport in _state.viewports.values())
    return next((statistics.message for statistics in told if statistics.has_failed), "")


def register() -> None:
    """Nothing else is there before something is to be shown."""
    if _file_opened not in bpy.app.handlers.load_post:
        bpy.app.handlers.load_post.append(_file_opened)


def unregister() -> None:
    if _file_opened in bpy.app.handlers.load_post:
        bpy.app.handlers.load_post.remove(_file_opened)
    _state.rendered.clear()
    disable()


def _picture(context, region, space, region_3d, viewport: Viewport):
    scene, settings = context.scene, context.scene.strata.preview
    depsgraph = context.evaluated_depsgraph_get()
    placement = placement_of(scene, space, region_3d, (region.width, region.height), depsgraph)
    options = preview_options(scene)
    key = (scene.session_uid, context.view_layer.name, _own(space), options.backend)
    if key not in _state.sessions:
        _state.sessions[key] = Session(options.backend)
        _state.sessions[key].executor.observer = _state.observer
    session = _state.shown[region.as_pointer()] = _state.sessions[key]
    session.read(depsgraph, space, placement, options.seed, options.read)
    budget_ms = frame_budget_ms_of(scene)
    is_new = viewport.show(session, placement, options, settings.layer, budget_ms, settings.longest_s)
    if is_new:
        frame = viewport.statistics
        _state.observer.tell(budget_ms=budget_ms, scale=frame.scale, map_share=frame.map_share)
    elif _works_in_draw(session) and viewport.has_work and viewport.wait() == 0.0:
        _advance(scene, region.as_pointer())
    return viewport.shown(settings.shows_noise)


def _works_in_draw(session: Session) -> bool:
    return session.devices.primary.name == "gpu"


def _advance(scene: bpy.types.Scene, pointer: int) -> bool:
    """Refines one region for a slice of the budget; whether it has a new picture."""
    budget_ms = frame_budget_ms_of(scene)
    _state.observer.stage(REFINING)
    return _state.viewports[pointer].advance(1e-3 * budget_ms, _state.shown[pointer].version, budget_ms)


def _own(space: bpy.types.SpaceView3D) -> int:
    """Viewports that hide objects share nothing."""
    return space.as_pointer() if hides_objects(space) else 0


def _start() -> None:
    """Listens to Blender, if not yet."""
    if _state.is_running:
        return
    _state.is_running = True
    for name, function in _HANDLERS:
        getattr(bpy.app.handlers, name).append(function)
    bpy.app.timers.register(_tick, first_interval=0.0, persistent=True)


def _stop() -> None:
    """Lets go of everything."""
    if _state.is_running:
        _state.is_running = False
        for name, function in _HANDLERS:
            getattr(bpy.app.handlers, name).remove(function)
        if bpy.app.timers.is_registered(_tick):
            bpy.app.timers.unregister(_tick)
    for pointer in list(_state.viewports):
        _drop(pointer)
    _drop_sessions()
    _state.textures.clear()


def _drop(pointer: int) -> None:
    """Frees what a region showed."""
    _state.viewports.pop(pointer).release()
    _state.shown.pop(pointer, None)
    _state.textures.drop(pointer)


def _drop_sessions() -> None:
    """Frees those that no viewport shows any more."""
    used = set(map(id, _state.shown.values()))
    for key in [key for key, session in _state.sessions.items() if id(session) not in used]:
        _state.sessions.pop(key).release()


@told_once
def _draw_view() -> None:
    context = bpy.context
    if context.scene is None or not is_on(context.scene) or _draws_engine(context.scene, context.space_data):
        return
    draw(context, is_overlay=True)


@told_once
def _draw_text() -> None:
    context = bpy.context
    statistics = state_of(context.region)
    if context.scene is None or statistics is None:
        return
    if statistics.has_failed or context.scene.strata.preview.show_statistics:
        caption.draw(statistics, context)


def _asked(scene: bpy.types.Scene, region: bpy.types.Region, region_3d: bpy.types.RegionView3D) -> tuple:
    """Differs whenever a picture that failed may succeed."""
    matrices = (tuple(map(tuple, matrix)) for matrix in (region_3d.view_matrix, region_3d.window_matrix))
    return (
        _state.edits,
        scene.session_uid,
        scene.frame_current_final,
        region.width,
        region.height,
        *matrices,
    )


def _failed(pointer: int, error: BaseException, asked: Any) -> None:
    """Says so in the region and in the panels; what is half done is begun anew."""
    viewport = _state.viewports[pointer]
    is_news = not viewport.statistics.has_failed
    viewport.fail(one_line(error), asked)
    if (session := _state.shown.get(pointer)) is not None:
        session.changes.all = True
    if is_news:
        for _window, area, _region in _regions():
            area.tag_redraw()


def _draws_engine(scene: bpy.types.Scene, space) -> bool:
    """Whether Strata's engine draws the viewport itself."""
    return space.shading.type == "RENDERED" and scene.render.engine == ENGINE_ID


@persistent
@told_once
def _depsgraph_updated(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    _state.edits += 1
    for (uid, *_), session in _state.sessions.items():
        if uid == scene.session_uid:
            session.changes.add(depsgraph)


@persistent
@told_once
def _everything_changed(*_) -> None:
    _state.edits += 1
    for session in _state.sessions.values():
        session.changes.all = True


@persistent
@told_once
def _file_closing(*_) -> None:
    _state.rendered.clear()
    disable()


@persistent
@told_once
def _file_opened(*_) -> None:
    """Switches on what the file wants to be seen with."""
    if available():
        return
    for window in bpy.context.window_manager.windows:
        if window.scene.strata.preview.on_opening:
            enable(window.scene)


_HANDLERS = (
    ("depsgraph_update_post", _depsgraph_updated),
    ("undo_post", _everything_changed),
    ("redo_post", _everything_changed),
    ("load_pre", _file_closing),
)


def _redraw() -> None:
    for _window, _area, region in _regions():
        region.tag_redraw()


def _regions() -> Iterator[tuple[bpy.types.Window, bpy.types.Area, bpy.types.Region]]:
    """Every 3D viewport."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "WINDOW":
                        yield window, area, region


def _tick() -> float | None:
    """Refines what is still, a slice of the budget at a time, and makes view transforms."""
    wait, alive = IDLE_SECONDS, set()
    for window, area, region in _regions():
        scene, pointer = window.scene, region.as_pointer()
        is_rendered = scene.session_uid in _state.rendered and _draws_engine(scene, area.spaces.active)
        if not (is_on(scene) or is_rendered):
            continue
        alive.add(pointer)
        try:
            if is_on(scene) and not is_rendered and _state.textures.read_view_transform(scene):
                region.tag_redraw()
            wait = min(wait, _refine(scene, region))
        except BaseException as error:
            if pointer in _state.viewports:
                _failed(pointer, error, _asked(scene, region, area.spaces.active.region_3d))
    for pointer in set(_state.viewports) - alive:
        _drop(pointer)
    _drop_sessions()
    if not (_state.scenes or _state.rendered):
        _stop()
        return None
    return wait


def _refine(scene: bpy.types.Scene, region: bpy.types.Region) -> float:
    """Works on a region's picture for a slice of the budget; seconds until there is more to do."""
    pointer = region.as_pointer()
    viewport = _state.viewports.get(pointer)
    if viewport is None or not viewport.has_work:
        return IDLE_SECONDS
    if still := viewport.wait():
        return still
    # Timers have a GPU context by luck only (none after a window was closed), so a GPU works on while
    # Blender draws.
    if _works_in_draw(_state.shown[pointer]) or _advance(scene, pointer):
        region.tag_redraw()
    _state.observer.stage(BLENDER)
    return 0.0 if viewport.has_work else IDLE_SECONDS
