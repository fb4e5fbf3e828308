"""The file that a scene is baked to."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core.errors import StrataError
from ..layers.files import check_writable
from ..layers.numbered import Placeholder
from ..layers.paths import NEVER_SAVED, expanded, exr_path, safe_name, variables
from .asked import kept


def default_output(scene: bpy.types.Scene) -> str:
    """A name that no other .blend of the folder writes to, nor another scene or view layer of this one."""
    names = ["{blend_name}"]
    names += ["{scene_name}"] if len(bpy.data.scenes) > 1 else []
    names += ["{view_layer_name}"] if len(scene.view_layers) > 1 else []
    return f"//{'_'.join(names)}_strata_####.exr"


def output_of(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer, given: str = "") -> Placeholder:
    """The absolute path that a view layer is baked to: `given` as it stands, or the scene's own, which may
    have templates. Raises StrataError."""
    own = scene.strata.output
    if not bpy.data.filepath and (given.startswith("//") if given else _is_relative(own)):
        raise StrataError(
            "the output is beside the Blender file, which was never saved: save it, or save to images only"
        )
    text = given or expanded(own, _values(scene, view_layer))
    return Placeholder(exr_path(bpy.path.abspath(text), blend_name()))


def told_output(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> tuple[Path | None, str]:
    """The file of the current frame, or why there can be none, for panels: the file system is asked once a
    second at most. Neither where it has not been asked."""

    def ask() -> tuple[Path | None, str]:
        try:
            path = output_of(scene, view_layer).path(scene.frame_current)
            check_writable(path)
        except StrataError as error:
            return None, str(error)
        return path, ""

    values = tuple(_values(scene, view_layer).items())
    question = "output", scene.strata.output, bpy.data.filepath, scene.frame_current, values
    return kept(question, ask) or (None, "")


def waits_for_saving(scene: bpy.types.Scene) -> bool:
    """Whether the file to bake to lies beside a Blender file that was never saved, and there are images to go
    to until then."""
    settings = scene.strata
    return settings.save_to == "BOTH" and _is_relative(settings.output) and not bpy.data.filepath


def _is_relative(own: str) -> bool:
    """Whether a scene's output is told from where the Blender file lies."""
    return own.startswith("//") or "blend_dir" in variables(own)


def blend_name() -> str:
    return safe_name(Path(bpy.data.filepath).stem) or NEVER_SAVED


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
