"""The executor on real geometry: shared nodes run once, values are kept, work is timed and cancellable."""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.core.errors import Cancelled
from strata.addon.core.executor import Executor
from strata.addon.core.graph import Graph, Node, Step
from strata.addon.core.sampling import Sampling
from strata.addon.core.shot import PixelFilter
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared.steps import LAYERED_DEPTH, SURFACE
from strata.tests.support.executing import SHOT, SIZE, depth_graph, drain, tilted_quad_scene


@pytest.fixture
def scene():
    outline, arrays = tilted_quad_scene()
    device = CpuDevice()
    device.set_scene(outline, arrays)
    return outline, device


def test_a_layer_is_the_mean_of_its_samples(scene):
    outline, device = scene
    executor = Executor(device, device)
    graph = depth_graph(outline)
    drain(executor.run(graph, Sampling(*SIZE, 4, PixelFilter("BOX", 0.5))))
    mean = executor.execution.images["Depth"]
    assert not executor.execution.films  # they are as large as the image
    # Perspective depth of a plane is not linear in the pixel, but nearly so: offsets are centred.
    drain(executor.run(graph, Sampling(*SIZE, 1)))
    centre = executor.execution.images["Depth"]
    assert mean.shape == (SIZE[1], SIZE[0])
    assert np.allclose(mean, centre, atol=2e-3)


def test_an_empty_plan_runs_nothing(scene):
    _, device = scene
    executor = Executor(device, device)
    drain(executor.run(Graph((), (), {}, frozenset()), Sampling(*SIZE)))
    assert executor.execution.images == executor.execution.timings == {}


def test_tiles_do_not_show(scene, monkeypatch):
    outline, device = scene
    whole, tiled = Executor(device, device), Executor(device, device)
    drain(whole.run(depth_graph(outline), Sampling(*SIZE, 2)))
    monkeypatch.setattr("strata.addon.core.sampling.PIXELS_PER_TILE", SIZE[0] * 5)
    drain(tiled.run(depth_graph(outline), Sampling(*SIZE, 2)))
    assert np.array_equal(whole.execution.images["Depth"], tiled.execution.images["Depth"])


def test_a_shared_node_runs_once_and_is_kept_for_the_next_run(scene):
    outline, device = scene
    runs = []

    def count(device, *inputs, which):
        runs.append(which)
        return np.float32(which)

    counted = Step("counted", cpu=count)
    twice = [Node(counted, "", (), {"which": 1}), Node(counted, "", (), {"which": 1})]
    add = Step("add", cpu=lambda device, surface, *numbers: surface["depth"] + sum(numbers))
    executor = Executor(device, device)
    drain(executor.run(depth_graph(outline, *twice, step=add), Sampling(*SIZE, 3)))
    drain(executor.run(depth_graph(outline, *twice, step=add), Sampling(*SIZE, 3)))
    assert runs == [1]
    other = Node(counted, "", (), {"which": 2})
    drain(executor.run(depth_graph(outline, other, step=add), Sampling(*SIZE, 1)))
    assert runs == [1, 2]


def test_every_node_is_timed(scene):
    outline, device = scene
    executor = Executor(device, device)
    graph = depth_graph(outline)
    drain(executor.run(graph, Sampling(*SIZE, 3)))
    runs = {t.node.step.name: t.runs for t in executor.execution.timings.values()}
    assert runs == {"geometry": 1, "surface": 3, "pick": 3}
    assert executor.execution.seconds(graph.nodes()) > 0.0


def test_progress_rises_to_one(scene):
    outline, device = scene
    shares = list(Executor(device, device).run(depth_graph(outline), Sampling(*SIZE, 3)))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_cancelling_stops_between_nodes_and_inside_kernels(scene):
    outline, device = scene
    executor = Executor(device, device)
    work = executor.run(depth_graph(outline), Sampling(*SIZE, 1))
    next(work)
    device.cancel_flag.set()
    with pytest.raises(Cancelled):
        drain(work)
    with pytest.raises(device.cancelled):
        SURFACE.cpu(
            device,
            device.geometry(),
            view=SHOT.view,
            visible=frozenset({0}),
            chunk=next(Sampling(*SIZE).chunks()),
            attributes=frozenset({"depth"}),
        )


class Other(CpuDevice):
    """A second device with other twins: what a GPU is to the executor."""

    name = "gpu"


def test_a_hole_moves_the_node_to_the_other_device(scene):
    outline, device = scene
    other = Other(device.cancel_flag)
    other.set_scene(*tilted_quad_scene())
    executor = Executor(other, device)
    drain(executor.run(depth_graph(outline), Sampling(*SIZE, 1)))
    straight = Executor(device, device)
    drain(straight.run(depth_graph(outline), Sampling(*SIZE, 1)))
    assert np.array_equal(executor.execution.images["Depth"], straight.execution.images["Depth"])


def test_a_twin_that_fails_runs_on_the_cpu_and_says_so(scene):
    outline, device = scene
    other = Other(device.cancel_flag)

    def fails(device, surface):
        raise RuntimeError("no such extension")

    step = Step("pick", cpu=lambda device, surface: surface["depth"], gpu=fails)
    executor = Executor(other, device)
    drain(executor.run(depth_graph(outline, step=step), Sampling(*SIZE, 2)))
    warnings = [warning for warning in executor.execution.warnings if "'pick'" in warning]
    assert len(warnings) == 1
    assert "no such extension" in warnings[0]


def test_node_keys_hash_content():
    def node(**params):
        return Node(LAYERED_DEPTH, "", (), params)

    assert node(a=np.arange(3)).key == node(a=np.arange(3)).key
    assert node(a=np.arange(3)).key != node(a=np.arange(3.0)).key
    assert node(casters=frozenset({2, 1})).key == node(casters=frozenset({1, 2})).key
    assert node(a=1, b=2).key != node(a=2, b=1).key
