"""`strata compare` of files that are off by known numbers."""

from __future__ import annotations

import json

import numpy as np
import pytest
from strata.addon.core.layers import Layer, LayerSet
from strata.addon.layers.exr import write_layers
from strata.addon.layers.exr_params import ExrParams
from strata.ops.cli import main

WIDTH, HEIGHT = 40, 30


def write(path, off: float = 0.0, size=(WIDTH, HEIGHT), names=("Soft Shadow Key", "Fog"), **how):
    width, height = size
    ramp = np.linspace(0.2, 0.8, width, dtype=np.float32)[None].repeat(height, 0)
    layers = {"Soft Shadow Key": ("V", ramp + off), "Fog": ("RGB", 2.0 * ramp[..., None].repeat(3, -1) + off)}
    report = {
        "layers": [{"name": "Soft Shadow Key", "role": "visibility"}, {"name": "Fog", "role": "scattering"}]
    }
    made = [Layer(name, layers[name][0], layers[name][1].astype(np.float32), "soft_shadow") for name in names]
    write_layers(
        path, LayerSet(tuple(made), width, height, "View", report=report), ExrParams.checked("exr", how)
    )
    return path


def compared(capfd, *words) -> list[dict]:
    assert main(["compare", *map(str, words), "--json"]) == 0
    return {each["name"]: each for each in json.loads(capfd.readouterr().out)}


@pytest.mark.parametrize("how", [{}, {"parts": "single"}, {"depth": "half"}])
def test_differences_are_those_that_were_made(tmp_path, capfd, how):
    first, second = write(tmp_path / "a.exr", 0.1, **how), write(tmp_path / "b.exr", **how)
    found = compared(capfd, first, second)
    rounding = 1e-3 if how.get("depth") else 1e-6
    shadow, fog = found["View.Soft Shadow Key"], found["View.Fog"]
    assert shadow["rms"] == pytest.approx(0.1, abs=rounding)
    assert not shadow["is_share"]
    ramp = 2.0 * np.linspace(0.2, 0.8, WIDTH)
    assert fog["is_share"]
    assert fog["rms"] == pytest.approx(np.sqrt(np.mean((0.1 / (ramp + ramp.mean())) ** 2)), abs=rounding)
    assert 0.0 < shadow["flip"] < 0.5
    same = compared(capfd, second, second)
    assert all(each["rms"] == each["flip"] == 0.0 for each in same.values())


def test_the_exit_code_says_whether_a_limit_is_kept(tmp_path):
    first, second = write(tmp_path / "a.exr", 0.1), write(tmp_path / "b.exr")
    words = ["compare", str(first), str(second), "--layers", "Soft Shadow Key", "-q"]
    assert main([*words, "--limit", ".09"]) == 1
    assert main([*words, "--limit", ".11"]) == 0
    assert main(words) == 0


def test_pictures_of_differences(tmp_path):
    first, second = write(tmp_path / "a.exr", 0.1), write(tmp_path / "b.exr")
    assert main(["compare", str(first), str(second), "-o", str(tmp_path / "out"), "-q"]) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "View.Soft_Shadow_Key.png",
        "View.Fog.png",
    }


def test_what_is_not_finite_is_counted(tmp_path, capfd):
    first = write(tmp_path / "a.exr", np.nan, names=("Soft Shadow Key",))
    found = compared(capfd, first, write(tmp_path / "b.exr", names=("Soft Shadow Key",)))
    assert found["View.Soft Shadow Key"]["non_finite"] == WIDTH * HEIGHT
    ramp = np.linspace(0.2, 0.8, WIDTH)
    assert found["View.Soft Shadow Key"]["rms"] == pytest.approx(np.sqrt(np.mean(ramp**2)))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("a.exr", "nowhere.exr"), "cannot read"),
        (("a.exr", "text.exr"), "is no OpenEXR file"),
        (("small.exr", "a.exr"), "small.exr is 20x30"),
        (("one.exr", "a.exr"), "one.exr has no layer 'Fog'"),
        (("a.exr", "one.exr", "--layers", "Fog"), "one.exr has no layer 'Fog'"),
        (("a.exr", "cut.exr"), "is no whole OpenEXR file"),
        (("a.exr", "a.exr", "--limit", "2"), "is no error like"),
    ],
)
def test_wrong_input_is_one_line(tmp_path, capfd, words, says):
    path = write(tmp_path / "a.exr")
    write(tmp_path / "small.exr", size=(20, HEIGHT))
    write(tmp_path / "one.exr", names=("Soft Shadow Key",))
    (tmp_path / "text.exr").write_text("nothing")
    (tmp_path / "cut.exr").write_bytes(path.read_bytes()[:-30])
    assert (
        main(["compare", *(str(tmp_path / each) if each.endswith(".exr") else each for each in words)]) == 2
    )
    error = capfd.readouterr().err.strip()
    assert says in error
    assert len(error.splitlines()) == 1
