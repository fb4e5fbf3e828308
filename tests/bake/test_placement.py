"""Bakes whose pixels are sampled at places of their own, on scenes made without Blender."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from strata.addon.bake import Baked, BakeJob
from strata.addon.core.errors import StrataError
from strata.addon.core.placement import Places
from strata.addon.core.sampling import Sampling, footprint_side
from strata.addon.core.shot import PixelFilter
from strata.addon.planning import Options, plan_scene, sampling_of
from strata.tests.bake.test_bake_job import FROM_ABOVE
from strata.tests.bake.test_passes import two_lamps

PER_PIXEL = "per_pixel"


def bake(shot=FROM_ABOVE, placement=PER_PIXEL, **options) -> Baked:
    outline, arrays = two_lamps()
    given = {"samples": 8, "probes": 0, "effects": ("soft_shadow", "toon", "volumetric_light")}
    chosen = Options(backend="cpu", placement=placement, **given | options)
    return BakeJob(outline, plan_scene(outline, shot, chosen), arrays, chosen).result()


def pixels_of(baked: Baked) -> list[np.ndarray]:
    return [layer.pixels for layer in baked.layers.layers]


def test_neither_tiles_nor_groups_change_a_bit(monkeypatch):
    whole, grouped = bake(), bake(memory_bytes=1)
    assert len(whole.layers.layers) > 2
    assert grouped.report.memory.groups > 1
    monkeypatch.setattr("strata.addon.core.sampling.PIXELS_PER_TILE", 64 * 10)
    for other in (grouped, bake()):
        for one, its in zip(pixels_of(whole), pixels_of(other), strict=True):
            np.testing.assert_array_equal(one, its)


DIGEST = """
import hashlib
from strata.tests.bake.test_placement import bake, pixels_of
print(hashlib.sha256(b"".join(pixels.tobytes() for pixels in pixels_of(bake(samples=2)))).hexdigest())
"""


def test_the_number_of_threads_changes_no_bit():
    digests = set()
    for threads in ("1", "3"):
        environment = {**os.environ, "RAYON_NUM_THREADS": threads}
        told = subprocess.run(
            [sys.executable, "-c", DIGEST], env=environment, capture_output=True, text=True, check=True
        )
        digests.add(told.stdout.split()[-1])
    assert len(digests) == 1


def test_file_and_report_say_how_samples_were_placed():
    for placement in (PER_PIXEL, "shared"):
        baked = bake(placement=placement, samples=1)
        assert baked.report.placement == baked.report.to_json()["placement"] == placement
        assert {layer.placement for layer in baked.layers.layers} == {placement}
    with pytest.raises(StrataError, match="placement: 'scattered' is none of shared, per_pixel"):
        Options(placement="scattered")


def test_more_samples_bring_both_placements_to_the_same_picture():
    """64 samples of either know a pixel's edge to about .015 of what it shows. What does not turn with a
    lamp's light is compared as it is."""
    shared, own = (bake(placement=placement, samples=64, lit=True) for placement in ("shared", PER_PIXEL))
    for one, other in zip(shared.layers.layers, own.layers.layers, strict=True):
        off = (one.pixels - other.pixels).reshape(64, 64, -1)
        if one.of.is_lamp:
            light = shared.lit[one.of.index][..., 1:2]
            off = off * (light / (light + light.mean()))
        assert np.sqrt(np.mean(off**2)) < 0.015, one.name
        assert abs(float(off.mean())) < 1e-3, one.name


def test_samples_are_compared_with_the_truth_where_they_lie():
    """Rays know a crisp shadow but for its rim, and the rasteriser an edge to 1/256 of a pixel. Were they
    compared with what lies beside them, the method would look as wrong as the sampling is, or more."""
    values = {"soft_shadow": {"method": "rays", "sample_rays": 64}}
    baked = bake(effects=("soft_shadow",), samples=4, probes=512, values=values)
    error = next(layer.error for layer in baked.report.layers if "A" in layer.name)
    assert error.method < 0.5 * error.sampling


def test_a_pixels_samples_hang_on_the_shots_seed():
    one, other = (bake(replace(FROM_ABOVE, seed=seed), samples=1) for seed in (1, 2))
    assert any(not np.array_equal(*pair) for pair in zip(pixels_of(one), pixels_of(other), strict=True))
    assert Places.of(FROM_ABOVE) == Places.of(replace(FROM_ABOVE, name="Other"))


def test_chunks_tell_of_places_and_share_no_jitter():
    places = Places(3, PixelFilter())
    chunks = list(Sampling(8, 8, 3, places=places).chunks())
    assert [chunk.sample for chunk in chunks] == [0, 1, 2]
    assert all((chunk.jitter, chunk.places) == ((0.0, 0.0), places) for chunk in chunks)
    pixels = np.array([[0, 0], [7, 3]])
    told = Sampling(8, 8, 3, places=places).offsets(pixels)
    np.testing.assert_array_equal(told[2], places.offsets(pixels, 2))
    shared = Sampling(8, 8, 3)
    np.testing.assert_array_equal(shared.offsets(pixels)[:, 1], shared.jitters)


def test_a_dot_is_filtered_by_what_a_sample_of_any_place_stands_for():
    """Of a box, whose density is the same everywhere, as of a shared one."""
    box, usual = PixelFilter("BOX", 0.5), PixelFilter()
    assert footprint_side(box, None, 4) == pytest.approx(0.5, rel=1e-3)
    assert footprint_side(usual, (0.0, 0.0), 4) < footprint_side(usual, None, 4)
    assert footprint_side(usual, None, 4) < footprint_side(usual, (1.2, 1.2), 4)
    assert footprint_side(PixelFilter("BOX", 0.0), None, 4) == 0.0


def test_plans_place_samples_as_they_are_asked_to():
    outline, _ = two_lamps()
    for placement, places in (("shared", None), (PER_PIXEL, Places.of(FROM_ABOVE))):
        options = Options(placement=placement)
        assert sampling_of(plan_scene(outline, FROM_ABOVE, options), options).places == places
