"""The render engine: F12, animations, farms and the rendered viewport, with layers as render passes."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from dataclasses import replace

import bpy
import numpy as np
from bpy.app.handlers import persistent, render_init

from .. import preview
from ..bake import Baked, BakeJob, read_depsgraph
from ..core.errors import Cancelled, one_line, sentence, told_once
from ..core.naming import ENGINE_ID
from ..devices.start import Devices, start_devices
from ..expected import expected_seconds
from ..layers.exr import layer_attributes, to_json
from ..measure.target import missed_in, samples_in, told_missed
from ..scene.exact.reading import Exact
from ..ui.properties import options_of
from ..ui.registration import Classes
from ..ui.state import STATE
from . import compatible_panels, handover, material_preview, passes, sockets
from .handover import NotServed, runner_of
from .passes import COMBINED, PassImage

_chosen: dict[tuple[int, str], dict[str, int]] = {}
"""Samples by layer, that the first frame of a render chose for a target error, by scene and view layer: all
frames of an animation have them, or their noise would flicker."""
_missed: dict[tuple[int, str], dict[int, list[str]]] = {}
"""Layers by frame that did not come down to their target, alike."""
POLL_SECONDS = 0.05  # between two looks whether the user cancelled


class StrataRenderEngine(bpy.types.RenderEngine):
    """Renders what a bake makes, pass by pass, and its composite as the combined image."""

    bl_idname = ENGINE_ID
    bl_label = "Strata"
    bl_use_preview = True
    bl_use_postprocess = True
    bl_use_eevee_viewport = True  # Material Preview shading is EEVEE's
    bl_use_shading_nodes_custom = False
    # With a GPU context on the render's thread, Blender's main thread would wait for the whole render as soon
    # as it draws a viewport or an image. In background the GPU device starts the context itself or says why
    # not: asked for here, Blender 5.2 ends with a segmentation fault on machines that have none.
    bl_use_gpu_context = False

    def update_render_passes(self, scene=None, renderlayer=None):
        told_once(self._register_passes)(scene, renderlayer)

    def render(self, depsgraph):
        try:
            if self.is_preview:
                picture = material_preview.picture(depsgraph, self.resolution_x, self.resolution_y)
                self._write("", [PassImage(COMBINED, "RGBA", picture)])
            else:
                self._render(depsgraph)
        except Cancelled:
            return
        except BaseException as error:  # a panic of the kernels is no Exception
            self.report({"ERROR"}, one_line(error))  # ends an animation too

    def _register_passes(self, scene, renderlayer) -> None:
        self.register_pass(scene, renderlayer, COMBINED, 4, "RGBA", "COLOR")
        for kind in passes.registered(scene, renderlayer):
            self.register_pass(scene, renderlayer, kind.name, len(kind.channels), kind.channels, kind.type)

    def _render(self, depsgraph) -> None:
        job, baked = self._rendered(depsgraph)
        layer_name = depsgraph.view_layer.name
        self._write(layer_name, passes.images_of(baked, job.outline, job.graph.shot, depsgraph))
        self._tell(layer_name, baked)
        scene, report = depsgraph.scene, baked.layers.report
        options = replace(job.options, samples_of={})  # a bake chooses by itself
        expected_s = expected_seconds(job.outline, job.graph, options, report, scene.strata.audit)
        STATE.show_plan(
            scene.session_uid, job.graph, job.memory, baked=job.outline.baked, expected_s=expected_s
        )
        STATE.show_report(scene.session_uid, report)

    def view_update(self, context, depsgraph):
        """Nothing: the preview follows the scene by itself, and looks at each frame at what changed."""

    def view_draw(self, context, depsgraph):
        if reason := preview.available():
            self.update_stats("", f"Strata: {reason}")
            return
        self._scene_id = context.scene.session_uid
        preview.follow(context.scene)
        preview.draw(context)
        shown = preview.state_of(context.region)
        self.update_stats("", f"Strata: {shown.message}" if shown and shown.message else "")

    def __del__(self):
        with suppress(ReferenceError):  # Blender has freed its part already, as after a cancelled render
            if (scene := getattr(self, "_scene_id", None)) is not None:
                preview.unfollow(scene)
        parent = getattr(super(), "__del__", None)
        if parent:
            parent()

    def _rendered(self, depsgraph) -> tuple[BakeJob, Baked]:
        self.update_stats("", "Strata: Reading the scene")
        # Passes are known before there is a plan, and none is of an error.
        options = options_of(depsgraph.scene_eval, composite=True, error_images=False)
        key = depsgraph.scene.session_uid, depsgraph.view_layer.name
        options = replace(options, samples_of=_chosen.get(key, {}))
        # To bake inside of a render ends an animation with a segmentation fault (Blender 5.2).
        *read, seconds = read_depsgraph(depsgraph, options, exact=Exact(can_bake=False))
        devices = start_devices(options.backend)
        try:
            job = BakeJob(*read, options, devices, seconds)
            baked = self._baked(job, depsgraph)
        except NotServed as reason:
            self.report({"WARNING"}, f"Rendered on the CPU: {reason}")
            devices = Devices(devices.fallback, devices.fallback, str(reason))
            job = BakeJob(*read, options, devices, seconds)
            baked = self._baked(job, depsgraph)
        if chosen := samples_in(baked.layers.report):
            _chosen.setdefault(key, chosen)
        self._tell_missed(depsgraph.scene, _missed.setdefault(key, {}), missed_in(baked.layers.report))
        return job, baked

    def _tell_missed(self, scene, missed: dict[int, list[str]], names: list[str]) -> None:
        """After the last frame of an animation."""
        missed[scene.frame_current] = names
        is_last = scene.frame_current + scene.frame_step > scene.frame_end
        if is_last and len(missed) > 1 and (words := told_missed(missed)):
            self.report({"WARNING"}, sentence(words))

    def _baked(self, job: BakeJob, depsgraph) -> Baked:
        """Shows in a window what is there so far. Raises NotServed where the job is the GPU's, and this
        thread cannot have it."""
        if not bpy.app.background:
            job.tiles = deque()
        runner = runner_of(job, depsgraph.scene.render.use_lock_interface)
        try:
            while (baked := runner.step(POLL_SECONDS)) is None:
                if self.test_break():
                    runner.cancel()
                while job.tiles:
                    first_row, tile = job.tiles.popleft()
                    self._put(depsgraph.view_layer.name, [PassImage(COMBINED, "RGBA", tile)], first_row)
                self.update_progress(job.progress)
                self.update_stats("", f"Strata: {job.stage} {100 * job.progress:.0f}%")
            return baked
        finally:
            runner.stop()

    def _write(self, layer_name: str, images: list[PassImage]) -> None:
        """`images` are as large as what is computed."""
        for image in images:
            if image.name != COMBINED:
                self.add_pass(image.name, len(image.channels), image.channels, layer=layer_name)
        self._put(layer_name, images)

    def _put(self, layer_name: str, images: list[PassImage], first_row: int = 0) -> None:
        """Into passes that are there, whole rows of what is computed."""
        height, width = images[0].pixels.shape[:2]
        result = self.begin_result(0, first_row, width, height, layer=layer_name)
        by_name = {image.name: image.pixels for image in images}
        for render_pass in result.layers[0].passes:  # once for each eye, where there are two
            if render_pass.name in by_name:
                flat = np.ascontiguousarray(by_name[render_pass.name], np.float32).reshape(-1)
                render_pass.rect.foreach_set(flat)
        self.end_result(result)

    def _tell(self, layer_name: str, baked: Baked) -> None:
        """Warnings to the console and the window; what there is to say of layers to the file's header.

        `begin_result` gives a result that is thrown away once its pixels are copied, with its header; the
        file is written from the render's own. Blender has one header for all parts, hence the long names.
        """
        for warning in baked.report.warnings:
            self.report({"WARNING"}, warning)
        header = self.get_result()
        header.stamp_data_add_field(f"strata:report.{layer_name}", to_json(baked.layers.report))
        for layer in baked.layers.layers:
            for name, value in layer_attributes(layer).items():
                header.stamp_data_add_field(f"{name}.{layer_name}.{layer.name}", str(value))


@persistent
def _forget_chosen(*_scene) -> None:
    """A render begins: of one frame, or of all of an animation's."""
    _chosen.clear()
    _missed.clear()


_classes = Classes(StrataRenderEngine)


def register() -> None:
    _classes.register()
    handover.register()
    if _forget_chosen not in render_init:
        render_init.append(_forget_chosen)
    compatible_panels.register()
    sockets.register()


def unregister() -> None:
    sockets.unregister()
    compatible_panels.unregister()
    handover.unregister()
    if _forget_chosen in render_init:
        render_init.remove(_forget_chosen)
    _classes.unregister()
