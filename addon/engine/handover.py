"""Lets the main thread work for a render on another thread: a GPU belongs to the main thread alone."""

from __future__ import annotations

import threading
from collections import deque

import bpy

from ..bake import Baked, BakeJob
from ..core.errors import Cancelled, told_once
from ..job import Runner
from ..ui.registration import Classes

LOOK_SECONDS = 0.1  # between two looks whether a job waits
TIMER_SECONDS = 0.05
SLICE_SECONDS = 0.04  # of the main thread's time between two events
MOST_IDLE_LOOKS = 50  # with a job that waits and gets no slice, before it is given back


class NotServed(Exception):
    """The main thread cannot work for the render; the message says why."""


class Handover:
    """A job that the main thread works off, slice by slice, while the thread that made it waits. `step`,
    `cancel` and `stop` are for that thread, and as a Runner's. None of them waits for the main thread once
    the render is cancelled: that one may be waiting for the render, to open a file or to quit. `step` may
    raise NotServed too."""

    def __init__(self, job: BakeJob):
        self.job = job
        self.idle_looks = 0
        self._ended = threading.Event()
        self._failure: BaseException | None = None
        self._is_cancelled = False
        _waiting.append(self)

    def step(self, seconds: float) -> Baked | None:
        if self._is_cancelled:
            raise Cancelled()
        if not self._ended.wait(seconds):
            return None
        if self._failure is not None:
            raise self._failure
        return self.job.result()

    def cancel(self) -> None:
        self._is_cancelled = True
        self.job.cancel()

    stop = cancel

    def work(self, seconds: float) -> bool:
        """A slice, on the main thread; whether nothing is left to do."""
        if not self._ended.is_set() and self.job.devices.primary.has_context():
            self.idle_looks = 0
            try:
                if self.job.advance(seconds):
                    self.end(None)
            except BaseException as failure:  # for the thread that waits
                self.end(failure)
        return self._ended.is_set()

    def end(self, failure: BaseException | None) -> None:
        """On the main thread."""
        self._failure = failure
        self.job.devices.primary.free()  # here, since freeing needs a GPU context too
        self._ended.set()


_waiting: deque[Handover] = deque()
_taken: list[Handover] = []


class STRATA_OT_render_slices(bpy.types.Operator):
    """Work for a render: unlike timers, operators have a GPU context"""

    bl_idname = "strata.render_slices"
    bl_label = "Render on the GPU"
    bl_options = {"INTERNAL"}

    def invoke(self, context, event):
        self._handover = _waiting.popleft()
        _taken.append(self._handover)
        manager = context.window_manager
        self._timer = manager.event_timer_add(TIMER_SECONDS, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type != "TIMER" or not self._handover.work(SLICE_SECONDS):
            return {"PASS_THROUGH"}
        self._leave(context)
        return {"FINISHED", "PASS_THROUGH"}

    def cancel(self, context):
        """Blender ends the operator itself, as when its window is closed: another one goes on."""
        self._leave(context)
        _waiting.append(self._handover)

    def _leave(self, context) -> None:
        context.window_manager.event_timer_remove(self._timer)
        _taken.remove(self._handover)


def runner_of(job: BakeJob, is_locked: bool) -> Runner | Handover:
    """What drives the job of a render on this thread; `is_locked`: the window takes no events meanwhile.
    Raises NotServed where a GPU's job cannot be driven so."""
    if not job.needs_main_thread:
        return Runner(job)
    if threading.current_thread() is threading.main_thread():
        if not job.devices.primary.has_context():
            raise NotServed("Blender gives no GPU to scripts here")
        return Runner(job)
    if is_locked:
        raise NotServed("Lock Interface keeps the GPU's thread from working for a render")
    return Handover(job)


def _look() -> float:
    """A timer, which has to go on whatever fails."""
    _serve()
    return LOOK_SECONDS


@told_once
def _serve() -> None:
    """Starts the operator for a job that waits, and gives back those that nobody works for."""
    for handover in (*_waiting, *_taken):
        handover.idle_looks += 1
        if handover.idle_looks > MOST_IDLE_LOOKS:
            _give_back(handover, "Blender handles no events for add-ons")
    windows = bpy.context.window_manager.windows
    window = next((window for window in windows if window.parent is None), None)
    if _waiting and window is not None:
        with bpy.context.temp_override(window=window):
            bpy.ops.strata.render_slices("INVOKE_DEFAULT")


def _give_back(handover: Handover, reason: str) -> None:
    if handover in _waiting:
        _waiting.remove(handover)
    handover.end(NotServed(reason))


_classes = Classes(STRATA_OT_render_slices)


def register() -> None:
    _classes.register()
    if not bpy.app.background and not bpy.app.timers.is_registered(_look):
        bpy.app.timers.register(_look, first_interval=LOOK_SECONDS, persistent=True)


def unregister() -> None:
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)
    for handover in (*_waiting, *_taken):
        _give_back(handover, "Strata was switched off")
    _classes.unregister()
