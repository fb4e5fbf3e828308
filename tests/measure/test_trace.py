"""A trace adds up, changes nothing, and says of work what was measured of it."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest
from strata.addon.bake import BakeJob
from strata.addon.core.executor import Executor
from strata.addon.core.graph import Node, Step
from strata.addon.core.observer import NOBODY
from strata.addon.core.sampling import Sampling
from strata.addon.devices.cpu import CpuDevice
from strata.addon.measure.trace import Event, Machine, Trace, Work, frames_of
from strata.addon.planning import Options, plan_scene
from strata.ops.tracing import frames_table
from strata.tests.measure.scenes import random_scene, shot_of
from strata.tests.support.executing import SIZE, depth_graph, drain, tilted_quad_scene

MACHINE = Machine(bandwidth=1e9, cores=4, others_cores=0.0)
ROUNDING_US = 0.01


def baked(observer=NOBODY, **options):
    observer.stage("Planning")
    outline, arrays = random_scene(1)
    options = Options(**{"backend": "cpu", "samples": 4, "probes": 256, **options})
    graph = plan_scene(outline, shot_of(1), options)
    return BakeJob(outline, graph, arrays, options, observer=observer).result()


def told_of(trace: Trace) -> tuple[dict, list[dict]]:
    """The file as a reader has it, and its complete events."""
    trace.end()
    told = json.loads(json.dumps(trace.to_json(frame=1), allow_nan=False))
    return told["otherData"], [event for event in told["traceEvents"] if event["ph"] == "X"]


def test_a_traced_bake_has_the_same_bits():
    plain, traced = baked(), baked(Trace())
    for one, other in zip(plain.layers.layers, traced.layers.layers, strict=True):
        assert one.name == other.name
        assert np.array_equal(one.pixels, other.pixels)


def test_events_nest_and_add_up():
    trace = Trace()
    report = baked(trace).report
    whole, events = told_of(trace)
    around: list[float] = []  # ends of those that are under way
    for event in events:
        start, end = event["ts"], event["ts"] + event["dur"]
        while around and around[-1] <= start + ROUNDING_US:
            around.pop()
        assert end <= min(around, default=end) + ROUNDING_US
        around.append(end)
    seconds = 1e-6 * sum(event["dur"] for event in events if event["cat"] == "stage")
    assert seconds == pytest.approx(whole["seconds"], rel=1e-6)
    assert sum(row["seconds"] for row in whole["summary"]) == pytest.approx(seconds, rel=1e-6)
    assert sum(row["share"] for row in whole["summary"]) == pytest.approx(1.0, rel=1e-6)
    runs = {row["name"]: row["count"] for row in whole["summary"] if row["where"] == "cpu"}
    for step in {step.name for step in report.steps} - {"coarse_picture"}:
        assert runs[step] >= 1, step


def test_a_bake_to_a_target_says_what_watching_took():
    trace = Trace()
    baked(trace, target_error=0.05)
    _, events = told_of(trace)
    (baking,) = (event for event in events if event["name"] == "Baking")
    assert 0.0 < baking["args"]["watching_s"] < 1e-6 * baking["dur"]


def test_an_event_says_what_its_node_read_and_made():
    outline, arrays = tilted_quad_scene()
    device = CpuDevice()
    device.set_scene(outline, arrays)
    executor = Executor(device, device)
    executor.observer = trace = Trace()
    constant = Node(Step("constant", cpu=lambda device: np.zeros(1000, np.float32)), "Key", (), {})
    add = Step("add", cpu=lambda device, surface, other: surface["depth"] + other[0])
    drain(executor.run(depth_graph(outline, constant, step=add), Sampling(*SIZE, 2)))
    _, events = told_of(trace)
    named = [event for event in events if event["name"] == "add" and event["args"].get("tile")]
    first = next(event["args"] for event in events if event["name"] == "constant")
    assert (first["instance"], first["read_bytes"], first["made_bytes"]) == ("Key", 0, 4000)
    assert first["least_s"] > 0.0
    pixels = 4 * SIZE[0] * SIZE[1]
    assert [event["args"]["sample"] for event in named if event["args"]["read_bytes"]] == [0, 1]
    assert named[0]["args"]["tile"] == f"rows 0 to {SIZE[1]}"
    assert named[0]["args"]["made_bytes"] == pixels
    assert named[0]["args"]["read_bytes"] == 4000 + pixels  # of the surface only its depth is asked for
    tracks = {event["tid"] for event in events}
    assert len(tracks) == 2  # nodes, films; there were no stages


def test_work_that_fails_is_no_event():
    outline, arrays = tilted_quad_scene()
    device = CpuDevice()
    device.set_scene(outline, arrays)
    executor = Executor(device, device)
    executor.observer = trace = Trace()
    with pytest.raises(ZeroDivisionError):
        drain(executor.run(depth_graph(outline, step=Step("bad", cpu=lambda *_: 1 // 0)), Sampling(*SIZE)))
    assert {event.name for event in trace.events} == {"geometry", "surface"}


@pytest.mark.parametrize(
    ("bound", "work"),
    [
        ("bytes", Work(1.0, 4.0, 0.0, read_bytes=400_000_000, made_bytes=100_000_000)),
        ("operations", Work(1.0, 3.9, 0.0, read_bytes=400_000_000, made_bytes=90_000_000)),
        ("operations", Work(1.0, 1.3, 0.0)),
        ("one core", Work(1.0, 1.2, 0.5)),
        ("one core", Work(1.0, 1.0, None)),  # another thread ended it
        ("Python", Work(1.0, 1.0, 0.9)),
        ("waiting", Work(1.0, 0.4, 0.4)),
        ("GPU wait", Work(1.0, 1.0, 1.0, wait_s=0.5)),
        ("compiling", Work(1.0, 1.0, 1.0, wait_s=0.1, compile_s=0.6)),
        ("draw calls", Work(1.0, 1.0, 1.0, wait_s=0.4)),
    ],
)
def test_what_bounds_work(bound, work):
    assert work.bound(MACHINE) == bound


def test_where_others_have_the_cores_one_is_all_there_is():
    busy = Machine(1e9, 4, others_cores=3.0)
    assert Work(1.0, 1.0, 0.0).bound(MACHINE) == "one core"
    assert Work(1.0, 1.0, 0.0).bound(busy) == "operations"


def test_frames_that_missed_their_budget_say_what_took_most_of_them():
    """Four frames of 10, 20, 40 and 40 ms for a budget of 16.6, and a stage that had none."""
    trace, began = Trace(), 0.0
    for frame_ms, step_ms, maps_ms in ((10, 9, 0), (20, 15, 4), (40, 10, 25), (40, 5, 5), (100, 0, 0)):
        args = {} if frame_ms == 100 else {"budget_ms": 16.6}
        trace.events.append(Event("Redraw", "stages", began, Work(1e-3 * frame_ms, 1e-3 * frame_ms), args))
        at = began
        for name, ms in (("surface", step_ms), ("maps", maps_ms)):
            trace.events.append(Event(name, "cpu", at, Work(1e-3 * ms, 3e-3 * ms)))
            at += 1e-3 * ms
        began += 1e-3 * frame_ms
    told = frames_of(trace, MACHINE)
    assert (told["count"], told["late"]) == (4, 3)
    assert told["median_ms"] == pytest.approx(30.0)
    assert told["longer"] == {"33 ms": 2, "16.6 ms": 3, "11.1 ms": 3}
    why = {row["what"]: (row["frames"], round(row["ms"], 6), row["bound"]) for row in told["why"]}
    assert why == {
        "surface": (1, 15.0, "operations"),
        "maps": (1, 25.0, "operations"),
        "between nodes": (1, 30.0, "waiting"),
    }
    assert "3 missed their own budget" in "\n".join(frames_table({"frames": told}))
    assert frames_of(Trace(), MACHINE) == {}
    assert frames_table({}) == []


def test_python_is_told_from_kernels_by_whose_time_it_is():
    trace = Trace()
    trace.stage("adding")
    sum(range(2_000_000))
    trace.stage("sleeping")
    time.sleep(0.05)
    whole, _ = told_of(trace)
    bounds = {row["name"]: row["bound"] for row in whole["summary"]}
    assert bounds == {"adding": "Python", "sleeping": "waiting"}
