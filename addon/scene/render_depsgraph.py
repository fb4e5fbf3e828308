"""The scene as F12 sees it.

`context.evaluated_depsgraph_get()` evaluates for the viewport: viewport subdivision levels, modifiers and
objects by their viewport switches. Blender hands a depsgraph in render mode only to the `render()` of a
RenderEngine, so a bake outside a render starts one, with an engine that looks and draws nothing. That costs
what F12 itself needs to evaluate, and 4 ms (Blender 5.2; no pixels are allocated, whatever the size).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import bpy

from ..core.errors import StrataError
from .cameras import frame_size_of, region_of

_ENGINE_ID = "STRATA_LOOK"

# What the scene renders with while the engine above stands in for it.
_replaced_engine: str | None = None


def engine_of(scene: bpy.types.Scene) -> str:
    """The id of the engine that the user chose, inside `with_render_depsgraph` too."""
    return _replaced_engine or scene.render.engine


@contextlib.contextmanager
def _replaced(owner, **values) -> Iterator[None]:
    """Sets properties, and puts back what was there."""
    before = {name: getattr(owner, name) for name in values}
    try:
        for name, value in values.items():
            setattr(owner, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(owner, name, value)


@contextlib.contextmanager
def _spare_render_slot() -> Iterator[None]:
    """Keeps what the user rendered last, since a render empties the active slot of the Render Result.

    Slots cannot be removed without an image editor, so one named as below stays, and is used again.
    """
    image = bpy.data.images.get("Render Result")
    if bpy.app.background or image is None or image.type != "RENDER_RESULT":
        yield
        return
    slots = image.render_slots
    active = slots.active_index
    spare = next((slot for slot in slots if slot.name == "Strata"), None)
    slots.active = spare or slots.new(name="Strata")
    try:
        yield
    finally:
        slots.active_index = active


def with_render_depsgraph[Result](
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    read: Callable[[bpy.types.Depsgraph], Result],
    frame: int | None = None,
    camera: bpy.types.Object | None = None,
) -> Result:
    """Calls `read(depsgraph)` with the scene evaluated for rendering at the frame (None: the scene's own),
    and returns what it returns.

    Nothing taken from the depsgraph outlives the call: copy arrays inside `read`. What it raises is raised
    here. The scene's settings, frame and camera, and the last render, stay as they were; handlers that other
    add-ons hang on renders do run.
    """
    return with_render_frames(scene, view_layer, lambda depsgraph, _: read(depsgraph), frame, camera)


def with_render_frames[Result](
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    read: Callable[[bpy.types.Depsgraph, Callable[[int], None]], Result],
    frame: int | None = None,
    camera: bpy.types.Object | None = None,
) -> Result:
    """`with_render_depsgraph` for many frames: `read(depsgraph, go_to)` may call `go_to(frame)`, which
    evaluates anew only what changes."""
    global _replaced_engine
    outcome: list[Result] = []
    failures: list[BaseException] = []

    class LookEngine(bpy.types.RenderEngine):
        bl_idname = _ENGINE_ID
        bl_label = "Strata (reading the scene)"

        def render(self, depsgraph):
            if outcome or failures:
                return
            try:
                if depsgraph.scene_eval.frame_current != frame:
                    raise StrataError(
                        f"scene '{scene.name}': Blender rendered frame {depsgraph.scene_eval.frame_current} "
                        f"where {frame} was asked for"
                    )
                outcome.append(read(depsgraph, lambda number: self.frame_set(number, 0.0)))
            except BaseException as failure:  # Blender would print it and go on
                failures.append(failure)

    subframe = scene.frame_subframe if frame is None else 0.0
    frame = scene.frame_current if frame is None else frame
    # A marker that binds a camera switches the scene to it on every frame change.
    markers = [m for m in scene.timeline_markers if m.camera is not None] if camera is not None else []
    if camera is None and scene.camera is None and not any(m.camera for m in scene.timeline_markers):
        raise StrataError(f"scene '{scene.name}' has no camera")
    # Refused here already, since Blender would print it.
    region_of(scene.render, frame_size_of(scene.render))
    bpy.utils.register_class(LookEngine)
    _replaced_engine = scene.render.engine
    try:
        with contextlib.ExitStack() as stack:
            stack.enter_context(_spare_render_slot())
            stack.enter_context(_replaced(scene, camera=camera or scene.camera))
            stack.enter_context(_replaced(scene, frame_current=frame, frame_subframe=subframe))
            # Nothing that works on the finished image.
            quiet = ("use_compositing", "use_sequencer", "use_freestyle")
            stack.enter_context(_replaced(scene.render, engine=_ENGINE_ID, **dict.fromkeys(quiet, False)))
            for marker in markers:
                stack.enter_context(_replaced(marker, camera=None))
            # `layer=` of the operator counts only in a window; `use` counts everywhere.
            for layer in scene.view_layers:
                stack.enter_context(_replaced(layer, use=layer.name == view_layer.name))
            # Blender itself draws grease pencil after the engine, which would start the GPU.
            stack.enter_context(_replaced(view_layer, use_grease_pencil=False))
            try:
                # Without it Blender renders the scene at the frame of the one in the window.
                with bpy.context.temp_override(scene=scene):
                    bpy.ops.render.render(scene=scene.name)
            except RuntimeError as error:
                if not (outcome or failures):
                    reason = str(error).strip().splitlines()[-1].removeprefix("Error: ")
                    raise StrataError(
                        f"scene '{scene.name}' cannot be evaluated for rendering: {reason}"
                    ) from None
    finally:
        _replaced_engine = None
        bpy.utils.unregister_class(LookEngine)
    if failures:
        raise failures[0]
    if not outcome:
        raise StrataError(f"scene '{scene.name}': Blender did not render view layer '{view_layer.name}'")
    return outcome[0]
