"""The file that a scene is baked to."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core.errors import StrataError
from ..layers.numbered import Placeholder
from ..layers.paths import NEVER_SAVED, expanded, exr_path


def default_output(scene: bpy.types.Scene) -> str:
    """A name that no other .blend of the folder writes to, nor another scene or view layer of this one."""
    names = ["{blend_name}"]
    names += ["{scene_name}"] if len(bpy.data.scenes) > 1 else []
    names += ["{view_layer_name}"] if len(scene.view_layers) > 1 else []
    return f"//{'_'.join(names)}_strata_####.exr"


def output_of(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, given: str = "") -> Placeholder:
    """The absolute path that a view layer is baked to: `given` as it stands, or the scene's own, which may
    have templates. Raises StrataError."""
    text = given or expanded(scene.strata.output, _values(scene, view_layer))
    if text.startswith("//") and not bpy.data.filepath:
        raise StrataError(
            "the output is beside the Blender file, which was never saved: save it, or save to images only"
        )
    return Placeholder(exr_path(bpy.path.abspath(text), blend_name()))


def waits_for_saving(scene: bpy.types.Scene) -> bool:
    """Whether the file to bake to lies beside a Blender file that was never saved, and there are images to go
    to until then."""
    settings = scene.strata
    return settings.save_to == "BOTH" and settings.output.startswith("//") and not bpy.data.filepath


def blend_name() -> str:
    return Path(bpy.data.filepath).stem or NEVER_SAVED


def _values(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> dict[str, str | float]:
    """Blender's variables of render outputs, and the view layer, by their names in a template."""
    render = scene.render
    width, height = (
        side * render.resolution_percentage // 100 for side in (render.resolution_x, render.resolution_y)
    )
    values = {
        "blend_name": blend_name(),
        "blend_dir": str(Path(bpy.data.filepath).parent),
        "scene_name": scene.name,
        "view_layer_name": view_layer.name,
        "resolution_x": width,
        "resolution_y": height,
        "fps": render.fps / render.fps_base,
    }
    return values | ({"camera_name": scene.camera.name} if scene.camera else {})
