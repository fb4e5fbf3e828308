"""The plan of a scene that is being worked on, made while nobody renders: read from what the viewport shows.

A bake reads the scene as F12 evaluates it, which starts a render: other add-ons' handlers run, and everything
is evaluated once more. That is not to happen unasked. What the two see differs in levels of detail, which no
plan depends on, and in what is hidden from one of them: the switches of rendering are heeded here, and what
only a bake shows is told.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import bpy

from ..core.errors import StrataError, one_line
from ..core.free_memory import held_bytes
from ..core.read import Read
from ..expected import expected_seconds
from ..planning import groups_of, plan_scene
from ..scene.exact.reading import Exact
from ..scene.extract import texel_bytes
from ..scene.render_visibility import rendered_objects, told_hidden
from ..scene.rescan import Changes, patched
from ..scene.scan import Scan, ScanOptions, TooLong, raster_of, scan
from ..scene.simulations import unbaked_simulations
from .properties import options_of
from .state import STATE

MOST_SECONDS = 2.0  # for reading a scene for the first time; more is only taken when somebody asks


class ScenePlan:
    """What is known of one scene. `changes` are to be told of what Blender tells; `seconds` are what the last
    plan took of this thread's own time, which a busy machine does not lengthen. Only on the main thread."""

    def __init__(self):
        self.changes = Changes(all=True)
        self.edits = 0
        self.seconds = 0.0
        self.is_too_long = False
        self._scan: Scan | None = None
        self._content: tuple | None = None

    def note(self, depsgraph: bpy.types.Depsgraph) -> None:
        """What Blender says in a depsgraph update handler."""
        fresh = Changes()
        fresh.add(depsgraph)
        if fresh:
            self.changes.take(fresh)
            self.edits += 1

    def forget(self) -> None:
        """Anything may have changed."""
        self.changes.all = True
        self.edits += 1

    def start_again(self) -> None:
        """As if nothing had been read yet."""
        self.seconds, self.is_too_long = 0.0, False
        self._scan = self._content = None

    def asked(self, depsgraph: bpy.types.Depsgraph) -> tuple:
        """All that the plan depends on; equal while it need not be made again."""
        try:
            view = raster_of(depsgraph, ScanOptions())
        except StrataError as error:
            view = str(error)
        # Blender evaluates settings with the next change of something else; animated ones are in both.
        scene = depsgraph.scene
        return self.edits, view, options_of(scene), scene.strata.audit, self._content_of(depsgraph)

    def make(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Reads what has changed, plans and shows it."""
        scene = depsgraph.scene.session_uid
        started = time.thread_time()
        try:
            outline, shot, warnings = self._read(depsgraph)
            options = options_of(depsgraph.scene)
            graph = plan_scene(outline, shot, options)
            held = held_bytes() + texel_bytes(outline, graph.wants)  # as when a bake has read them
            memory = groups_of(outline, graph, options, held)[1]
            exactly = self._scan.exactly
            baked = exactly.exact.told(exactly.needed(graph, outline)) if exactly else ()
            told = STATE.reports.get(scene), depsgraph.scene.strata.audit
            expected_s = expected_seconds(outline, graph, options, *told)
            STATE.show_plan(scene, graph, memory, warnings, baked, expected_s)
        except TooLong:
            self.is_too_long = True
        except BaseException as error:  # a panic of the kernels is no Exception
            STATE.show_no_plan(scene, one_line(error))
        self.seconds = time.thread_time() - started

    @staticmethod
    def _content_of(depsgraph: bpy.types.Depsgraph) -> tuple[Any, ...]:
        """Of what there is; Blender tells of no object that is hidden or shown, nor of frames."""
        view_layer = depsgraph.view_layer
        return (
            view_layer.name,
            depsgraph.scene.frame_current_final,
            len(depsgraph.objects),
            depsgraph.scene.strata.read,
            depsgraph.scene.strata.read_texels,
            rendered_objects(view_layer),
        )

    def _read(self, depsgraph: bpy.types.Depsgraph):
        """The outline and its shot, and all that is to be said of it."""
        content, settings = self._content_of(depsgraph), depsgraph.scene.strata
        rendered = content[-1]
        changes, self.changes = self.changes, Changes()
        try:
            raster, of_camera = raster_of(depsgraph, ScanOptions())
            outline = None
            if self._scan is not None and content == self._content:
                outline = patched(self._scan, changes, depsgraph) if changes else self._scan.outline
            if outline is None:
                how = ScanOptions(
                    camera=raster.camera,
                    shows=lambda thing: thing.session_uid in rendered,
                    seconds=None if self._scan else MOST_SECONDS,
                    exact=Exact(settings.read_texels) if settings.read == Read.EXACT.value else None,
                )
                # Blender's own data is not to be kept.
                self._scan = scan(depsgraph, how).without_sources()
                outline = self._scan.outline
        except BaseException:
            self.changes.all = True
            raise
        shot = replace(self._scan.shot, name=raster.camera.name, source=raster)
        self._scan, self._content = replace(self._scan, outline=outline, shot=shot), content
        warnings = [*of_camera, *outline.warnings, *unbaked_simulations(depsgraph)]
        warnings.append(told_hidden(depsgraph.view_layer, rendered))
        return outline, shot, [*dict.fromkeys(filter(None, warnings))]
