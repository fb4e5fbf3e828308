"""The plan of a scene, for people and for programs."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ..addon.bake import Options, plan_scene
from ..addon.core.graph import Graph
from ..addon.core.outline import Outline


def read_plan(scene, view_layer, options: Options, camera=None, size=None) -> tuple[Outline, Graph]:
    """Scans the scene as F12 would see it and plans; extracts nothing. Only on the main thread."""
    from ..addon.scene.render_depsgraph import with_render_depsgraph
    from ..addon.scene.scan import ScanOptions, scan

    how = ScanOptions(size, camera.name if camera else None)
    outline = with_render_depsgraph(
        scene, view_layer, lambda depsgraph: scan(depsgraph, how).outline, camera=camera
    )
    return outline, plan_scene(outline, options)


def described_plan(outline: Outline, graph: Graph) -> dict[str, Any]:
    """A plan as plain values; a layer's steps in the order they run, each name once."""
    layers = [
        {
            "name": layer.name,
            "effect": layer.effect,
            "light": layer.light,
            "channels": layer.channels,
            "steps": list(dict.fromkeys(node.step.name for node in graph.nodes([layer.node]))),
        }
        for layer in graph.layers
    ]
    return {
        "scene": outline.scene_name,
        "view_layer": outline.view_layer_name,
        "frame": outline.frame,
        "size": list(outline.size),
        "layers": layers,
        "steps": [{"name": node.step.name, "instance": node.instance} for node in graph.nodes()],
        "surface_attributes": sorted(graph.surface_attributes),
        "instances_read": len(graph.instances),
        "instances": len(outline.instances),
        "left_out": [asdict(entry) for entry in graph.left_out],
        "warnings": list(outline.warnings),
    }


def nothing_to_bake(graph: Graph) -> str | None:
    """Why there is nothing to bake, in one line; None if there is something."""
    if graph.layers:
        return None
    reasons = "; ".join(f"{entry.what}: {entry.reason}" for entry in graph.left_out)
    return f"nothing to bake, no file written ({reasons or 'no effect is switched on'})"
