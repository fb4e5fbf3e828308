"""Measuring where there is next to nothing to measure, and where the numbers are no numbers."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strata.addon.core.sampling import footprints
from strata.addon.core.shot import PixelFilter
from strata.addon.core.slices import finished
from strata.addon.core.surface import SurfacePoints
from strata.addon.core.view_rays import ViewRays
from strata.addon.measure.difficulty import Difficulty
from strata.addon.measure.image import measure_light, measure_mask
from strata.addon.measure.report import LayerError
from strata.addon.measure.shadow_probes import Stratum
from strata.addon.measure.visibility import measure_visibility
from strata.tests.measure.fields import Field
from strata.tests.measure.images import NAME, Light, collected

# What layers hold at their worst: nothing, everything, in between, and no numbers.
ODD = (0.0, 1.0, 0.5, 1e-40, 3e38, -1.0, math.nan, math.inf, -math.inf)
VISIBILITIES = st.sampled_from([0.0, 1.0, 0.25, 1e-40])


def is_sound(error: LayerError) -> bool:
    """Finite throughout, as JSON wants it, and the value within its interval."""
    low, high = error.ci95
    assert error.to_json()
    return 0.0 <= low <= error.value * (1.0 + 1e-9) and error.value <= high * (1.0 + 1e-9)


def visibility(field: Field, probes: int, seed: int = 0, strata=None) -> LayerError:
    strata = field.strata(probes, np.random.default_rng(seed)) if strata is None else strata
    work = measure_visibility(strata, probes, field.weigh, field.screen, field.reference, seed)
    return finished(work)


def empty_stratum(kind: Difficulty) -> Stratum:
    nothing = np.zeros((0, 3), np.float32)
    points = SurfacePoints(nothing, nothing, nothing, np.zeros(3))
    return Stratum(kind, 0, np.zeros(0, np.uint32), np.zeros(0, np.uint32), np.zeros(0), points)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_layer_in_which_nothing_is_in_doubt(value):
    """No ray contradicts it and nothing is partly lit, so that no probe is left for the slow reference."""
    pixels = np.full(1000, value)
    error = visibility(Field(pixels, pixels, np.ones(1000)), probes=4)
    assert (error.value, error.bias, error.p99, error.max, error.probes) == (0.0, 0.0, 0.0, 0.0, 0)
    # 256 of the 1000 are screened: the rule of three for those, two-sided.
    expected = 3.689 / 256 * (1.0 - 0.256)
    assert error.ci95[0] == 0.0
    assert error.ci95[1] ** 2 == pytest.approx(expected, rel=0.01)


def test_strata_without_pixels():
    field = Field(np.ones(10), np.ones(10), np.ones(10))
    strata = [empty_stratum(kind) for kind in (Difficulty.PENUMBRA, Difficulty.EDGE, Difficulty.REST)]
    error = visibility(field, 8, strata=strata)
    assert (error.value, error.ci95, error.probes) == (0.0, (0.0, 0.0), 0)
    strata += field.strata(8, np.random.default_rng(0))
    assert visibility(field, 8, strata=strata).value == 0.0


@settings(max_examples=150, deadline=None)
@given(
    pixels=st.lists(
        st.tuples(VISIBILITIES, VISIBILITIES, st.sampled_from([0.0, 1.0, 1e-30, 1e30, math.inf, math.nan])),
        max_size=12,
    ),
    probes=st.sampled_from([1, 2, 3, 100]),
)
def test_any_shadow_has_a_sound_error(pixels, probes):
    values, truths, weights = np.array(pixels, np.float64).reshape(-1, 3).T
    error = visibility(Field(values, truths, weights), probes)
    assert is_sound(error)
    assert error.value <= 1.0 + 1e-9
    if (values == truths).all() and np.isin(truths, (0.0, 1.0)).all():
        assert error.value == 0.0


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_shadow_reference_without_numbers_is_refused(value):
    field = Field(np.full(9, 0.5), np.full(9, 0.5), np.ones(9))
    broken = lambda points, samples, seed: (np.full((len(points.position), 2), value), np.ones(9))  # noqa: E731
    work = measure_visibility(
        field.strata(4, np.random.default_rng(0)), 4, field.weigh, field.screen, broken, 0
    )
    with pytest.raises(ValueError, match="not finite"):
        finished(work)


def images(channels: int):
    """(height, width, channels) of ODD values, few of them, so that whole images of each come up."""

    def filled(shape_and_values):
        (height, width), values = shape_and_values
        return np.resize(np.array(values, np.float32), (height, width, channels))

    shapes = st.tuples(st.integers(1, 5), st.integers(1, 5))
    return st.tuples(shapes, st.lists(st.sampled_from(ODD), min_size=1, max_size=12)).map(filled)


@settings(max_examples=150, deadline=None)
@given(
    values=images(3),
    truth=st.sampled_from([0.0, 1.0, 1e-30, 1e6]),
    noise=st.sampled_from([0.0, 0.1]),
    probes=st.sampled_from([1, 2, 100]),
)
def test_any_light_has_a_sound_error(values, truth, noise, probes):
    error = Light(values, np.full(values.shape, truth), noise=noise).measured(probes, seed=1)
    assert is_sound(error)
    assert error.probes >= 1


def mask_of(strata, image: np.ndarray, truth: float, probes: int) -> LayerError:
    def look(pixels, jitter):
        nothing = np.zeros((len(pixels), 3))
        return ViewRays(pixels, jitter, nothing, nothing, nothing[:, 0], {}, None)

    def reference(seen, seed):
        return np.full((1, len(seen), 1), truth)

    def scattered(pixels, samples, seed):
        return footprints(PixelFilter("BOX", 0.5), pixels, samples, seed)

    return finished(measure_mask(strata, image, probes, reference, look, scattered, "made up", 0))


@settings(max_examples=60, deadline=None)
@given(values=images(1), truth=st.sampled_from([0.0, 0.5, 1.0]), probes=st.sampled_from([1, 2, 100]))
def test_any_mask_has_a_sound_error(values, truth, probes):
    image = values[..., 0]
    strata = list(collected(image, probes, seed=1).strata(NAME))
    error = mask_of(strata, image, truth, probes)
    assert is_sound(error)
    assert error.value <= 1.0 + 1e-9
    if not np.isfinite(image).any():  # shown black
        assert error.value == float(truth > 1.0 / 8.0)


def test_images_without_strata():
    def reference(stratum, seed):
        raise AssertionError("there is nothing to ask for")

    light = finished(measure_light([], 0.0, 0, 4, reference, "made up", 0))
    mask = mask_of([], np.zeros((1, 1), np.float32), 0.0, 4)
    for error in (light, mask):
        assert (error.value, error.ci95, error.probes) == (0.0, (0.0, 0.0), 0)
