"""Light through what is partly opaque, in whole bakes: the product of what each card lets through."""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.core.medium import Medium
from strata.addon.planning import Options, plan_scene
from strata.tests.support.cards import LAMPS, baked, constant, scene_of, shot, textured
from strata.tests.support.settings import maps

STACKS = {
    "one": [constant(0.3)],
    "two": [constant(0.3), textured(0.5)],
    "five": [constant(0.3), textured(0.5), constant(0.7), textured(0.3), constant(0.5)],
    "clipped": [constant(0.3), textured(0.3, threshold=0.5)],
    "clear": [constant(0.0), textured(0.0)],
    "whole": [constant(0.3), textured(0.7, threshold=0.5)],
}
LETS = {
    "one": 0.7,
    "two": 0.35,
    "five": 0.7 * 0.5 * 0.3 * 0.7 * 0.5,
    "clipped": 0.7,
    "clear": 1.0,
    "whole": 0.0,
}
METHODS = ["bitmask", "hybrid", "area", "rays"]
TOLERANCE = 0.005  # what is asked for; by rays there is no noise at all


def pixels_of(result) -> np.ndarray:
    (layer,) = result.layers.layers
    return layer.pixels


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("lamp", LAMPS)
@pytest.mark.parametrize("stack", ["one", "two", "five", "clipped"])
def test_what_gets_through_is_the_product(backend, stack, lamp, method):
    found = pixels_of(baked(STACKS[stack], lamp, backend, method=method))
    assert np.abs(found - LETS[stack]).max() < TOLERANCE


@pytest.mark.parametrize("method", ["bitmask", "area"])
@pytest.mark.parametrize("lamp", LAMPS)
@pytest.mark.parametrize("stack", ["one", "two", "five", "clipped"])
def test_without_rays_it_is_so_by_chance(backend, stack, lamp, method):
    """Each texel of each card is there or not, anew for each sample: 64 samples of 48 x 48 pixels are off by
    .0012 (one sigma). A wide light is behind several texels, each of which lies over others of other cards
    only in part: what the bitmask counts of five cards is off by up to .02, and areas, which are summed, hide
    all of the light."""
    is_hard, cards = lamp.startswith("hard"), len(STACKS[stack])
    if method == "area" and cards == 5 and not is_hard:
        return
    found = pixels_of(baked(STACKS[stack], lamp, backend, 64, method=method, rays=0))
    tolerance = TOLERANCE if is_hard or stack in ("one", "clipped") else 0.025
    assert found.mean() == pytest.approx(LETS[stack], abs=tolerance)


def test_what_is_clear_casts_nothing_and_hides_nothing(backend):
    result = baked(STACKS["clear"], "area", backend, are_seen=True)
    assert (pixels_of(result) == 1.0).all()


def test_what_is_whole_is_as_if_nothing_got_through(backend):
    assert (pixels_of(baked(STACKS["whole"], "area", backend)) == 0.0).all()


def test_a_scene_without_partial_opacity_is_planned_as_ever():
    """Clips are maps' own business: no map is drawn for each sample, and nothing more is left to rays."""
    partly, _ = scene_of([constant(0.5)], "area")
    options = Options(("soft_shadow",), "cpu", 8, 1, maps())
    assert "soft_shadow/leave_partial" in {
        node.step.name for node in plan_scene(partly, shot(), options).nodes()
    }
    for card in (constant(0.0), constant(1.0), textured(0.7, threshold=0.5)):
        outline, _ = scene_of([card], "area")
        steps = {node.step.name for node in plan_scene(outline, shot(), options).nodes()}
        assert "drawn_depth" not in steps
        assert "soft_shadow/leave_partial" not in steps


def test_a_preview_converges():
    """Without rays, of one sample a frame: the mean of the frames so far comes closer and closer."""
    errors = [pixels_of(baked(STACKS["two"], "hard sun", "cpu", n, rays=0)).std() for n in (1, 16, 64)]
    assert errors[0] > 2.0 * errors[1] > 3.0 * errors[2]


@pytest.mark.parametrize("lamp", ["hard sun", "sun"])
def test_fog_is_lit_in_proportion(backend, lamp):
    """Light that fog scatters once is linear in what gets through one card."""

    def light(opacity: float) -> np.ndarray:
        fog = Medium((0.2,) * 3, (0.0,) * 3)
        result = baked([constant(opacity)], lamp, backend, 64, effect="volumetric_light", medium=fog)
        return next(layer.pixels for layer in result.layers.layers if layer.of.is_lamp)

    none, some, whole = (float(light(opacity).mean(dtype=np.float64)) for opacity in (0.0, 0.3, 1.0))
    # Of 64 samples of 2304 pixels, each through many texels: .001 at most, one sigma.
    assert (none - some) / (none - whole) == pytest.approx(0.3, abs=0.005)
