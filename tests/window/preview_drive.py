"""Inside a Blender with a window: switches the preview on, edits, looks, and writes down what was there.

`blender --python scripts/in_blender.py -- strata.tests.window.preview_drive ZIP SCENE.blend BACKEND
RESULT.json PICTURES`
"""

import json
import sys
import time
from pathlib import Path

import bpy
import gpu
import numpy as np
from strata.tests.window.person import work

ARCHIVE, SCENE, BACKEND, RESULT, PICTURES = sys.argv[sys.argv.index("--") + 1 :]
MODULE = "bl_ext.user_default.strata"
WIDTH, HEIGHT = 240, 135  # of the render, and of the frame in the viewport


def viewports():
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield from ((window, area, region) for region in area.regions if region.type == "WINDOW")


def first():
    return next(viewports())


class Screen:
    """What a region shows, read where Blender's last draw handler runs."""

    def __init__(self):
        self.wanted = None
        self.pixels = None

    def draw(self):
        region = bpy.context.region
        if self.wanted == region.as_pointer():
            box = gpu.state.active_framebuffer_get()
            data = box.read_color(0, 0, region.width, region.height, 4, 0, "FLOAT")
            self.pixels = np.array(data, np.float32).reshape(region.height, region.width, 4)
            self.wanted = None

    def photograph(self, region):
        """A generator: waits for the picture."""
        self.wanted, self.pixels = region.as_pointer(), None
        while self.pixels is None:
            region.tag_redraw()
            yield 0.05
        return self.pixels


SCREEN = Screen()


def on_screen(pixels):
    """What Blender makes of its overlays, (h, w, 4) as their framebuffer has them: decoded by IEC 61966-2-1,
    and a power of 1 / 2.2 of that (colours.py looks at the screen itself)."""
    colour = pixels[..., :3]
    linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return np.concatenate([linear ** (1 / 2.2), pixels[..., 3:]], axis=2)


def settled(preview, region, seconds=60.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        state = preview.state_of(region)
        if state and (state.is_converged or state.message):
            break
        yield 0.05
    else:
        raise TimeoutError("not converged")
    yield 1.5  # and warm


def edited(preview, region, edit):
    """What the next frame ran after an edit: runs by step."""
    before = preview.state_of(region)
    edit()
    region.tag_redraw()
    end = time.monotonic() + 10.0
    while preview.state_of(region) is before and time.monotonic() < end:
        yield 0.0
    ran = {}
    for (step, _instance), (_ms, runs) in preview.state_of(region).steps.items():
        ran[step] = ran.get(step, 0) + runs
    return {} if preview.state_of(region) is before else ran


def blocks(pixels, side=8):
    """Means of square blocks."""
    height, width = (length // side for length in pixels.shape[:2])
    cut = pixels[: height * side, : width * side]
    return cut.reshape(height, side, width, side, -1).mean(axis=(1, 3))


def save(name, pixels):
    image = bpy.data.images.new(name, pixels.shape[1], pixels.shape[0])
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
    image.filepath_raw, image.file_format = str(Path(PICTURES) / name), "PNG"
    image.save()
    bpy.data.images.remove(image)


def person(found):
    """What is done, as a generator; each value is how many seconds to let Blender work."""
    bpy.ops.extensions.package_install_files(repo="user_default", filepath=ARCHIVE, enable_on_install=True)
    preview = sys.modules[f"{MODULE}.addon.preview"]
    control = sys.modules[f"{MODULE}.addon.preview.control"]
    bpy.ops.wm.open_mainfile(filepath=SCENE)
    yield 0.5
    scene = bpy.context.scene
    window, area, region = first()
    space = area.spaces.active
    preview.disable()
    scene.strata.preview.on_opening = space.show_region_ui = False
    bpy.ops.wm.save_mainfile()
    yield 0.5
    space.overlay.show_overlays = space.show_gizmo = False
    space.region_3d.view_perspective = "CAMERA"
    render, settings = scene.render, scene.strata
    render.resolution_x, render.resolution_y, render.resolution_percentage = WIDTH, HEIGHT, 100
    settings.backend, settings.samples = BACKEND, 2
    settings.soft_shadow.method, settings.soft_shadow.resolution = "bitmask", 256
    settings.preview.frame_budget_ms, settings.preview.show_statistics = 1e5, False
    bpy.types.SpaceView3D.draw_handler_add(SCREEN.draw, (), "WINDOW", "POST_PIXEL")
    yield 0.5
    before = yield from SCREEN.photograph(region)

    found["available"] = preview.available()
    preview.enable(scene)
    yield from settled(preview, region)
    pixels = yield from SCREEN.photograph(region)
    save("preview.png", pixels)
    viewport = control._state.viewports[region.as_pointer()]
    assert viewport.picture, viewport.statistics.message
    # Outside the frame everything is as without the preview; inside it is the bake, as Blender would save it.
    place = viewport.picture.place
    left, bottom, right, top = (round(edge) for edge in place)
    changed = np.abs(pixels - before)[..., :3].max(axis=2) > 2 / 255
    changed[bottom - 1 : top + 1, left - 1 : right + 1] = False
    found["changed outside"] = float(changed.mean())
    picture = viewport.picture.pixels
    image = bpy.data.images.new("expected", picture.shape[1], picture.shape[0], float_buffer=True)
    image.pixels.foreach_set(np.ascontiguousarray(picture, np.float32).ravel())
    path = str(Path(PICTURES) / "expected.png")
    image.save_render(path, scene=scene)
    bpy.data.images.remove(image)
    saved = bpy.data.images.load(path)
    saved.colorspace_settings.is_data = True
    numbers = np.empty(saved.size[0] * saved.size[1] * 4, np.float32)
    saved.pixels.foreach_get(numbers)
    expected = numbers.reshape(saved.size[1], saved.size[0], 4)
    inside = on_screen(pixels[bottom:top, left:right])
    # The frame's sides are no whole pixels: the picture's pixels are a little smaller or larger.
    height, width = expected.shape[:2]
    rows = ((np.arange(bottom, top) + 0.5 - place[1]) / (place[3] - place[1]) * height).astype(int)
    columns = ((np.arange(left, right) + 0.5 - place[0]) / (place[2] - place[0]) * width).astype(int)
    chosen = np.ix_(rows.clip(0, height - 1), columns.clip(0, width - 1))
    # Where blocks are smooth: around edges light is blended, which the view transform then bends.
    there = expected[chosen]
    rough = blocks(there * there) - blocks(there) ** 2
    smooth = (blocks(picture[chosen][..., 3:])[..., 0] == 1.0) & (rough.max(axis=2) < 1e-4)
    difference = np.abs(blocks(inside) - blocks(there))[..., :3][smooth]
    found["smooth"] = float(smooth.mean())
    found["brightness"] = [float(difference.mean()), float(np.quantile(difference, 0.95))]
    found["pixel"] = (place[2] - place[0]) / width

    # The map of the noise is on screen in the very colours that it has.
    settings.preview.shows_noise = settings.preview.show_statistics = True
    yield 1.0
    yield from settled(preview, region)
    pixels = yield from SCREEN.photograph(region)
    save("noise_map.png", pixels)
    there = viewport.shown(True).pixels[chosen][..., :3]
    inside = on_screen(pixels[bottom:top, left:right])[..., :3]
    found["noise map"] = float(np.quantile(np.abs(blocks(inside) - blocks(there)), 0.95))
    found["noise map colours"] = len(np.unique(np.round(there * 255).reshape(-1, 3), axis=0))
    settings.preview.shows_noise = settings.preview.show_statistics = False
    yield 1.0
    yield from settled(preview, region)

    light = next(thing for thing in scene.objects if thing.type == "LIGHT")
    found["idle"] = yield from edited(preview, region, lambda: None)

    def move_light():
        light.location.x += 0.05

    bpy.ops.strata.trace_preview()
    found["light"] = yield from edited(preview, region, move_light)
    yield from settled(preview, region)
    trace = Path(PICTURES) / "trace.json"
    bpy.ops.strata.trace_preview(filepath=str(trace))
    told = json.loads(trace.read_text())
    found["traced frames"] = told["otherData"]["frames"]["count"]
    found["traced stages"] = sorted(
        {each["name"] for each in told["traceEvents"] if each.get("cat") == "stage"}
    )
    found["traced steps"] = sorted(
        {each["name"] for each in told["traceEvents"] if each.get("cat") == "node"}
    )

    def move_camera():
        scene.camera.location.x += 0.05

    found["camera"] = yield from edited(preview, region, move_camera)
    yield from settled(preview, region)

    def slide():
        settings.soft_shadow.refinements = 2

    found["slider"] = yield from edited(preview, region, slide)
    yield from settled(preview, region)

    # What the viewport alone hides.
    instances = lambda: len(control._state.shown[region.as_pointer()].outline.instances)  # noqa: E731
    found["instances"] = [instances()]
    mesh = next(thing for thing in scene.objects if thing.type == "MESH")
    for thing in scene.objects:
        thing.select_set(thing == mesh)
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.view3d.localview()
    yield 1.0
    found["instances"].append(instances())
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.view3d.localview()
    yield 1.0
    found["instances"].append(instances())
    mesh.hide_set(True)
    yield 1.0
    found["instances"].append(instances())
    mesh.hide_set(False)
    yield 1.0

    # Undo: the light is where it was, and so is its shadow.
    bpy.ops.ed.undo_push(message="before")
    light = next(thing for thing in scene.objects if thing.type == "LIGHT")
    light.location.x += 1.0
    bpy.ops.ed.undo_push(message="moved")
    yield from settled(preview, region)
    moved = control._state.shown[region.as_pointer()].outline.lights[0].emitter.centre
    bpy.ops.ed.undo()
    yield 0.5
    _window, area, region = first()
    yield from settled(preview, region)
    undone = control._state.shown[region.as_pointer()].outline.lights[0].emitter.centre
    found["undone"] = moved[0] - undone[0]

    # Four viewports in one area, and another window.
    with bpy.context.temp_override(window=window, area=area, region=region):
        area.spaces.active.region_3d.view_perspective = "PERSP"
        bpy.ops.screen.region_quadview()
    yield 1.0
    found["quad"] = sum(preview.state_of(region) is not None for _, _, region in viewports())
    _window, area, region = first()
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.screen.region_quadview()
    yield 1.0
    bpy.ops.wm.window_new_main()
    yield 1.0
    found["windows"] = sum(preview.state_of(region) is not None for _, _, region in viewports())
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[-1]):
        bpy.ops.wm.window_close()
    yield 1.0
    found["windows after"] = len(control._state.viewports)

    preview.disable(bpy.context.scene)
    yield 1.0
    found["left"] = [len(control._state.viewports), len(control._state.sessions), len(control._state.handles)]
    found["running"] = control._state.is_running
    preview.enable(bpy.context.scene)
    yield 0.5
    bpy.ops.wm.open_mainfile(filepath=SCENE)
    yield 1.0
    found["on after load"] = preview.is_on()
    found["done"] = True


work(person, RESULT)
