"""How long a bake still takes: made-up bakes whose end is known."""

from types import SimpleNamespace

import pytest
from strata.addon.core import progress
from strata.addon.core.execution import Execution
from strata.addon.core.graph import Graph, Node, PlannedLayer, Rate, Step
from strata.addon.core.progress import Forecast
from strata.addon.core.slices import finished
from strata.addon.effects.shared.lit import LIT
from strata.addon.measure.budget import PILOT_SECONDS, MeasuringOutlook

PIXELS, CHUNKS = 10_000, 8
MAP_SECONDS, SURFACE_SECONDS, SHADE_SECONDS = 1.0, 0.1, 0.5
WHOLE = 3 * MAP_SECONDS + CHUNKS * (SURFACE_SECONDS + 3 * SHADE_SECONDS)


@pytest.fixture
def bake(monkeypatch):
    """Three lamps, each with a map that is made once and a node at the surface."""
    monkeypatch.setattr(progress, "_learnt", {})
    maps = [Node(Step("map"), str(lamp), (), {"lamp": lamp}) for lamp in range(3)]
    surface = Node(Step("surface", rate=Rate.SAMPLE), "", (), {})
    shades = [Node(Step("shade", rate=Rate.SAMPLE), "", (surface, each), {}) for each in maps]
    layers = tuple(PlannedLayer(f"Layer {k}", "", shade, LIT) for k, shade in enumerate(shades))
    graph = Graph(layers, (), {surface: frozenset()}, frozenset())
    order = [(node, MAP_SECONDS) for node in maps]
    for _ in range(CHUNKS):
        order += [(surface, SURFACE_SECONDS), *((shade, SHADE_SECONDS) for shade in shades)]
    return graph, order


def worst_factor(graph, order, start: float) -> float:
    execution, passed, worst = Execution(), 0.0, 1.0
    forecast = Forecast([(graph, CHUNKS)], PIXELS, execution, None)
    for node, seconds in order[:-1]:
        execution.add_time(node, "cpu", seconds)
        passed += seconds
        if passed > start * WHOLE:
            left = forecast.seconds_left()
            worst = max(worst, left / (WHOLE - passed), (WHOLE - passed) / left)
    forecast.learn()
    return worst


def test_the_time_left_is_known_once_a_chunk_is_done(bake):
    graph, order = bake
    assert worst_factor(graph, order, 0.3) == pytest.approx(1.0)


def test_a_second_frame_knows_it_from_its_start(bake):
    graph, order = bake
    worst_factor(graph, order, 0.3)
    assert worst_factor(graph, order, 0.0) == pytest.approx(1.0)


def test_nothing_is_left_of_a_graph_that_is_done(bake):
    graph, order = bake
    execution = Execution()
    for node, seconds in order:
        execution.add_time(node, "cpu", seconds)
    assert Forecast([(graph, CHUNKS)], PIXELS, execution, None).seconds_left() == 0.0
    # A second group of lamps runs the surface again.
    assert Forecast([(graph, CHUNKS)] * 2, PIXELS, execution, None).seconds_left() == pytest.approx(
        CHUNKS * (SURFACE_SECONDS + 3 * SHADE_SECONDS)
    )


TREE = Node(
    Step(
        "tree",
        work_of=lambda node, outline: sum(mesh.triangles for mesh in outline.meshes),
        ordinary_seconds=5e-7,
    ),
    "",
    (),
    {},
)


def measured_layers(count: int, triangles: int = 0, probes: int | None = None, others=()) -> MeasuringOutlook:
    """Of layers whose probes take 0.3 ms each, in a graph with the nodes `others` besides."""
    layer = SimpleNamespace(kind=SimpleNamespace(score=SimpleNamespace(probe_seconds=3e-4)))
    graph = SimpleNamespace(layers=[layer] * count, nodes=lambda: others)
    outline = SimpleNamespace(meshes=[SimpleNamespace(triangles=triangles)])
    return MeasuringOutlook(graph, outline, TREE, probes)


def test_measuring_is_expected_to_go_on_as_it_began():
    outlook = measured_layers(4, 2_000_000, 1000)
    assert outlook.seconds_left(10.0) == pytest.approx(1.0 + 4 * 0.3)
    outlook.has_tree = True
    assert outlook.seconds_left(10.0) == pytest.approx(4 * 0.3)

    def measured():
        return "error", 3.0
        yield

    assert finished(outlook.watched(measured())) == ("error", 3.0)
    assert outlook.seconds_left(10.0) == pytest.approx(9.0)


def test_what_layers_are_allowed_bounds_what_measuring_is_expected_to_take():
    few = measured_layers(1)
    assert few.seconds_left(0.1) == pytest.approx(0.75 * 0.15 * 2.0)
    # Two pilots are run whatever there is time for.
    few._taken = 0.3
    least = 40 * 3e-4 + PILOT_SECONDS
    assert few.seconds_left(0.1) == pytest.approx(least)
    assert few.seconds_left(0.1, slower=3.0) == pytest.approx(3 * least)


def test_a_tree_that_an_effect_has_built_is_not_expected_again():
    assert measured_layers(1, 2_000_000, 1000, others=(TREE,)).seconds_left(10.0) == pytest.approx(0.3)


def test_what_the_pilots_say_of_a_layer_is_believed():
    outlook = measured_layers(2)
    told = []

    def measured():
        outlook.expect(5.0)
        told.append(outlook.seconds_left(100.0))
        return "error", 5.0
        yield

    finished(outlook.watched(measured()))
    assert told == [pytest.approx(5.0 + 2048 * 3e-4)]  # and the other as layers mostly do
    assert outlook.seconds_left(100.0) == pytest.approx(2048 * 3e-4)


def test_what_has_more_to_do_takes_as_many_times_as_long(monkeypatch):
    monkeypatch.setattr(progress, "_learnt", {})
    fog = Step("fog", rate=Rate.SAMPLE, work_of=lambda node, outline: node.params["points"])
    small, large = (Node(fog, str(points), (), {"points": points}) for points in (1, 28))
    layers = tuple(PlannedLayer(f"Layer {node.instance}", "", node, LIT) for node in (small, large))
    graph = Graph(layers, (), {}, frozenset())
    execution = Execution()
    forecast = Forecast([(graph, 1)], PIXELS, execution, None)
    execution.add_time(small, "cpu", 2.0)
    assert forecast.seconds_left() == pytest.approx(28 * 2.0)
