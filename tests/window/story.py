"""Inside a Blender with a window: an artist's first ten minutes, from the startup file on, as the tutorial
(docs/tutorial.md) tells them.

`blender --python scripts/in_blender.py -- strata.tests.window.story PART FOLDER PHOTOGRAPHS RESULT.json`,
with the extension installed and the mouse (xdotool) on the same screen. PART is `first`, or `imported`: a
scene as it comes out of a download, which is open then (imported_scene.py). They are two sessions, since
Mesa's Vulkan in software ends Blender after some hundred redraws of its window: each takes some of the
mappings that a process may have, for good.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np
from strata.tests.window import person

PART, FOLDER, PHOTOGRAPHS, RESULT = sys.argv[sys.argv.index("--") + 1 :]
MODULE = "bl_ext.user_default.strata"
SIZE = (480, 270)
LAYER = "Soft Shadow Light"


def module(name: str):
    return sys.modules[f"{MODULE}.addon.{name}"]


def state():
    return module("ui.state").STATE


def images() -> list[str]:
    """Names of the layers' images."""
    return sorted(image.name for image in bpy.data.images if image.name.startswith("Soft Shadow"))


def pixels(image: bpy.types.Image) -> np.ndarray:
    found = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    image.pixels.foreach_get(found)
    return found.reshape(image.size[1], image.size[0], image.channels)


class Artist:
    """Where things are in the window, and what has been seen."""

    def __init__(self, found: dict):
        self.found, self.photographs = found, Path(PHOTOGRAPHS)
        self.window, self.area = person.view_3d()

    @property
    def view(self):
        return person.region_of(self.area, "WINDOW")

    @property
    def sidebar(self):
        return person.region_of(self.area, "UI")

    def photograph(self, name: str, turns: int = 0):
        """With the sidebar scrolled down so far, and the mouse where it has nothing to explain."""
        yield from self.scroll(5, turns)
        view = self.view
        yield from person.move(view.x + 0.2 * view.width, view.y + 0.2 * view.height)
        yield from person.photograph(self.photographs, name)
        yield from self.scroll(4, turns)

    def press(self, key: str):
        yield from person.press(key, *person.middle(self.view))

    def open_sidebar(self):
        """N, and a click on each tab until it is ours."""
        yield from self.press("n")
        yield 1.0
        sidebar = self.sidebar
        y = sidebar.y + sidebar.height - 20
        while sidebar.active_panel_category != "Strata" and y > sidebar.y:
            yield from person.click(sidebar.x + sidebar.width - 12, y)
            y -= 25
        yield 0.5

    def click(self, button: str, share: float = 0.6):
        """On the button of an operator or a property, looked for anew, as panels grow; scrolls down to it,
        and up again. `share` of the sidebar's width, from its left."""
        for turns in (0, 12, 24):
            yield from self.scroll(5, 12 if turns else 0)
            places = yield from person.survey(self.area, self.sidebar, share)
            if button in places:
                yield from person.click(*places[button])
                yield from self.scroll(4, turns)
                return
        raise AssertionError(f"no button of {button} in the sidebar")

    def scroll(self, wheel: int, turns: int):
        """The sidebar: `wheel` 5 is down, 4 is up."""
        yield from person.move(*person.middle(self.sidebar))
        for _ in range(turns):
            person.xdotool("click", wheel)
            yield 0.05

    def bake(self):
        """By the button, to its end; the report."""
        scene = bpy.context.scene.session_uid
        state().reports.pop(scene, None)
        yield from self.click("strata.bake")
        yield from person.wait(lambda: scene in state().reports, 120.0)
        yield from person.wait(lambda: not state().is_baking)
        yield 1.0
        return state().reports[scene]

    def converged(self):
        """Until the preview's picture is the bake's."""

        def is_converged():
            assert not module("preview").failure(), module("preview").failure()
            shown = module("preview").state_of(self.view)
            return shown is not None and shown.is_converged

        yield 1.5  # what was there before the change may be
        yield from person.wait(is_converged, 120.0)
        yield 0.5

    def render(self, seconds: float = 120.0):
        """F12 in the display that is set, to its end; the picture as it would be saved."""
        done, told = [], bpy.app.handlers.render_complete
        noted = lambda *_: done.append(True)  # noqa: E731
        told.append(noted)
        yield from self.press("F12")
        yield from person.wait(lambda: done and not is_rendering(), seconds)
        told.remove(noted)
        yield 1.0

    def rendered(self) -> np.ndarray:
        """What F12 left, (height, width, 4), with the compositor's work and the view transform, 0 to 1."""
        path = Path(FOLDER, "rendered.png")
        bpy.data.images["Render Result"].save_render(str(path))
        image = bpy.data.images.load(str(path))
        try:
            return pixels(image)
        finally:
            bpy.data.images.remove(image)
            path.unlink()

    def back_to_one_window(self):
        for window in list(bpy.context.window_manager.windows)[1:]:
            with bpy.context.temp_override(window=window):
                bpy.ops.wm.window_close()
        yield 1.0


def is_rendering() -> bool:
    return bpy.app.is_job_running("RENDER")


def first_shadow(artist: Artist):
    """The startup file as it is: one click."""
    scene = bpy.context.scene
    yield from artist.open_sidebar()
    artist.found["tab"] = artist.sidebar.active_panel_category
    yield 2.0  # what the panel finds out by itself
    yield from artist.photograph("1 sidebar")
    report = yield from artist.bake()
    artist.found["first bake"] = [[layer["name"] for layer in report["layers"]], images()]
    # A ground, and a smaller picture: what follows is done several times.
    bpy.ops.mesh.primitive_plane_add(size=20.0, location=(0.0, 0.0, -1.0))
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    bpy.context.view_layer.objects.active = scene.objects["Cube"]
    scene.objects["Plane"].select_set(False)
    bpy.ops.ed.undo_push(message="a ground")
    yield 0.5
    yield from artist.bake()
    artist.found["second bake"] = images()
    artist.found["darkest"] = float(pixels(bpy.data.images[LAYER])[..., 0].min())
    yield from artist.photograph("2 baked", turns=24)


def preview(artist: Artist):
    """The preview in Solid shading through the camera; then from within Edit Mode, without a modifier and
    with one."""
    area, found = artist.area, artist.found
    yield from artist.press("KP_0")
    yield 1.0
    yield from artist.click("strata.preview", 0.3)
    yield from artist.converged()
    yield from artist.photograph("3 preview")
    space = area.spaces.active
    found["frame"] = person.frame_on_screen(artist.view, space.region_3d)
    cube = bpy.context.scene.objects["Cube"]
    space.overlay.show_overlays = space.show_gizmo = False
    for name in ("plain", "subdivided"):
        if name == "subdivided":
            cube.modifiers.new("Subdivision", "SUBSURF").render_levels = 1
            cube.modifiers[0].levels = 1
        yield from artist.converged()
        yield from artist.photograph(f"3 {name} object mode")
        yield from artist.press("Tab")
        assert bpy.context.mode == "EDIT_MESH"
        yield from artist.converged()
        yield from artist.photograph(f"3 {name} edit mode")
        yield from artist.press("Tab")
    cube.modifiers.clear()
    space.overlay.show_overlays = space.show_gizmo = True
    yield from artist.click("strata.preview", 0.3)
    yield 0.5


def engine(artist: Artist):
    """F12 with the engine in Blender's default display: cancelled, and to its end; Rendered shading."""
    scene, found = bpy.context.scene, artist.found
    scene.render.engine = "STRATA"
    scene.strata.samples = 4096
    yield 1.0
    yield from artist.press("F12")
    yield from person.wait(is_rendering)
    yield 3.0
    found["renders until Esc"] = is_rendering()
    person.xdotool("key", "Escape")
    yield from person.wait(lambda: not is_rendering())  # how soon, test_interface.py asks
    yield from artist.back_to_one_window()
    scene.strata.samples = 8
    yield from artist.render()
    yield from artist.photograph("4 engine")
    found["engine"] = float(artist.rendered()[..., :3].mean())
    yield from artist.back_to_one_window()
    space = artist.area.spaces.active
    space.shading.type = "RENDERED"
    yield 6.0
    yield from artist.photograph("4 rendered shading")
    space.shading.type = "SOLID"
    yield 0.5


def compositor(artist: Artist):
    """Cycles, first with its own shadows, then with those of the button's nodes."""
    scene, found = bpy.context.scene, artist.found
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", 64, False
    yield from artist.render()
    own = artist.rendered()
    yield from artist.back_to_one_window()
    report = yield from artist.bake()
    found["layers"] = [layer["name"] for layer in report["layers"]]
    found["files"] = sorted(path.name for path in Path(FOLDER).glob("*.exr"))
    bpy.ops.ed.undo_push(message="before the nodes")
    yield from artist.click("strata.build_compositor")
    yield 1.0
    found["own shadow is off"] = not scene.objects["Light"].data.use_shadow
    yield from artist.render()
    yield from artist.photograph("5 compositor", turns=24)
    composited = artist.rendered()
    found["own and composited"] = [float(own[..., :3].mean()), float(composited[..., :3].mean())]
    found["apart"] = float(np.abs(own - composited)[..., :3].mean())
    yield from artist.back_to_one_window()
    yield from artist.bake()  # the marked lamp is baked all the same
    found["layers after"] = images()
    yield from artist.press("ctrl+z")  # the bake
    yield from artist.press("ctrl+z")  # the nodes
    yield 1.0
    found["own shadow is back"] = bpy.context.scene.objects["Light"].data.use_shadow


def quit_blender(artist: Artist):
    """Saved, and Ctrl-Q: Blender asks nothing and is gone."""
    yield from artist.bake()
    artist.found["last images"] = images()
    bpy.ops.wm.save_mainfile()
    yield 1.0
    artist.found["modified images"] = [image.name for image in bpy.data.images if image.is_dirty]
    artist.found["quit asks"] = False
    Path(RESULT).write_text(json.dumps(artist.found, indent=1))
    yield from artist.press("ctrl+q")
    yield 3.0
    yield from artist.photograph("6 quit asks")
    artist.found["quit asks"] = True


def imported(found: dict):
    """A scene as it comes out of a download: looked at, baked, rendered."""
    artist = Artist(found)
    scene = bpy.context.scene
    scene.strata.samples = 2
    yield from artist.open_sidebar()
    yield from artist.press("KP_0")
    yield from artist.click("strata.preview", 0.3)
    yield from artist.converged()
    yield 2.0  # what the panel finds out by itself
    yield from artist.photograph("6 imported")
    report = yield from artist.bake()
    found["layers"] = [layer["name"] for layer in report["layers"]]
    found["warnings"] = report["warnings"]
    scene.render.engine = "STRATA"
    yield from artist.render()
    yield from artist.photograph("7 imported F12")
    found["spread"] = float(artist.rendered()[..., :3].std())


def first(found: dict):
    artist = Artist(found)
    yield from first_shadow(artist)
    yield from preview(artist)
    bpy.ops.wm.save_as_mainfile(filepath=str(Path(FOLDER, "first.blend")))
    yield 1.0
    yield from engine(artist)
    yield from compositor(artist)
    yield from quit_blender(artist)


bpy.context.preferences.view.render_display_type = "WINDOW"
person.work({"first": first, "imported": imported}[PART], RESULT)
