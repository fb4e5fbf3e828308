"""What a person does after a bake, and to stop one; part of drive.py."""

from __future__ import annotations

import atexit
import json
import time
from pathlib import Path

import bpy
from strata.tests.window import person


def find(what: str, area, region, share: float, top: float = 1.0):
    """Where the first button of an operator or a value is, from `top` of a region down."""
    window = bpy.context.window_manager.windows[0]
    x, y = region.x + share * region.width, region.y + top * region.height - person.STEP_PIXELS
    while y > region.y:
        person.point_at(x, y)
        yield person.LOOK_SECONDS
        if person.under_the_mouse(window, area, region) == what:
            return x, y - 2
        y -= person.STEP_PIXELS
    raise AssertionError(f"there is no {what}")


def cancel_by_button(found: dict, state, area, region, place):
    """By the X that is beside the progress, where the bake's button was before."""
    yield from person.click(*place)
    yield from person.wait(lambda: state().share > 0.002)
    window = bpy.context.window_manager.windows[0]
    x, y = region.x + region.width - 10, place[1]
    while person.under_the_mouse(window, area, region) != "strata.cancel_bake":
        assert x > place[0], "there is no button to cancel with"
        x -= person.STEP_PIXELS
        yield from person.move(x, y)
    person.xdotool("click", 1)
    clicked = time.monotonic()
    yield from person.wait(lambda: not state().is_baking)
    found["seconds to cancel by button"] = time.monotonic() - clicked


def look_at_the_result(found: dict, photographs: Path, area, sidebar):
    """Its file in a new window, then a layer in an Image Editor that is open, by clicks into the panel, which
    is scrolled down to its end."""
    manager = bpy.context.window_manager
    place = yield from find("strata.show_baked", area, sidebar, 0.3)
    yield from person.click(*place)
    yield 1.0
    shown = manager.windows[-1].screen.areas[0].spaces.active
    found["shown in a new window"] = [len(manager.windows), shown.image and shown.image.filepath]
    with bpy.context.temp_override(window=manager.windows[-1]):
        bpy.ops.wm.window_close()
    yield 0.5
    editor = max((a for a in manager.windows[0].screen.areas if a != area), key=lambda a: a.width * a.height)
    before, editor.ui_type = editor.ui_type, "IMAGE_EDITOR"
    yield 0.5
    place = yield from find("strata.show_layer", area, sidebar, 0.2)
    yield from person.click(*place)
    yield 0.5
    image = editor.spaces.active.image
    lamp = bpy.context.view_layer.objects.active
    found["layer of a row"] = [image and image.name, lamp.name]
    found["editor"] = [editor.x, editor.y, editor.width, editor.height]
    yield from person.photograph(photographs, "5a shown")
    lamp.rotation_euler.x += 0.5  # the first is the sun
    bpy.ops.strata.bake()
    yield from person.photograph(photographs, "5b filled anew")
    lamp.rotation_euler.x -= 0.5
    editor.ui_type = before
    yield 0.5


def make_a_report(found: dict, photographs: Path, state, area):
    """Error against time, by another Blender, of a small picture; stopped, then to its end."""
    window, render = bpy.context.window_manager.windows[0], bpy.context.scene.render
    before, render.resolution_percentage = render.resolution_percentage, 50
    folder = Path(bpy.data.filepath).parent / "report"
    for stops in (True, False):
        with bpy.context.temp_override(window=window, area=area):
            bpy.ops.strata.report("EXEC_DEFAULT", folder=str(folder), cycles=False)
        yield from person.wait(lambda: "%" in state().report_doing)
        if stops:
            yield from person.photograph(photographs, "5c reporting")
            bpy.ops.strata.cancel_report()
        yield from person.wait(lambda: not state().is_reporting, 300.0)
        found["report stopped" if stops else "report"] = sorted(path.name for path in folder.iterdir())
        folder = folder.with_name("report 2")
    render.resolution_percentage = before


def quit_by_key(found: dict, result: str):
    """As somebody who has saved; what Blender asks then nobody answers."""

    def ended() -> None:
        found["quits without a question"] = True
        Path(result).write_text(json.dumps(found, indent=1))

    atexit.register(ended)
    yield from person.press("ctrl+q", 700, 450)
    yield 10.0
    atexit.unregister(ended)
    found["quits without a question"] = False
