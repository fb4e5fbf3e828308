"""When the plan of a scene is made by itself: soon after it has changed, while a panel of Strata is to be
seen and nobody is in the middle of anything. Never in background.

A plan holds up Blender for as long as it takes, mostly some hundredths of a second. The longer the last one
took, the longer it waits for a pause; one that took over a second is not made again unasked, until somebody
has asked for one that took less.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import bpy
from bpy.app.handlers import persistent

from ..core.errors import told_once
from ..core.naming import ENGINE_ID
from .properties import options_of
from .scene_plan import ScenePlan
from .state import STATE

TICK_SECONDS = 0.2
PAUSE_SECONDS = 0.4  # without a change, before anything is read
PAUSES = 10.0  # and at least so many times what the last plan took
LONGEST_SECONDS = 1.0
JOBS = ("RENDER", "OBJECT_BAKE")  # of Blender's, that read what is evaluated; most others lock the interface


class _Watched:
    """One scene: when it was last touched, and what its plan stands for."""

    def __init__(self):
        self.plan = ScenePlan()
        self.is_touched = True
        self.touched_at = time.monotonic()
        self.settings: tuple = ()
        self.stands_for: tuple | None = None
        self.rows: tuple | None = None  # of STATE, as they were left here
        self.before_bake: tuple | None = None

    def touch(self) -> None:
        self.is_touched, self.touched_at = True, time.monotonic()

    @property
    def is_heavy(self) -> bool:
        """Not to be read again unasked."""
        return self.plan.is_too_long or self.plan.seconds > LONGEST_SECONDS

    @property
    def pause(self) -> float:
        return PAUSE_SECONDS if self.is_heavy else max(PAUSE_SECONDS, PAUSES * self.plan.seconds)

    def look(self, window: bpy.types.Window) -> bool:
        """Makes a plan if it is time; whether what is shown has changed."""
        scene, uid = window.scene, window.scene.session_uid
        if (settings := _settings(window)) != self.settings:
            self.settings = settings
            self.touch()
        if STATE.plans.get(uid) is not self.rows:  # a bake's, which looks closer
            self._take_over(window)
        self.before_bake = None
        if not self.is_touched or time.monotonic() - self.touched_at < self.pause:
            return False
        self.is_touched = False
        with bpy.context.temp_override(window=window):
            depsgraph = bpy.context.evaluated_depsgraph_get()
        asked, before = self.plan.asked(depsgraph), STATE.shown(uid)
        if asked == self.stands_for:
            return False
        if self.is_heavy:
            if uid in STATE.plans:
                STATE.outdated.add(uid)
        else:
            self.plan.make(depsgraph)
            self.stands_for, self.rows = asked, STATE.plans.get(uid)
        if self.plan.is_too_long and uid not in STATE.plans:
            STATE.show_no_plan(uid, f"scene '{scene.name}' takes long to read")
            STATE.outdated.add(uid)
            self.rows = STATE.plans[uid]
        return STATE.shown(uid) != before

    def begin_bake(self, window: bpy.types.Window) -> None:
        """Of what is read now the next plan of others will be."""
        if self.before_bake is None:
            self.before_bake = self._now(window)

    def begin_job(self) -> None:
        """The same while a job of Blender's is at work, when nothing may be evaluated."""
        if self.before_bake is None:
            self.before_bake = self.stands_for or ()

    def _take_over(self, window: bpy.types.Window) -> None:
        """A plan that others have made stands for what the scene was when they read it."""
        uid = window.scene.session_uid
        self.rows = STATE.plans.get(uid)
        if self.rows is None:
            self.stands_for = None
            self.touch()
            return
        self.stands_for = self._now(window) if self.before_bake is None else self.before_bake

    def _now(self, window: bpy.types.Window) -> tuple:
        with bpy.context.temp_override(window=window):
            return self.plan.asked(bpy.context.evaluated_depsgraph_get())


_watched: dict[int, _Watched] = {}


def _settings(window: bpy.types.Window) -> tuple:
    """What a plan depends on and Blender tells nobody of."""
    scene, render = window.scene, window.scene.render
    return (
        options_of(scene),
        window.view_layer.name,
        scene.frame_current,
        scene.camera and scene.camera.session_uid,
        render.resolution_x,
        render.resolution_y,
        render.resolution_percentage,
        render.use_border,
        render.use_crop_to_border,
        tuple(getattr(render, f"border_{edge}") for edge in ("min_x", "max_x", "min_y", "max_y")),
    )


def _is_seen(window: bpy.types.Window) -> bool:
    """Whether a panel of Strata may be on screen."""
    for area in window.screen.areas:
        if _is_render_tab(area) and window.scene.render.engine == ENGINE_ID:
            return True
        if area.type == "VIEW_3D" and any(_is_sidebar(region) for region in area.regions):
            return True
    return False


def _is_sidebar(region: bpy.types.Region) -> bool:
    return region.type == "UI" and region.width > 1 and region.active_panel_category == "Strata"


def _is_busy(windows: list[bpy.types.Window]) -> bool:
    """Whether somebody drags, paints or plays: what holds the mouse is not to be held up."""
    return any(
        window.screen.is_animation_playing
        or any(operator.bl_options & {"BLOCKING", "GRAB_CURSOR"} for operator in window.modal_operators)
        for window in windows
    )


def _tick() -> float:
    told_once(_look)()
    return TICK_SECONDS


def _is_job_running() -> bool:
    return any(map(bpy.app.is_job_running, JOBS))


def _look() -> None:
    manager = bpy.context.window_manager
    if manager.is_interface_locked:  # what would be evaluated here a job is at work on
        return
    windows = list(manager.windows)
    seen: Iterator[bpy.types.Window] = (window for window in windows if _is_seen(window))
    by_scene = {window.scene.session_uid: window for window in reversed(list(seen))}
    if not by_scene or _is_busy(windows):
        return
    is_job_running = _is_job_running()
    for uid, window in by_scene.items():
        watched = _watched.setdefault(uid, _Watched())
        if is_job_running:
            watched.begin_job()
        elif STATE.is_baking:
            watched.begin_bake(window)
        elif watched.look(window):
            redraw(windows)


def redraw(windows) -> None:
    """Of what panels of the scene may be in: the views themselves have not changed."""
    for window in windows:
        for area in window.screen.areas:
            within = "UI" if area.type == "VIEW_3D" else "WINDOW" if _is_render_tab(area) else ""
            for region in area.regions:
                if region.type == within:
                    region.tag_redraw()


def _is_render_tab(area: bpy.types.Area) -> bool:
    return area.type == "PROPERTIES" and area.spaces.active.context == "RENDER"


def somebody_asked(scene: bpy.types.Scene, seconds: float) -> None:
    """A scene was read as a bake does, in so many seconds of this thread: where that was quick, whether it
    takes too long to be read unasked is found out anew."""
    watched = _watched.get(scene.session_uid)
    if watched is not None and watched.is_heavy and seconds <= LONGEST_SECONDS:
        watched.plan.start_again()


@persistent
@told_once
def _updated(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if (watched := _watched.get(scene.session_uid)) is not None:
        watched.plan.note(depsgraph)
        watched.touch()


@persistent
@told_once
def _everything_changed(*_) -> None:
    for watched in _watched.values():
        watched.plan.forget()
        watched.touch()


@persistent
@told_once
def _file_closing(*_) -> None:
    _watched.clear()


_HANDLERS = (
    ("depsgraph_update_post", _updated),
    ("undo_post", _everything_changed),
    ("redo_post", _everything_changed),
    ("load_pre", _file_closing),
)


def register() -> None:
    if bpy.app.background:
        return
    for name, function in _HANDLERS:
        if function not in getattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).append(function)
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=TICK_SECONDS, persistent=True)


def unregister() -> None:
    _watched.clear()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    for name, function in _HANDLERS:
        if function in getattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).remove(function)
