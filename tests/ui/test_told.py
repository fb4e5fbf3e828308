"""What the panel says of a bake's errors, also of one that an earlier version made."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from strata.addon.effects.soft_shadow import EFFECT
from strata.addon.measure.report import LayerError
from strata.addon.ui import last_bake

ALIASED = LayerError("in use", 0.02, (0.018, 0.022), 0.0, 0.1, 0.2, 64, "rays", 1e-3, 0.1, 0.005, 0.019)
METHOD = replace(ALIASED, method=0.019, sampling=0.005)
EARLIER = LayerError("weighted rmse", 0.02, (0.018, 0.022), 0.0, 0.1, 0.2, 64, "rays", 1e-3, 0.1).to_json()


def layer(light: str, error: dict, *settings: str) -> dict:
    return {
        "name": f"Soft Shadow {light}", "light": light, "error": error, "verdict": "visible",
        "lowered_by": list(settings), "seconds": 1.0,
    }  # fmt: skip


@pytest.fixture
def said(monkeypatch):
    """Lines as they would stand in a panel, unbroken."""
    lines: list[str] = []
    monkeypatch.setattr(
        last_bake, "text", lambda layout, context, words, icon="", indent=2: lines.append(words)
    )
    return lines


def test_what_holds_for_all_layers_is_said_once(said):
    made = [layer(light, ALIASED.to_json(), "samples") for light in ("Key", "fill")]
    last_bake._told(SimpleNamespace(), SimpleNamespace(), EFFECT, made)
    assert said == [
        "Multiplied onto its light, off by this share of the brightness",
        "Most of it is aliasing: more samples",
    ]


def test_what_holds_for_some_is_said_with_their_names(said):
    made = [layer("Key", ALIASED.to_json(), "samples"), layer("fill", METHOD.to_json(), "method=hybrid")]
    made.append({"name": "Soft Shadow Rim", "light": "Rim", "seconds": 1.0})  # not measured
    last_bake._told(SimpleNamespace(), SimpleNamespace(), EFFECT, made)
    assert said[1:] == [
        "Key: most of it is aliasing: more samples",
        "fill: most of it is the method: Method Hybrid",
    ]


def test_an_earlier_report_names_its_metric(said):
    entry = layer("Key", EARLIER | {"share_off_by_1_percent": 0.1}, "method=hybrid")
    last_bake._told(SimpleNamespace(), SimpleNamespace(), EFFECT, [entry])
    assert said == [
        "Off by this share at surface points (weighted RMSE, not the error in use)",
        "Lower it with Method Hybrid",
    ]


def test_why_a_target_is_not_reached_is_said_of_each(said):
    words = "off by 2.6%, target 2.0%: 64 samples at most, and not enough"
    made = [layer("Key", ALIASED.to_json(), "samples") | {"target_words": words}]
    made.append({"name": "Soft Shadow Rim", "light": "Rim", "seconds": 1.0, "target_words": words})
    last_bake._told(SimpleNamespace(), SimpleNamespace(), EFFECT, made)
    assert said[:2] == [f"Key: {words}", f"Rim: {words}"]
