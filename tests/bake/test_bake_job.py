"""A bake's report and its slices, on scenes made without Blender."""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import replace

import numpy as np
import pytest
from strata.addon.bake import Baked, BakeJob
from strata.addon.core.arrays import Arrays
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.errors import Cancelled, StrataError
from strata.addon.core.outline import Light, Outline
from strata.addon.core.shot import Camera, Raster, Shot
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared.coarse_picture import COARSER, seen_boxes
from strata.addon.effects.shared.visibility_truth import SCORE
from strata.addon.effects.soft_shadow import EFFECT as SOFT_SHADOW
from strata.addon.effects.soft_shadow.run import needed
from strata.addon.measure.report import LayerError, NotMeasured
from strata.addon.measure.report_text import format_table
from strata.addon.measuring import Measuring
from strata.addon.planning import Options, plan_scene
from strata.tests.measure.scenes import random_scene, shot_of
from strata.tests.support.flat_scenes import DOWN, FLOOR, PLATE, lamp, scene_of
from strata.tests.support.settings import maps

FROM_ABOVE = Shot("Camera", Raster(Camera("Camera", (0.0, 0.0, 10.0), **DOWN), (64, 64)))


def job_of(outline: Outline, arrays: Arrays, shot: Shot = FROM_ABOVE, **options) -> BakeJob:
    options = Options(backend="cpu", **{"samples": 1, "probes": 128, **options})
    return BakeJob(outline, plan_scene(outline, shot, options), arrays, options)


def bake(seed: int = 1, **options) -> Baked:
    return job_of(*random_scene(seed), shot_of(seed), **options).result()


@pytest.mark.parametrize("method", ["bitmask", "hybrid"])
def test_every_second_is_in_the_report_once(method):
    values = {"soft_shadow": {"method": method, "resolution": 512}}
    report = max((bake(probes=2048, samples=4, values=values).report for _ in range(3)), key=share_told)
    names = [step.name for step in report.steps]
    assert names.count("coarse_picture") == names.count("geometry") == names.count("surface") == 1
    # Measuring traces rays too; their tree is a step only where the layer itself needs it.
    assert names.count("ray_accelerator") == (method == "hybrid")
    (layer,) = report.layers
    steps = math.fsum(step.seconds for step in report.steps)
    assert layer.seconds == pytest.approx(steps)
    assert layer.seconds_alone == pytest.approx(steps)
    # The rest: planning, starting, putting the report together. A busy machine pauses anywhere, hence three.
    assert 0.8 <= share_told(report) <= 1.0


def share_told(report) -> float:
    """Of a report's seconds, those that it says what they were for."""
    steps = math.fsum(step.seconds for step in report.steps)
    errors = math.fsum(layer.error.seconds for layer in report.layers)
    return (steps + errors + report.compile_seconds) / report.seconds


def test_what_layers_share_is_no_ones_own():
    outline, arrays = random_scene(1)
    lights = (outline.lights[0], replace(outline.lights[0], name="Other"))
    baked = job_of(replace(outline, lights=lights), arrays, shot_of(1), values=maps()).result()
    shared = {"coarse_picture", "geometry", "surface"}
    first, second = baked.report.layers
    steps = dict.fromkeys(("shared", "own"), 0.0)
    for step in baked.report.steps:
        steps["shared" if step.name in shared else "own"] += step.seconds
    # Two lights that are the same are the same nodes: nothing is either's own.
    assert first.seconds == second.seconds
    for layer in (first, second):
        assert layer.seconds_alone >= layer.seconds + steps["shared"]


def test_the_seed_chooses_the_probes():
    errors = [bake(seed=1, **{"probes": 64}).report.layers[0].error for _ in range(2)]
    assert errors[0].value == errors[1].value
    outline, arrays = random_scene(1)
    other = job_of(outline, arrays, shot_of(1), probes=64, seed=7).result()
    assert other.report.seed == 7
    assert other.report.layers[0].error.value != errors[0].value


def test_a_layer_that_is_right_wherever_it_is_screened_has_an_upper_limit():
    baked = job_of(*scene_of([FLOOR], [lamp()])).result()
    (layer,) = baked.report.layers
    assert layer.error.value == layer.error.ci95[0] == 0.0
    assert 0.0 < layer.error.ci95[1] < 0.05


def test_looking_and_measuring_come_in_slices():
    outline, arrays = random_scene(1)
    job = job_of(outline, arrays, shot_of(1, (1600, 1600)), probes=2048)
    stages = []
    while not job._is_done:
        next(job._work, None)
        stages.append(job.stage)
    assert stages.count("Starting") >= 3  # a 400 x 400 look in strips
    assert stages.count("Measuring") >= 10


def test_a_slice_of_no_time_gets_on_all_the_same():
    job = job_of(*random_scene(1), shot_of(1))
    for _ in range(10_000):
        if job.advance(0.0):
            break
    assert job.stage == "Done"
    assert job.advance(0.0)


@pytest.mark.parametrize("stage", ["Starting", "Baking", "Measuring"])
def test_the_next_slice_after_cancelling_raises(stage):
    outline, arrays = random_scene(1)
    job = job_of(outline, arrays, shot_of(1, (1200, 1200)), probes=2048)
    next(job._work)
    while job.stage != stage:
        next(job._work)
    job.cancel()
    with pytest.raises(Cancelled):
        job.advance()
    with pytest.raises(Cancelled):  # and for good
        job.advance()


def test_what_there_is_so_far_is_shown_and_changes_nothing():
    options = {"samples": 8, "probes": 0, "composite": True}
    job = job_of(*random_scene(1), shot_of(1), **options)
    job.tiles = deque()
    composite = job.result().composite
    np.testing.assert_array_equal(composite, bake(**options).composite)
    assert {first_row for first_row, _ in job.tiles} == {0}
    apart = [float(np.abs(tile - composite).mean()) for _, tile in job.tiles]  # after 1, 2, 4, 8 samples
    assert len(apart) == 4
    assert apart == sorted(apart, reverse=True)
    assert apart[0] > 0.0 == apart[-1]


def test_a_bake_whose_every_layer_the_coarse_picture_empties():
    """Boxes say that the lamp shines on the floor; the coarse picture, that the lid hides both from the
    camera. What it hides is larger than what is seen: smaller things could be between its pixels."""
    lid, plate = ((-9.0, -9.0, 6.0), (9.0, 9.0, 6.0)), ((-2.5, -2.5, 1.0), (2.5, 2.5, 1.0))
    outline, arrays = scene_of([FLOOR, plate, lid], [lamp()])
    job = job_of(outline, arrays, samples=2)
    assert len(job.graph.layers) == 1
    baked = job.result()
    assert baked.layers.layers == ()
    assert baked.report.layers == ()
    assert dict(baked.report.left_out)["Soft Shadow Lamp"] == "reaches nothing in view"


def test_hairs_between_the_coarse_pictures_pixels_are_kept():
    """A hair a thousandth of a pixel wide, right between two of the coarse picture's columns."""
    side = 64 // COARSER
    step = 2.0 * 10.0 * 18.0 / 50.0 / side  # metres of a look's pixel on the floor
    hair = ((0.0, -0.3, 0.01), (0.001 * step, 0.3, 0.01))
    outline, arrays = scene_of([FLOOR, hair], [lamp()])
    device = CpuDevice()
    device.set_scene(outline, arrays)
    boxes = seen_boxes(device, device.geometry(), outline, FROM_ABOVE, frozenset({0, 1}))
    assert np.any(np.all(boxes == np.array(hair), axis=(1, 2)))
    alone = seen_boxes(device, device.geometry(), outline, FROM_ABOVE, frozenset({0}))
    assert len(boxes) == len(alone) + 1


@pytest.mark.parametrize("size", [(32_769, 4), (4, 40_000)])
def test_an_image_too_large_for_the_rasteriser_is_refused_in_one_line(size):
    with pytest.raises(StrataError, match=r"at most 32768") as refusal:
        shot_of(0, size)
    assert "\n" not in str(refusal.value)


def test_reasons_name_their_cause():
    def reason(light: Light) -> str:
        outline, _ = scene_of([FLOOR, PLATE], [light, replace(lamp(), name="Other")])
        assert needed(outline) is None
        left_out = plan_scene(outline, FROM_ABOVE, Options(backend="cpu")).left_out
        return next((each.reason for each in left_out if each.what == "Soft Shadow Lamp"), "")

    assert reason(lamp()) == ""
    assert reason(lamp(power=0.0)) == "no power"
    assert reason(lamp(side=0.0, power=0.0)) == "an area light of no size gives no light"
    assert "ray visibility" in reason(replace(lamp(), receivers=frozenset()))
    assert reason(replace(lamp(), receivers=frozenset({1}))) == ""
    assert reason(replace(lamp(), casts_shadow=False)) == "its shadow is switched off"


WRONG_SIDE = 1.0


def broken_for(error: BaseException):
    """The truth of soft shadows, which raises for lamps at x = WRONG_SIDE."""

    def truth(rays, outline, layer, *others):
        if outline.lights[layer.of.index].emitter.centre[0] == WRONG_SIDE:
            raise error
        return SCORE.truth(rays, outline, layer, *others)

    return truth


def two_lamps(monkeypatch, error: BaseException, **options) -> BakeJob:
    """A lamp whose shadow's reference raises, and a good one."""
    kind = replace(SOFT_SHADOW.layers[0], score=replace(SCORE, truth=broken_for(error)))
    lamps = [lamp((WRONG_SIDE, 0.0, 5.0)), replace(lamp((0.0, 0.0, 5.0)), name="Other", key="Other")]
    outline, arrays = scene_of([FLOOR, PLATE], lamps)
    job = job_of(outline, arrays, **options)
    original = Measuring.errors

    def errors(self, graph):
        layers = tuple(replace(layer, kind=kind) for layer in graph.layers)
        return original(self, replace(graph, layers=layers))

    monkeypatch.setattr(Measuring, "errors", errors)
    return job


@pytest.mark.parametrize("error", [ValueError("no\nluck"), MemoryError(), ZeroDivisionError()])
def test_a_layer_that_cannot_be_measured_is_baked_and_the_others_measured(monkeypatch, error):
    baked = two_lamps(monkeypatch, error).result()
    bad, good = baked.report.layers
    assert isinstance(bad.error, NotMeasured)
    assert "\n" not in bad.error.why
    assert isinstance(good.error, LayerError)
    assert set(baked.layers.layers[0].error) == {"not_measured"}
    assert baked.layers.layers[0].pixels.min() < 0.1 < baked.layers.layers[0].pixels.max()
    assert f"{bad.name} is not measured: " in format_table(baked.report)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), Cancelled()])
def test_interrupts_pass_through_measuring(monkeypatch, error):
    with pytest.raises(type(error)):
        two_lamps(monkeypatch, error).result()


def test_layers_are_whole_where_the_tree_cannot_be_built(monkeypatch):
    monkeypatch.setattr("strata.addon.measuring.ray_accelerator", lambda outline, shot: 1 / 0)
    (layer,) = bake().layers.layers
    assert "ZeroDivisionError" in layer.error["not_measured"]


def test_only_probes_that_nobody_set_are_limited():
    (layer,) = bake(probes=None).report.layers
    assert 32 <= layer.error.probes_in_time <= 2048
    assert layer.to_json()["error"]["probes_in_time"] == layer.error.probes_in_time
    (layer,) = bake(probes=128).report.layers
    assert layer.error.probes_in_time is None
    assert "probes_in_time" not in layer.to_json()["error"]


def test_shots_of_one_job_share_what_no_camera_changes():
    """A lamp's maps for fog are made once for two cameras, and no pixel is another than by itself."""
    lamps = [
        replace(
            lamp(),
            kind="POINT",
            emitter=Emitter(EmitterKind.SPHERE, (0.0, 0.0, 5.0), *DOWN.values(), 0.0, 0.0),
        )
    ]
    outline, arrays = scene_of([FLOOR, PLATE], lamps)
    aside = replace(FROM_ABOVE.source.camera, eye=(0.5, 0.0, 9.0))
    shots = FROM_ABOVE, replace(FROM_ABOVE, name="Aside", source=Raster(aside, (48, 32)))
    fog = {"use_scene_medium": False, "scattering_per_m": (0.1, 0.1, 0.1)}
    options = Options(("soft_shadow", "volumetric_light"), "cpu", 1, 0, {"volumetric_light": fog})
    graphs = [plan_scene(outline, shot, options) for shot in shots]
    together = BakeJob(outline, graphs, arrays, options).results()
    ran = [Counter(step.name for step in baked.report.steps) for baked in together]
    assert ran[0]["volumetric_light/light_map"] > 0
    assert ran[1]["volumetric_light/light_map"] == ran[1]["geometry"] == 0
    assert ran[1]["surface"] == ran[1]["volumetric_light/airlight"] == 1
    for graph, baked in zip(graphs, together, strict=True):
        alone = BakeJob(outline, graph, arrays, options).result()
        assert [each.name for each in alone.layers.layers] == [each.name for each in baked.layers.layers]
        for one, other in zip(alone.layers.layers, baked.layers.layers, strict=True):
            assert np.array_equal(one.pixels, other.pixels)


def test_a_shot_is_not_warned_of_what_another_takes():
    outline, arrays = scene_of([FLOOR, PLATE], [lamp()])
    larger = replace(FROM_ABOVE, name="Larger", source=Raster(FROM_ABOVE.source.camera, (480, 320)))
    shots = FROM_ABOVE, larger
    options = Options(("soft_shadow",), "cpu", 1, 0, memory_bytes=1)
    graphs = [plan_scene(outline, shot, options) for shot in shots]
    warnings = [
        baked.layers.report["warnings"] for baked in BakeJob(outline, graphs, arrays, options).results()
    ]
    assert [len(each) for each in warnings] == [1, 1]
    assert all("over its budget" in each for (each,) in warnings)
    assert warnings[0] != warnings[1]


def test_a_shot_has_the_memory_that_earlier_ones_leave_it():
    outline, arrays = scene_of([FLOOR, PLATE], [lamp()])
    shots = FROM_ABOVE, replace(FROM_ABOVE, name="Again")
    options = Options(("soft_shadow",), "cpu", 1, 0, memory_bytes=1 << 30)
    graphs = [plan_scene(outline, shot, options) for shot in shots]
    job = BakeJob(outline, graphs, arrays, options)
    first, second = (baked.report.memory for baked in job.results())
    assert first.layers > 0
    assert second.held == first.held + first.layers
    assert second.budget == first.budget - first.layers
