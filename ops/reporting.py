"""The button that has another Blender make a report of the scene, and shows its page."""

from __future__ import annotations

import signal
import subprocess
import tempfile
from pathlib import Path

import bpy

from ..addon.audit.other_blender import Scene, kept_scene
from ..addon.core.errors import StrataError, one_line
from ..addon.layers.files import check_writable
from ..addon.report.report import PAGE
from ..addon.ui.registration import Classes
from ..addon.ui.state import STATE
from ..addon.ui.watching import redraw

TIMER_SECONDS = 0.25
INTERRUPTED = 130
PACKAGE = __package__.rpartition(".")[0]
_FEW = ("--samples-only", "--repeats", "1")


class STRATA_OT_report(bpy.types.Operator):
    """Bake this scene with many settings in another Blender, and show what each costs and how wrong it is on
    a page with plots. You can go on working meanwhile"""

    bl_idname = "strata.report"
    bl_label = "Error against Time"
    bl_options = {"REGISTER"}

    folder: bpy.props.StringProperty(
        name="Folder", description="Where to; a new one beside this Blender file if empty", subtype="DIR_PATH"
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

    @classmethod
    def poll(cls, context):
        if STATE.is_reporting:
            cls.poll_message_set("A report is being made")
        elif not bpy.app.binary_path:
            cls.poll_message_set("Takes a Blender that is a program: use strata report")
        return bool(bpy.app.binary_path) and not STATE.is_reporting

    def invoke(self, context, event):
        return context.window_manager.invoke_props_dialog(self, confirm_text="Start")

    def draw(self, context):
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        for name in ("folder", "thorough", "cycles", "eevee"):
            layout.prop(self, name)
        layout.label(text="Takes as long as some ten bakes, or a hundred with all settings", icon="TIME")

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
        if STATE.is_report_cancelled:
            self._process.send_signal(signal.SIGINT)
            STATE.is_report_cancelled = False
        if self._process.poll() is None:
            self._show(context)
            return {"PASS_THROUGH"}
        code, page, said = self._process.returncode, self._folder / PAGE, self._last_line()
        self._end(context)
        if code == INTERRUPTED:
            self.report({"INFO"}, f"Report stopped; what was found is in {self._folder}")
            return {"CANCELLED"}
        if code or not page.is_file():
            self.report({"ERROR"}, f"No report: {said or f'Blender ended with {code}'}")
            return {"CANCELLED"}
        self.report({"INFO"}, f"Report in {page}")
        bpy.ops.wm.url_open(url=page.as_uri())
        return {"FINISHED"}

    def cancel(self, context):
        """Blender ends the operator itself, as when another file is opened."""
        self._end(context)

    def _start(self, context) -> None:
        STATE.is_reporting, STATE.is_report_cancelled = True, False
        STATE.report_doing = "Starting"
        self._folder = Path(bpy.path.abspath(self.folder)) if self.folder else _new_folder()
        check_writable(self._folder / PAGE)
        scene, view_layer = context.scene, context.view_layer
        self._kept = kept_scene(scene, view_layer)
        scripts = ("--enable-autoexec",) if self._kept.runs_scripts else ("--disable-autoexec",)
        rivals = [name for name in ("cycles", "eevee") if getattr(self, name)]
        command = [bpy.app.binary_path, "--background", *scripts, str(self._kept.file), "--addons", PACKAGE]
        command += ["--command", "strata", "report", "-o", str(self._folder)]
        command += ["--scene", scene.name, "--view-layer", view_layer.name]
        command += ["--frames", str(scene.frame_current)]
        command += () if self.thorough else _FEW
        command += ("--rivals", ",".join(rivals)) if rivals else ()
        with open(self._log, "wb") as log:
            self._process = subprocess.Popen(command, stdout=log, stderr=log, stdin=subprocess.DEVNULL)

    @property
    def _log(self) -> Path:
        return Path(self._kept.folder.name) / "report.txt"

    def _last_line(self) -> str:
        lines = self._log.read_text(encoding="utf-8", errors="replace").splitlines()
        ours = [line for line in lines if line.startswith(("report:", "strata:"))]
        return ours[-1].partition(":")[2].strip() if ours else ""

    def _show(self, context) -> None:
        said = self._last_line() or "Starting"
        if said != STATE.report_doing:
            STATE.report_doing = said
            redraw(context.window_manager.windows)

    def _end(self, context) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
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
    """Stop the report; what was found so far stays"""

    bl_idname = "strata.cancel_report"
    bl_label = "Stop Report"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        return STATE.is_reporting

    def execute(self, context):
        STATE.is_report_cancelled = True
        return {"FINISHED"}


def _new_folder() -> Path:
    """Beside the Blender file, with a number where there are others; of one never saved a temporary one."""
    file = Path(bpy.data.filepath)
    if not bpy.data.filepath:
        return Path(tempfile.mkdtemp(prefix="strata_report_"))
    number, folder = 1, file.with_name(f"{file.stem}_report")
    while folder.exists():
        number += 1
        folder = file.with_name(f"{file.stem}_report_{number}")
    return folder


_classes = Classes(STRATA_OT_report, STRATA_OT_cancel_report)
register, unregister = _classes.register, _classes.unregister
