"""Bakes that go on until each layer's error is at its target, on scenes made without Blender."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.bake import Baked, BakeJob
from strata.addon.core.errors import StrataError
from strata.addon.core.slices import finished
from strata.addon.measure.report import NotMeasured
from strata.addon.measuring import Measuring
from strata.addon.passes import FEWEST_TO_BE_STUCK, USUAL_SAMPLES
from strata.addon.planning import Options, plan_scene
from strata.tests.bake.test_bake_job import FROM_ABOVE
from strata.tests.support.flat_scenes import FLOOR, lamp, scene_of
from strata.tests.support.settings import maps

SOFT, CRISP = 2.0, 0.02


def two_lamps():
    """Over a floor with many small plates: edges in every other pixel."""
    rng = np.random.default_rng(1)
    lows = np.concatenate([rng.uniform(-2.8, 2.5, (40, 2)), rng.uniform(0.2, 1.5, (40, 1))], axis=1)
    highs = lows + np.concatenate([rng.uniform(0.05, 0.5, (40, 2)), np.zeros((40, 1))], axis=1)
    plates = [(tuple(low), tuple(high)) for low, high in zip(lows.tolist(), highs.tolist(), strict=True)]
    lights = [lamp((-1.0, 0.0, 5.0), CRISP), lamp((1.0, 1.0, 5.0), SOFT)]
    named = [replace(light, name=name, pass_name=name) for light, name in zip(lights, "AB", strict=True)]
    return scene_of([FLOOR, *plates], named)


def bake(scene=None, **options) -> Baked:
    outline, arrays = scene or two_lamps()
    given = {"most_samples": 64, "target_error": 0.008, "probes": 0, "effects": ("soft_shadow",)}
    given["values"] = maps()
    chosen = Options(backend="cpu", **given | options)
    return BakeJob(outline, plan_scene(outline, FROM_ABOVE, chosen), arrays, chosen).result()


def samples_of(baked: Baked) -> dict[str, int]:
    return {layer.name: layer.samples for layer in baked.report.layers}


def pixels_of(baked: Baked) -> list[np.ndarray]:
    return [layer.pixels for layer in baked.layers.layers]


def test_each_layer_gets_samples_of_its_own():
    loose, close = bake(target_error=0.03), bake(target_error=0.01)
    assert list(samples_of(loose).values()) == [4, 4]
    crisp, soft = samples_of(close).values()
    assert crisp > soft == 4
    assert all(layer.target.reached and layer.target.seen <= 0.01 for layer in close.report.layers)
    assert [layer.samples for layer in close.layers.layers] == [crisp, soft]


def test_what_was_chosen_gives_the_same_bits_again():
    first = bake()
    again = bake(target_error=0.0, samples_of=samples_of(first))
    assert samples_of(again) == samples_of(first)
    for one, other in zip(pixels_of(first), pixels_of(again), strict=True):
        assert np.array_equal(one, other)


def test_the_choice_does_not_hang_on_what_is_reported():
    """Nor on the clock: neither how many probes there are nor whether there are any."""
    choices = [samples_of(bake(probes=probes)) for probes in (0, 64, None)]
    assert choices[0] == choices[1] == choices[2]


def test_a_layer_in_groups_is_the_same():
    whole, grouped = bake(composite=True), bake(composite=True, memory_bytes=1)
    assert grouped.report.memory.groups > 1 == whole.report.memory.groups
    alone = bake(samples_of=samples_of(grouped), target_error=0.0)
    for one, other in zip(pixels_of(grouped), pixels_of(alone), strict=True):
        assert np.array_equal(one, other)
    # The parts have each their own number of samples; the picture is the sum of their means.
    assert len(set(samples_of(grouped).values())) == 2
    assert grouped.composite.mean() == pytest.approx(whole.composite.mean(), rel=0.01)
    # What no layer tells of has as many as nobody looked at.
    same = dict.fromkeys(samples_of(whole), USUAL_SAMPLES)
    pictures = [bake(composite=True, samples_of=same, memory_bytes=size).composite for size in (0, 1)]
    assert np.allclose(*pictures, rtol=1e-5)


def test_a_picture_in_groups_is_made_again_too():
    first = bake(composite=True, memory_bytes=1)
    again = bake(composite=True, memory_bytes=1, target_error=0.0, samples_of=samples_of(first))
    assert np.array_equal(first.composite, again.composite)


def test_a_picture_has_as_many_samples_as_its_slowest_layer():
    apart, joined = samples_of(bake()), samples_of(bake(composite=True))
    assert set(joined.values()) == {max(apart.values())} != set(apart.values())


def test_the_error_is_at_the_target():
    """By all pixels, with other rays than those that decided: in the mean of four seeds, since in so small a
    picture a single choice is off by a tenth or two."""
    truths, measured, target = [], Measuring.errors, 0.008

    def errors(self, graph):
        for layer in graph.layers:
            probed = self._probed(layer)
            pixels = probed.image.size
            watch = finished(layer.kind.score.watch(probed, 8 * pixels, 4, 123))
            truths.append(watch.rms(probed.image.reshape(pixels, -1)[watch.pixels]))
        return (yield from measured(self, graph))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Measuring, "errors", errors)
        for seed in range(4):
            bake(target_error=target, probes=1, seed=seed)
    assert len(truths) == 8
    assert 0.7 * target < np.mean(truths) < 1.1 * target
    assert max(truths) < 1.3 * target


def test_what_was_watched_makes_the_reported_interval_narrow():
    """With as many probes, which are others than those that decided; and it holds the error of all pixels."""
    widths, held, measured = {True: [], False: []}, [], Measuring.errors

    def errors(self, graph):
        for layer in graph.layers:
            probed, score = self._probed(layer), layer.kind.score
            everything = finished(score.watch(probed, 8 * probed.image.size, 4, 123))
            true = everything.rms(probed.image.reshape(-1, 1)[everything.pixels])
            for seed in range(4):
                for is_told in (True, False):
                    asked = replace(probed, watched=probed.watched if is_told else None, found={})
                    error = finished(score.measure(asked, 48, 50 + seed))
                    widths[is_told].append(error.ci95[1] - error.ci95[0])
                    held.extend([error.ci95[0] <= true <= error.ci95[1]] * is_told)
        return (yield from measured(self, graph))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Measuring, "errors", errors)
        bake(probes=1)
    assert len(held) == 8
    assert sum(held) >= 7
    assert np.mean(widths[True]) < 0.8 * np.mean(widths[False])


def test_what_more_samples_do_not_lower_is_told():
    coarse = {"soft_shadow": {"method": "area", "resolution": 128}}
    baked = bake(target_error=0.005, values=coarse, probes=512)
    told = [layer for layer in baked.report.layers if not layer.target.reached]
    assert told
    for layer in told:
        assert FEWEST_TO_BE_STUCK <= layer.samples < 64  # it does not go on for nothing
        assert "target 0.5%: the method cannot go below" in layer.target_words
        assert "Method Hybrid" in layer.target_words or "Map Size" in layer.target_words


@pytest.mark.parametrize("failing", ["A", "AB"])
def test_a_layer_that_cannot_be_measured_has_as_many_samples_as_another(monkeypatch, failing):
    """Or as many as there may be, where no other could be either."""
    watch = Measuring.watch

    def broken(self, layer, samples):
        if layer.name[-1] in failing:
            return NotMeasured("broken")
        return (yield from watch(self, layer, samples))

    monkeypatch.setattr(Measuring, "watch", broken)
    baked = bake(target_error=0.004, most_samples=12)
    a, b = samples_of(baked).values()
    assert a == b == (12 if failing == "AB" else b)
    assert b > 4
    told = [each for each in baked.report.warnings if "could not be measured (broken)" in each]
    assert len(told) == len(failing)
    assert f"it has {a} samples" in told[0]


def test_layers_of_which_nothing_was_chosen_have_the_most_of_any():
    """The same in all frames of a sequence, whichever others a frame needs."""
    first, *_ = samples_of(bake())
    baked = bake(target_error=0.0, samples_of={first: 6, "Soft Shadow of another frame": 9})
    assert sorted(samples_of(baked).values()) == [6, 9]
    assert any("as many as any other has" in each for each in baked.report.warnings)


def test_what_was_chosen_before_says_whether_it_is_enough():
    """By the error that is reported, since nobody looks beforehand: for later frames of a sequence."""
    few = dict.fromkeys(samples_of(bake(target_error=0.03)), 1)
    for target, reached in ((0.004, False), (0.2, True)):
        for layer in bake(target_error=target, samples_of=few, probes=256).report.layers:
            assert layer.target.reached is reached
            assert layer.target.seen == layer.error.value
            words = f"target {100 * target:g}%: one sample as chosen before, and not enough"
            assert (words in layer.target_words) is not reached
    assert all(layer.target is None for layer in bake(samples_of=few).report.layers)  # nobody measures


def test_most_samples_are_told():
    baked = bake(target_error=0.001, most_samples=6)
    assert set(samples_of(baked).values()) == {6}
    assert all("6 samples at most" in layer.target_words for layer in baked.report.layers)


def test_a_budget_ends_a_bake_between_two_passes():
    """The first pass is made whatever it takes, and what was made can be made again."""
    counts = []
    for budget in (1e-3, 1e6):
        baked = bake(target_error=0.0, time_budget_s=budget)
        counts += set(samples_of(baked).values())
        assert baked.report.time_budget_s == budget
        again = bake(target_error=0.0, samples_of=samples_of(baked))
        assert all(np.array_equal(*pair) for pair in zip(pixels_of(baked), pixels_of(again), strict=True))
    assert counts == [4, 64]
    late = bake(target_error=0.002, time_budget_s=1e-3)
    assert all(
        "there was no time for more than 4 samples" in each.target_words for each in late.report.layers
    )


def test_a_bake_without_a_target_has_the_samples_it_was_told():
    plain = bake(target_error=0.0, samples=3)
    assert set(samples_of(plain).values()) == {3}
    assert all(layer.target is None and not layer.in_passes for layer in plain.report.layers)


OWN = (("soft_shadow", "target_error", 0.01),)
"""A lamp's."""


def with_own(outline, *of_lamps):
    lights = zip(outline.lights, of_lamps, strict=True)
    return replace(outline, lights=tuple(replace(light, own_settings=own) for light, own in lights))


def test_a_lamp_has_a_target_of_its_own():
    """Others have exactly as many samples as are set, also a number that is no pass by itself."""
    outline, arrays = two_lamps()
    scene = with_own(outline, OWN, ()), arrays
    crisp, _ = samples_of(bake(target_error=0.01)).values()
    baked = bake(scene, target_error=0.0, samples=7)
    own, other = baked.report.layers
    assert (own.target.error, own.target.reached, other.target) == (0.01, True, None)
    assert crisp - 4 <= own.samples <= crisp + 4  # offsets differ where there is a pass of 7
    assert own.samples > other.samples == 7
    again = bake(target_error=0.0, samples_of=samples_of(baked))
    assert all(np.array_equal(*pair) for pair in zip(pixels_of(baked), pixels_of(again), strict=True))
    few = bake(scene, target_error=0.0, samples=3, own_targets={})
    assert set(samples_of(few).values()) == {3}


def test_a_lamp_goes_before_its_effect_and_that_before_the_bake():
    outline, arrays = two_lamps()
    values = {"soft_shadow": {"target_error": 0.03}}
    scene = with_own(outline, OWN, (("soft_shadow", "target_error", 0.0),)), arrays
    for target in (0.0, 0.004):
        own, other = bake(scene, target_error=target, values=values).report.layers
        assert (own.target.error, other.target.error) == (0.01, 0.03)
        assert own.samples > other.samples == 4


def test_an_own_target_counts_beside_a_budget():
    outline, arrays = two_lamps()
    scene = with_own(outline, (("soft_shadow", "target_error", 0.1),), ()), arrays
    own, other = bake(scene, target_error=0.0, time_budget_s=1e6, most_samples=12).report.layers
    assert (own.samples, other.samples) == (4, 12)


@pytest.mark.parametrize("target", [-0.1, 1.0])
def test_a_target_is_a_share(target):
    with pytest.raises(StrataError, match="target error"):
        Options(target_error=target)
