"""Colour ramps: Blender's own evaluate() is the judge, at random positions of random ramps in every mode."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.core.params import Colour, ParamSpec, plain
from strata.addon.core.ramp import HuePath, Ramp, RampInterpolation, RampMode
from strata.addon.effects.toon.ramp_table import table_of
from strata.addon.scene.own_settings import ramp_of
from strata.addon.ui.properties import fill_ramp

# Blender works in float32: a few units in the last place of numbers up to 6 (hue in sixths).
TOLERANCE = 3e-6


@pytest.fixture
def blender_ramp():
    texture = bpy.data.textures.new("Judge", "NONE")
    texture.use_color_ramp = True
    yield texture.color_ramp
    bpy.data.textures.remove(texture)


def _random_ramp(rng, interpolation, mode, hue) -> Ramp:
    """One to six stops; some share a position, lie at an end, are grey, or share a hue."""
    positions = rng.uniform(0, 1, rng.integers(1, 7))
    positions = np.where(rng.random(len(positions)) < 0.3, rng.integers(0, 2, len(positions)), positions)
    colours = rng.uniform(0, 1, (len(positions), 4))
    colours[:, :3] = np.where(rng.random((len(positions), 3)) < 0.5, np.round(colours[:, :3]), colours[:, :3])
    stops = zip(
        np.sort(positions).astype(np.float32).tolist(), colours.astype(np.float32).tolist(), strict=True
    )
    return Ramp(tuple((position, tuple(colour)) for position, colour in stops), interpolation, mode, hue)


@pytest.mark.parametrize("interpolation", list(RampInterpolation))
@pytest.mark.parametrize("mode", list(RampMode))
def test_ramps_are_blenders_own(interpolation, mode, blender_ramp):
    rng = np.random.default_rng(8)
    paths = list(HuePath) if mode != RampMode.RGB else [HuePath.NEAR]
    for trial in range(24):
        ramp = _random_ramp(rng, interpolation, mode, paths[trial % len(paths)])
        fill_ramp(blender_ramp, ramp)
        positions = [0.0, 1.0, *(position for position, _ in ramp.stops)]
        positions = np.append(positions, rng.uniform(0, 1, 60).astype(np.float32)).astype(np.float64)
        truth = np.array([blender_ramp.evaluate(position)[:] for position in positions])
        np.testing.assert_allclose(table_of(ramp).evaluate(positions), truth, atol=TOLERANCE, rtol=0)


def test_a_ramp_goes_to_blender_and_back(blender_ramp):
    ramp = _random_ramp(np.random.default_rng(5), RampInterpolation.CARDINAL, RampMode.HSL, HuePath.FAR)
    fill_ramp(blender_ramp, ramp)
    assert ramp_of(blender_ramp) == ramp


def test_a_ramp_is_written_and_read_as_text():
    ramp = Ramp.parse("1:#ffffff , 0:#80402080; CONSTANT")
    assert [position for position, _ in ramp.stops] == [0.0, 1.0]
    # 0x80 is 128 / 255; by IEC 61966-2-1 that is 0.2159.
    assert ramp.stops[0][1] == pytest.approx((0.21586, 0.05127, 0.01444, 128 / 255), abs=1e-5)
    assert ramp.interpolation == RampInterpolation.CONSTANT
    assert str(ramp) == "0:#80402080,1:#ffffff;constant"
    assert Ramp.parse(str(ramp)) == ramp
    turning = Ramp.parse("0:#ff0000,1:#0000ff;hsv;cw")
    assert (turning.mode, turning.hue) == (RampMode.HSV, HuePath.CW)
    assert Ramp.parse(str(turning)) == turning


@pytest.mark.parametrize("text", ["", "0.5", "0:red", "2:#ffffff", "nan:#ffffff", "0:#ffffff;wavy", "0:#fff"])
def test_what_is_no_ramp_is_refused(text):
    with pytest.raises(StrataError):
        Ramp.parse(text)


def _spec(kind, default) -> ParamSpec:
    return ParamSpec("ink", kind, default, (0.0, 1.0), None, "", False, "")


def test_colours_and_ramps_are_parameters():
    colour = _spec(Colour, Colour(0.0, 0.0, 0.0))
    assert colour.check("toon", "#ff0000") == Colour(1.0, 0.0, 0.0)
    assert colour.check("toon", "0.1,0.2,0.3") == colour.check("toon", [0.1, 0.2, 0.3])
    for wrong in ("red", "1,2", (1.0, 2.0, 0.0), float("nan"), "nan,0,0"):
        with pytest.raises(StrataError, match=r"toon\.ink"):
            colour.check("toon", wrong)
    ramp = _spec(Ramp, Ramp.parse("0:#000000"))
    assert plain(ramp.check("toon", "0:#ffffff")) == "0:#ffffff;linear"
    with pytest.raises(StrataError, match=r"toon\.ink"):
        ramp.check("toon", "black to white")
    assert plain(colour.check("toon", "#000000")) == [0.0, 0.0, 0.0]
