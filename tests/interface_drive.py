"""Inside a Blender with a window: uses the sidebar as a person would, and writes down what happened.

`blender --enable-event-simulate --python interface_drive.py -- ZIP SCENE.blend OUT.exr RESULT.json`
"""

import json
import sys
import time
import traceback

import bpy

ARCHIVE, SCENE, OUT, RESULT = sys.argv[sys.argv.index("--") + 1 :]
MODULE = "bl_ext.user_default.strata"


def view_3d():
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                return window, area
    raise LookupError("no 3D View")


def in_view(operator, *words):
    window, area = view_3d()
    with bpy.context.temp_override(window=window, area=area):
        return operator(*words)


def person():
    """What is done, as a generator; each value is how many seconds to let Blender work."""
    bpy.ops.extensions.package_install_files(repo="user_default", filepath=ARCHIVE, enable_on_install=True)
    bpy.ops.wm.open_mainfile(filepath=SCENE)
    yield 0.5
    state = sys.modules[f"{MODULE}.addon.ui.state"].STATE
    window, area = view_3d()
    area.spaces.active.show_region_ui = True
    yield 1.0  # the region appears
    sidebar = next(region for region in area.regions if region.type == "UI")
    sidebar.active_panel_category = "Strata"
    render, settings = bpy.context.scene.render, bpy.context.scene.strata
    render.resolution_x, render.resolution_y, render.resolution_percentage = 96, 54, 100
    settings.backend, settings.samples, settings.probes, settings.output = "cpu", 4096, 16, OUT
    yield 0.5

    in_view(bpy.ops.strata.plan)
    yield 0.5
    scene = bpy.context.scene.session_uid
    found = {"plan": [[row.light, row.what, row.reason] for row in state.plans[scene]]}

    in_view(bpy.ops.strata.bake, "INVOKE_DEFAULT")
    found["started"] = state.is_baking
    while state.share < 0.002:
        yield 0.05
    found["drawn while baking"] = state.doing
    pressed = time.monotonic()
    window.event_simulate(type="ESC", value="PRESS", x=area.x + 50, y=area.y + 50)
    while state.is_baking:
        yield 0.01
    found["seconds to cancel"] = time.monotonic() - pressed
    found["images after cancel"] = [image.name for image in bpy.data.images if image.is_float]

    settings.samples, settings.soft_shadow.resolution = 1, 256
    in_view(bpy.ops.strata.bake, "INVOKE_DEFAULT")
    while state.is_baking:
        yield 0.05
    yield 0.5  # the result is drawn
    found["images"] = sorted(image.name for image in bpy.data.images if image.is_float and image.size[0])
    found["layers"] = [layer["name"] for layer in state.reports[scene]["layers"]]
    with open(RESULT, "w") as file:
        json.dump(found, file)


ACTIONS = person()


def act():
    try:
        return next(ACTIONS)
    except StopIteration:
        pass
    except BaseException:
        traceback.print_exc()
    bpy.ops.wm.quit_blender()
    return None


bpy.context.preferences.view.show_splash = False
bpy.app.timers.register(act, first_interval=1.0, persistent=True)
