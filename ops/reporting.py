"""The button that has another Blender make a report of the scene, and shows its page."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path

import bpy

from ..addon.audit.other_blender import Scene, kept_scene
from ..addon.core.errors import StrataError, one_line
from ..addon.layers.files import check_writable
from ..addon.layers.paths import resolved
from ..addon.report.report import PAGE
from ..addon.ui.registration import Classes
from ..addon.ui.state import STATE
from ..addon.ui.watching import redraw

TIMER_SECONDS = 0.25
SECONDS_TO_STOP = 5.0
STOPPED = 130, -signal.SIGTERM
"""What a child that was stopped ends with: once its command runs it writes a page of what there is."""
PACKAGE = __package__.rpartition(".")[0]
LOG = "log.txt"
SAMPLES_ALONE = "--samples-only", "--repeats", "1"


class STRATA_OT_report(bpy.types.Operator):
    """Bake this scene with many settings in another Blender, and show what each costs and how wrong it is on
    a page with plots. You can go on working meanwhile"""

    bl_idname = "strata.report"
    bl_label = "Error against Time"
    bl_options = {"REGISTER"}

    folder: bpy.props.StringProperty(
        name="Folder",
        description="Where to; a new one beside this Blender file if empty",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
    )
    thorough: bpy.props.BoolProperty(
        name="All Settings",
        description="Vary all settings that trade time for error, three times each; else only the samples",
    )
    cycles: bpy.props.BoolProperty(
        name="Cycles", description="Have Cycles make the same shadows", default=True
    )
    eevee: bpy.props.BoolProperty(name="EEVEE", description="Have EEVEE make the same shadows")

    _process: subprocess.Popen | None = None
    _kept: Scene | None = None
    _timer = None
    _is_stopping = False

    @classmethod
    def poll(cls, context):
        reason = ""
        if STATE.is_reporting:
            reason = "A report is being made"
        elif bpy.app.background or not bpy.app.binary_path:
            reason = "Takes a Blender with a window: use strata report"
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def invoke(self, context, event):
        return context.window_manager.invoke_props_dialog(self, confirm_text="Start")

    def draw(self, context):
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        for name in ("folder", "thorough", "cycles", "eevee"):
            layout.prop(self, name)
        layout.label(text="1 to 64 samples, measured with care: minutes, or an hour", icon="TIME")

    def execute(self, context):
        try:
            self._start(context)
        except (StrataError, OSError) as error:
            self._end(context)
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        manager = context.window_manager
        self._timer = manager.event_timer_add(TIMER_SECONDS, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            return self._looked(context)
        except (StrataError, OSError) as error:
            self._end(context)
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}

    def _looked(self, context):
        if STATE.is_report_cancelled and not self._is_stopping:
            self._is_stopping = True
            self._process.terminate()
        if self._process.poll() is None:
            self._show(context)
            return {"PASS_THROUGH"}
        code, page, said = self._process.returncode, self._folder / PAGE, self._last_line("strata:")
        is_stopped = self._is_stopping and code in STOPPED
        self._end(context)
        if is_stopped:
            where = f"; what was found is in {page}" if page.is_file() else ", nothing had been found"
            self.report({"INFO"}, f"Report stopped{where}")
            return {"CANCELLED"}
        if code or not page.is_file():
            self.report(
                {"ERROR"}, f"No report: {said or f'Blender ended with {code}'} ({self._folder / LOG})"
            )
            return {"CANCELLED"}
        self.report({"INFO"}, f"Report in {page}")
        bpy.ops.wm.url_open(url=page.as_uri())
        return {"FINISHED"}

    def cancel(self, context):
        """Blender ends the operator itself, as when another file is opened."""
        self._end(context)

    def _start(self, context) -> None:
        STATE.is_reporting, STATE.is_report_cancelled = True, False
        STATE.report_doing, self._is_stopping = "Starting", False
        file = Path(bpy.data.filepath) if bpy.data.filepath else None
        if self.folder:
            self._folder = Path(resolved(self.folder, file and file.parent)).absolute()
        else:
            self._folder = _new_folder(file)
        check_writable(self._folder / PAGE)
        self._folder.mkdir(parents=True, exist_ok=True)
        scene, view_layer = context.scene, context.view_layer
        self._kept = kept_scene(scene, view_layer)
        # Its name is the page's title.
        copy = self._kept.file.rename(self._kept.file.with_name(file.name if file else "never saved.blend"))
        scripts = "--enable-autoexec" if self._kept.runs_scripts else "--disable-autoexec"
        rivals = [name for name in ("cycles", "eevee") if getattr(self, name)]
        command = [bpy.app.binary_path, "--background", scripts, str(copy), "--addons", PACKAGE]
        command += ["--command", "strata", "report", "-o", str(self._folder)]
        command += [f"--scene={scene.name}", f"--view-layer={view_layer.name}"]
        command += [f"--frames={scene.frame_current}"]
        command += () if self.thorough else SAMPLES_ALONE
        command += ("--rivals", ",".join(rivals)) if rivals else ()
        with open(self._folder / LOG, "wb") as log:
            # A session of its own, so that whatever it starts can be ended with it.
            self._process = subprocess.Popen(
                command, stdout=log, stderr=log, stdin=subprocess.DEVNULL, start_new_session=True
            )

    def _last_line(self, *starts: str) -> str:
        lines = (self._folder / LOG).read_text(encoding="utf-8", errors="replace").splitlines()
        ours = [line for line in lines if line.startswith(starts)]
        return ours[-1].partition(":")[2].strip() if ours else ""

    def _show(self, context) -> None:
        said = "Stopping" if self._is_stopping else self._last_line("report:", "strata:") or "Starting"
        if said != STATE.report_doing:
            STATE.report_doing = said
            redraw(context.window_manager.windows)

    def _end(self, context) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(SECONDS_TO_STOP)
        if self._process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        self._process = None
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        if self._kept is not None:
            self._kept.folder.cleanup()
            self._kept = None
        STATE.is_reporting = False
        redraw(context.window_manager.windows)


class STRATA_OT_cancel_report(bpy.types.Operator):
    """Stop the report; a page of what was found so far stays"""

    bl_idname = "strata.cancel_report"
    bl_label = "Stop Report"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        return STATE.is_reporting and not STATE.is_report_cancelled

    def execute(self, context):
        STATE.is_report_cancelled = True
        return {"FINISHED"}


def _new_folder(file: Path | None) -> Path:
    """Beside the Blender file, with a number where there are others; of one never saved a temporary one."""
    if file is None:
        return Path(tempfile.mkdtemp(prefix="strata_report_"))
    number, folder = 1, file.with_name(f"{file.stem}_report")
    while folder.exists():
        number += 1
        folder = file.with_name(f"{file.stem}_report_{number}")
    return folder


_classes = Classes(STRATA_OT_report, STRATA_OT_cancel_report)
register, unregister = _classes.register, _classes.unregister
