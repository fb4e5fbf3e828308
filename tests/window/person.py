"""A person at a Blender window: a real mouse and a real keyboard (xdotool), eyes (ImageMagick's import).

To be imported inside Blender. Everything is a generator that yields how many seconds to let Blender work.
"""

import json
import subprocess
import time
import traceback
from pathlib import Path

import bpy
from bpy_extras.view3d_utils import location_3d_to_region_2d

STEP_PIXELS = 7  # between two looks at what is under the mouse
LOOK_SECONDS = 0.06
HEADER_BOX = 44  # pixels from a sidebar's left to the middle of a box in a panel's header


def view_3d():
    """The window and the area of its largest 3D View."""
    window = bpy.context.window_manager.windows[0]
    areas = [area for area in window.screen.areas if area.type == "VIEW_3D"]
    return window, max(areas, key=lambda area: area.width * area.height)


def opened_plainly(preview) -> list:
    """How the file opened: its view, whether the sidebar is there, and whether the preview is on. Then as
    Blender's own startup file opens, with nothing of that. `preview`: Strata's module."""
    space = view_3d()[1].spaces.active
    found = [space.region_3d.view_perspective, space.show_region_ui, preview.is_on()]
    preview.disable()
    bpy.context.scene.strata.preview.on_opening = False
    space.region_3d.view_perspective, space.show_region_ui = "PERSP", False
    return found


def region_of(area, kind: str):
    return next(region for region in area.regions if region.type == kind)


def xdotool(*words) -> None:
    subprocess.run(["xdotool", *map(str, words)], check=True)


def point_at(x: float, y: float) -> None:
    """In Blender's window coordinates, from the bottom left."""
    window = bpy.context.window_manager.windows[0]
    xdotool("mousemove", round(window.x + x), round(window.height - y))


def move(x: float, y: float):
    point_at(x, y)
    yield 0.15


def click(x: float, y: float):
    yield from move(x, y)
    yield 0.25
    xdotool("click", 1)
    yield 0.3


def press(key: str, x: float, y: float):
    """A key, with the mouse there."""
    yield from move(x, y)
    xdotool("key", key)
    yield 0.4


def drag(x: float, y: float, by_x: float, by_y: float = 0.0, steps: int = 10):
    yield from move(x, y)
    yield 0.25
    xdotool("mousedown", 1)
    yield 0.1
    for step in range(1, steps + 1):
        point_at(x + by_x * step / steps, y + by_y * step / steps)
        yield 0.05
    xdotool("mouseup", 1)
    yield 0.3


def middle(region) -> tuple[float, float]:
    return region.x + 0.5 * region.width, region.y + 0.5 * region.height


def under_the_mouse(window, area, region) -> str:
    """What the button there is of: a data path such as `strata.samples`, an operator such as `strata.bake`,
    or nothing."""
    manager = bpy.context.window_manager
    manager.clipboard = ""
    with bpy.context.temp_override(window=window, area=area, region=region):
        for copy in (bpy.ops.ui.copy_data_path_button, bpy.ops.ui.copy_python_command_button):
            if copy.poll():
                try:
                    copy()
                except RuntimeError:  # a button without one
                    continue
                if manager.clipboard:
                    break
    text = manager.clipboard
    return text.removeprefix("bpy.ops.").partition("(")[0]


def survey(area, region, share: float = 0.5):
    """Moves the mouse down a region and returns where its buttons are: centres by what they are of."""
    window = bpy.context.window_manager.windows[0]
    seen: dict[str, list[float]] = {}
    x = region.x + share * region.width
    y = region.y + region.height - STEP_PIXELS
    while y > region.y:
        point_at(x, y)
        yield LOOK_SECONDS
        if what := under_the_mouse(window, area, region):
            seen.setdefault(what, []).append(y)
        y -= STEP_PIXELS
    return {what: (x, 0.5 * (min(ys) + max(ys))) for what, ys in seen.items()}


def wait(until, seconds: float = 60.0):
    """Until something is so."""
    started = time.monotonic()
    while not until():
        assert time.monotonic() - started < seconds, "waited in vain"
        yield 0.01


def frame_on_screen(region, region_3d) -> tuple[float, float, float, float]:
    """The camera's frame in pixels of the photograph: left, top, right, bottom."""
    scene = bpy.context.scene
    matrix = scene.camera.matrix_world
    corners = [matrix @ corner for corner in scene.camera.data.view_frame(scene=scene)]
    places = [location_3d_to_region_2d(region, region_3d, corner) for corner in corners]
    window = bpy.context.window_manager.windows[0]
    left, right = (window.x + region.x + choose(x for x, _ in places) for choose in (min, max))
    bottom, top = (window.height - region.y - choose(y for _, y in places) for choose in (min, max))
    return left, top, right, bottom


def photograph(folder: Path, name: str):
    yield 0.5
    subprocess.run(["import", "-window", "root", str(folder / f"{name}.png")], check=True)


def work(actions, result: str) -> None:
    """Does `actions(found)`, a generator, once Blender's window is there; then writes what it found to the
    file `result`, or what went wrong, and ends Blender."""
    found: dict = {}
    going = actions(found)

    def act():
        try:
            return next(going)
        except StopIteration:
            pass
        except BaseException:
            found["failure"] = traceback.format_exc()
        Path(result).write_text(json.dumps(found, indent=1))
        bpy.ops.wm.quit_blender()
        return None

    bpy.context.preferences.view.show_splash = False
    bpy.app.timers.register(act, first_interval=1.0, persistent=True)
