"""The whole chain on random scenes: a bake with weights, its error and interval; against many view rays
through every pixel. And faults of all kinds, each of which a single report shows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from itertools import count, islice

import numpy as np
import pytest
from strata.addon.bake import BakeJob
from strata.addon.core.metrics import mean_brightness
from strata.addon.core.outline import Outline
from strata.addon.core.slices import finished
from strata.addon.effects.shared import lit, steps
from strata.addon.measure.footprint import Probed, seen
from strata.addon.measure.measure import Measurement
from strata.addon.measure.report import LayerError
from strata.addon.planning import Options, plan_scene
from strata.tests.measure.fields import LUMINANCE
from strata.tests.measure.scenes import lamp, random_scene, shot_of
from strata.tests.support.settings import maps

SCENES = 50
PROBES = 256
VIEWS = 96  # of each half, through every pixel; the halves' product is free of their noise

# What scenes are baked with, in turn: bad settings too.
SETTINGS = [
    {},
    {"samples": 1},
    {"resolution": 128},
    {"max_samples": 16},
    {"weight": "none"},
    {"samples": 4, "method": "hybrid"},
    {"method": "automatic"},
    {"opacity": 0.4},
    {"opacity": 0.7, "rays": 0},
]


def bake(
    seed: int, outline: Outline | None = None, samples=8, weight="radiance", opacity=1.0, **values
) -> list[Probed]:
    """Of each layer of a random scene, what its score gets."""
    own, arrays = random_scene(seed, opacity)
    outline, kept = outline or own, []

    class Keeping(Measurement):
        def measure(self, probed, *arguments):
            kept.append(probed)
            return super().measure(probed, *arguments)

    values = maps(**{"resolution": 256} | values)
    options = Options(("soft_shadow",), "cpu", samples, 1, values, weight=weight)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("strata.addon.bake.Measurement", Keeping)
        BakeJob(outline, plan_scene(outline, shot_of(seed), options), arrays, options).result()
    return kept


def measured(probed: Probed, probes: int, seed: int = 0) -> LayerError:
    return finished(Measurement(probes, seed).measure(probed))


class Truth:
    """What many view rays through every pixel of a layer tell."""

    def __init__(self, probed: Probed):
        told = probed.rays, probed.outline, probed.layer, probed.layers, probed.casters
        truth = partial(probed.layer.kind.score.truth, *told)
        looked = finished(seen(probed, truth, np.arange(probed.image.size), VIEWS, 1, 99, 2))
        light = looked.multiplied @ LUMINANCE
        self.used, self.light = (
            each.reshape(len(light), 2, VIEWS).mean(axis=2)
            for each in (looked.truth[0, ..., 0] * light, light)
        )

    def error(self, image: np.ndarray) -> float:
        """By the definition: over the pixels that the lamp would light."""
        whole = self.light.mean(axis=1)
        halves = image.reshape(-1, 1).astype(np.float64) * self.light - self.used
        shares = halves[whole > 0.0] / (whole + mean_brightness(whole[whole > 0.0]))[whole > 0.0, None]
        return float(np.sqrt(max(shares.prod(axis=1).mean(), 0.0)))


@cache
def scenes() -> list[tuple[Probed, Truth]]:
    """Without those of which the plan leaves the light out."""
    numbers = ((seed, SETTINGS[seed % len(SETTINGS)]) for seed in count())
    baked = (probed for seed, values in numbers for probed in bake(seed, **values))
    return [(probed, Truth(probed)) for probed in islice(baked, SCENES)]


def spoilt(image: np.ndarray, rng) -> np.ndarray:
    """One to five of a thousand pixels turned from light to dark or from dark to light."""
    image = image.copy()
    bad = rng.choice(image.size, max(round(rng.uniform(1e-3, 5e-3) * image.size), 1), replace=False)
    image.reshape(-1)[bad] = image.reshape(-1)[bad] < 0.5
    return image


@pytest.mark.parametrize("rare_errors", [False, True], ids=["as baked", "rare large errors"])
def test_the_interval_holds_the_true_error(rare_errors):
    rng = np.random.default_rng(0)
    missed = []
    for seed, (probed, truth) in enumerate(scenes()):
        image = spoilt(probed.image, rng) if rare_errors else probed.image
        error, (low, high) = truth.error(image), measured(replace(probed, image=image), PROBES, seed).ci95
        if not low <= error <= high:
            missed.append((seed, error, low, high))
    assert len(missed) <= 0.1 * SCENES, missed


def test_the_interval_ends_close_above_the_true_error():
    """Where every other pixel is looked at; with a quarter of the probes the median is 1.5. Of what noise has
    taken, nothing can be said."""
    errors = [truth.error(probed.image) for probed, truth in scenes()]
    highs = [measured(probed, 4 * PROBES, seed).ci95[1] for seed, (probed, _) in enumerate(scenes())]
    assert np.median([high / error for high, error in zip(highs, errors, strict=True) if error > 0.0]) <= 1.3


def test_estimates_are_unbiased():
    """Squares of many layers, each seen with few probes, add up to the true sum."""
    found = [[measured(probed, 64, seed).value ** 2 for seed in range(6)] for probed, _ in scenes()[:12]]
    true = [truth.error(probed.image) ** 2 for probed, truth in scenes()[:12]]
    uncertainty = np.sqrt((np.var(found, axis=1, ddof=1) / 6).sum())
    assert np.mean(found, axis=1).sum() == pytest.approx(sum(true), abs=4 * uncertainty)


def two_lamps(seed: int) -> Outline:
    outline, _ = random_scene(seed)
    other = replace(outline.lights[0], name="Other", key="Other", emitter=lamp(np.random.default_rng(99)))
    return replace(outline, lights=(*outline.lights, other))


def broken(change):
    """LAYERED_DEPTH with a bug: `change` is done to its depths (layers, height, width)."""

    sound = steps.LAYERED_DEPTH

    def twin(device, *inputs, **params):
        return np.ascontiguousarray(change(sound.cpu(device, *inputs, **params)))

    return replace(sound, name="layered_depth_broken", cpu=twin)


FAULTY_MAPS = {
    "shifted by a fiftieth": lambda depths: np.roll(depths, 5, axis=2),
    "nearest layer lost": lambda depths: np.concatenate([depths[1:], np.full_like(depths[:1], np.inf)]),
}


@pytest.fixture(scope="module")
def sound() -> list[Probed]:
    return bake(1, two_lamps(1), samples=16)


def assert_shows(sound: list[Probed], faulty: Probed) -> LayerError:
    """Against the healthy layer of the same lamp."""
    healthy = next(each for each in sound if each.layer.of == faulty.layer.of)
    error = measured(faulty, 512)
    assert error.ci95[0] > measured(healthy, 512).ci95[1]
    return error


@pytest.mark.parametrize("fault", FAULTY_MAPS.values(), ids=FAULTY_MAPS)
def test_a_wrong_map_shows_in_one_report_as_the_methods_fault(fault, sound, monkeypatch):
    monkeypatch.setattr(steps, "LAYERED_DEPTH", broken(fault))
    error = assert_shows(sound, bake(1, two_lamps(1), samples=16)[0])
    assert error.method > 0.7 * error.value
    assert error.max > 0.3


def test_missing_weights_show_as_sampling(sound):
    error = assert_shows(sound, bake(1, two_lamps(1), samples=16, weight="none")[0])
    assert error.sampling > error.method


def test_weights_of_another_lamp_show(sound, monkeypatch):
    """Of one that lights the things, and not the floor."""
    irradiance, things = lit.irradiance, frozenset(range(1, len(two_lamps(1).instances)))

    def of_another(recorder, surface, light):
        return irradiance(recorder, surface, replace(light, receivers=things))

    monkeypatch.setattr(lit, "irradiance", of_another)
    assert_shows(sound, bake(1, two_lamps(1), samples=16)[0])


def test_a_layer_of_another_lamp_shows(sound):
    first, last = sound
    assert_shows(sound, replace(first, image=last.image, weights=last.weights, samples=last.samples))


def test_a_shadow_is_the_methods_and_an_edge_is_samplings():
    """With rays wherever a map is in doubt, nearly all that is left is what lies between the samples."""
    error = measured(bake(1, two_lamps(1), samples=2, method="hybrid", rays=64)[0], 512)
    assert error.method < 0.5 * error.sampling
