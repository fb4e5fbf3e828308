"""Whole bakes of real files, on both devices: every planned layer is there, finite, and worth its pixels."""

from __future__ import annotations

import json

import bpy
import numpy as np
import pytest
from strata.addon.bake import BakeJob, bake, read_scene
from strata.addon.core.errors import Cancelled, StrataError
from strata.addon.measure.in_use import InUseScore
from strata.addon.planning import Options
from strata.addon.scene.open import choose, open_blend
from strata.tests.support.places import SAMPLES, scene_files
from strata.tests.support.settings import maps

SMALL = (160, 90)
EVERYTHING = ("soft_shadow", "volumetric_light", "toon")
FOG = {"volumetric_light": {"use_scene_medium": False, "resolution": 256, "light_samples": 1}}


def bake_file(path, options: Options, **where):
    open_blend(path)
    chosen = choose()
    return bake(chosen.scene, chosen.view_layer, options, **{"size": SMALL, **where})


def images(baked) -> dict[str, np.ndarray]:
    return {layer.name: layer.pixels for layer in baked.layers.layers}


@pytest.mark.parametrize("path", scene_files(), ids=lambda path: path.stem)
def test_every_planned_layer_of_every_scene_is_there_and_finite(path, backend):
    """All effects are on, and there is fog everywhere."""
    open_blend(path)
    if not any(thing.type == "CAMERA" for thing in bpy.data.objects):
        with pytest.raises(StrataError, match="no camera"):
            choose()
        return
    chosen = choose()
    outline, graph, arrays, _ = read_scene(
        chosen.scene,
        chosen.view_layer,
        options := Options(EVERYTHING, backend, samples=1, probes=64, values=FOG),
        size=SMALL,
    )
    job = BakeJob(outline, graph, arrays, options)
    baked = job.result()
    layers, graph = images(baked), job.graph
    assert list(layers) == [layer.name for layer in graph.layers]
    if layers:  # a plan that keeps nothing has one reason for the whole effect
        assert len(layers) + len({o.light for o in graph.left_out if o.light}) >= len(outline.lights)
    else:
        assert graph.left_out
    kinds = {layer.name: layer.kind for layer in graph.layers}
    for name, pixels in layers.items():
        channels = () if len(kinds[name].channels) == 1 else (len(kinds[name].channels),)
        assert pixels.shape == (SMALL[1], SMALL[0], *channels), name
        assert np.isfinite(pixels).all(), name
        assert pixels.min() >= 0.0, name
        if isinstance(kinds[name].score, InUseScore):
            # A mean of visibilities; the sums of eight roundings may pass 1 by an ulp or two.
            assert pixels.max() <= 1.0 + 1e-6, name
    report = json.loads(json.dumps(baked.layers.report))
    assert report["backend"] == backend
    assert [layer["name"] for layer in report["layers"]] == list(layers)
    for layer in report["layers"]:
        low, high = layer["error"]["ci95"]
        assert 0.0 <= low <= layer["error"]["value"]
        # It is not known how wrong a layer is where parts of the scene are missing.
        assert (high is None) == bool(outline.unknown)
        assert high is None or layer["error"]["value"] <= high
        assert layer["non_finite"] == 0
        assert layer["seconds"] <= layer["seconds_alone"] * (1 + 1e-9)
    # Nothing that was planned for the GPU silently ran elsewhere.
    assert not [w for w in report["warnings"] if "failed on gpu" in w]


def test_the_courtyard_has_a_layer_for_each_light():
    baked = bake_file(SAMPLES / "courtyard.blend", Options(backend="cpu", samples=1, probes=0))
    layers = images(baked)
    assert set(layers) == {
        "Soft Shadow Sun",
        "Soft Shadow Sky panel",
        "Soft Shadow Wall lantern light",
        "Soft Shadow Lantern light",
    }
    for name, pixels in layers.items():
        assert pixels.min() < 0.05, name
        assert pixels.max() > 0.95, name


def test_a_scene_that_needs_nothing_says_so():
    baked = bake_file(SAMPLES / "plain.blend", Options(backend="cpu"))
    assert not baked.layers.layers
    assert any(
        "switched off" in o["reason"] or "casts" in o["reason"] for o in baked.layers.report["left_out"]
    )


@pytest.mark.parametrize("method", ["area", "bitmask", "hybrid", "rays"])
def test_every_method_bakes(method, backend):
    values = {"method": method, "resolution": 512, "sample_rays": 64}
    options = Options(backend=backend, samples=1, probes=256, values={"soft_shadow": values})
    baked = bake_file(SAMPLES / "stacked.blend", options)
    (layer,) = baked.layers.layers
    # The area sum overshadows where occluders overlap, which is what this scene is made of.
    assert layer.error["method"] < (0.3 if method == "area" else 0.05)


def test_a_bake_is_the_same_bit_for_bit_from_run_to_run(backend):
    options = Options(backend=backend, samples=2, probes=128)
    first = bake_file(SAMPLES / "stacked.blend", options)
    second = bake_file(SAMPLES / "stacked.blend", options)
    assert all(np.array_equal(images(first)[name], pixels) for name, pixels in images(second).items())
    errors = [layer.error for layer in first.layers.layers]
    for error, again in zip(errors, (layer.error for layer in second.layers.layers), strict=True):
        assert {**error, "seconds": 0} == {**again, "seconds": 0}


def test_the_render_region_is_computed_in_its_place():
    options = Options(backend="cpu", samples=1, probes=0, values=maps())
    whole = bake_file(SAMPLES / "stacked.blend", options)
    open_blend(SAMPLES / "stacked.blend")
    chosen = choose()
    render = chosen.scene.render
    render.use_border, render.use_crop_to_border = True, False
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.5, 1.0
    part = bake(chosen.scene, chosen.view_layer, options, size=SMALL)
    (name,) = images(whole)
    inside = np.s_[45:90, 40:120]
    # Maps are fitted to what is in view, so the two differ by a map's discretisation, not by a place.
    difference = np.abs(images(whole)[name][inside] - images(part)[name][inside])
    assert difference.mean() < 0.02
    outside = images(part)[name].copy()
    outside[inside] = 1.0
    assert (outside == 1.0).all()
    assert part.layers.region == (40, 45, 120, 90)
    assert not part.layers.is_cropped


def test_a_bake_can_be_cancelled():
    open_blend(SAMPLES / "stacked.blend")
    chosen = choose()
    options = Options(backend="cpu", samples=4)
    outline, graph, arrays, _ = read_scene(chosen.scene, chosen.view_layer, options, size=SMALL)
    job = BakeJob(outline, graph, arrays, options)
    job.advance(0.0)
    job.cancel()
    with pytest.raises(Cancelled):
        job.result()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"effects": ("glow",)}, "no effect 'glow'"),
        ({"backend": "tpu"}, "tpu"),
        ({"samples": 0}, "samples"),
        ({"values": {"soft_shadow": {"layers": 99}}}, "soft_shadow.layers"),
        ({"probes": -1}, "probes"),
    ],
)
def test_bad_options_are_refused_in_one_line(options, words):
    with pytest.raises(StrataError) as refusal:
        bake_file(SAMPLES / "plain.blend", Options(**options))
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_the_file_that_blender_starts_with_bakes(tmp_path):
    bpy.ops.wm.read_factory_settings()
    path = str(tmp_path / "startup.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    layer = bake_file(path, Options(backend="cpu")).layers.layers[0]
    low, high = layer.error["ci95"]
    assert low <= layer.error["value"] <= high
    assert 0.0 < high < 0.1
