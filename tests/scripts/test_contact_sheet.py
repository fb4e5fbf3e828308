"""The picture of a bake for a person."""

from __future__ import annotations

import numpy as np
from PIL import Image
from strata.addon.core.layers import Layer
from strata.addon.core.roles import Of
from strata.tests.layers.made_layers import ERROR, HEIGHT, WIDTH, layer, layer_set


def test_contact_sheet_multiplies_each_light_by_its_own_shadow(tmp_path):
    from strata.scripts.pictures.contact_sheet import AMBIENT, composite, error_lines, save_contact_sheet

    shadow = Layer(
        "Soft Shadow Key", "V", np.zeros((HEIGHT, WIDTH), np.float32), "soft_shadow", "Key", Of.lamp(0)
    )
    lit = {
        0: np.full((HEIGHT, WIDTH, 3), 2.0, np.float32),
        1: np.full((HEIGHT, WIDTH, 3), 3.0, np.float32),  # its layer was left out: nothing shadows it
    }
    total = composite((shadow,), lit)
    np.testing.assert_allclose(total, 2.0 * AMBIENT + 3.0, rtol=1e-6)  # float32 sums
    path = tmp_path / "sheet.png"
    save_contact_sheet(path, layer_set(shadow, layer("Glow", "RGBA")), lit)
    assert error_lines({}) == ("error not measured",)
    assert error_lines({"not_measured": "no memory"}) == ("error not measured", "no memory")
    assert error_lines(ERROR, "Key", "fine", ["samples"]) == (
        "multiplied onto its light, off by 1.1% of the brightness",
        "fine (95% sure: 1.0% to 1.2%)",
        "most of it is aliasing: more samples",
    )
    assert error_lines(ERROR, "Key", "fine")[2] == "64 probes · rays"
    clipped = {**ERROR, "display": 0.001}
    assert error_lines(clipped, "Key", "fine", ["samples"])[2:] == (
        "most of it is aliasing: more samples",
        "on a display 0.1%, since white is clipped",
    )
    with Image.open(path) as sheet:
        assert sheet.width == 1600
        assert sheet.getextrema()[0][1] > 200  # the lit image is there, and bright
