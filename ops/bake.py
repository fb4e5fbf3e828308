"""The operators behind the panel's buttons."""

from __future__ import annotations

import time
from functools import partial

import bpy

from ..addon.audit.audit import audited
from ..addon.audit.other_blender import kept_scene
from ..addon.bake import Baked, BakeJob, read_job
from ..addon.core.errors import Cancelled, StrataError, one_line, sentence
from ..addon.expected import expected_seconds
from ..addon.job import Runner, run_to_end
from ..addon.layers.exr import check_codec, write_layers
from ..addon.layers.files import check_writable
from ..addon.layers.images import fill_images, packed, reload_file
from ..addon.sequence import sequence_layers
from ..addon.ui.output import output_of, waits_for_saving
from ..addon.ui.properties import exr_of, options_of
from ..addon.ui.registration import Classes
from ..addon.ui.state import STATE, Made
from ..addon.ui.watching import redraw, somebody_asked
from .planning import nothing_to_bake, read_plan, room_warning
from .reported import reported
from .terminal import time_left

TIMER_SECONDS = 0.05
SLICE_SECONDS = 0.04  # of the main thread's time between two events, where a GPU bakes


class STRATA_OT_bake(bpy.types.Operator):
    """Bake a layer for each light and effect, with its measured error. Esc cancels"""

    bl_idname = "strata.bake"
    bl_label = "Bake Layers"
    bl_options = {"UNDO"}  # it fills images; REGISTER would bake again on every change in the redo panel

    filepath: bpy.props.StringProperty(
        name="File Path",
        description="Multilayer EXR to write instead of the scene's Strata output",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )

    _runner: Runner | None = None
    _timer = None

    @classmethod
    def poll(cls, context):
        if STATE.is_baking:
            cls.poll_message_set("A bake is running")
        return not STATE.is_baking

    def execute(self, context):
        """To the end, for scripts and in background."""
        try:
            job = self._prepare(context)
            if job is None:
                return {"CANCELLED"}
            return self._finished(run_to_end(job, finish=self._write))
        except BaseException as error:  # a panic of the kernels is no Exception
            return self._failed(error)

    def invoke(self, context, event):
        try:
            job = self._prepare(context)
            if job is None:
                return {"CANCELLED"}
            self._runner = Runner(job, self._write)
            STATE.is_baking, STATE.is_cancelled = True, False
            manager = context.window_manager
            self._timer = manager.event_timer_add(TIMER_SECONDS, window=context.window)
            self._show(context)
        except BaseException as error:
            self._end(context)
            return self._failed(error)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC" and event.value == "PRESS":
            self._runner.cancel()
            return {"RUNNING_MODAL"}
        if STATE.is_cancelled:
            self._runner.cancel()
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            baked = self._runner.step(SLICE_SECONDS if self._runner.job.needs_main_thread else 0.0)
            if baked is None:
                self._show(context)
                return {"PASS_THROUGH"}
            self._end(context)
            return self._finished(baked)
        except BaseException as error:
            self._end(context)
            return self._failed(error)

    def cancel(self, context):
        """Blender ends the operator itself, as when another file is opened."""
        self._end(context)

    def _prepare(self, context) -> BakeJob | None:
        """Reads the scene, on the main thread; None if there is nothing to bake."""
        scene = context.scene
        self._scene_id, self._scene_name = scene.session_uid, scene.name
        self._warnings, self._not_written = (), ""  # of the file
        self._packed: tuple[bytes, ...] = ()
        self._kept_scene, self._is_audited = None, scene.strata.audit
        self._wants_images = scene.strata.save_to != "FILE"
        self._waits = not self.filepath and waits_for_saving(scene)
        has_file = self.filepath or not (self._waits or scene.strata.save_to == "IMAGES")
        output = output_of(scene, context.view_layer, self.filepath) if has_file else None
        self._path = output and output.path(scene.frame_current)
        if self._path:
            check_writable(self._path)
            self._exr = exr_of(scene)
            check_codec(self._exr)
        composite = True if self._path and self._exr.composite else None
        where = scene, context.view_layer, partial(options_of, composite=composite)
        sequence = None
        if output and output.is_numbered:
            sequence = sequence_layers(*where, (scene.frame_current,))
        manager = context.window_manager
        manager.progress_begin(0.0, 1.0)  # of the mouse, while Blender bakes materials
        try:
            job = read_job(*where, show=manager.progress_update, sequence=sequence or ())
        finally:
            manager.progress_end()
        self._job = job
        if reason := nothing_to_bake(job.graph, job.sequence):
            STATE.show_plan(self._scene_id, job.graph, expected_s=0.0)
            self.report({"WARNING"}, sentence(reason))
            return None
        if self._path and (warning := room_warning(self._path, job, self._exr)):
            self.report({"WARNING"}, warning)
        if self._is_audited:
            try:
                self._kept_scene = kept_scene(scene, context.view_layer)
            except StrataError as error:
                self.report({"WARNING"}, f"Not held against Cycles: {one_line(error)}")
        return job

    def _write(self, baked: Baked) -> Baked:
        """On the worker thread: nothing of Blender may be touched here. A file that cannot be written
        costs no layer: all go to images then."""
        if self._kept_scene is not None and baked.layers.layers:
            job, job.stage = self._job, "Auditing"

            def show(share: float) -> None:
                job.progress = share

            with self._kept_scene as kept:
                baked = audited(baked, kept, job.outline, job.graph, lambda: job.is_cancelled, show)
        if self._path and baked.layers.layers:
            try:
                self._warnings = write_layers(self._path, baked.layers, self._exr, baked.composite)
            except Exception as error:
                self._not_written = one_line(error)
        if self._wants_images or self._not_written:
            self._packed = packed(baked.layers)
        return baked

    def _finished(self, baked: Baked):
        if not baked.layers.layers:
            self.report({"WARNING"}, "Nothing to bake: no shadow falls on what the camera sees")
            return {"CANCELLED"}
        for warning in self._warnings:
            self.report({"WARNING"}, warning)
        if self._packed:
            fill_images(self._scene_name, baked.layers, self._packed)
        if is_written := bool(self._path and not self._not_written):
            reload_file(self._path)
        job, report = self._job, baked.layers.report
        expected_s = expected_seconds(job.outline, job.graph, job.options, report, self._is_audited)
        STATE.show_plan(self._scene_id, job.graph, job.memory, baked=job.outline.baked, expected_s=expected_s)
        made = Made(baked.layers.view_layer, self._path if is_written else None, bool(self._packed))
        STATE.show_report(self._scene_id, report, made)
        if self._not_written:
            self.report({"ERROR"}, f"{self._not_written}. The layers are in images of this Blender file")
            return {"FINISHED"}
        where = f" to {self._path}" if self._path else ""
        if self._waits:
            where = " to images; once this Blender file is saved, also to a file beside it"
        seconds = report["seconds"]
        count = len(baked.layers.layers)
        layers = f"{count} layers" if count > 1 else "1 layer"
        self.report({"INFO"}, f"Baked {layers} in {seconds:.1f} s{where}")
        return {"FINISHED"}

    def _failed(self, error: BaseException):
        if isinstance(error, Cancelled):
            self.report({"INFO"}, "Bake cancelled, nothing written")
        else:
            self.report({"ERROR"}, one_line(error))
        return {"CANCELLED"}

    def _show(self, context) -> None:
        job = self._runner.job
        left = time_left(job.seconds_left)
        STATE.share = job.progress
        STATE.doing = f"{job.stage} {100 * job.progress:.0f}%{left and ', ' + left}"
        context.workspace.status_text_set(f"Strata: {STATE.doing}   Esc: Cancel")
        redraw(context.window_manager.windows)

    def _end(self, context) -> None:
        """Nothing where it has ended already."""
        if self._runner is None:
            return
        self._runner.stop()
        self._runner = None
        STATE.is_baking = False
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        context.workspace.status_text_set(None)
        redraw(context.window_manager.windows)


class STRATA_OT_cancel_bake(bpy.types.Operator):
    """Stop the bake that is running; nothing of it is written"""

    bl_idname = "strata.cancel_bake"
    bl_label = "Cancel Bake"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        return STATE.is_baking

    def execute(self, context):
        STATE.is_cancelled = True
        return {"FINISHED"}


class STRATA_OT_plan(bpy.types.Operator):
    """Read the scene as a bake does, and say which layers it makes, and what it leaves out and why"""

    bl_idname = "strata.plan"
    bl_label = "Read the Scene"
    bl_options = {"REGISTER"}

    @reported
    def execute(self, context):
        started = time.thread_time()
        scene = context.scene
        told = {"report": STATE.reports.get(scene.session_uid), "is_audited": scene.strata.audit}
        outline, graph, memory, expected_s = read_plan(scene, context.view_layer, options_of, **told)
        somebody_asked(scene, time.thread_time() - started)
        STATE.show_plan(scene.session_uid, graph, memory, outline.warnings, outline.baked, expected_s)
        redraw(context.window_manager.windows)
        return {"FINISHED"}


_classes = Classes(STRATA_OT_bake, STRATA_OT_cancel_bake, STRATA_OT_plan)
register, unregister = _classes.register, _classes.unregister
