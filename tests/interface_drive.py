"""Inside a Blender with a window: uses Strata as a person would, and writes down what happened.

`blender SCENE.blend --python interface_drive.py -- OUT.exr PHOTOGRAPHS RESULT.json`, with the extension
installed and the mouse (xdotool) on the same screen.
"""

import json
import sys
import time
import traceback
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import interface_person as person

OUT, PHOTOGRAPHS, RESULT = sys.argv[sys.argv.index("--") + 1 :]
MODULE = "bl_ext.user_default.strata"
SMALL = (96, 54)


def state():
    return sys.modules[f"{MODULE}.addon.ui.state"].STATE


def float_images() -> list[str]:
    return sorted(image.name for image in bpy.data.images if image.is_float and image.size[0])


def prepare():
    """What is not about Strata: a quick image, a quiet window."""
    scene = bpy.context.scene
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = *SMALL, 100
    settings = scene.strata
    settings.backend, settings.samples, settings.probes = "cpu", 4096, 16
    settings.output = OUT
    bpy.ops.wm.save_mainfile()
    bpy.ops.ed.undo_push(message="prepared")
    yield 0.5


def open_sidebar(area):
    """N, and a click on each tab until it is ours."""
    yield from person.press("n", *person.middle(person.region_of(area, "WINDOW")))
    yield 1.0
    sidebar = person.region_of(area, "UI")
    y = sidebar.y + sidebar.height - 20
    while sidebar.active_panel_category != "Strata" and y > sidebar.y:
        yield from person.click(sidebar.x + sidebar.width - 12, y)
        y -= 25
    yield 0.5


def wait(until, seconds: float = 60.0):
    """Until something is so."""
    started = time.monotonic()
    while not until():
        assert time.monotonic() - started < seconds, "waited in vain"
        yield 0.01


def person_at_work(found: dict):
    """What is done; each value is how many seconds to let Blender work."""
    photographs = Path(PHOTOGRAPHS)
    yield from prepare()
    scene = bpy.context.scene
    scene_id = scene.session_uid
    window, area = person.view_3d()
    yield from open_sidebar(area)
    sidebar = person.region_of(area, "UI")
    found["tab"] = sidebar.active_panel_category
    yield from person.photograph(photographs, "1 panel")
    buttons = yield from person.survey(area, sidebar, 0.6)
    found["buttons"] = sorted(buttons)

    # A value, by dragging it.
    before = scene.strata.soft_shadow.layers
    yield from person.drag(*buttons["strata.soft_shadow.layers"], by_x=60)
    found["layers dragged"] = [before, scene.strata.soft_shadow.layers]
    yield from person.press("ctrl+z", *person.middle(person.region_of(area, "WINDOW")))
    yield 0.5
    scene = bpy.context.scene
    found["layers undone"] = scene.strata.soft_shadow.layers

    # A bake by the button, cancelled.
    yield from person.click(*buttons["strata.bake"])
    yield from wait(lambda: state().share > 0.002)
    found["drawn while baking"] = state().doing
    yield from person.photograph(photographs, "2 baking")
    person.xdotool("key", "Escape")
    pressed = time.monotonic()
    yield from wait(lambda: not state().is_baking)
    found["seconds to cancel"] = time.monotonic() - pressed
    found["images after cancel"] = float_images()

    # And to its end.
    scene.strata.samples, scene.strata.soft_shadow.resolution, scene.strata.soft_shadow.layers = 1, 256, 2
    bpy.ops.ed.undo_push(message="before the bake")
    yield 0.5
    yield from person.click(*buttons["strata.bake"])
    yield from wait(lambda: scene_id in state().reports)
    yield from wait(lambda: not state().is_baking)
    yield 1.0
    found["layers"] = [layer["name"] for layer in state().reports[scene_id]["layers"]]
    found["images"] = float_images()
    found["lights"] = sorted({row.light for row in state().plans[scene_id] if row.light})
    for _ in range(30):  # down to the results
        yield from person.move(*person.middle(sidebar))
        person.xdotool("click", 5)
    yield from person.photograph(photographs, "3 baked")
    yield from person.press("ctrl+z", *person.middle(person.region_of(area, "WINDOW")))
    yield 1.0
    found["images after undo"] = float_images()

    # F12, with the engine.
    scene = bpy.context.scene
    scene.render.engine = "STRATA"
    state().reports.clear()
    scene.strata.samples, scene.strata.probes = 1, 16
    yield 0.5
    yield from person.press("F12", *person.middle(person.region_of(area, "WINDOW")))
    yield from wait(lambda: scene_id in state().reports)
    yield from wait(lambda: not bpy.app.is_job_running("RENDER"))
    yield 1.0
    found["rendered"] = [layer["name"] for layer in state().reports[scene_id]["layers"]]
    yield from person.photograph(photographs, "4 rendered")

    # Saved, opened again.
    scene.strata.samples = 7
    for window in list(bpy.context.window_manager.windows)[1:]:  # where F12 shows its image
        with bpy.context.temp_override(window=window):
            bpy.ops.wm.window_close()
    yield 1.0
    yield from person.press("ctrl+s", 700, 450)
    yield 1.0
    found["is saved"] = not bpy.data.is_dirty
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    yield 2.0
    found["samples after opening"] = bpy.context.scene.strata.samples

    bpy.ops.preferences.addon_disable(module=MODULE)
    yield 1.0
    found["is gone"] = not hasattr(bpy.types.Scene, "strata")
    yield from person.photograph(photographs, "5 disabled")


FOUND = {}
ACTIONS = person_at_work(FOUND)


def act():
    try:
        return next(ACTIONS)
    except StopIteration:
        pass
    except BaseException:
        FOUND["failure"] = traceback.format_exc()
    Path(RESULT).write_text(json.dumps(FOUND, indent=1))
    bpy.ops.wm.quit_blender()
    return None


bpy.context.preferences.view.show_splash = False
bpy.context.preferences.view.render_display_type = "WINDOW"
bpy.app.timers.register(act, first_interval=1.0, persistent=True)
