"""Jitters follow the pixel filter; tiles cover the image once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.core.sampling import (
    PIXELS_PER_TILE,
    Sampling,
    extended_jitters,
    filter_weight,
    jitters,
    passes_up_to,
)
from strata.addon.core.shot import PixelFilter

FILTERS = [PixelFilter("BOX", 0.5), PixelFilter("GAUSSIAN", 2.25), PixelFilter("BLACKMAN_HARRIS", 1.5)]


@pytest.mark.parametrize("pixel_filter", FILTERS)
def test_one_sample_is_the_centre(pixel_filter):
    assert np.abs(jitters(pixel_filter, 1)).max() < 1e-12


@pytest.mark.parametrize("pixel_filter", FILTERS)
def test_jitters_have_the_filters_moments(pixel_filter):
    # 4096 well-spread points know the variance to about 1 in 1000; centred to rounding of the strata.
    offsets = jitters(pixel_filter, 4096)
    x = np.linspace(-pixel_filter.radius, pixel_filter.radius, 200_001)
    weight = filter_weight(pixel_filter, x)
    variance = (weight * x * x).sum() / weight.sum()
    assert np.abs(offsets.mean(axis=0)).max() < 1e-3
    assert np.allclose(offsets.var(axis=0), variance, rtol=2e-3)
    assert np.abs(offsets).max() <= pixel_filter.radius


@pytest.mark.parametrize("samples", [2, 3, 5, 8, 16, 31, 100])
def test_jitters_are_centred_for_any_count(samples):
    offsets = jitters(PixelFilter("BOX", 0.5), samples)
    assert len({tuple(o) for o in offsets}) == samples
    assert np.abs(offsets.mean(axis=0)).max() < 1e-12
    for axis in (0, 1):  # a rook pattern: every row and column of strata holds one
        strata = np.floor((offsets[:, axis] + 0.5) * samples)
        assert sorted(strata) == list(range(samples))


@pytest.mark.parametrize(("samples", "most"), [(4, 0.15), (8, 0.03), (16, 0.0005)])
def test_edges_of_every_slope_are_met_evenly(samples, most):
    """The share of straight edges, at all places where the filter sees both sides, whose coverage is off by
    more than 1/8. A Hammersley set gets 22%, 5.8% and 0.13% wrong; free sets of 8, found by chance, 1.75%."""
    pixel_filter = PixelFilter()
    offsets = jitters(pixel_filter, samples)
    x = pixel_filter.radius * ((np.arange(300) + 0.5) / 150.0 - 1.0)
    weight = np.outer(filter_weight(pixel_filter, x), filter_weight(pixel_filter, x)).ravel()
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    places, errors = np.linspace(-2.2, 2.2, 600), []
    for angle in np.pi * np.arange(60) / 60:
        direction = np.array([np.cos(angle), np.sin(angle)])
        order = np.argsort(grid @ direction)
        beside = np.interp(places, (grid @ direction)[order], np.cumsum(weight[order]) / weight.sum())
        met = np.searchsorted(np.sort(offsets @ direction), places) / samples
        errors.append(np.abs(met - beside)[(beside > 1 / 128) & (beside < 1 - 1 / 128)])
    assert (np.concatenate(errors) > 1 / 8).mean() < most


@pytest.mark.parametrize("size", [(960, 540), (3840, 2160), (1, 1), (PIXELS_PER_TILE + 1, 2)])
def test_tiles_cover_every_row_once_a_sample(size):
    sampling = Sampling(*size, samples=2)
    chunks = list(sampling.chunks())
    assert len(chunks) == sampling.chunk_count
    for sample in (0, 1):
        rows = [range(c.y0, c.y1) for c in chunks if c.sample == sample]
        assert sorted(y for r in rows for y in r) == list(range(size[1]))


@pytest.mark.parametrize("pixel_filter", FILTERS)
def test_sets_that_grow_meet_edges_about_as_evenly_as_plain_ones(pixel_filter):
    """After every pass, root mean square over 64 directions and all places: 1.19 of the plain set at most,
    1.13 in the middle or less."""
    passes = passes_up_to(64)
    extended, ratios = extended_jitters(pixel_filter, passes), []
    for samples in passes:
        plain = edge_error(pixel_filter, jitters(pixel_filter, samples))
        ratios.append(edge_error(pixel_filter, extended[:samples]) / plain)
    assert ratios[0] == 1.0
    assert max(ratios) < 1.2
    assert np.median(ratios) < 1.15
    assert np.abs(extended).max() <= pixel_filter.radius


def edge_error(pixel_filter: PixelFilter, offsets: np.ndarray) -> float:
    """Root mean square difference of the coverage of straight edges, that the filter sees and the set."""
    x = pixel_filter.radius * ((np.arange(200) + 0.5) / 100.0 - 1.0)
    weight = np.outer(filter_weight(pixel_filter, x), filter_weight(pixel_filter, x)).ravel()
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    places, squares = np.linspace(-1.4, 1.4, 400) * pixel_filter.radius, []
    for angle in np.pi * np.arange(64) / 64:
        direction = np.array([np.cos(angle), np.sin(angle)])
        order = np.argsort(grid @ direction)
        beside = np.interp(places, (grid @ direction)[order], np.cumsum(weight[order]) / weight.sum())
        met = np.searchsorted(np.sort(offsets @ direction), places) / len(offsets)
        squares.append((met - beside) ** 2)
    return float(np.sqrt(np.mean(squares)))


def test_what_was_sampled_stays_when_more_are_wanted():
    """So that a bake may go on, and be made again from how many samples it took."""
    pixel_filter = PixelFilter()
    longer, shorter = (extended_jitters(pixel_filter, passes_up_to(most)) for most in (64, 24))
    assert np.array_equal(longer[:24], shorter)
    whole = Sampling(8, 8, 24, pixel_filter, passes=passes_up_to(64))
    parts = [replace(whole, samples=10), replace(whole, first=10)]
    assert [chunk for part in parts for chunk in part.chunks()] == list(whole.chunks())
    assert sum(part.chunk_count for part in parts) == whole.chunk_count


def test_offsets_of_passes_that_may_never_come_are_not_made(monkeypatch):
    made = []
    monkeypatch.setattr(
        "strata.addon.core.sampling.extended_jitters",
        lambda _, passes: made.append(passes) or jitters(PixelFilter(), passes[-1]),
    )
    chunks = Sampling(4, 4, 4096, passes=passes_up_to(4096)).chunks()
    assert [next(chunks).samples for _ in range(5)] == [4, 4, 4, 4, 5]
    assert set(made) == {(4,), (4, 5)}


def test_any_number_of_samples_is_spread():
    """More than there are places to begin from too."""
    offsets = extended_jitters(PixelFilter("BOX", 0.5), passes_up_to(4096)) + 0.5
    assert np.histogram2d(*offsets.T, bins=16, range=[(0, 1)] * 2)[0].min() >= 0.5 * 4096 / 256
