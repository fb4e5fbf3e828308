"""Inside a Blender with a window: how fast the preview follows a light, and how fast EEVEE does.

`blender --window-geometry 0 0 1000 640 --python scripts/in_blender.py -- \
  strata.scripts.bench.preview_window SCENE.blend RESULT.json [eevee|trace]`
"""

import json
import sys
import time
import traceback
from pathlib import Path

import bpy

SCENE, RESULT, *MORE = sys.argv[sys.argv.index("--") + 1 :]
FRAMES = 24
MOVES = {
    "Sun": ("rotation_euler", 0.004),
    "Sky panel": ("location", 0.01),
    "Wall lantern light": ("location", 0.01),
    "Lantern light": ("location", 0.01),
    "Lantern": ("location", 0.01),
    "Key": ("rotation_euler", 0.004),
}
LIGHTS = tuple(MOVES)[:4]  # of the courtyard
OTHERS = {
    "mist": (("soft_shadow", "volumetric_light"), "Lantern"),
    "comic": (("soft_shadow", "toon"), "Key"),
}
DRAWN = []


def imported():
    sys.path.insert(0, str(Path(RESULT).parent))  # the kernels are there
    sys.modules["strata"].register()
    return sys.modules["strata.addon.preview"]


def viewport():
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "VIEW_3D":
            return area, next(region for region in area.regions if region.type == "WINDOW")
    raise LookupError("no 3D View")


def rate():
    return (len(DRAWN) - 1) / (DRAWN[-1] - DRAWN[0])


def drag(name, frames):
    """A light moved once before every redraw."""
    thing, (channel, step) = bpy.data.objects[name], MOVES[name]
    DRAWN.clear()
    while len(DRAWN) < frames:
        before = len(DRAWN)
        getattr(thing, channel)[0] += step
        end = time.monotonic() + 60.0
        while len(DRAWN) == before and time.monotonic() < end:
            yield 0.0


def settled(preview, region):
    """Waits for the still picture: seconds to each number of samples, with the estimated error."""
    started, shown = time.perf_counter(), []
    while time.perf_counter() < started + 120.0:
        state = preview.state_of(region)
        if state and state.samples and (not shown or shown[-1][1] != state.samples):
            shown.append((time.perf_counter() - started, state.samples, state.noise))
        if state and state.is_converged:
            return shown
        yield 0.01
    return shown


def opened(path):
    """The file in one viewport that fills the window, through its camera, without overlays."""
    bpy.ops.wm.open_mainfile(filepath=path)
    yield 1.0
    area, _region = viewport()
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=area):
        bpy.ops.screen.screen_full_area(use_hide_panels=True)
    yield 1.0
    area, region = viewport()
    space = area.spaces.active
    space.overlay.show_overlays = space.show_gizmo = space.show_region_header = False
    space.show_region_toolbar = space.show_region_ui = False
    space.region_3d.view_perspective = "PERSP"
    space.region_3d.view_matrix = bpy.context.scene.camera.matrix_world.inverted()
    yield 1.0
    return region, space


def person(found):
    region, space = yield from opened(SCENE)
    bpy.types.SpaceView3D.draw_handler_add(
        lambda: DRAWN.append(time.perf_counter()), (), "WINDOW", "POST_PIXEL"
    )
    yield 1.0
    found["size"] = [region.width, region.height]
    if "eevee" in MORE:
        yield from eevee(found, space, region)
        return
    preview = imported()
    scene = bpy.context.scene
    if "trace" in MORE:
        yield from trace(preview, scene, space, region)
        return
    for _ in range(2):  # the first ones still smooth edges
        DRAWN.clear()
        while len(DRAWN) < FRAMES:
            region.tag_redraw()
            yield 0.0
    found["alone"] = rate()
    yield from drag("Sun", FRAMES)
    found["alone dragged"] = rate()

    # Over Blender's own picture.
    started = time.perf_counter()
    preview.enable(scene)
    while not ((state := preview.state_of(region)) and state.frame_ms):
        yield 0.0
    found["first"] = time.perf_counter() - started
    found["first still"] = yield from settled(preview, region)
    yield 4.0  # warm
    found["solid"] = {}
    for name in LIGHTS:
        yield from drag(name, FRAMES)
        found["solid"][name] = rate()
    preview.disable(scene)

    # As the engine of the rendered viewport, where Blender draws nothing else.
    scene.render.engine, space.shading.type = "STRATA", "RENDERED"
    yield 1.0
    yield from settled(preview, region)
    yield 4.0
    found["lights"] = {}
    for name in LIGHTS:
        yield from drag(name, FRAMES)
        state = preview.state_of(region)
        found["lights"][name] = {
            "rate": rate(),
            "frame_ms": state.frame_ms,
            "steps_ms": sum(ms for ms, _runs in state.steps.values()),
            "scale": state.scale,
            "map_share": state.map_share,
            "nodes": state.ran,
            "error": state.noise,
        }
        found["lights"][name]["still"] = yield from settled(preview, region)
        yield 2.0
    settings = scene.strata.soft_shadow  # the effect that the table is about
    sliders = []
    for value in (2, 1):
        before = preview.state_of(region)
        settings.refinements = value
        region.tag_redraw()
        while (state := preview.state_of(region)) is before:
            yield 0.0
        sliders.append((state.frame_ms, sum(ms for ms, _runs in state.steps.values()), state.ran))
        yield from settled(preview, region)
        yield 3.0
    found["slider"] = sliders
    found["others"] = {}
    for name, (effects, thing) in OTHERS.items():
        region, space = yield from opened(str(Path(SCENE).with_name(f"{name}.blend")))
        scene = bpy.context.scene
        preview.disable(scene)  # which the file switches on
        for effect in ("soft_shadow", "volumetric_light", "toon"):
            getattr(scene.strata, effect).enabled = effect in effects
        scene.strata.samples = 2
        scene.render.engine, space.shading.type = "STRATA", "RENDERED"
        yield 1.0
        yield from settled(preview, region)
        yield 4.0
        yield from drag(thing, FRAMES)
        state = preview.state_of(region)
        found["others"][name] = {
            "light": thing,
            "effects": effects,
            "rate": rate(),
            "frame_ms": state.frame_ms,
            "scale": state.scale,
            "still": (yield from settled(preview, region)),
        }


def trace(preview, scene, space, region):
    """Of drags, beside the result."""
    scene.render.engine, space.shading.type = "STRATA", "RENDERED"
    yield 1.0
    yield from settled(preview, region)
    for name in LIGHTS:  # warm, and at their scales
        yield from drag(name, FRAMES // 2)
        yield 2.0
    bpy.ops.strata.trace_preview()
    for name in LIGHTS:
        yield from drag(name, FRAMES)
        yield 2.0
    bpy.ops.strata.trace_preview(filepath=str(Path(RESULT).with_name("trace.json")))


def eevee(found, space, region):
    scene = bpy.context.scene
    scene.render.engine = "BLENDER_EEVEE"
    space.shading.type = "RENDERED"
    found["samples"] = scene.eevee.taa_samples

    def still(quiet):
        while not DRAWN or time.perf_counter() - DRAWN[-1] < quiet:
            yield 0.2

    yield from still(20.0)  # shaders are compiled meanwhile
    yield from drag("Sun", 3)
    yield from still(6.0)
    yield from drag("Sun", 8)
    found["eevee rate"] = rate()
    started = DRAWN[-1]
    DRAWN.clear()
    yield from still(6.0)
    found["eevee still"] = [DRAWN[-1] - started, len(DRAWN)]


FOUND = {}
ACTIONS = person(FOUND)


def act():
    try:
        wait = next(ACTIONS)
        Path(RESULT).write_text(json.dumps(FOUND))  # so that nothing is lost if it takes too long
        return wait
    except StopIteration:
        pass
    except BaseException:
        FOUND["failure"] = traceback.format_exc()
    Path(RESULT).write_text(json.dumps(FOUND))
    bpy.ops.wm.quit_blender()
    return None


bpy.context.preferences.view.show_splash = False
bpy.app.timers.register(act, first_interval=1.0, persistent=True)
