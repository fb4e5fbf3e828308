"""Readers of neighbours: the same bits whatever the tiles, on both devices, up to the image's border."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.core.effect import LayerKind
from strata.addon.core.executor import Executor
from strata.addon.core.film import takes_of
from strata.addon.core.graph import WHOLE, Graph, Node, PlannedLayer, Rate, Step
from strata.addon.core.memory import too_large
from strata.addon.core.reach import fitted, margins_of, reads_whole
from strata.addon.core.roles import Role
from strata.addon.core.sampling import Sampling
from strata.addon.core.shader import Shader
from strata.addon.core.view import View
from strata.addon.effects.shared.steps import GEOMETRY, SURFACE, surface
from strata.addon.planning import Options, plan_scene
from strata.tests.support.executing import SHOT, drain, tilted_quad_scene
from strata.tests.support.gpu_scenes import on_both, scene_of, triangle_mesh
from strata.tests.support.tiny_effects import effect, registry

SIZE, REACH = (96, 70), 40
VIEW = View((0, 0, 3), (1, 0, 0), (0, 1, 0), (0, 0, -1), (-0.4, 0.4, -0.3, 0.3), 0.1, 100.0)
TILES = [SIZE[0] * rows for rows in (70, 48, 17, 1)]
# One triangle that fills the view and what is read around it: no outline that a GPU may move.
FILLED = scene_of([triangle_mesh([[(-9, -9, -1), (9, -9, 0.5), (0, 12, 0)]])])
SHADER = Shader(
    "../tests/core/test_reach.glsl",
    samplers=(("depth", "FLOAT_2D"),),
    images=(("result", "R32F", "WRITE"),),
    params=("size",),
)


def _cpu(device, surface):
    """The depth 40 pixels to the right and above, and as many to the left and below."""
    depth = surface["depth"]
    return depth[2 * REACH :, 2 * REACH :] - depth[: -2 * REACH, : -2 * REACH]


def _gpu(device, surface):
    rows, columns = (side - 2 * REACH for side in surface["depth"].shape)
    result = device.new_image((rows, columns))
    size = {"size": (columns, rows, REACH)}
    device.dispatch(SHADER, (columns, rows), {"result": result}, {"depth": surface["depth"]}, size)
    return result


AROUND = Step("around", cpu=_cpu, gpu=_gpu, reach=REACH)


def graph() -> Graph:
    """A layer of neighbours of neighbours, and one that reads its own pixel only."""
    geometry = Node(GEOMETRY, "", (), {"scene": "Scene"})
    surface = Node(SURFACE, "camera", (geometry,), {"view": VIEW, "visible": frozenset({0})})
    alone = Step("alone", cpu=lambda _, surface: surface["depth"], gpu=lambda _, surface: surface["depth"])
    held = Step("held", cpu=lambda _, depth: {"depth": depth}, gpu=lambda _, depth: {"depth": depth})
    near = Node(AROUND, "", (surface,), {})
    far = Node(AROUND, "", (Node(held, "", (near,), {}),), {})
    nodes = {"Alone": Node(alone, "", (surface,), {}), "Near": near, "Far": far}
    layers = tuple(PlannedLayer(name, "test", node, LayerKind(name, "Z")) for name, node in nodes.items())
    return Graph(layers, (), {surface: frozenset({"depth"})}, frozenset({0}), surface=surface)


@pytest.fixture(params=[0, 1], ids=["cpu", "gpu"])
def device(request):
    return on_both(*FILLED)[request.param][0]


def images(device, sampling: Sampling, graph: Graph) -> dict[str, np.ndarray]:
    executor = Executor(device, device)
    drain(executor.run(graph, sampling))
    return executor.execution.images


def test_bits_do_not_depend_on_tiles(device):
    whole = images(device, Sampling(*SIZE, 2, tile_pixels=TILES[0]), graph())
    for tile_pixels in TILES[1:]:
        tiled = images(device, Sampling(*SIZE, 2, tile_pixels=tile_pixels), graph())
        for name, image in whole.items():
            assert np.array_equal(image, tiled[name]), (name, tile_pixels)
    depth = whole["Alone"].astype(np.float64)
    inside = depth[2 * REACH :, 2 * REACH :] - depth[: -2 * REACH, : -2 * REACH]
    if inside.size:
        assert np.allclose(whole["Near"][REACH:-REACH, REACH:-REACH], inside, atol=1e-5)
    # At the border too a neighbour is what lies there: a plane's slope has no kink.
    near = whole["Near"].astype(np.float64)
    assert (near < 0.0).all()
    assert np.abs(np.diff(near, 2, axis=0)).max() < 1e-3 * np.abs(near).max()
    assert np.abs(np.diff(near, 2, axis=1)).max() < 1e-3 * np.abs(near).max()


def test_a_layer_does_not_depend_on_what_else_reads_its_surface(device):
    made = graph()
    alone = replace(made, layers=made.layers[:1])
    sampling = Sampling(*SIZE, 2, tile_pixels=TILES[2])
    assert np.array_equal(images(device, sampling, made)["Alone"], images(device, sampling, alone)["Alone"])


def test_only_what_neighbours_are_read_of_is_worked_out_around_a_tile():
    made = graph()
    found = margins_of(made, takes_of(made))
    alone, near, far = (found[layer.node] for layer in made.layers)
    assert (alone, near, far) == ((0,), (40, 0), (0,))
    assert found[made.surface] == (80, 40, 0)
    assert all(layer.node.rate == Rate.SAMPLE for layer in made.layers)


def test_a_step_that_reads_a_whole_image_gets_it_or_is_left_out():
    def share(device, surface):
        return surface["depth"] / np.float32(surface["depth"].sum(dtype=np.float64))

    made = graph()
    step = Step("share", cpu=share, hole="a sum over all pixels", reach=WHOLE)
    node = Node(step, "", (made.surface,), {})
    layers = (made.layers[0], PlannedLayer("Share", "test", node, LayerKind("Share", "Z")))
    made = replace(made, layers=layers)
    sampling = Sampling(*SIZE, 2, tile_pixels=TILES[2])
    found = images(on_both(*FILLED)[0][0], fitted(sampling, made.nodes()), made)
    assert found["Share"].sum(dtype=np.float64) == pytest.approx(1.0, abs=1e-5)
    assert reads_whole(made.nodes())
    assert not reads_whole(made.nodes([layers[0].node]))
    outline = tilted_quad_scene()[0]
    assert too_large(made, outline, sampling, 1 << 40) == {}
    found = too_large(made, outline, sampling, 1 << 20)
    assert found.keys() == {"Share"}
    assert "over the budget of 1 MB" in found["Share"]


def test_a_composite_is_made_of_the_layers_that_fit():
    kind = LayerKind("Share", "V", role=Role.TRANSMITTANCE)
    step = Step("share", cpu=lambda device, surface: surface["depth"], hole="one will do", reach=WHOLE)

    def run(recorder, outline, params):
        recorder.layer(kind, recorder.step(step, surface(recorder, outline, "depth")))

    outline, _ = tilted_quad_scene()
    for budget, names in ((1 << 40, ["Share", "Composite"]), (1 << 20, ["Composite"])):
        share = effect("share", (kind,), run)
        options = Options(("share",), composite=True, memory_bytes=budget, registry=registry(share))
        graph = plan_scene(outline, SHOT, options)
        assert [layer.name for layer in graph.layers] == names
        reasons = [entry.reason for entry in graph.left_out if entry.what == "Share"]
        assert len(reasons) == (budget == 1 << 20)
        assert all(reason.endswith("over the budget of 1 MB") for reason in reasons)


@pytest.mark.parametrize("declared", [{"reach": WHOLE}, {"rate": Rate.PICTURE}], ids=["whole", "finished"])
def test_nothing_is_read_around_a_whole_image(declared):
    """It would be made of other pixels than where nobody reads around it, or be too small."""
    made = graph()
    node = Node(Step("all", cpu=lambda _, surface: surface["depth"], **declared), "", (made.surface,), {})
    read = Node(Step("held", cpu=lambda _, depth: {"depth": depth}), "", (node,), {})
    for each, is_refused in ((read, False), (Node(AROUND, "", (read,), {}), True)):
        chosen = replace(made, layers=(PlannedLayer("All", "test", each, LayerKind("All", "Z")),))
        if is_refused:
            with pytest.raises(ValueError, match="there is nothing around"):
                margins_of(chosen, takes_of(chosen))
        else:
            margins_of(chosen, takes_of(chosen))
