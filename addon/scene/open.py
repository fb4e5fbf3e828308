"""Opening a .blend without a window, and choosing what of it to bake. Every refusal is one line."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import BinaryIO

import bpy

from ..core.errors import StrataError

# Plain, and compressed by Zstandard (Blender 3.0 and later) or gzip (before).
_MAGIC = (b"BLENDER", b"\x28\xb5\x2f\xfd", b"\x1f\x8b")


# Blender shows Python the engine that stands in, and tells a terminal only whose place it takes.
_UNKNOWN_ENGINE = re.compile(r"Engine '([^'\n]*)' not available for scene '([^\n]*)' \(")


@dataclass(frozen=True, eq=False)
class Chosen:
    """What to bake; `camera` is a name for `ScanOptions`, None for the scene's own."""

    scene: bpy.types.Scene
    view_layers: tuple[bpy.types.ViewLayer, ...]
    camera: str | None
    frames: tuple[int, ...]

    @property
    def view_layer(self) -> bpy.types.ViewLayer:
        """The only one, or the first."""
        return self.view_layers[0]

    def outside(self, frames: Iterable[int]) -> str | None:
        """What is to be said of frames outside the scene's range, which are baked all the same."""
        start, end = self.scene.frame_start, self.scene.frame_end
        outside = [frame for frame in frames if not start <= frame <= end]
        if not outside:
            return None
        which = (
            f"frame {outside[0]} is" if len(outside) == 1 else f"{len(outside)} frames from {outside[0]} are"
        )
        return f"{which} outside scene '{self.scene.name}', which runs from {start} to {end}"


def open_blend(path: str | os.PathLike, trusts_scripts: bool = False) -> tuple[str, ...]:
    """Opens a file, without running its scripts and drivers in Python unless `trusts_scripts`. Returns what
    Blender says on opening only. Raises StrataError for what cannot be read; what was open before then stays
    open."""
    path = os.path.abspath(path)
    if os.path.exists(path) and not os.path.isfile(path):
        raise StrataError(f"cannot read '{path}': it is not a file")  # a pipe would never end
    try:
        with open(path, "rb") as file:
            start = file.read(8)
    except OSError as error:
        raise StrataError(f"cannot read '{path}': {error.strerror or error}") from None
    if not start.startswith(_MAGIC):
        raise StrataError(f"'{path}' is not a Blender file")
    try:
        with _silent() as said:
            bpy.ops.wm.open_mainfile(filepath=path, load_ui=False, use_scripts=trusts_scripts)
            said.seek(0)
            engines = _UNKNOWN_ENGINE.findall(said.read().decode(errors="replace"))
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1].rpartition(": ")[2]
        raise StrataError(f"cannot read '{path}': {reason}") from None
    return tuple(
        f"scene '{scene}': render engine '{engine}' is not there, it is read as for "
        f"{bpy.data.scenes[scene].render.engine}"
        for engine, scene in engines
        if scene in bpy.data.scenes
    )


def choose(
    scene: str | None = None,
    view_layer: str | None = None,
    camera: str | None = None,
    frames: Iterable[int] | None = None,
) -> Chosen:
    """Looks names up in the open file; `view_layer` "all" is every one that renders. Without them: the active
    scene, its first view layer that renders, the scene's camera and current frame. Raises StrataError for a
    name that is not there and a scene without a camera."""
    found = bpy.context.scene if scene is None else _named(bpy.data.scenes, scene, "scene", "file")
    used = tuple(layer for layer in found.view_layers if layer.use) or tuple(found.view_layers[:1])
    if view_layer is None:
        layers = used[:1]
    elif view_layer == "all" and "all" not in found.view_layers:
        layers = used
    else:
        layers = (_named(found.view_layers, view_layer, "view layer", f"scene '{found.name}'"),)
    if camera is not None:
        shown = _named(bpy.data.objects, camera, "camera", "file")
        if shown.type != "CAMERA":
            raise StrataError(f"'{camera}' is not a camera")
    elif found.camera is None and not any(marker.camera for marker in found.timeline_markers):
        raise StrataError(f"scene '{found.name}' has no camera{_with_camera()}")
    return Chosen(found, layers, camera, tuple(frames or (found.frame_current,)))


def _with_camera() -> str:
    """Which scenes of the file have one."""
    names = [s.name for s in bpy.data.scenes if s.camera or any(m.camera for m in s.timeline_markers)]
    shown = ", ".join(f"'{name}'" for name in names)
    return f"; --scene: {shown} {'has' if len(names) == 1 else 'have'} one" if names else ""


def _named(collection, name: str, what: str, where: str):
    found = collection.get(name)
    if found is None:
        known = ", ".join(
            f"'{each.name}'" for each in collection if what != "camera" or each.type == "CAMERA"
        )
        raise StrataError(f"{where} has no {what} '{name}' (it has {known or 'none'})")
    return found


@contextlib.contextmanager
def _silent() -> Iterator[BinaryIO]:
    """Turns standard output away, into a file: an operator tells its errors to Python's, and Blender's log
    goes past it to the file descriptors."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.redirect_stdout(io.StringIO()))
        said = stack.enter_context(tempfile.TemporaryFile())
        for descriptor in (1, 2):
            try:
                kept = os.dup(descriptor)
            except OSError:  # closed, as in a windowed program
                continue
            stack.callback(os.close, kept)
            stack.callback(os.dup2, kept, descriptor)
            os.dup2(said.fileno(), descriptor)
        yield said
