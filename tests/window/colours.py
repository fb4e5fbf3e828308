"""Inside a Blender with a window: shows a chart of colours in every way that there is, with every view
transform, and writes down where the chart is on the photographs.

`blender --python scripts/in_blender.py -- strata.tests.window.colours PHOTOGRAPHS RESULT.json`, with
the extension installed.
"""

import sys
from pathlib import Path

import bpy
from strata.tests.window import person

PHOTOGRAPHS, RESULT = sys.argv[sys.argv.index("--") + 1 :]
COLUMNS, ROWS = 12, 6
HUES = (
    (1.0, 1.0, 1.0),
    (1.0, 0.2, 0.1),
    (0.2, 1.0, 0.15),
    (0.1, 0.25, 1.0),
    (1.0, 0.8, 0.1),
    (0.5, 0.3, 0.2),
)
# Beside every view transform with nothing else: what else the scene's colour management has.
OTHERS = {
    "look": {"view_transform": "AgX", "look": "AgX - Punchy"},
    "exposure": {"view_transform": "AgX", "exposure": 1.5},
    "gamma": {"view_transform": "Standard", "gamma": 1.4},
}


def preview():
    return sys.modules["bl_ext.user_default.strata.addon.preview"]


def chart():
    """Squares that glow, a hue for each row and from 1/1024 to 16 from the left to the right, before an
    orthographic camera whose frame they fill; a lamp, since without one there is nothing to bake."""
    person.opened_plainly(preview())
    scene = bpy.context.scene
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    for row in range(ROWS):
        for column in range(COLUMNS):
            x, y = column - 0.5 * (COLUMNS - 1), row - 0.5 * (ROWS - 1)
            bpy.ops.mesh.primitive_plane_add(size=1.0, location=(x, y, 0.0))
            material = bpy.data.materials.new("Square")
            shader = material.node_tree.nodes["Principled BSDF"]
            shader.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
            shader.inputs["Emission Color"].default_value = (*HUES[row], 1.0)
            shader.inputs["Emission Strength"].default_value = 2.0 ** (14.0 * column / (COLUMNS - 1) - 10.0)
            bpy.context.object.data.materials.append(material)
    bpy.ops.object.light_add(type="SUN", location=(0.0, 0.0, 5.0))
    bpy.ops.object.camera_add(location=(0.0, 0.0, 5.0))
    scene.camera = bpy.context.object
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", COLUMNS
    render = scene.render
    render.engine = "STRATA"
    render.resolution_x, render.resolution_y, render.resolution_percentage = 20 * COLUMNS, 20 * ROWS, 100
    render.dither_intensity = 0.0
    scene.strata.backend, scene.strata.samples, scene.strata.probes = "cpu", 1, 0
    scene.strata.preview.show_statistics = False


def manage(values: dict):
    """Sets the scene's colour management."""
    view = bpy.context.scene.view_settings
    values = {"look": "None", "exposure": 0.0, "gamma": 1.0, **values}
    view.view_transform = values.pop("view_transform")
    for name, value in values.items():
        setattr(view, name, value)


def transforms() -> list[str]:
    """Of this Blender's colour configuration, for an sRGB display."""
    try:
        bpy.context.scene.view_settings.view_transform = ""
    except TypeError as error:  # the only one to tell: an enumeration made at runtime
        return str(error).partition("(")[2].split("'")[1::2]
    raise AssertionError("an empty name is a view transform")


def go(found: dict):
    chart()
    scene = bpy.context.scene
    _window, area = person.view_3d()
    region, space = person.region_of(area, "WINDOW"), area.spaces.active
    space.overlay.show_overlays = space.show_gizmo = False
    space.show_region_header = space.show_region_toolbar = space.show_region_ui = False
    space.region_3d.view_perspective = "CAMERA"
    yield 1.0
    settings = {name: {"view_transform": name} for name in transforms()} | OTHERS
    found["settings"] = list(settings)
    found["squares"] = COLUMNS, ROWS
    bpy.ops.render.render()
    folder = Path(PHOTOGRAPHS)
    for name, values in settings.items():
        manage(values)
        bpy.data.images["Render Result"].save_render(str(folder / f"{name} F12.png"), scene=scene)
    preview().enable(scene)
    for shading in ("MATERIAL", "SOLID", "RENDERED"):
        space.shading.type = shading
        for name, values in settings.items():
            if shading == "MATERIAL" and name != "exposure":  # drawn as in SOLID
                continue
            manage(values)
            region.tag_redraw()
            yield 0.5
            yield from person.wait(lambda: preview().state_of(region).is_converged)
            yield from person.photograph(folder, f"{name} {shading}")
    found["frame"] = person.frame_on_screen(region, space.region_3d)


person.work(go, RESULT)
