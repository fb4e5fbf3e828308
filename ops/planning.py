"""The plan of a scene, for people and for programs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ..addon.bake import BakeJob
from ..addon.core.free_memory import held_bytes
from ..addon.core.graph import Graph, PlannedLayer
from ..addon.core.memory import MemoryEstimate
from ..addon.core.outline import Outline
from ..addon.core.read import Read
from ..addon.core.sequence import SequenceLayer, with_neutral
from ..addon.expected import about_seconds, expected_seconds
from ..addon.layers.exr_params import ExrParams
from ..addon.layers.files import free_on_disk
from ..addon.measure.report import rounded
from ..addon.planning import Options, groups_of, plan_scene


def read_plan(
    scene,
    view_layer,
    options_of: Callable[[Any], Options],
    frame: int | None = None,
    camera=None,
    size=None,
    report: Mapping[str, Any] | None = None,
    is_audited: bool = False,
) -> tuple[Outline, Graph, MemoryEstimate, float]:
    """Scans the scene as F12 would see it and plans, and says what memory and how many seconds baking that
    takes (`report` and `is_audited` as in expected_seconds); extracts nothing. As `read_job`, only on the
    main thread. A bake's closer look may yet leave out layers."""
    from ..addon.scene.exact.reading import Exact
    from ..addon.scene.extract import texel_bytes
    from ..addon.scene.render_depsgraph import with_render_depsgraph
    from ..addon.scene.scan import Scan, ScanOptions, scan

    def read(depsgraph) -> tuple[Scan, Graph, Options]:
        options = options_of(depsgraph.scene_eval)
        exact = Exact(options.read_texels) if options.read == Read.EXACT.value else None
        found = scan(depsgraph, ScanOptions(size, camera.name if camera else None, exact=exact))
        graph = plan_scene(found.outline, found.shot, options)
        if exact is not None:
            told = tuple(exact.told(found.exactly.needed(graph, found.outline)))
            found = replace(found, outline=replace(found.outline, baked=told))
        return found, graph, options

    scanned, graph, options = with_render_depsgraph(scene, view_layer, read, frame, camera)
    outline = scanned.outline
    held = held_bytes() + texel_bytes(outline, graph.wants)  # as when a bake has read them
    memory = groups_of(outline, graph, options, held)[1]
    return outline, graph, memory, expected_seconds(outline, graph, options, report, is_audited)


def uncounted(graph: Graph, given: Mapping[str, Iterable[str]]) -> list[str]:
    """A line for each parameter that was `given`, by effect, and changes nothing with the others that a
    plan's layers have; and for each effect of those that makes no layer."""
    lines = []
    for effect_id, names in given.items():
        made = [layer.params for layer in graph.layers if layer.effect == effect_id and layer.params]
        if not made and graph.layers:
            lines.append(f"--set of {effect_id} changes nothing: it makes no layer here")
        for spec in made[0].specs() if made else ():
            counts = any(spec.used_when.holds(params.__getattribute__) for params in made)
            if spec.name in names and not counts:
                where = spec.used_when.words()
                lines.append(f"--set {effect_id}.{spec.name} changes nothing: it counts where {where}")
    return lines


def described_plan(
    outline: Outline,
    graph: Graph,
    memory: MemoryEstimate,
    expected_s: float,
    sequence: Iterable[SequenceLayer] = (),
    warnings: Iterable[str] = (),
) -> dict[str, Any]:
    """A plan as plain values; a layer's steps in the order they run, each name once. `expected_s`: what a
    bake will take; `sequence`: layers that the frame's file has besides, with their neutral value."""
    graph, missing = with_neutral(graph, sequence, outline)
    layers = [
        {
            "name": layer.name,
            "effect": layer.effect,
            "light": layer.light,
            "pass_name": layer.pass_name,
            "channels": layer.kind.channels,
            "role": layer.kind.role.value,
            **(
                {"joins": layer.joins, "steps": _steps(graph, layer)}
                if isinstance(layer, PlannedLayer)
                else {"steps": [], "neutral": True}
            ),
        }
        for layer in (*graph.layers, *missing)
    ]
    return {
        "scene": outline.scene_name,
        "view_layer": outline.view_layer_name,
        "frame": outline.frame,
        "size": list(graph.shot.size),
        "layers": layers,
        "steps": [{"name": node.step.name, "instance": node.instance} for node in graph.nodes()],
        "surface_attributes": sorted(frozenset().union(*graph.surfaces.values())),
        "instances_read": len(graph.instances),
        "instances": len(outline.instances),
        "triangles_read": sum(outline.meshes[outline.instances[i].mesh].triangles for i in graph.instances),
        "left_out": [asdict(entry) for entry in graph.left_out],
        "warnings": [*warnings, *outline.warnings, *([memory.shortage] if memory.shortage else [])],
        "baked": list(outline.baked),
        "memory": {"sentence": memory.sentence, **memory.to_json()},
        "expected_seconds": rounded(expected_s),
    }


def _steps(graph: Graph, layer: PlannedLayer) -> list[str]:
    return list(dict.fromkeys(node.step.name for node in graph.nodes([layer.node])))


def plan_lines(plan: dict[str, Any]) -> Iterator[str]:
    """A described plan for a person."""
    for layer in plan["layers"]:
        if layer["steps"]:
            yield f"{layer['name']}: {' > '.join(layer['steps'])}"
    for entry in plan["left_out"]:
        yield f"left out: {entry['what']}: {entry['reason']}"
    if plan["layers"]:
        read = f"{plan['instances_read']:,} of {plan['instances']:,} instances"
        yield f"geometry: {read}, {plan['triangles_read']:,} triangles"
        yield plan["memory"]["sentence"]
        yield f"time: {about_seconds(plan['expected_seconds'])}, as it seems"
    yield from plan["baked"]
    for warning in plan["warnings"]:
        yield f"warning: {warning}"


def room_warning(path: Path, job: BakeJob, exr: ExrParams) -> str:
    """What is to be said before a bake whose file may not fit onto the disk; empty where it surely fits."""
    width, height = job.graph.shot.size
    channels = sum(len(layer.channels) for layer in job.graph.layers if layer.effect) + 4 * exr.composite
    if job.options.error_images:
        channels += sum(layer.kind.score is not None for layer in job.graph.layers)
    most, free = 4 * width * height * channels, free_on_disk(path)
    if most <= free:
        return ""
    return f"{path} takes up to {most / 1e6:,.0f} MB, and the disk has {free / 1e6:,.0f} MB left"


def nothing_to_bake(graph: Graph, sequence: Iterable[SequenceLayer] = ()) -> str | None:
    """Why there is nothing to bake, in one line; None if there is something, or the frame's file has layers
    that other frames need."""
    if graph.layers or sequence:
        return None
    reasons = "; ".join(f"{entry.what}: {entry.reason}" for entry in graph.left_out if entry.effect)
    return f"nothing to bake, no file written ({reasons or 'no effect is switched on'})"
