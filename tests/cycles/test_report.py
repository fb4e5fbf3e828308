"""Cycles and EEVEE as rivals: their shadows are ours too, and what they are off by falls with samples."""

from __future__ import annotations

import json

from strata.addon.report.rivals import eevee
from strata.ops.cli import main
from strata.tests.support.places import SAMPLES

CONVERGED = 0.03
"""Of 256 samples at 64x36: noise is .016 to .02 there, and a shadow misplaced by a pixel .06."""
EEVEE = 0.1
"""Of 16 samples at 32x18: a shadow that is not there is off by .4."""


def test_light_groups_with_and_without_a_denoiser(tmp_path):
    words = ["--size", "64x36", "--backend", "cpu", "--samples", "1", "--samples-only", "--repeats", "1"]
    words += ["--effects", "soft_shadow", "--rivals", "cycles"]
    assert main(["report", str(SAMPLES / "stacked.blend"), "-o", str(tmp_path), *words]) == 0
    data = json.loads((tmp_path / "report.json").read_text())
    assert not data["warnings"]
    errors = {
        (point["curve"], point["samples"]): point["layers"]["Soft Shadow Panel"]["value"]
        for point in data["points"]
        if point["who"] == "cycles"
    }
    for point in data["points"]:
        layer = point["layers"]["Soft Shadow Panel"]
        assert layer["value"] == min(layer["ways"].values(), default=layer["value"])
        assert len(layer["ways"]) == 2 * (point["who"] == "cycles")
    plain, denoised = "one render, light groups", "one render, light groups, denoised"
    assert errors[plain, 256] < CONVERGED < errors[plain, 4]
    assert errors[denoised, 4] < errors[plain, 4]
    assert all(point["cpu_s"][1] > 0.0 for point in data["points"])


def test_eevee_a_lamp_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr(eevee, "SAMPLES", (16,))
    words = ["--size", "32x18", "--backend", "cpu", "--samples", "1", "--samples-only", "--repeats", "1"]
    words += ["--effects", "soft_shadow", "--rivals", "eevee"]
    assert main(["report", str(SAMPLES / "stacked.blend"), "-o", str(tmp_path), *words]) == 0
    data = json.loads((tmp_path / "report.json").read_text())
    assert not data["warnings"]
    (point,) = (point for point in data["points"] if point["who"] == "eevee")
    assert point["layers"]["Soft Shadow Panel"]["value"] < EEVEE
    assert point["cpu_s"][1] > 0.0
