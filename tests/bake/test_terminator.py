"""What a plan does for smooth surfaces, whose shadows begin above them near the terminator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.bake import BakeJob
from strata.addon.planning import Options, plan_scene
from strata.tests.measure.scenes import random_scene, shot_of

MORE = {"soft_shadow/raised", "terminator_lift"}


def smooth_scene(offset: float):
    """Boxes and balls on a floor; the things have the normals of spheres about their middle."""
    outline, arrays = random_scene(5)
    meshes = [arrays.meshes[0]]
    for mesh in arrays.meshes[1:]:
        corners = mesh.positions[mesh.corner_vertices]
        length = np.maximum(np.linalg.norm(corners, axis=1, keepdims=True), 1e-6)
        meshes.append(replace(mesh, corner_normals=(corners / length).astype(np.float32)))
    instances = (
        outline.instances[0],
        *(replace(each, terminator_offset=offset) for each in outline.instances[1:]),
    )
    return replace(outline, instances=instances), replace(arrays, meshes=tuple(meshes))


def steps_of(outline, effect="soft_shadow", **values) -> set[str]:
    graph = plan_scene(outline, shot_of(5), Options((effect,), "cpu", 2, 0, values={effect: values}))
    return {node.step.name for node in graph.nodes()} | set(graph.surfaces[graph.surface])


@pytest.mark.parametrize("method", ["area", "bitmask", "hybrid"])
def test_only_smooth_surfaces_with_an_offset_ask_for_more(method):
    assert steps_of(smooth_scene(0.0)[0], method=method) & MORE == set()
    assert steps_of(smooth_scene(0.1)[0], method=method) & MORE == MORE
    # Out of the camera's sight they are nothing to it.
    outline, _ = smooth_scene(0.1)
    hidden = tuple(replace(each, visible_camera=each.terminator_offset == 0.0) for each in outline.instances)
    assert steps_of(replace(outline, instances=hidden), method=method) & MORE == set()


def test_toon_asks_for_it_where_its_shadows_are_crisp_and_its_normals_smooth():
    outline, _ = smooth_scene(0.1)
    for normals, there in (("smooth", True), ("flat", False)):
        found = steps_of(outline, "toon", shadow_edge="crisp", normals=normals)
        assert ("terminator_lift" in found) == there


@pytest.mark.parametrize("method", ["bitmask", "hybrid", "rays"])
def test_a_layer_is_what_its_own_reference_says(method):
    """The truth by rays heeds offsets too: the method's own error stays what it is without."""
    values = {"soft_shadow": {"method": method, "sample_rays": 64}}
    errors = []
    for offset in (0.0, 0.1):
        outline, arrays = smooth_scene(offset)
        options = Options(("soft_shadow",), "cpu", 8, 512, values=values)
        shot = shot_of(5, (96, 96))
        job = BakeJob(outline, plan_scene(outline, shot, options), arrays, options)
        (layer,) = job.result().report.layers
        errors.append(layer.error.method)
    assert errors[1] < errors[0] + 0.004
