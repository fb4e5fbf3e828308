"""What is said of an error: one rule, no claim of nothing, and advice that is true."""

from __future__ import annotations

import re

import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.effects.soft_shadow.params import SoftShadowParams
from strata.addon.effects.toon.params import ToonParams
from strata.addon.effects.volumetric_light.params import VolumetricLightParams
from strata.addon.measure.in_use import InUseScore
from strata.addon.measure.light import LightScore
from strata.addon.measure.mask import MaskScore
from strata.addon.measure.report import LayerError, LayerReport, Report
from strata.addon.measure.report_text import format_table
from strata.addon.measure.verdict import (
    FINE_UP_TO,
    INVISIBLE_UP_TO,
    Verdict,
    advice,
    interval_words,
    percent,
    verdict,
    worded,
)
from strata.addon.planning import Options
from strata.addon.preview import caption
from strata.addon.preview.viewport import Statistics
from strata.addon.scene.open import choose, open_blend
from strata.tests.support.places import SAMPLES

SHADOW, LIGHT, MASK = InUseScore(None), LightScore(None), MaskScore(None)


def error(method: float | None = None, sampling: float | None = None) -> LayerError:
    return LayerError("in use", 0.02, (0.0, 0.1), 0.0, 0.0, 0.0, 64, "rays", 0.0, 0.1, method, sampling)


def test_invisible_is_less_than_8_bits_lose_in_middle_grey():
    """And fine up to a whole step of theirs."""
    grey = np.linspace(0.17, 0.19, 4001)
    code = np.round(255.0 * (1.055 * grey ** (1 / 2.4) - 0.055))
    decoded = ((code / 255.0 + 0.055) / 1.055) ** 2.4
    lost = np.sqrt((((decoded - grey) / grey) ** 2).mean())
    step = np.diff(np.unique(decoded)).mean() / 0.18
    assert 0.9 * lost < INVISIBLE_UP_TO < lost
    assert pytest.approx(step, rel=0.1) == FINE_UP_TO
    assert [verdict(each) for each in (0.0, 0.004, 0.01, 0.03)] == [
        Verdict.INVISIBLE,
        Verdict.INVISIBLE,
        Verdict.FINE,
        Verdict.VISIBLE,
    ]


def test_a_mask_is_judged_by_what_its_wrong_pixels_are_off_by():
    assert verdict(MASK.rms(0.001)) is Verdict.INVISIBLE  # 0.4% root mean square
    assert verdict(MASK.rms(0.01)) is Verdict.FINE
    assert verdict(MASK.rms(0.05)) is Verdict.VISIBLE
    assert SHADOW.rms(0.01) == LIGHT.rms(0.01) == 0.01


def test_an_interval_that_reaches_further_is_said():
    assert worded(0.003, 0.004) == "invisible"
    assert worded(0.003, 0.03) == "invisible, perhaps visible"


def test_nothing_is_ever_said_to_have_no_error():
    assert [percent(each) for each in (0.0, 9e-4, 0.00104, 0.0168, 0.0994, 0.0996, 1.0)] == [
        "below 0.1%", "below 0.1%", "0.1%", "1.7%", "9.9%", "10%", "100%",
    ]  # fmt: skip
    assert interval_words(0.0, 5e-4) == "below 0.1%"
    assert interval_words(0.0, 0.02) == "0% to 2.0%"
    found = LayerError(SHADOW.metric, 0.0, (0.0, 2e-5), 0.0, 0.0, 0.0, 64, "rays", 0.0, 0.1)
    layer = LayerReport("Shadow", "soft_shadow", "Key", 1.0, 1.0, 0, found, verdict=worded(0.0, 2e-5))
    told = format_table(Report("1", "5", "s", 1, (8, 8), 0, "cpu", "", 1.0, 0.0, 0, (), (layer,), (), ()))
    for noise in (0.0, 1e-5):
        told += " ".join(caption.lines(Statistics(samples=8, of_samples=8, is_converged=True, noise=noise)))
    assert "invisible" in told
    assert not re.search(r"\b0(\.0+)?%|\b0\.000", told), told


def test_the_preview_says_noise_and_what_lowers_it_once_it_is_done():
    still = Statistics(samples=8, of_samples=8, is_converged=True, noise=0.03)
    assert caption.lines(still)[1] == "noise 3.0%, visible: lower it with Samples"
    out_of_time = Statistics(samples=2, of_samples=8, out_of="time_limit", noise=0.03)
    assert caption.lines(out_of_time)[1] == "noise 3.0%, visible: lower it with Time Limit"
    refining = Statistics(samples=2, of_samples=8, noise=0.03)
    assert caption.lines(refining)[1] == "noise 3.0%, visible"  # it gets better by itself


def test_settings_that_change_nothing_are_not_advised():
    bitmask, method = SoftShadowParams(), error(0.019, 0.005)
    assert SHADOW.lowered_by(bitmask, method)[0] == "method=hybrid"
    assert "rays" not in SHADOW.lowered_by(bitmask, method)  # bitmask asks none
    hybrid = SoftShadowParams.checked("soft_shadow", {"method": "hybrid", "layers": 8, "spacing": 2})
    found = SHADOW.lowered_by(hybrid, method)
    assert found[:3] == ("spacing=1", "rays", "resolution")
    assert {"method=hybrid", "layers"}.isdisjoint(found)  # there are no more than 8
    coarse = VolumetricLightParams.checked("volumetric_light", {"scale": "1/4"})
    assert LIGHT.lowered_by(coarse, method)[0] == "scale=1"
    assert advice(()) == ""
    assert (
        advice(["method=hybrid", "resolution"], SoftShadowParams) == "lower it with Method Hybrid, Map Size"
    )
    assert advice(["samples"], ToonParams) == "lower it with Samples"


def test_samples_are_advised_first_where_most_of_an_error_is_aliasing():
    bitmask = SoftShadowParams()
    for score in (SHADOW, LIGHT):
        assert score.lowered_by(bitmask, error(0.005, 0.019))[0] == "samples"
        assert score.lowered_by(bitmask, error(0.019, 0.005))[-1] == "samples"
        assert score.lowered_by(bitmask, error())[-1] == "samples"
        assert score.lowered_by(None, error()) == ("samples",)
    assert MASK.lowered_by(None, error()) == ("samples",)


@pytest.mark.parametrize(
    ("scene", "effect", "metric", "settings"),
    [
        ("courtyard", "soft_shadow", SHADOW.metric, {}),
        ("mist", "volumetric_light", LIGHT.metric, {"light_samples": 1, "resolution": 256}),
        ("comic", "toon", MASK.metric, {"halftone": False}),
    ],
)
def test_what_is_advised_first_lowers_the_error(scene, effect, metric, settings):
    """Of all layers together, measured as a bake does."""
    open_blend(SAMPLES / f"{scene}.blend")
    chosen = choose()

    def baked(samples: int, values: dict) -> tuple[float, tuple[str, ...]]:
        options = Options((effect,), "cpu", samples, 512, {effect: values})
        report = bake(chosen.scene, chosen.view_layer, options, size=(96, 54)).report
        found = [layer for layer in report.layers if layer.error.metric == metric]
        assert found
        advised = [layer.lowered_by for layer in found if layer.lowered_by]
        return sum(layer.error.value for layer in found), advised[0]

    before, advised = baked(1, settings)
    name, _, value = advised[0].partition("=")
    samples = 8 if name == "samples" else 1
    more = {} if name == "samples" else {name: value or 8 * settings[name]}
    after, _ = baked(samples, settings | more)
    assert after < 0.8 * before, (advised, before, after)
