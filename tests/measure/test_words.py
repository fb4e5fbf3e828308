"""What is said of where an error comes from, also of files that an earlier version baked."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from strata.addon.effects.registry import EFFECTS
from strata.addon.effects.soft_shadow.params import SoftShadowParams
from strata.addon.measure.report import LayerError, error_of
from strata.addon.measure.verdict import USES, causes, interval_words, off_by, told, worded

ERROR = LayerError("in use", 0.02, (0.018, 0.022), 0.0, 0.1, 0.2, 64, "rays", 1e-3, 0.1, 0.005, 0.019)
SETTINGS = ("samples", "method=hybrid", "resolution")

# As version 0.1.0 wrote them before errors were those of layers in use.
EARLIER = {
    "Soft Shadow Sun": {
        "metric": "weighted rmse", "value": 0.00947175, "ci95": [0.00910167, 0.0260078], "bias": -0.000289053,
        "p99": 0.0453158, "max": 0.194245, "probes": 33, "reference": "ray traced, 2 x 128 rays",
        "reference_noise": 0.00687992, "seconds": 0.180866,
    },
    "Volumetric Sun": {
        "metric": "relative l2", "value": 0.0514331, "ci95": [0.0325984, 1.3148], "bias": -0.012461,
        "p99": 0.193181, "max": 0.267117, "probes": 70, "reference": "ray marched, 2 x 512 shadow rays",
        "reference_noise": 0.0293913, "seconds": 0.946055, "share_off_by_1_percent": 0.186491,
    },
}  # fmt: skip


def test_every_metric_of_ours_has_words():
    metrics = {kind.score.metric for effect in EFFECTS for kind in effect.layers if kind.score}
    assert metrics <= set(USES)
    assert off_by("in use", "2.0%", "Key") == "multiplied onto its light, off by 2.0% of the brightness"
    assert off_by("in use", "2.0%") == "multiplied onto the picture, off by 2.0% of the brightness"
    assert off_by("in use, added", "2.0%", "Key") == "added to the picture, off by 2.0% of the brightness"
    assert off_by("share of wrong pixels", "3.0%") == "3.0% of its pixels are wrong"
    assert off_by("points apart", "3.0%") == "points apart: 3.0%"  # an effect may bring its own


def test_advice_follows_the_cause():
    assert told(ERROR, "Key", SETTINGS) == (
        "multiplied onto its light, off by 2.0% of the brightness; most of it is aliasing: more samples"
    )
    methods = replace(ERROR, method=0.019, sampling=0.005)
    assert causes(methods, SETTINGS[1:], SoftShadowParams) == [
        "most of it is the method: Method Hybrid, Map Size"
    ]
    assert causes(methods, ("sample_rays", "samples"), SoftShadowParams) == [
        "most of it is noise: more samples or Sample Rays"
    ]
    unknown = replace(ERROR, method=None, sampling=None)
    assert causes(unknown, ("samples",)) == ["lower it with Samples"]
    assert causes(ERROR) == []  # invisible: no settings are named
    assert told(ERROR, "Key") == ""
    assert causes(replace(ERROR, value=0.001, ci95=(0.0, 0.02)), SETTINGS) == []


def test_an_interval_without_an_upper_end_says_so():
    missing = replace(ERROR, value=0.001, ci95=(0.0, None), unknown=("library '//a.blend' is missing",))
    assert causes(missing) == ["perhaps by any amount, since part of the scene is not read"]
    assert worded(0.001, None) == "invisible, perhaps visible"
    assert worded(0.03, None) == "visible"
    assert interval_words(0.0, None) == "0% or more"
    assert interval_words(0.012, None) == "1.2% or more"
    document = json.loads(json.dumps(missing.to_json(), allow_nan=False))
    assert (document["ci95"], document["unknown"]) == ([0.0, None], list(missing.unknown))
    assert error_of(document) == missing
    assert "unknown" not in ERROR.to_json()


@pytest.mark.parametrize(("share", "is_said"), [(0.004, True), (0.019, False)])
def test_what_white_clips_is_said_where_it_is_most_of_it(share, is_said):
    said = causes(replace(ERROR, display=share), SETTINGS)
    assert ("on a display 0.4%, since white is clipped" in said) == is_said


@pytest.mark.parametrize(
    ("value", "model", "is_said"), [(0.02, 0.015, True), (0.04, 0.015, False), (0.0, 0.004, False)]
)
def test_colour_that_one_channel_cannot_hold_is_said_where_it_counts(value, model, is_said):
    said = causes(replace(ERROR, value=value, model=model))
    assert said == (["besides 1.5% of colour, which one channel cannot hold"] if is_said else [])


def test_a_file_of_an_earlier_version_is_read_and_its_metric_named():
    shadow, light = (error_of(entry) for entry in EARLIER.values())
    assert isinstance(shadow, LayerError)
    assert (shadow.value, shadow.ci95, shadow.method) == (0.00947175, (0.00910167, 0.0260078), None)
    assert "share_off_by_1_percent" not in light.to_json()
    assert told(shadow, "Sun", ("method=hybrid",), SoftShadowParams) == (
        "off by 0.9% at surface points (weighted RMSE, not the error in use); lower it with Method Hybrid"
    )
    assert "(relative L2, not the error in use)" in off_by(light.metric, "5.1%", "Sun")


def test_a_file_of_a_later_version_is_read_too():
    assert error_of(ERROR.to_json() | {"of_later": 0.1}) == ERROR
