"""How long a bake is expected to take, before it begins."""

from __future__ import annotations

from dataclasses import replace

import pytest
from strata.addon import speeds
from strata.addon.bake import BakeJob
from strata.addon.core import progress
from strata.addon.core.graph import Rate
from strata.addon.core.outline import Outline
from strata.addon.expected import (
    LAMP_AUDITED_SECONDS,
    STARTING_SECONDS,
    about_seconds,
    expected_seconds,
)
from strata.addon.planning import Options, plan_scene
from strata.tests.bake.test_bake_job import FROM_ABOVE
from strata.tests.bake.test_passes import two_lamps

SOFT = Options(("soft_shadow",), "cpu", samples=8, probes=0)
TRIES = 3  # another process may have the processor


@pytest.fixture(autouse=True)
def nothing_learnt(monkeypatch):
    monkeypatch.setattr(progress, "_learnt", {})
    monkeypatch.setattr(speeds, "_chosen", [])


LARGER = replace(FROM_ABOVE, source=replace(FROM_ABOVE.source, frame_size=(240, 240)))


def planned(options: Options):
    outline, arrays = two_lamps()
    return outline, plan_scene(outline, LARGER, options), arrays


def baked(options: Options):
    return BakeJob(*planned(options), options).result().report


@pytest.mark.parametrize("target", [0.0, 0.008])
def test_after_one_bake_it_is_within_a_factor_of_two(target):
    options, factors = replace(SOFT, target_error=target, probes=None), []
    for _ in range(TRIES):
        before = baked(options)
        expected = expected_seconds(*planned(options)[:2], options, before.to_json())
        factors.append(expected / baked(options).seconds)
        if 0.5 < factors[-1] < 2.0:
            return
    pytest.fail(f"expected over real: {factors}")


def test_what_the_last_bake_needed_is_expected_again():
    """Of another target by how far that one was; of the same as many samples."""
    aimed, most = replace(SOFT, target_error=0.008), replace(SOFT, samples=64)
    outline, graph, _ = planned(aimed)
    usual = expected_seconds(outline, graph, aimed)
    row = {"samples": 64, "target": {"error": 0.008, "seen": 0.0078}}
    report = {"layers": [{"name": layer.name, **row} for layer in graph.layers]}
    known = expected_seconds(outline, graph, aimed, report)
    assert known > 2.0 * usual
    assert known > expected_seconds(outline, graph, most)  # that and deciding
    loose = replace(aimed, target_error=0.1)
    assert expected_seconds(outline, graph, loose, report) < usual
    assert expected_seconds(outline, graph, replace(aimed, time_budget_s=0.01), report) == 0.01


def test_nothing_takes_no_time():
    nothing = Outline("S", "V", 1)
    assert expected_seconds(nothing, plan_scene(nothing, FROM_ABOVE, SOFT), SOFT) == 0.0


def test_speeds_are_kept_for_the_next_blender(tmp_path, monkeypatch):
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(speeds, "LEAST_SECONDS", 0.0)
    baked(SOFT)
    learnt = progress.learnt("cpu")
    assert learnt
    for backend, device in (("gpu", "gpu"), ("auto", "cpu"), ("cpu", "cpu")):
        monkeypatch.setattr(progress, "_learnt", {})
        assert speeds.recall_speeds(backend) == device
        assert progress.learnt(device).keys() == (learnt.keys() if device == "cpu" else set())
    speeds.keep_speeds("auto", "gpu", 1.0)  # which chose that
    assert speeds.recall_speeds("auto") == "gpu"
    monkeypatch.setattr(speeds, "_chosen", [])  # the next Blender
    assert speeds.recall_speeds("auto") == "gpu"
    speeds.recall_speeds("cpu")
    assert progress.learnt("cpu") == {kind: pytest.approx(each, rel=1e-3) for kind, each in learnt.items()}


def test_what_a_gpu_took_is_not_expected_of_the_cpu():
    outline, graph, _ = planned(SOFT)
    usual = expected_seconds(outline, graph, SOFT)
    kinds = {(node.step.name, node.rate == Rate.SAMPLE): 1e-12 for node in graph.nodes()}
    progress.recall("gpu", kinds)
    assert expected_seconds(outline, graph, SOFT) == usual
    progress.recall("cpu", kinds)
    assert expected_seconds(outline, graph, SOFT) < 0.5 * usual


def test_images_of_errors_and_audits_are_expected_too():
    measured = replace(SOFT, probes=64)
    outline, graph, _ = planned(measured)
    usual = expected_seconds(outline, graph, measured)
    images = sum(layer.kind.score.pixel_seconds for layer in graph.layers if layer.kind.score) * 240 * 240
    with_images = expected_seconds(outline, graph, replace(measured, error_images=True))
    assert with_images - usual == pytest.approx(images)
    assert expected_seconds(outline, graph, replace(SOFT, error_images=True)) < usual  # nothing is measured
    audited = expected_seconds(outline, graph, measured, is_audited=True)
    assert audited - usual == pytest.approx(STARTING_SECONDS + 2 * LAMP_AUDITED_SECONDS, rel=0.05)
    assert expected_seconds(outline, graph, replace(measured, time_budget_s=0.01), is_audited=True) > 1.0


@pytest.mark.parametrize(
    "held", ["", "{", "[1]", '{"cpu": [], "auto": {}}', '{"cpu": {"a run": "x", "b": -1}}']
)
def test_a_spoilt_file_of_speeds_says_nothing(tmp_path, monkeypatch, held):
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path))
    (tmp_path / speeds.NAME).write_text(held)
    for backend in ("cpu", "auto"):
        speeds.recall_speeds(backend)
    assert progress.learnt("cpu") == {}


def test_a_folder_that_cannot_be_written_to_keeps_nothing(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "file" / "cache"))
    speeds.keep_speeds("cpu", "cpu", 10.0)
    speeds.recall_speeds("cpu")


@pytest.mark.parametrize(
    ("seconds", "told"),
    [
        (0.2, "about a second or less"),
        (3.4, "about 3 s"),
        (12.0, "about 10 s"),
        (200.0, "about 3 min"),
        (9e3, "about 2 h"),
    ],
)
def test_a_person_is_told_its_size(seconds, told):
    assert about_seconds(seconds) == told
