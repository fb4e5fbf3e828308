"""Films: what a pixel's samples become, and steps that work on finished images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.core.effect import LayerKind, Reduce
from strata.addon.core.execution import Execution
from strata.addon.core.executor import Executor
from strata.addon.core.film import Film, takes_of
from strata.addon.core.graph import Node, PlannedLayer, Rate, Step
from strata.addon.core.sampling import Sampling
from strata.addon.core.shot import PixelFilter
from strata.addon.core.surface import Chunk
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared.weights import FLOOR, FLOOR_OFF_SURFACES
from strata.tests.support.executing import SIZE, depth_graph, drain, tilted_quad_scene

BOX = PixelFilter("BOX", 0.5)
TILES = [None, SIZE[0] * 5, SIZE[0]]


def fed(film: Film, samples: list, weights: list | None = None) -> Film:
    """One row of pixels, sample by sample."""
    for number, values in enumerate(samples):
        chunk = Chunk(len(values), 1, 0, 1, number, (0.0, 0.0), len(samples))
        weight = None if weights is None else np.array([weights[number]], np.float32)
        film.add(chunk, np.array([values], np.float32), weight)
    return film


def test_a_mean_of_samples_and_of_their_squares():
    film = fed(Film("a", (1, 2), has_squares=True), [(1.0, 5.0), (3.0, 5.0)])
    assert film.image().tolist() == [[2.0, 5.0]]
    assert film.squares().tolist() == [[5.0, 25.0]]
    assert film.finished().tolist() == [[2.0, 5.0]]


def test_a_weighted_mean_is_a_ratio_of_sums():
    film = Film("a", (1, 2), weights=(1, 2), has_squares=True)
    fed(film, [(1.0, 1.0), (0.0, 2.0)], [(3.0, 1e-30), (1.0, 2.0)])
    assert film.image().tolist() == [[0.75, 2.0]]
    assert film.squares().tolist() == [[0.75, 4.0]]
    assert film.finished().tolist() == [[0.75, 2.0]]
    assert film.weights.tolist() == [[2.0, 1.0]]


def test_parts_with_samples_of_their_own_join():
    """Terms of a sum by their means, and parts of a weight too: as though both had had as many samples."""
    first, last = fed(Film("a", (1, 1)), [(1.0,), (3.0,)]), fed(Film("a", (1, 1)), [(4.0,)] * 5)
    image = first.finished()
    first.join(last.finished(), None)
    assert image.tolist() == [[6.0]]
    first = fed(Film("a", (1, 1), weights=(1, 1)), [(1.0,), (0.0,)], [(3.0,), (1.0,)])
    last = fed(Film("a", (1, 1), weights=(1, 1)), [(0.25,)] * 4, [(2.0,)] * 4)
    image = first.finished()
    first.join(last.finished(), last.weights)
    assert image.tolist() == [[0.5]]  # of weights 2 and 2
    assert first.weights.tolist() == [[4.0]]


def test_pixels_of_a_film_under_way():
    film = fed(Film("a", (1, 3)), [(1.0, 2.0, 3.0), (3.0, 4.0, 5.0)])
    assert film.at(np.array([2, 0])).tolist() == [[4.0], [2.0]]


def test_where_all_weigh_nothing_the_mean_over_surfaces_stands():
    film = Film("a", (1, 3), weights=(1, 3))
    samples = [(0.25, 0.25, 1.0), (0.75, 0.75, 1.0), (0.5, 1.0, 1.0)]
    weights = [(FLOOR, FLOOR, FLOOR_OFF_SURFACES)] * 2 + [(FLOOR, FLOOR_OFF_SURFACES, FLOOR_OFF_SURFACES)]
    assert np.allclose(fed(film, samples, weights).finished(), [[0.5, 0.5, 1.0]], rtol=2e-6)


def test_one_sample_and_equal_samples_keep_their_bits():
    values = np.random.default_rng(1).uniform(0.0, 1.0, 64).astype(np.float32)
    weights = np.random.default_rng(2).uniform(1e-30, 1e3, (5, 64)).astype(np.float32)
    for samples in (1, 5):
        film = fed(Film("a", (1, 64), weights=(1, 64)), [values] * samples, list(weights[:samples]))
        assert np.array_equal(film.finished()[0], values)


def test_a_sample_may_come_in_parts_of_its_weight():
    film = Film("a", (1, 1), weights=(1, 1))
    for weights in ((3.0, 1.0), (1.0, 1.0)):
        fed(film, [(1.0,), (0.0,)], [(weight,) for weight in weights])
    assert np.allclose(film.finished(), 4.0 / 6.0)
    assert film.weights.tolist() == [[3.0]]


def test_the_samples_of_some_pixels_are_kept():
    """Numbered row by row, whatever the tiles; as they are, not as they weigh."""
    kept = np.array([1, 4, 5])
    rng = np.random.default_rng(3)
    samples, weights = rng.random((2, 3, 2, 2)).astype(np.float32), rng.random((2, 3, 2)).astype(np.float32)
    film = Film("a", (3, 2, 2), weights=(3, 2), kept_pixels=kept)
    for y0, y1 in ((0, 1), (1, 3)):
        for number in range(2):
            chunk = Chunk(2, 3, y0, y1, number, (0.0, 0.0), 2)
            film.add(chunk, samples[number, y0:y1], weights[number, y0:y1])
    assert np.array_equal(film.samples, samples.reshape(2, 6, 2)[:, kept])
    assert Film("b", (1, 2)).samples == []


def test_only_measured_layers_keep_samples():
    outline, arrays = tilted_quad_scene()
    device = CpuDevice()
    device.set_scene(outline, arrays)
    graph, kept = depth_graph(outline), np.array([0, 17, 100])
    for score in (None, print):
        layers = tuple(replace(each, kind=replace(each.kind, score=score)) for each in graph.layers)
        executor, execution = Executor(device, device), Execution(kept_pixels=kept)
        drain(executor.run(replace(graph, layers=layers), Sampling(*SIZE, 3, BOX, SIZE[0] * 5), execution))
        assert set(execution.samples_of) == (set() if score is None else {"Depth"})
    samples = execution.samples_of["Depth"]
    assert samples.shape == (3, 3, 1)
    mean = execution.images["Depth"].reshape(-1)[kept]
    assert np.allclose(samples.mean(axis=0)[:, 0], mean, rtol=1e-6)


def test_a_weight_counts_for_every_channel_or_each_has_its_own():
    samples = [[(1.0, 2.0)], [(5.0, 6.0)]]
    film = fed(Film("a", (1, 1, 2), weights=(1, 1)), samples, [(3.0,), (1.0,)])
    assert film.finished().tolist() == [[[2.0, 3.0]]]
    film = fed(Film("a", (1, 1, 2), weights=(1, 1, 2)), samples, [[(3.0, 1.0)], [(1.0, 3.0)]])
    assert film.finished().tolist() == [[[2.0, 5.0]]]


def test_ids_have_no_mean():
    film = fed(Film("a", (1, 2), Reduce.FIRST), [(7.0, -1.0), (9.0, 4.0)])
    assert film.finished().tolist() == [[7.0, -1.0]]


def test_terms_of_a_sum_are_added_under_their_own_samples():
    film = fed(Film("a", (1, 1)), [(1.0,), (3.0,)])
    assert film.image().tolist() == [[2.0]]
    assert fed(film, [(10.0,), (30.0,)]).finished().tolist() == [[22.0]]


@pytest.fixture
def scene():
    outline, arrays = tilted_quad_scene()
    device = CpuDevice()
    device.set_scene(outline, arrays)
    return outline, device


def images(graph, device, samples: int, tile_pixels: int | None = None) -> dict[str, np.ndarray]:
    executor = Executor(device, device)
    drain(executor.run(graph, Sampling(*SIZE, samples, BOX, tile_pixels)))
    assert not executor.execution.films
    return executor.execution.images


def layer_of(node: Node, name: str, **more) -> PlannedLayer:
    return PlannedLayer(
        name, "test", node, LayerKind(name, "V", reduce=more.pop("reduce", Reduce.MEAN)), **more
    )


SQUARED = Step("squared", cpu=lambda device, image: image * image, rate=Rate.PICTURE)
FLIPPED = Step(
    "flipped", cpu=lambda device, *images: np.ascontiguousarray(images[0][::-1]), rate=Rate.PICTURE
)


@pytest.mark.parametrize("tile_pixels", TILES)
@pytest.mark.parametrize("is_layer", [True, False])
def test_a_step_on_finished_images_runs_once_on_the_mean(scene, tile_pixels, is_layer):
    outline, device = scene
    graph = depth_graph(outline)
    depth = graph.layers[0]
    squared = Node(SQUARED, "", (depth.node,), {})
    flipped = Node(FLIPPED, "", (squared,), {})
    layers = (*([depth] if is_layer else []), layer_of(squared, "Squared"), layer_of(flipped, "Flipped"))
    found = images(replace(graph, layers=layers), device, 3, tile_pixels)
    mean = images(graph, device, 3)["Depth"]
    assert set(found) == {layer.name for layer in layers}
    assert np.array_equal(found["Squared"], mean * mean)  # a mean of squares would be larger
    assert np.array_equal(found["Flipped"], (mean * mean)[::-1])


def test_only_what_a_finished_image_is_read_of_gets_a_film_of_its_own(scene):
    outline, _ = scene
    graph = depth_graph(outline)
    squared = Node(SQUARED, "", (graph.layers[0].node,), {})
    both = replace(graph, layers=(*graph.layers, layer_of(squared, "Squared")))
    assert [take.name for take in takes_of(both)] == ["Depth"]
    alone = replace(graph, layers=both.layers[1:])
    assert [take.name for take in takes_of(alone)] == [graph.layers[0].node.key]
    assert squared.rate == Rate.PICTURE


@pytest.mark.parametrize("tile_pixels", TILES)
def test_a_weighted_layer_is_weighed_by_its_node(scene, tile_pixels):
    outline, device = scene
    graph = depth_graph(outline)
    depth = graph.layers[0].node
    middle = np.float32(np.median(images(graph, device, 1)["Depth"]))
    near = Step("near", cpu=lambda device, depth: np.float32(FLOOR) + np.float32(1.0) * (depth < middle))
    near = Node(near, "", (depth,), {})
    product = Node(Step("product", cpu=lambda device, a, b: a * b), "", (depth, near), {})
    weighted = layer_of(depth, "Weighted", weight=near)
    layers = (weighted, *(layer_of(node, node.step.name) for node in (near, product)), graph.layers[0])
    executor = Executor(device, device)
    drain(executor.run(replace(graph, layers=layers), Sampling(*SIZE, 4, BOX, tile_pixels)))
    found = executor.execution.images
    expected = np.where(found["near"] > FLOOR, found["product"] / found["near"], found["Depth"])
    assert 0.0 < (found["near"] > FLOOR).mean() < 1.0
    assert np.allclose(found["Weighted"], expected, rtol=1e-6)  # sums and means round apart
    assert executor.execution.weights.keys() == {"Weighted"}
    assert np.array_equal(executor.execution.weights["Weighted"], found["near"])


def test_a_preview_develops_what_it_has_so_far(scene):
    outline, device = scene
    graph = depth_graph(outline)
    squared = Node(SQUARED, "", (graph.layers[0].node,), {})
    graph = replace(graph, layers=(layer_of(squared, "Squared"),))
    executor = Executor(device, device)
    sampling = Sampling(*SIZE, 3, BOX, SIZE[0] * 5, is_progressive=True)
    execution, takes = None, takes_of(graph)
    for chunk in sampling.chunks():
        drain(executor.frame(graph, chunk, 1, execution))
        execution = executor.execution
        for take in takes:
            executor.collect(take, chunk)
        if chunk.y1 == SIZE[1]:
            for _ in executor.develop(graph, takes, execution):
                pass
            fewer = images(graph, device, 3)["Squared"] if chunk.sample == 2 else None
    assert np.array_equal(execution.images["Squared"], fewer)
    whole = next(Sampling(*SIZE).chunks())
    drain(executor.frame(graph, whole, 2))
    assert np.array_equal(executor.layer_value(graph.layers[0])[1], images(graph, device, 1)["Squared"])


@pytest.mark.parametrize("most_surface_bytes", [0, 16 * SIZE[0] * SIZE[1], 1 << 20])
def test_a_preview_makes_each_sample_once_whatever_it_may_keep(scene, most_surface_bytes):
    outline, device = scene
    graph, execution = depth_graph(outline), Execution()
    executor = Executor(device, device, most_surface_bytes=most_surface_bytes)
    sampling = Sampling(*SIZE, 6, BOX, tile_pixels=TILES[1], is_progressive=True)
    for chunk in sampling.chunks():
        drain(executor.frame(graph, chunk, 1, execution))
        for take in takes_of(graph):
            executor.collect(take, chunk)
    runs = {timing.node.step.name: timing.runs for timing in execution.timings.values()}
    assert runs["surface"] == runs["pick"] == sampling.chunk_count
