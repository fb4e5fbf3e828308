"""The report: JSON with the documented keys, and a table that fits a terminal."""

import json
import os
import pathlib
import re
import tomllib
import types

import numpy as np
import pytest
from strata.addon.core.graph import Graph, LeftOut, Node, PlannedLayer, Step
from strata.addon.core.roles import Of
from strata.addon.core.version import VERSION
from strata.addon.effects.shared.lit import LIT
from strata.addon.effects.soft_shadow import EFFECT
from strata.addon.measure.report import (
    LayerError,
    LayerReport,
    Report,
    StepTime,
    peak_mb,
    report_of,
    rounded,
)
from strata.addon.measure.report_text import format_table
from strata.addon.measure.table import WIDTH, columns, cut, width_of, wrapped
from strata.tests.support.places import ROOT

ERROR = LayerError(
    "in use",
    0.01123456789,
    (0.0101, 0.0122),
    -0.001,
    0.05,
    0.21,
    2048,
    "ray traced, 32 view rays a pixel",
    1e-3,
    0.4,
    method=0.004,
    sampling=0.0105,
    display=0.008,
)
OUTLINE = types.SimpleNamespace(scene_name="court.blend", frame=7, baked=())
NAMES = ["Soft Shadow Key", "Soft Shadow Fill"]


def report(**changes) -> Report:
    node = Node(Step("soft_shadow/visibility"), "Key", (), {})
    layers = [
        PlannedLayer(
            name, "soft_shadow", node, EFFECT.layers[0], None, name.split()[-1], Of.lamp(0), pass_name="K"
        )
        for name in NAMES
    ]
    image = np.ones((540, 960), np.float32)
    spoilt = image.copy()
    spoilt[3, 4:6] = np.nan
    facts = {
        "outline": OUTLINE,
        "graph": Graph(
            (*layers, PlannedLayer("picture", "", node, LIT)),
            (LeftOut("Soft Shadow Rim", "reaches nothing in view"),),
            {},
            frozenset(),
            shot=types.SimpleNamespace(size=(960, 540)),
        ),
        "backend": "cpu",
        "backend_reason": "no GPU here",
        "seed": 5,
        "seconds": 1.9,
        "compile_seconds": 0.0,
        "steps": [StepTime("layered_depth", "Key", "cpu", 0.2)],
        "images": dict(zip(NAMES, [image, spoilt], strict=True)),
        "costs": {NAMES[0]: (0.4, 0.9), NAMES[1]: (0.3, 0.8)},
        "errors": {NAMES[0]: ERROR},
        "warnings": ["twice", "twice", "once"],
    }
    return report_of(**facts | changes)


def test_json_has_the_documented_keys():
    document = report().to_json()
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert list(document) == [
        "strata", "blender", "scene", "frame", "size", "seed", "backend", "backend_reason", "seconds",
        "compile_seconds", "peak_mb", "steps", "layers", "left_out", "warnings", "memory", "baked",
        "target_error", "time_budget_s", "placement",
    ]  # fmt: skip
    assert document["size"] == [960, 540]
    assert document["steps"] == [
        {"name": "layered_depth", "instance": "Key", "device": "cpu", "seconds": 0.2}
    ]
    assert document["left_out"] == [{"what": "Soft Shadow Rim", "reason": "reaches nothing in view"}]
    assert document["warnings"] == ["twice", "once"]
    key, fill = document["layers"]
    assert list(key) == [
        "name", "effect", "light", "seconds", "seconds_alone", "non_finite", "error", "role", "pass_name",
        "samples", "verdict", "lowered_by",
    ]  # fmt: skip
    assert (key["role"], key["pass_name"]) == ("visibility", "K")
    assert (key["verdict"], key["lowered_by"]) == ("fine", ["samples"])
    assert key["error"] == {
        "metric": "in use", "value": 0.0112346, "ci95": [0.0101, 0.0122], "bias": -0.001, "p99": 0.05,
        "max": 0.21, "probes": 2048, "reference": "ray traced, 32 view rays a pixel",
        "reference_noise": 0.001, "seconds": 0.4, "method": 0.004, "sampling": 0.0105, "display": 0.008,
    }  # fmt: skip
    assert (key["non_finite"], fill["non_finite"]) == (0, 2)
    assert {"error", "verdict", "lowered_by"}.isdisjoint(fill)


def test_numbers_are_short_and_finite():
    assert rounded(1 / 3) == 0.333333
    assert rounded(1.23456789e-9) == 1.23457e-9
    with pytest.raises(ValueError, match="no place"):
        rounded(float("nan"))


def test_the_version_is_the_packages():
    for name in ("pyproject.toml", "kernels/Cargo.toml", "blender_manifest.toml"):
        document = tomllib.loads((ROOT / name).read_text())
        table = document.get("project") or document.get("package") or document
        assert table["version"] == VERSION


def test_peak_memory_grows_with_use():
    before = peak_mb()
    assert before > 10
    block = np.ones(64 << 17)  # 64 MiB
    assert peak_mb() >= before
    del block
    if os.path.exists("/proc/self/statm"):
        pages = int(pathlib.Path("/proc/self/statm").read_text().split()[1])
        assert peak_mb() >= pages * os.sysconf("SC_PAGESIZE") // 2**20


def test_table_says_what_a_person_asks():
    text = format_table(report())
    assert "court.blend, frame 7, 960 x 540" in text
    assert re.search(r"Soft Shadow Key +0\.40 +1\.1% +1\.0% to 1\.2% +fine +5\.0% +21% +in use", text)
    assert re.search(r"Soft Shadow Fill +0\.30 +not measured +2 values are not finite", text)
    assert re.search(r"layered_depth +Key +cpu +0\.200", text)
    assert "Soft Shadow Rim: reaches nothing in view" in text
    assert "cpu (no GPU here)" in text
    assert max(map(width_of, text.splitlines())) <= WIDTH


def test_table_keeps_its_width_whatever_the_names():
    odd = "灯" * 60 + "\n\x1b[31m" + "é́" * 20 + "\ud800"
    layers = tuple(LayerReport(odd, "soft_shadow", odd, 1e6, 1e6, 3, ERROR) for _ in range(3))
    steps = tuple(StepTime(odd, odd, odd, 1.0) for _ in range(30))
    document = Report(
        "0.1.0",
        "5.2.3",
        odd,
        1,
        (1, 1),
        0,
        "cpu",
        odd * 9,
        1.0,
        0.0,
        10,
        steps,
        layers,
        ((odd, odd),),
        (odd * 5,),
    )
    text = format_table(document)
    assert max(map(width_of, text.splitlines())) <= WIDTH
    assert "\x1b" not in text
    text.encode()  # no lone surrogates
    assert "20 others" in text


def test_columns_line_up_in_any_script():
    lines = columns(["name", "seconds"], [["灯", "1.50"], ["abc", "12.25"]])
    assert lines == ["name  seconds", "灯       1.50", "abc     12.25"]


def test_cut_and_wrapped():
    assert cut("abcdef", 6) == "abcdef"
    assert cut("abcdefg", 6) == "abc..."
    assert width_of(cut("灯" * 9, 10)) <= 10
    lines = wrapped("word " * 60, "  what: ")
    assert len(lines) == 3
    assert lines[0].startswith("  what: word word")
    assert " ".join(lines).split() == ["what:", *["word"] * 60]
    assert wrapped("", "  x ") == ["  x"]
