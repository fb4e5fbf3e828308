"""Inside a Blender with a window: uses Strata as a person would, and writes down what happened.

`blender SCENE.blend --python scripts/in_blender.py -- strata.tests.window.drive OUT.exr PHOTOGRAPHS
RESULT.json`, with the extension installed and the mouse (xdotool) on the same screen.
"""

import sys
import time
from pathlib import Path

import bpy
from strata.tests.window import after_bake, person

OUT, PHOTOGRAPHS, RESULT = sys.argv[sys.argv.index("--") + 1 :]
MODULE = "bl_ext.user_default.strata"
SMALL = (96, 54)
LIGHT = "Sky panel"
LAYER = f"Soft Shadow {LIGHT}"


def state():
    return sys.modules[f"{MODULE}.addon.ui.state"].STATE


def float_images() -> list[str]:
    return sorted(image.name for image in bpy.data.images if image.is_float and image.size[0])


def prepare(found: dict):
    """What is not about Strata: a quick image, a quiet window."""
    found["opens"] = person.opened_plainly(sys.modules[f"{MODULE}.addon.preview"])
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


def told_without_asking(found: dict, photographs: Path):
    """The plan by itself, and what is above everything else, without moving what is below."""
    scene = bpy.context.scene
    watching = sys.modules[f"{MODULE}.addon.ui.watching"]
    # However slow the machine, the scene counts as one that is read again by itself, and soon.
    watching.LONGEST_SECONDS, watching.PAUSES = 60.0, 1.0
    started = time.monotonic()
    yield from person.wait(lambda: scene.session_uid in state().plans)
    found["seconds to plan"] = time.monotonic() - started
    found["lights listed"] = sorted({row.light for row in state().plans[scene.session_uid] if row.light})
    yield from person.photograph(photographs, "1 panel")
    hidden = scene.objects[LIGHT]
    hidden.hide_set(True)
    yield from person.wait(lambda: state().warnings.get(scene.session_uid))
    found["warned"] = state().warnings[scene.session_uid]
    yield from person.photograph(photographs, "1a warned")
    hidden.hide_set(False)
    yield from person.wait(lambda: not state().warnings.get(scene.session_uid))


def read_texts(photographs: Path, area):
    """The preview's lines beside Blender's own, and each without the other."""
    overlay, settings = area.spaces.active.overlay, bpy.context.scene.strata.preview
    overlay.show_overlays = True
    for name, ours, blenders in (("none", 0, 0), ("Blender", 0, 1), ("both", 1, 1), ("Strata", 1, 0)):
        settings.show_statistics = bool(ours)
        overlay.show_text = overlay.show_stats = bool(blenders)
        area.tag_redraw()
        yield from person.photograph(photographs, f"3a text {name}")
    settings.show_statistics, overlay.show_text = False, True


def converged(region):
    """Until the preview's picture is the bake's."""

    def is_converged():
        shown = sys.modules[f"{MODULE}.addon.preview"].state_of(region)
        return shown is not None and shown.is_converged

    yield 1.0  # what was there before the change may be
    yield from person.wait(is_converged, 120.0)
    yield 0.5


def watch_a_light(found: dict, photographs: Path, buttons: dict, area):
    """The preview by its switch, through the camera, while a light is moved by G and the mouse."""
    scene, region, space = bpy.context.scene, person.region_of(area, "WINDOW"), area.spaces.active
    middle = person.middle(region)
    yield from person.press("KP_0", *middle)
    yield 1.0
    space.overlay.show_overlays = space.show_gizmo = False
    scene.strata.samples, scene.strata.soft_shadow.resolution = 2, 256
    scene.strata.preview.layer, scene.strata.preview.show_statistics = LAYER, False
    yield from person.click(*buttons["strata.preview"])
    yield from converged(region)
    found["frame"] = person.frame_on_screen(region, space.region_3d)
    yield from person.photograph(photographs, "2 preview")
    bake_beside(photographs / "before.exr")
    yield 0.5
    yield from switch_effects(photographs, buttons, region)
    scene.strata.preview.layer = LAYER

    light = scene.objects[LIGHT]
    for thing in scene.objects:
        thing.select_set(thing == light)
    bpy.context.view_layer.objects.active = light
    bpy.ops.ed.undo_push(message="a light is selected")
    yield 0.5
    before = light.location.copy()
    yield from person.press("g", *middle)
    for step in range(1, 7):
        person.point_at(middle[0] - 15 * step, middle[1] + 4 * step)
        yield 0.2
    person.xdotool("click", 1)
    yield from converged(region)
    found["light moved"] = (light.location - before).length
    yield from person.photograph(photographs, "3 light moved")
    yield from read_texts(photographs, area)
    bake_beside(photographs / "after.exr")
    yield 0.5
    yield from person.click(*buttons["strata.preview"])
    yield 1.0
    found["preview is off"] = not sys.modules[f"{MODULE}.addon.preview"].is_on()
    yield from person.press("ctrl+z", *middle)
    yield 1.0
    found["light undone"] = (bpy.context.scene.objects[LIGHT].location - before).length
    space.overlay.show_overlays = space.show_gizmo = True
    scene = bpy.context.scene
    scene.strata.samples, scene.strata.soft_shadow.resolution = 4096, 1024
    yield from person.press("KP_0", *middle)
    yield 1.0


def switch_effects(photographs: Path, buttons: dict, region):
    """Fog, then toon over it, by the boxes in their panels, while the preview shows the composite."""
    settings = bpy.context.scene.strata
    fog = settings.volumetric_light
    settings.preview.layer = ""
    fog.use_scene_medium, fog.light_samples, fog.resolution = False, 1, 256
    fog.enabled = False
    yield from converged(region)
    yield from person.photograph(photographs, "2a composite")
    for name, effect in (("2b fog", "volumetric_light"), ("2c toon", "toon")):
        yield from person.click(*buttons[f"strata.{effect}.enabled"])
        assert getattr(settings, effect).enabled, effect
        yield from converged(region)
        yield from person.photograph(photographs, name)
    settings.toon.enabled, fog.use_scene_medium = False, True


def bake_beside(path: Path):
    """The same layers in a file, to compare a photograph with."""
    scene = bpy.context.scene
    probes, save_to = scene.strata.probes, scene.strata.save_to
    scene.strata.probes, scene.strata.save_to = 0, "FILE"
    # About as many pixels as the window shows: both then see the same edges.
    scene.render.resolution_x, scene.render.resolution_y = 576, 324
    bpy.ops.strata.bake(filepath=str(path))
    scene.render.resolution_x, scene.render.resolution_y = SMALL
    scene.strata.probes, scene.strata.save_to = probes, save_to


def person_at_work(found: dict):
    """What is done; each value is how many seconds to let Blender work."""
    photographs = Path(PHOTOGRAPHS)
    yield from prepare(found)
    scene = bpy.context.scene
    scene_id = scene.session_uid
    window, area = person.view_3d()
    yield from open_sidebar(area)
    sidebar = person.region_of(area, "UI")
    found["tab"] = sidebar.active_panel_category
    yield from told_without_asking(found, photographs)
    buttons = yield from person.survey(area, sidebar, 0.6)
    buttons = (yield from person.survey(area, sidebar, 0.3)) | buttons  # the preview's switch is on the left
    left = person.HEADER_BOX / sidebar.width
    buttons = (yield from person.survey(area, sidebar, left)) | buttons  # and so are the effects' boxes
    found["buttons"], found["bake button"] = sorted(buttons), buttons["strata.bake"]

    # A value, by dragging it.
    before = scene.strata.probes
    yield from person.drag(*buttons["strata.probes"], by_x=60)
    found["probes dragged"] = [before, scene.strata.probes]
    yield from person.press("ctrl+z", *person.middle(person.region_of(area, "WINDOW")))
    yield 0.5
    scene = bpy.context.scene
    found["probes undone"] = scene.strata.probes

    yield from watch_a_light(found, photographs, buttons, area)

    # A bake by the button, cancelled.
    scene = bpy.context.scene
    yield from person.click(*buttons["strata.bake"])
    yield from person.wait(lambda: state().share > 0.002)
    found["drawn while baking"] = state().doing
    yield from person.photograph(photographs, "4 baking")
    person.xdotool("key", "Escape")
    pressed = time.monotonic()
    yield from person.wait(lambda: not state().is_baking)
    found["seconds to cancel"] = time.monotonic() - pressed
    yield from after_bake.cancel_by_button(found, state, area, sidebar, buttons["strata.bake"])
    found["images after cancel"] = float_images()

    # And to its end.
    scene.strata.samples, scene.strata.soft_shadow.resolution, scene.strata.soft_shadow.layers = 1, 256, 2
    bpy.ops.ed.undo_push(message="before the bake")
    yield 0.5
    yield from person.click(*buttons["strata.bake"])
    yield from person.wait(lambda: scene_id in state().reports)
    yield from person.wait(lambda: not state().is_baking)
    yield 1.0
    found["layers"] = [layer["name"] for layer in state().reports[scene_id]["layers"]]
    found["images"] = float_images()
    found["lights"] = sorted({row.light for row in state().plans[scene_id] if row.light})
    for _ in range(30):  # down to the results
        yield from person.move(*person.middle(sidebar))
        person.xdotool("click", 5)
    yield from person.photograph(photographs, "5 baked")
    yield from after_bake.look_at_the_result(found, photographs, area, sidebar)
    yield from after_bake.make_a_report(found, photographs, state, area)
    found["images after more bakes"] = float_images()
    found["unsaved images"] = [image.name for image in bpy.data.images if image.is_dirty]
    for _ in range(2):  # the selection, then the bake
        yield from person.press("ctrl+z", *person.middle(person.region_of(area, "WINDOW")))
        yield 1.0
    found["images after undo"] = float_images()

    # F12, with the engine, and Esc.
    scene = bpy.context.scene
    scene.render.engine = "STRATA"
    state().reports.clear()
    scene.strata.samples, scene.strata.probes = 4096, 16
    bpy.context.preferences.view.render_display_type = "NONE"  # the keyboard stays with this window
    yield 0.5
    yield from person.press("F12", *person.middle(person.region_of(area, "WINDOW")))
    yield from person.wait(lambda: bpy.app.is_job_running("RENDER"))
    yield 3.0  # into the samples
    found["renders until Esc"] = bpy.app.is_job_running("RENDER")
    person.xdotool("key", "Escape")
    pressed = time.monotonic()
    yield from person.wait(lambda: not bpy.app.is_job_running("RENDER"))
    found["seconds to cancel a render"] = time.monotonic() - pressed
    found["left of the cancelled render"] = [sorted(state().reports), float_images()]
    bpy.context.preferences.view.render_display_type = "WINDOW"

    # And to its end.
    scene.strata.samples = 1
    yield 0.5
    yield from person.press("F12", *person.middle(person.region_of(area, "WINDOW")))
    yield from person.wait(lambda: scene_id in state().reports)
    yield from person.wait(lambda: not bpy.app.is_job_running("RENDER"))
    yield 1.0
    found["rendered"] = [layer["name"] for layer in state().reports[scene_id]["layers"]]
    yield from person.photograph(photographs, "6 rendered")

    # Saved, opened again.
    bpy.ops.strata.bake()
    scene.strata.samples = 7
    scene.strata.preview.on_opening = True
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
    found["preview after opening"] = sys.modules[f"{MODULE}.addon.preview"].is_on(bpy.context.scene)
    found["images after opening"] = float_images()
    bpy.context.scene.strata.samples = 1
    bpy.ops.strata.bake()

    bpy.ops.preferences.addon_disable(module=MODULE)
    yield 1.0
    found["is gone"] = not hasattr(bpy.types.Scene, "strata")
    yield from person.photograph(photographs, "7 disabled")
    yield from person.press("ctrl+s", 700, 450)
    yield 1.0
    yield from after_bake.quit_by_key(found, RESULT)


bpy.context.preferences.view.render_display_type = "WINDOW"
person.work(person_at_work, RESULT)
