"""Renders all lamps' light in one go: `lamp_light.py REQUEST.json`, written by rivals/cycles.py. A program of
its own, run by a Blender of its own as the audit's is, which it takes its ways with a scene from. Writes one
OpenEXR file a render, `<number>.exr`, not compressed, and `costs.json`."""

import json
import sys
import time
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import bpy


def main(path: str) -> None:
    request = json.loads(Path(path).read_text(encoding="utf-8"))
    spec = spec_from_file_location("audit", request["audit"])
    audit = module_from_spec(spec)
    spec.loader.exec_module(audit)
    scene, view_layer = audit.opened(request)
    audit.only(scene, view_layer, "surface", request["media"])
    view_layer.use_pass_diffuse_direct = view_layer.use_pass_diffuse_color = False
    scene.cycles.use_light_tree = True
    scene.render.use_persistent_data = False
    scene.render.threads_mode = "AUTO"
    lamps, _ = put_into_groups(view_layer, request["groups"])
    folder, costs = Path(request["folder"]), []
    for number, render in enumerate(request["renders"]):
        for lamp in lamps:
            lamp.data.use_shadow = render["shadow"]
        scene.cycles.samples = render["samples"]
        scene.cycles.seed = 1
        scene.render.filepath = str(folder / f"{number}.exr")
        is_denoised = render["denoise"]
        view_layer.cycles.denoising_store_passes = is_denoised
        scene.render.use_compositing = is_denoised
        scene.compositing_node_group = denoised(scene, view_layer, folder, number) if is_denoised else None
        costs.append(rendered(scene, writes=not is_denoised))
    (folder / "costs.json").write_text(json.dumps(costs), encoding="utf-8")


def put_into_groups(view_layer, groups: dict) -> tuple:
    """The lamps, whose light falls on diffuse surfaces only; all others get the black one, given beside."""
    black = bpy.data.lights.new("black", "POINT")
    black.energy = 0.0
    lamps = []
    while view_layer.lightgroups:
        view_layer.lightgroups.remove(view_layer.lightgroups[0])
    for item in [item for item in bpy.data.objects if item.type == "LIGHT"]:
        if item.name_full not in groups:
            item.data = black
            continue
        name = groups[item.name_full]
        view_layer.lightgroups.add(name=name)
        item.lightgroup = name
        item.visible_camera = item.visible_glossy = False
        item.visible_transmission = item.visible_volume_scatter = False
        lamps.append(item)
    return lamps, black


def denoised(scene, view_layer, folder: Path, number: int):
    """Nodes that write each group with a Denoise node on it."""
    tree = bpy.data.node_groups.new("denoised", "CompositorNodeTree")
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene, layers.layer = scene, view_layer.name
    output = tree.nodes.new("CompositorNodeOutputFile")
    output.directory, output.file_name = str(folder), str(number)
    image = output.format
    image.media_type, image.file_format = "MULTI_LAYER_IMAGE", "OPEN_EXR_MULTILAYER"
    image.color_depth, image.exr_codec = "32", "NONE"
    for group in view_layer.lightgroups:
        output.file_output_items.new("RGBA", group.name)
        node = tree.nodes.new("CompositorNodeDenoise")
        tree.links.new(layers.outputs[f"Combined_{group.name}"], node.inputs["Image"])
        tree.links.new(layers.outputs["Denoising Albedo"], node.inputs["Albedo"])
        tree.links.new(layers.outputs["Denoising Normal"], node.inputs["Normal"])
        tree.links.new(node.outputs[0], output.inputs[group.name])
    scene.render.compositor_device = "CPU"
    return tree


def rendered(scene, writes: bool) -> dict:
    """What the whole call took: reading the scene, trees, samples, nodes and the file, not compressed."""
    before = status("VmRSS")
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        has_peak = True
    except OSError:
        has_peak = False
    wall, cpu = time.perf_counter(), time.process_time()
    bpy.ops.render.render(write_still=writes, scene=scene.name)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return {"wall": wall, "cpu": cpu, "memory_mb": status("VmHWM") - before if has_peak else None}


def status(name: str) -> float:
    """MiB."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines()
        return int(next(line for line in lines if line.startswith(f"{name}:")).split()[1]) / 1024
    except (OSError, StopIteration):
        return 0.0


if __name__ == "__main__":
    main(sys.argv[-1])
