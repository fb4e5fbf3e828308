"""What an earlier bake chose, taken again from its file or its report."""

from __future__ import annotations

import json

import numpy as np
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.core.layers import Layer, LayerSet
from strata.addon.layers.exr import write_layers
from strata.addon.layers.exr_params import ExrParams
from strata.addon.layers.settings_from import settings_in

CHOSEN = [{"name": "A", "samples": 10, "in_passes": True}, {"name": "B", "samples": 4, "in_passes": True}]


def test_of_a_file_and_of_a_report(tmp_path):
    layer = Layer("A", "V", np.ones((2, 2), np.float32), effect="soft_shadow", samples=10)
    layers = LayerSet((layer,), 2, 2, "ViewLayer", report={"layers": CHOSEN})
    write_layers(tmp_path / "a.exr", layers, ExrParams())
    (tmp_path / "a.json").write_text(json.dumps(layers.report))
    for name in ("a.exr", "a.json"):
        assert settings_in(tmp_path / name) == ({"": {"A": 10, "B": 4}}, None)


def test_view_layers_have_their_own(tmp_path):
    counts = ("X", 8), ("Y", 5)
    of_two = [{**each, "view_layer": name, "samples": n} for name, n in counts for each in CHOSEN]
    (tmp_path / "a.json").write_text(json.dumps({"layers": of_two}))
    assert settings_in(tmp_path / "a.json") == ({"X": {"A": 8, "B": 8}, "Y": {"A": 5, "B": 5}}, None)


def test_of_a_bake_without_a_target(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps({"layers": [{"name": "A", "samples": 16}]}))
    assert settings_in(tmp_path / "a.json") == ({}, 16)


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        "no JSON",
        "[]",
        '{"layers": 5}',
        '{"layers": [5]}',
        '{"layers": {"a": 1}}',
        '{"layers": [{"name": "A"}]}',
        '{"layers": [{"samples": 8}]}',
        '{"layers": [{"name": "A", "samples": "many"}]}',
        '{"layers": [{"name": "A", "samples": -3, "in_passes": true}]}',
        '{"layers": [{"name": "A", "samples": 100000000}]}',
        '{"layers": [{"name": "A", "in_passes": true}]}',
    ],
)
def test_what_says_nothing_is_refused(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(StrataError):
        settings_in(tmp_path / "a.json")
    with pytest.raises(StrataError, match="cannot read"):
        settings_in(tmp_path / "b.json")
