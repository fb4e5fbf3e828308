"""Measuring where there is next to nothing to measure, and where the numbers are no numbers."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strata.addon.core.slices import finished
from strata.addon.measure.in_use import InUseScore
from strata.addon.measure.mask import MaskScore
from strata.addon.measure.report import LayerError
from strata.tests.measure.fields import Field, probed_of
from strata.tests.measure.images import Light

# What layers hold at their worst: nothing, everything, in between, and no numbers.
ODD = (0.0, 1.0, 0.5, 1e-40, 3e38, -1.0, math.nan, math.inf, -math.inf)
VISIBILITIES = st.sampled_from([0.0, 1.0, 0.25, 1e-40])
# Truths are kept from being negative or infinite where they are made; nothing is known before the sky.
LIGHT = st.sampled_from([0.0, 1.0, 1e-30, 1e30, math.nan])


def is_sound(error: LayerError) -> bool:
    """Finite throughout, as JSON wants it, and the value within its interval."""
    low, high = error.ci95
    assert error.to_json()
    return 0.0 <= low <= error.value * (1.0 + 1e-9) and error.value <= high * (1.0 + 1e-9)


def field_of(values, truths, light, covered=1.0) -> Field:
    """Of rows of 100 pixels, each of them like the first ones over and over."""
    count = 100 * max(-(-len(values) // 100), 1)
    values, truths, light = (np.resize(np.array(each, np.float64), count) for each in (values, truths, light))
    both = (
        np.repeat(truths[:, None, None], 2, axis=1),
        np.repeat(light[:, None, None], 2, axis=1) * np.ones(3),
    )
    return Field(values[:, None], *both, np.full(count, covered))


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_layer_in_which_nothing_is_in_doubt(value):
    """No ray contradicts it and nothing is partly lit, so that no probe is left for the slow reference."""
    error = field_of([value] * 1000, [value], [1.0]).measured(4, 0)
    assert (error.value, error.bias, error.p99, error.max, error.probes) == (0.0, 0.0, 0.0, 0.0, 0)
    assert error.ci95[0] == 0.0
    # 192 of the 1000 are screened: the rule of three for those, two-sided; half of a pixel as bright as the
    # mean is the light's share.
    assert error.ci95[1] ** 2 == pytest.approx(0.25 * 3.689 / 192 * (1.0 - 0.192), rel=0.01)


@settings(max_examples=100, deadline=None)
@given(
    pixels=st.lists(st.tuples(st.sampled_from(ODD), VISIBILITIES, LIGHT), min_size=1, max_size=12),
    covered=st.sampled_from([1.0, 0.3]),
    probes=st.sampled_from([1, 2, 3, 100]),
    is_weighed=st.booleans(),
    channels=st.sampled_from([1, 3]),
    is_kept=st.booleans(),
)
def test_any_layer_that_multiplies_has_a_sound_error(pixels, covered, probes, is_weighed, channels, is_kept):
    field = field_of(*zip(*pixels, strict=True), covered)
    if channels == 3:
        field = replace(field, values=field.values * np.ones(3), truths=field.truths * np.ones(3), noise=0.1)
    kept = field.kept(3) if is_kept else None
    error = field.measured(probes, 0, is_weighed, kept)
    assert is_sound(error)
    assert error.value <= 1.0 + 1e-9
    assert (error.method is not None) == is_kept
    shown = np.nan_to_num(field.values, nan=0.0, posinf=0.0, neginf=0.0)[:, None]
    if channels == 1 and (shown == field.truths).all() and np.isin(field.truths, (0.0, 1.0)).all():
        assert error.value == 0.0


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_reference_without_numbers_is_refused(value):
    def broken(rays, outline, layer, layers, casters, view_rays, samples, seed):
        return np.full((1, len(view_rays), 1), value if samples else 1.0), np.ones((len(view_rays), 3))

    work = InUseScore(broken).measure(probed_of(np.full((3, 100), 0.5, np.float32)), 4, 0)
    with pytest.raises(ValueError, match="not finite"):
        finished(work)


def images(channels: int):
    """(height, width, channels) of ODD values, few of them, so that whole images of each come up."""

    def filled(shape_and_values):
        (height, width), values = shape_and_values
        return np.resize(np.array(values, np.float32), (height, width, channels))

    shapes = st.tuples(st.integers(1, 5), st.integers(1, 5))
    return st.tuples(shapes, st.lists(st.sampled_from(ODD), min_size=1, max_size=12)).map(filled)


@settings(max_examples=100, deadline=None)
@given(
    values=images(3),
    truth=st.sampled_from([0.0, 1.0, 1e-30, 1e6, -1.0]),
    noise=st.sampled_from([0.0, 0.1]),
    probes=st.sampled_from([1, 2, 100]),
)
def test_any_light_has_a_sound_error(values, truth, noise, probes):
    error = Light(values, np.full(values.shape, truth), noise=abs(noise * truth)).measured(probes, seed=1)
    assert is_sound(error)
    assert error.probes >= 1


@settings(max_examples=60, deadline=None)
@given(values=images(1), truth=st.sampled_from([0.0, 0.5, 1.0]), probes=st.sampled_from([1, 2, 100]))
def test_any_mask_has_a_sound_error(values, truth, probes):
    def reference(rays, outline, layer, view_rays, seed):
        return np.full((1, len(view_rays), 1), truth)

    error = finished(MaskScore(reference, "made up").measure(probed_of(values[..., 0]), probes, 0))
    assert is_sound(error)
    assert error.value <= 1.0 + 1e-9
    if not np.isfinite(values).any():  # shown black
        assert error.value == float(truth > 1.0 / 8.0)
