"""Parameters: every value is checked at the border, and the message names it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.core.naming import LONGEST_LAMP, lamp_pass_name, layer_name
from strata.addon.effects.registry import EFFECTS
from strata.addon.effects.soft_shadow.params import Method, SoftShadowParams
from strata.addon.effects.toon.params import ToonParams


def test_defaults_are_within_their_own_ranges():
    for effect in EFFECTS:
        for spec in effect.params.specs():
            assert spec.check(effect.id, spec.default) == spec.default
            assert spec.doc
            if spec.hard:
                assert spec.hard[0] <= spec.soft[0] <= spec.soft[1] <= spec.hard[1]


def test_words_from_a_command_line_become_values():
    params = SoftShadowParams.checked("soft_shadow", {"layers": "5", "method": "area", "gradient_scale": "2"})
    assert (params.layers, params.method, params.gradient_scale) == (5, Method.AREA, 2.0)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"layers": 9}, ("soft_shadow.layers", "9", "1 to 8")),
        ({"layers": "three"}, ("soft_shadow.layers", "whole number")),
        ({"gradient_scale": float("nan")}, ("soft_shadow.gradient_scale", "not a number")),
        ({"method": "magic"}, ("soft_shadow.method", "magic", "area, bitmask, hybrid, rays")),
        ({"softness": 1}, ("softness", "layers")),
    ],
)
def test_a_bad_value_is_refused_by_name(values, words):
    with pytest.raises(StrataError) as refusal:
        SoftShadowParams.checked("soft_shadow", values)
    message = str(refusal.value)
    assert "\n" not in message
    assert all(word in message for word in words)


def test_an_unknown_effect_is_refused_by_name():
    with pytest.raises(StrataError, match=r"no effect 'glow'.*soft_shadow"):
        EFFECTS.named("glow")


def test_layer_names_have_no_dots_and_fit():
    assert layer_name("Soft Shadow", lamp_pass_name("Key", "Key")) == "Soft Shadow Key"
    assert layer_name("Soft Shadow", lamp_pass_name("Key.001", "Key.001")) == "Soft Shadow Key_001"
    assert layer_name("Transmittance") == "Transmittance"
    long = lamp_pass_name("é" * 80, "é" * 80)
    assert len(long.encode()) <= LONGEST_LAMP
    assert lamp_pass_name("é" * 81, "é" * 81) != long
    assert lamp_pass_name(long, "é" * 80) == long


def test_a_limit_may_be_rounded_to_float32():
    pi = float(np.float32(math.pi))
    assert pi > math.pi
    params = ToonParams.checked("toon", {"crease_angle": pi})
    assert params.crease_angle == math.pi
    with pytest.raises(StrataError, match=r"toon\.crease_angle"):
        ToonParams.checked("toon", {"crease_angle": 3.1416})
