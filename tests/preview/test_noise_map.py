"""The map of the noise: its figures, its colours, and what a viewport shows of it."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from strata.addon.preview import caption, noise_map
from strata.addon.preview.estimate import noise_shares, sampling_noise
from strata.addon.preview.viewport import Statistics
from strata.tests.preview.test_preview import BUDGET_MS, SIZE, brightness_share, two_lights


def samples_of(shape, samples: int, noise, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (1.0 + noise * rng.standard_normal((samples, *shape))).astype(np.float32)


@pytest.mark.parametrize("shape", [(90, 160), (90, 160, 4)])
def test_it_is_the_figure_of_the_caption_pixel_by_pixel(shape):
    drawn = samples_of(shape, 8, 0.2)
    of = drawn.mean(axis=0), (drawn**2).mean(axis=0), 8, 16
    shares = noise_shares(*of)
    assert shares.shape == shape[:2]
    assert np.sqrt((shares**2).mean()) == pytest.approx(sampling_noise(*of), rel=0.05)


def test_it_tells_where_the_noise_is():
    noise = np.zeros((60, 60))
    noise[:30] = 0.3
    drawn = samples_of((60, 60), 16, noise)
    shares = noise_shares(drawn.mean(axis=0), (drawn**2).mean(axis=0), 16, 1 << 20)
    assert float(np.median(shares[:29])) == pytest.approx(0.3 / 4.0, rel=0.1)
    # float32 squares of what is constant leave some 1e-4.
    assert float(shares[31:].max()) < noise_map.LOWEST


def test_what_is_darker_than_the_mean_is_a_share_of_that():
    mean = np.full((30, 30), 2.0, np.float32)
    mean[10:20] = 0.0
    shares = noise_shares(mean, mean**2 + np.float32(0.04), 4, 1 << 20)
    assert shares[15, 15] == pytest.approx(0.2 * np.sqrt(4 / 3) / 2.0 / mean.mean(), rel=1e-3)
    assert shares[2, 2] == pytest.approx(0.2 * np.sqrt(4 / 3) / 2.0 / 2.0, rel=1e-3)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, 3e38])
def test_odd_pictures_have_a_map_all_the_same(value):
    mean = np.full((5, 3), value, np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        found = noise_map.colours(noise_shares(mean, mean * mean, 2, 2))
    assert found.shape == (5, 3, 4)
    assert np.isfinite(found).all()


def test_colours_are_in_order_of_their_lightness():
    shares = np.geomspace(noise_map.LOWEST, noise_map.HIGHEST, 200)
    found = noise_map.colours(shares)
    linear = np.where(found <= 0.04045, found / 12.92, ((found + 0.055) / 1.055) ** 2.4)
    lightness = (linear[:, :3] @ [0.2126, 0.7152, 0.0722]) ** (1.0 / 3.0)
    steps = np.diff(lightness)
    assert (steps > 0.0).all()
    assert steps.max() < 3.0 * steps.mean()
    ends = noise_map.colours(np.array([0.0, noise_map.LOWEST, noise_map.HIGHEST, 50.0]))
    np.testing.assert_array_equal(ends[0], ends[1])
    np.testing.assert_array_equal(ends[2], ends[3])


def refined(samples: int, layer: str = ""):
    watched = two_lights("cpu", samples=samples)
    watched.layer = layer
    watched.draw()
    return watched


@pytest.mark.parametrize("layer", ["", "Soft Shadow Panel"])
def test_it_comes_with_the_second_sample_and_goes_with_an_edit(layer):
    watched = refined(4, layer)
    viewport = watched.viewport
    seen = []
    assert viewport.shown(True) is viewport.picture  # a moving frame has no spread
    while viewport.has_work:
        if viewport.advance(0.0, watched.session.version, BUDGET_MS):
            seen.append(viewport.statistics.samples)
            shown = viewport.shown(True)
            assert (shown is not viewport.picture) == viewport.statistics.has_spread == (seen[-1] > 1)
    assert seen[0] == 1 < seen[-1] == 4
    assert viewport.shown(False) is viewport.picture
    shown = viewport.shown(True)
    assert shown is viewport.shown(True)  # made once
    assert shown.pixels.shape == (SIZE[1], SIZE[0], 4)
    assert shown.place == viewport.picture.place
    assert not shown.is_colour
    assert len(np.unique(shown.pixels.reshape(-1, 4), axis=0)) > 20
    watched.edited(lambda: setattr(bpy.data.objects["Spot"].data, "energy", 50.0))
    assert viewport.shown(True) is viewport.picture


def test_it_marks_the_pixels_that_are_off():
    """Of the composite, against many more samples: the noisiest tenth holds most of the squares."""
    truth = refined(64)
    truth.settle()
    truth = truth.viewport.picture.pixels[..., :3].copy()
    watched = refined(8)
    watched.settle()
    film, *samples = watched.viewport._spread
    shares = noise_shares(film.image(), film.squares(), *samples)
    picture = watched.viewport.picture.pixels[..., :3]
    noisiest = shares > np.quantile(shares, 0.9)
    squares = ((picture - truth) ** 2).sum(axis=2)
    assert squares[noisiest].sum() > 0.6 * squares.sum()
    true = brightness_share(picture, truth)
    assert true / 2.0 < np.sqrt((shares**2).mean()) < 2.0 * true


def test_one_sample_has_no_map_and_the_caption_says_so():
    watched = refined(1)
    watched.settle()
    viewport = watched.viewport
    assert viewport.statistics.is_converged
    assert viewport.shown(True) is viewport.picture
    ((words, _colour),) = caption.legend(viewport.statistics)
    assert "2 samples" in words
    viewport.release()
    assert viewport.shown(True) is None


def test_the_legend_is_in_percent_and_in_the_maps_colours():
    found = caption.legend(Statistics(has_spread=True))
    words = "".join(text for text, _ in found)
    assert all(mark in words for mark in ("0.1%", "1%", "10%", "100%"))
    for mark, (_, colour) in zip(noise_map.MARKS, found[1::2], strict=True):
        np.testing.assert_allclose(colour, noise_map.colours(np.array(mark)))
    assert caption.legend(Statistics(message="nothing is in view")) == []
    ((words, _colour),) = caption.legend(Statistics(samples=4))  # ids, say
    assert "no mean" in words


def test_the_caption_writes_a_legend_where_the_map_is_on(monkeypatch):
    written = []
    blf = SimpleNamespace(
        SHADOW=0,
        draw=lambda font, text: written.append(text),
        dimensions=lambda font, text: (8.0 * len(text), 10.0),
        **dict.fromkeys(("size", "enable", "disable", "shadow", "color", "position"), lambda *given: None),
    )
    monkeypatch.setattr(caption, "blf", blf)
    monkeypatch.setattr(caption, "lines_above", lambda *given: 0.0)
    monkeypatch.setattr(caption, "free_corner", lambda *given: (0, 100))
    preview = SimpleNamespace(shows_noise=True)
    styles = [SimpleNamespace(widget=SimpleNamespace(points=11))]
    context = SimpleNamespace(
        preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0), ui_styles=styles, view=None),
        window_manager=SimpleNamespace(windows=[]),
        space_data=None,
        region_data=None,
        region=None,
        area=SimpleNamespace(regions=[]),
        scene=SimpleNamespace(render=SimpleNamespace(engine=""), strata=SimpleNamespace(preview=preview)),
    )
    caption.draw(Statistics(samples=4, of_samples=8, has_spread=True), context)
    assert any("100%" in text for text in written)
    written.clear()
    preview.shows_noise = False
    caption.draw(Statistics(samples=4, of_samples=8, has_spread=True), context)
    assert written == ["Strata: refining, 4 of 8 samples"]
