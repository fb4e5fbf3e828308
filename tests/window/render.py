"""Inside a Blender with a window: presses F12 in each of its display types, watches whether Blender goes on
meanwhile, and writes down what happened.

`blender SCENE.blend --python scripts/in_blender.py -- strata.tests.window.render DEVICE PHOTOGRAPHS
RESULT.json`, with the extension installed and the mouse (xdotool) on the same screen.
"""

import sys
import time
from itertools import pairwise
from pathlib import Path

import bpy
from strata.tests.window import person

DEVICE, PHOTOGRAPHS, RESULT = sys.argv[sys.argv.index("--") + 1 :]
DISPLAYS = ("WINDOW", "NONE", "AREA", "SCREEN")  # the first is Blender's default
TICK_SECONDS = 0.02
WATCHED_SECONDS = 3.0
ticks: list[float] = []


def tick() -> float:
    ticks.append(time.monotonic())
    return TICK_SECONDS


def longest_gap(seconds: float, redraws: bool = False):
    """Between two ticks of a timer: so long Blender heeds nothing. `redraws`: its windows, all the time."""
    ticks[:] = [time.monotonic()]
    for _ in range(round(seconds / 0.25)):
        yield 0.25
        if redraws:
            for window in bpy.context.window_manager.windows:
                for area in window.screen.areas:
                    area.tag_redraw()
    return max(later - earlier for earlier, later in pairwise([*ticks, time.monotonic()]))


def is_rendering() -> bool:
    return bpy.app.is_job_running("RENDER")


def render_started(area):
    """F12, and into the samples."""
    yield from person.press("F12", *person.middle(person.region_of(area, "WINDOW")))
    yield from person.wait(is_rendering)
    yield 4.0  # programs are compiled, and what shows the image drawn


def back_to_one_window():
    """Away with what F12 shows its image in."""
    for window in list(bpy.context.window_manager.windows)[1:]:
        with bpy.context.temp_override(window=window):
            bpy.ops.wm.window_close()
    window = bpy.context.window_manager.windows[0]
    if window.screen.show_fullscreen:
        with bpy.context.temp_override(window=window, area=window.screen.areas[0]):
            bpy.ops.screen.back_to_previous()
    for area in window.screen.areas:
        if area.type == "IMAGE_EDITOR":
            area.type = "VIEW_3D"
    yield 1.0


def watch(found: dict, display: str):
    bpy.context.preferences.view.render_display_type = display
    _window, area = person.view_3d()
    yield 1.0  # drawn as it stays
    idle = yield from longest_gap(WATCHED_SECONDS, redraws=True)
    yield from render_started(area)
    busy = yield from longest_gap(WATCHED_SECONDS)
    seen = {"idle": idle, "gap": busy, "renders": is_rendering()}
    yield from person.photograph(Path(PHOTOGRAPHS), f"{DEVICE} {display}")
    person.xdotool("key", "Escape")
    pressed = time.monotonic()
    yield from person.wait(lambda: not is_rendering())
    seen["seconds to cancel"] = time.monotonic() - pressed
    found[display] = seen
    yield 0.5
    yield from back_to_one_window()


def rendered(area):
    """F12 to its end; the report's backend and reason, and the mean of the picture."""
    reports().clear()
    yield from person.press("F12", *person.middle(person.region_of(area, "WINDOW")))
    yield from person.wait(lambda: reports() and not is_rendering())
    yield 0.5
    (report,) = reports().values()
    return [report["backend"], report["backend_reason"]]


def reports() -> dict:
    return sys.modules["bl_ext.user_default.strata.addon.ui.state"].STATE.reports


def settle():
    """Few samples at a small size, with the scene's lamps."""
    person.opened_plainly(sys.modules["bl_ext.user_default.strata.addon.preview"])
    scene = bpy.context.scene
    scene.render.engine = "STRATA"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 240, 135, 100
    settings = scene.strata
    settings.backend, settings.samples, settings.probes = DEVICE, 4096, 16
    settings.soft_shadow.resolution = 256
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "VIEW_3D":  # quick to draw: what else takes long is to be seen
            area.spaces.active.show_object_viewport_mesh = False


def interrupt(found: dict):
    """What else may happen while it renders."""
    bpy.context.preferences.view.render_display_type = "WINDOW"
    _window, area = person.view_3d()
    # The window that shows the image is closed, which ends Blender's operator too.
    yield from render_started(area)
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[-1]):
        bpy.ops.wm.window_close()
    yield 1.0
    # Another file is opened.
    yield from render_started(area)
    started = time.monotonic()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    found["seconds to open a file"] = time.monotonic() - started
    yield 1.0
    found["renders after opening"] = is_rendering()
    # To the end, by F12, with the interface locked, and by a script.
    settle()
    settings = bpy.context.scene.strata
    settings.samples, settings.probes = 2, 0
    bpy.context.preferences.view.render_display_type = "NONE"
    yield 1.0
    _window, area = person.view_3d()
    found["F12"] = yield from rendered(area)
    bpy.context.scene.render.use_lock_interface = True
    found["locked"] = yield from rendered(area)
    bpy.context.scene.render.use_lock_interface = False
    reports().clear()
    bpy.ops.render.render()
    (report,) = reports().values()
    found["script"] = [report["backend"], report["backend_reason"]]
    # Blender quits, as `work` makes it.
    settings.samples = 4096
    yield from render_started(area)
    found["renders when it quits"] = is_rendering()


def go(found: dict):
    settle()
    bpy.ops.wm.save_mainfile()
    bpy.app.timers.register(tick, persistent=True)
    yield 1.0
    for display in DISPLAYS:
        yield from watch(found, display)
    yield from interrupt(found)


person.work(go, RESULT)
