"""Whether a baked file lies on a scene's render as that is set up now."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core.errors import StrataError
from ..core.naming import ENGINE_ID, some_frames
from ..scene.cameras import camera_warnings, frame_size_of, region_of
from ..scene.changing import may_change
from ..scene.materials import is_medium
from ..scene.volumes import volume_of
from .exr_header import ExrHeader, header_of

_WITHOUT_GROUPS = {"BLENDER_EEVEE": "EEVEE", "BLENDER_WORKBENCH": "Workbench"}


def unfit_render(scene: bpy.types.Scene) -> str:
    """Why no shadows can be put onto what a scene renders; empty where they can."""
    engine = scene.render.engine
    if engine == ENGINE_ID:
        return "What Strata renders has its shadows already"
    if engine in _WITHOUT_GROUPS:
        return (
            f"{_WITHOUT_GROUPS[engine]} has no light groups, by which shadows are joined: render with Cycles"
        )
    if scene.render.use_multiview:
        return "Stereoscopy is on, and shadows are baked for one eye"
    return ""


def rendering(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> list[bpy.types.ViewLayer]:
    """View layers that a render makes images of, that in view first. Raises StrataError if there is none."""
    if scene.render.use_single_layer:
        return [view_layer]
    found = sorted((layer for layer in scene.view_layers if layer.use), key=lambda layer: layer != view_layer)
    if not found:
        raise StrataError("no view layer renders")
    return found


def unfit_file(scene: bpy.types.Scene, path: Path) -> str:
    """Why a baked file does not lie on what a scene renders; empty where it does. Cheap enough to be asked at
    every redraw."""
    if not path.is_file():
        return f"There is no {path}: bake to a file first"
    try:
        header = header_of(path)
        frame = frame_size_of(scene.render)
        region = region_of(scene.render, frame)
    except StrataError as error:
        return f"{error}"
    return _wrong_place(scene, header, frame, region) or _wrong_camera(scene, header)


def _wrong_place(scene: bpy.types.Scene, header: ExrHeader, frame: tuple[int, int], region) -> str:
    if not header.is_whole:
        return (
            "The file has pixels for its render region only, which Blender's compositor misplaces: "
            "bake with Window set to Frame"
        )
    x0, y0, x1, y1 = region or (0, 0, *frame)
    offset, size = (x0, frame[1] - y1), (x1 - x0, y1 - y0)
    cut = header.json("strata:cropped_from")
    if scene.render.use_border and scene.render.use_crop_to_border:
        if not cut:
            return "The render is cropped to its region and the file is not: bake again"
        if header.size != size or cut != {"frame": list(frame), "offset": list(offset)}:
            return "The file is cropped to another region than the render: bake again"
        return ""
    if cut:
        return "The file is cropped to a render region and the render is not: bake again"
    if header.size != frame:
        baked, rendered = (" x ".join(map(str, pixels)) for pixels in (header.size, frame))
        return f"The file has {baked} pixels and the render {rendered}: bake again"
    if part := header.json("strata:region"):
        left, top = part["offset"]
        right, bottom = left + part["size"][0], top + part["size"][1]
        if not (left <= x0 and x1 <= right and top <= offset[1] and offset[1] + size[1] <= bottom):
            return "The file has shadows in its render region only, and the render is larger: bake again"
    return ""


def _wrong_camera(scene: bpy.types.Scene, header: ExrHeader) -> str:
    baked, camera = header.text("Camera"), scene.camera
    if camera is None:
        return "The scene has no camera"
    if baked and baked != camera.name:
        return (
            f"The file was baked from camera '{baked}' and the scene renders from '{camera.name}': bake again"
        )
    return ""


def unlike(scene: bpy.types.Scene, path: Path, frames: dict[int, Path]) -> list[str]:
    """What to warn of. `frames`: files by frame where there is one for each, otherwise empty."""
    found = camera_warnings(scene.camera, scene.render)
    found += [
        f"{what} is a medium: light that it scatters gets the shadow of what lies behind it, which is wrong; "
        "keep it out of the render and add Volumetric Light instead"
        for what in _media(scene)
    ]
    missing = [frame for frame, file in frames.items() if not file.is_file()]
    if missing:
        found.append(
            f"{len(missing)} frames of the scene's range have no file, and would lie in full shadow: "
            f"{some_frames(missing)}"
        )
    baked = header_of(path).text("Frame")
    if (
        not frames
        and baked.lstrip("-").isdecimal()
        and int(baked) != scene.frame_current
        and may_change(scene)
    ):
        found.append(f"the file is of frame {int(baked)}, and the scene is at {scene.frame_current}")
    return found


def _media(scene: bpy.types.Scene) -> list[str]:
    """What shows a volume: the world, and objects that render."""
    world = scene.world
    shown = {thing for layer in scene.view_layers if layer.use for thing in layer.objects}
    shown |= {
        inner
        for thing in shown
        if thing.instance_collection
        for inner in thing.instance_collection.all_objects
    }
    found = [
        f"'{thing.name}'"
        for thing in sorted(shown, key=lambda thing: thing.name_full)
        if not thing.hide_render and (thing.type == "VOLUME" or any(map(is_medium, _materials(thing))))
    ]
    has_world = world is not None and any(volume_of(world.node_tree, ""))
    return [f"world '{world.name}'", *found] if has_world else found


def _materials(thing: bpy.types.Object) -> list[bpy.types.Material]:
    return [slot.material for slot in thing.material_slots if slot.material is not None]
