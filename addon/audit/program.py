"""Renders what an audit asks for. A program of its own, run by a Blender of its own, so that nothing of the
scene that somebody works on is touched: `program.py REQUEST.json`, written by audit.py. Imports nothing of
Strata's: all that is known of the scene here is what Blender knows.

A picture of every N-th pixel is N times smaller, with a pixel filter that is N times narrower, so that each
of its pixels has the footprint of a whole one. Writes one OpenEXR file a render, `<number>.exr`, not
compressed.
"""

import json
import sys
from pathlib import Path

import bpy

PASSES = {
    "surface": ("use_pass_diffuse_direct", "use_pass_diffuse_color"),
    "airlight": (),
}


def main(path: str) -> None:
    request = json.loads(Path(path).read_text(encoding="utf-8"))
    scene, view_layer = opened(request)
    lamps = {item.name_full: item for item in bpy.data.objects if item.type == "LIGHT"}
    data = {name: item.data for name, item in lamps.items()}
    black = bpy.data.lights.new("black", "POINT")
    black.energy = 0.0
    for item in lamps.values():
        item.data = black
    for number, render in enumerate(request["renders"]):
        lamp = lamps[render["lamp"]]
        lamp.data = data[render["lamp"]]
        lamp.visible_camera = False
        lamp.data.use_shadow = render["shadow"]
        only(scene, view_layer, render["of"], request["media"])
        scene.cycles.seed = render["seed"]
        scene.render.filepath = str(Path(request["folder"]) / f"{number}.exr")
        bpy.ops.render.render(write_still=True, scene=scene.name)
        lamp.data = black
        print(f"rendered {number}", flush=True)


def opened(request: dict) -> tuple:
    """The scene and its view layer, at the frame, as Cycles is to render them."""
    bpy.ops.wm.open_mainfile(filepath=request["file"], load_ui=False, use_scripts=request["scripts"])
    if not hasattr(bpy.types.Scene, "cycles"):
        import addon_utils

        addon_utils.enable("cycles")
    scene = next(each for each in bpy.data.scenes if each.name_full == request["scene"])
    view_layer = scene.view_layers[request["view_layer"]]
    scene.frame_set(request["frame"])
    set_up(scene, view_layer, request)
    return scene, view_layer


def set_up(scene, view_layer, request: dict) -> None:
    """Cycles takes all samples asked for and changes none; light goes straight from a lamp to a surface."""
    values = {
        scene.render: {
            "engine": "CYCLES",
            "resolution_x": request["size"][0],
            "resolution_y": request["size"][1],
            "resolution_percentage": 100,
            "pixel_aspect_x": request["pixel_aspect"][0],
            "pixel_aspect_y": request["pixel_aspect"][1],
            "use_border": False,
            "use_compositing": False,
            "use_sequencer": False,
            "use_multiview": False,
            "use_persistent_data": True,
            "use_file_extension": False,
        },
        scene.cycles: {
            "device": "CPU",
            "samples": request["samples"],
            "use_animated_seed": False,
            "use_adaptive_sampling": False,
            "use_denoising": False,
            "use_light_tree": False,
            "light_sampling_threshold": 0.0,
            "sample_clamp_direct": 0.0,
            "max_bounces": 0,
            "min_light_bounces": 0,
            "volume_bounces": 0,
            "use_fast_gi": False,
            "pixel_filter_type": request["filter"]["kind"],
            "filter_width": request["filter"]["width"],
            "dicing_rate": scene.cycles.dicing_rate * request["dicing"],
            "time_limit": 0.0,
        },
        scene.render.image_settings: {
            "media_type": "MULTI_LAYER_IMAGE",
            "file_format": "OPEN_EXR_MULTILAYER",
            "color_depth": "32",
            "exr_codec": "NONE",
        },
        view_layer: {"use_pass_combined": True, "samples": 0, "use": True},
    }
    for owner, settings in values.items():
        for name, value in settings.items():
            setattr(owner, name, value)
    for other in scene.view_layers:
        other.use = other == view_layer
    scene.timeline_markers.clear()  # they would bring back their cameras
    scene.camera = camera_of(scene, request["camera"])
    for material in bpy.data.materials:
        material.cycles.emission_sampling = "NONE"
    trees = [material.node_tree for material in bpy.data.materials] + list(bpy.data.node_groups)
    for tree in filter(None, trees):
        darken(tree)
    if scene.world is not None:
        without_light(scene.world)


def camera_of(scene, asked: dict):
    """The scene's, which moves as it does, with the window of what is asked for."""
    camera = bpy.data.objects[asked["asked"]] if asked["asked"] else scene.camera
    if camera.name != asked["name"]:
        raise SystemExit(f"the scene's camera is '{camera.name}' here, not '{asked['name']}'")
    camera = camera.copy()
    camera.data = camera.data.copy()
    camera.data.animation_data_clear()
    left, right, bottom, top = asked["window"]
    data, width = camera.data, right - left
    lens = data.lens
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
    data.lens_unit = "MILLIMETERS"
    if data.type == "ORTHO":
        data.ortho_scale = width
    else:
        data.lens = 36.0 / width
        data.dof.aperture_fstop *= data.lens / lens  # of a lens, whose opening is its length over this
    data.shift_x, data.shift_y = 0.5 * (left + right) / width, 0.5 * (bottom + top) / width
    return camera


def darken(tree) -> None:
    """Surfaces do not shine."""
    names = {"BSDF_PRINCIPLED": "Emission Strength", "EMISSION": "Strength"}
    for node in tree.nodes:
        if name := names.get(node.type):
            unlink(tree, node.inputs[name])
            node.inputs[name].default_value = 0.0


def without_light(world) -> None:
    """It keeps its volume."""
    if world.node_tree is None:
        world.color = (0.0, 0.0, 0.0)
        return
    for node in world.node_tree.nodes:
        if node.type == "OUTPUT_WORLD":
            unlink(world.node_tree, node.inputs["Surface"])


def unlink(tree, socket) -> None:
    for link in list(socket.links):
        tree.links.remove(link)


_volumes: list = []


def only(scene, view_layer, of: str, media: list) -> None:
    """Surfaces without media, or media with all."""
    is_surface = of == "surface"
    for item in bpy.data.objects:
        if item.name in media:
            item.hide_render = is_surface
    for name in PASSES["surface"]:
        setattr(view_layer, name, is_surface)
    view_layer.cycles.use_pass_volume_direct = not is_surface
    if is_surface and not _volumes:
        owners = [*bpy.data.materials, *filter(None, [scene.world])]
        for tree in filter(None, (owner.node_tree for owner in owners)):
            for node in tree.nodes:
                if node.type in {"OUTPUT_MATERIAL", "OUTPUT_WORLD"}:
                    for link in list(node.inputs["Volume"].links):
                        _volumes.append((tree, link.from_socket, link.to_socket))
                        tree.links.remove(link)
    elif not is_surface:
        while _volumes:
            tree, source, target = _volumes.pop()
            tree.links.new(source, target)


if __name__ == "__main__":
    main(sys.argv[-1])
