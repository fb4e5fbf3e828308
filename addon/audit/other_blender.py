"""Programs for another Blender, which touch nothing of the scene that somebody works on."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from ..core.errors import Cancelled, StrataError
from ..core.graph import Graph
from ..core.outline import Outline
from .grid import STRETCH, Grid

POLL_SECONDS = 0.05


@dataclass(frozen=True)
class Scene:
    """What is open, for another Blender to open: `file` holds it as it is now, `folder` is to be written to;
    `scene` by its name with its library; `camera` is who was asked for in place of the scene's own;
    `blender`: the program, none where it is a Python module. Made by `kept_scene`, on the main thread."""

    file: Path
    folder: tempfile.TemporaryDirectory
    scene: str
    view_layer: str
    camera: str | None
    blender: tuple[str, ...]
    runs_scripts: bool

    def command(self, program: Path) -> list[str]:
        if not self.blender:
            return [sys.executable, str(program)]
        return [*self.blender, "--background", "--factory-startup", "--python", str(program), "--"]

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *_) -> None:
        self.folder.cleanup()


def kept_scene(
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    camera: str | None = None,
    is_untouched: bool = False,
    runs_scripts: bool | None = None,
) -> Scene:
    """Saves a copy, unless what is open `is_untouched` since it was read (Blender does not know of what
    Python did). Its folder is gone with it. `runs_scripts`: whether the other Blender may, None for what this
    one's preferences say. Raises StrataError where nothing can be saved."""
    file = Path(bpy.data.filepath)
    try:
        folder = tempfile.TemporaryDirectory(prefix="strata_audit_")
        if not is_untouched:
            file = Path(folder.name) / "scene.blend"
            bpy.ops.wm.save_as_mainfile(filepath=str(file), copy=True, compress=False)
    except (OSError, RuntimeError) as error:
        raise StrataError(f"no copy of the scene can be saved ({' '.join(str(error).split())})") from None
    if runs_scripts is None:
        runs_scripts = bpy.context.preferences.filepaths.use_scripts_auto_execute
    blender = (bpy.app.binary_path,) if bpy.app.binary_path else ()
    return Scene(file, folder, scene.name_full, view_layer.name, camera, blender, runs_scripts)


def request_of(scene: Scene, outline: Outline, graph: Graph, grid: Grid) -> dict[str, Any]:
    """What the programs want to know of any render of those pixels. Raises StrataError for a pixel filter
    that Cycles has not."""
    raster, pixel_filter = graph.shot.source, graph.shot.pixel_filter
    if pixel_filter.kind not in STRETCH or pixel_filter.radius <= 0.0:
        raise StrataError("its pixel filter is a box, whose width Cycles does not let anyone set")
    return {
        "file": str(scene.file),
        "folder": scene.folder.name,
        "scripts": scene.runs_scripts,
        "scene": scene.scene,
        "view_layer": scene.view_layer,
        "frame": outline.frame,
        "camera": {"asked": scene.camera, "name": raster.camera.name, "window": grid.window(raster)},
        "size": grid.count,
        "pixel_aspect": raster.pixel_aspect,
        "filter": {"kind": pixel_filter.kind, "width": grid.filter_width(pixel_filter)},
        "dicing": 1.0 / grid.step,
        "media": sorted({instance.name for instance in outline.instances if instance.medium is not None}),
    }


def run_program(
    scene: Scene,
    program: Path,
    request: dict[str, Any],
    made: Sequence[Path],
    is_cancelled: Callable[[], bool] = lambda: False,
    look: Callable[[], None] = lambda: None,
) -> None:
    """Runs it to its end; `made` are the files that it is to write, `look` is called now and then. Raises
    Cancelled, and StrataError where a file is missing."""
    folder = Path(scene.folder.name)
    path = folder / "request.json"
    path.write_text(json.dumps(request), encoding="utf-8")
    log = folder / "log.txt"
    with open(log, "wb") as out:
        process = subprocess.Popen(
            [*scene.command(program), str(path)],
            stdout=out,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        )
        try:
            while process.poll() is None:
                if is_cancelled():
                    raise Cancelled
                look()
                time.sleep(POLL_SECONDS)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
    if process.returncode or not all(path.exists() for path in made):
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        raise StrataError(
            f"the other Blender rendered nothing ({lines[-1][:200] if lines else 'without a word'})"
        )
