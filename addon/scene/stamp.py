"""What Blender writes into the header of its own renders, whatever its metadata switches say."""

from __future__ import annotations

from datetime import datetime

import bpy


def stamp_of(scene: bpy.types.Scene, camera_name: str) -> dict[str, str]:
    """Text by Blender's name for it, as BKE_stamp_info gives it. `Date` alone differs from run to run."""
    digits = len(str(max(scene.frame_end, 1)))
    return {
        "Software": f"Blender {bpy.app.version_string}",
        "File": bpy.data.filepath or "<untitled>",
        "Date": f"{datetime.now():%Y/%m/%d %H:%M:%S}",
        "Scene": scene.name,
        "Camera": camera_name,
        "Frame": f"{scene.frame_current:0{digits}d}",
        "Time": bpy.utils.smpte_from_frame(
            scene.frame_current, fps=scene.render.fps, fps_base=scene.render.fps_base
        ),
    }
