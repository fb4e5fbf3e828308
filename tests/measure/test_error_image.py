"""Images of errors: made-up ones that are known, and those of bakes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import OpenEXR
import pytest
from strata.addon.bake import BakeJob
from strata.addon.core.errors import Cancelled, StrataError
from strata.addon.core.naming import LONGEST, error_name
from strata.addon.core.shot import Camera, PixelFilter, Raster, Shot
from strata.addon.core.slices import finished
from strata.addon.core.view_rays import ViewRays
from strata.addon.layers.exr import write_layers
from strata.addon.layers.images import packed
from strata.addon.measure import error_image as module
from strata.addon.measure.error_image import AGREED, error_image
from strata.addon.measure.footprint import Probed
from strata.addon.measure.in_use import InUseScore
from strata.addon.measure.light import LightScore
from strata.addon.measure.mask import MaskScore
from strata.addon.planning import Options, plan_scene
from strata.tests.support.flat_scenes import DOWN, FLOOR, PLATE, lamp, scene_of
from strata.tests.support.settings import maps

SIZE = (40, 60)
FROM_ABOVE = Shot("Camera", Raster(Camera("Camera", (0.0, 0.0, 8.0), **DOWN), (64, 64)))
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def job_of(boxes=(FLOOR, PLATE), lights=None, **options) -> BakeJob:
    how = Options(backend="cpu", **{"samples": 1, "probes": 256, "error_images": True, **options})
    outline, arrays = scene_of(list(boxes), [lamp()] if lights is None else lights)
    return BakeJob(outline, plan_scene(outline, FROM_ABOVE, how), arrays, how)


def noisy(errors: np.ndarray, noise: np.ndarray):
    """Halves that err by `errors` (N, K) with that noise (N,) of a single view ray; and what was asked."""
    asked = []

    def halves(pixels, views, seed):
        asked.append((len(pixels), views))
        rng = np.random.default_rng(seed)
        drawn = rng.standard_normal((len(pixels), 2, errors.shape[1]))
        yield
        return errors[pixels, None] + drawn * (noise[pixels] / np.sqrt(views))[:, None, None]

    return halves, asked


def test_its_mean_square_without_the_noise_is_that_of_the_errors():
    rng = np.random.default_rng(1)
    errors = 0.05 * rng.standard_normal((SIZE[0] * SIZE[1], 1))
    noise = np.where(np.arange(len(errors)) % 3 == 0, 0.1, 0.0)
    halves, asked = noisy(errors, noise)
    told = []
    image = finished(error_image(halves, SIZE, (8, 24), 1, told.append))
    assert image.pixels.shape == SIZE
    assert image.pixels.dtype == np.float32
    assert sum(told) == errors.size
    # A single view ray errs by 0.1: 2 x 8 by .025, 2 x 32 by half of that.
    sure = (noise == 0.0).reshape(SIZE)
    np.testing.assert_allclose(image.pixels[sure], np.abs(errors).reshape(SIZE)[sure], atol=1e-7)
    within = np.sqrt((image.pixels.astype(float) ** 2).mean() - image.noise**2)
    assert within == pytest.approx(float(np.sqrt((errors**2).mean())), rel=0.02)
    again = sum(count for count, views in asked if views == 24)
    assert 0.7 < again / np.count_nonzero(noise) <= 1.0
    assert image.rays == (16, pytest.approx(16 + 48 * again / errors.size))
    assert image.noise == pytest.approx(float(np.sqrt((noise**2).mean() / 64)), rel=0.2)


def test_what_rays_agree_on_is_not_looked_at_again():
    halves, asked = noisy(np.full((SIZE[0] * SIZE[1], 3), 0.5), np.full(SIZE[0] * SIZE[1], 0.1 * AGREED))
    image = finished(error_image(halves, SIZE, (8, 24), 1, lambda pixels: None))
    assert {views for _, views in asked} == {8}
    assert max(count for count, _ in asked) <= module.PIXELS_AT_ONCE
    np.testing.assert_allclose(image.pixels, 0.5 * np.sqrt(3.0), rtol=0.01)


class Rays:
    """Tells of each view ray its pixel and where in it."""

    def look(self, pixels, jitter, samples=None):
        nothing = np.zeros((len(pixels), 3))
        return ViewRays(
            pixels, np.broadcast_to(jitter, (len(pixels), 2)), nothing, nothing, nothing, {}, None
        )


def probed_of(values: np.ndarray) -> Probed:
    outline = SimpleNamespace(working_space="Linear Rec.709", exposure=1.0, frame=1)
    shot = SimpleNamespace(pixel_filter=PixelFilter("BOX", 1.0))
    layer = SimpleNamespace(name="Layer", effect="made up")
    return Probed(layer, (), outline, shot, values, None, None, Rays(), np.zeros(0, np.uint8))


def image_of(score, values: np.ndarray) -> np.ndarray:
    return finished(score.error_image(probed_of(values), 1, lambda pixels: None)).pixels


def test_a_layer_that_multiplies_is_off_by_a_share_of_the_light_there():
    rng = np.random.default_rng(2)
    values, light = rng.random(SIZE).astype(np.float32), rng.random((*SIZE, 3)) * 4.0

    def truth(rays, outline, layer, layers, casters, view_rays, samples, seed):
        columns, rows = view_rays.pixels.T
        return np.full((1, len(rows), 1), 0.25), light[rows, columns]

    brightness = light @ LUMINANCE
    found = image_of(InUseScore(truth), values)
    expected = np.abs(values - 0.25) * brightness / (brightness + brightness.mean())
    # Of the mean brightness a part of the pixels is looked at.
    np.testing.assert_allclose(found, expected, rtol=0.03)


@pytest.mark.parametrize("mean", [0.5, 0.0])
def test_light_that_is_added_is_off_by_a_share_of_the_truth(mean):
    """`mean`: 0 where the layer holds nothing though there is light."""
    truth = np.random.default_rng(3).random((*SIZE, 3)) + 0.5
    values = np.float32(mean) * truth.astype(np.float32)

    def reference(rays, outline, layer, view_rays, seed):
        columns, rows = view_rays.pixels.T
        return truth[rows, columns][None]

    brightness = truth.mean(axis=2)
    wrong = np.sqrt(((values - truth) ** 2).mean(axis=2))
    expected = wrong / (brightness + brightness.mean())
    np.testing.assert_allclose(image_of(LightScore(reference), values), expected, rtol=0.02)


def test_a_mask_is_off_by_its_largest_difference():
    """Half of each pixel is covered."""

    def reference(rays, outline, layer, view_rays, seed):
        covered = (view_rays.jitter[:, :1] < 0.0).astype(float)
        return np.concatenate([covered, 0.0 * covered], axis=1)[None]

    values = np.zeros((*SIZE, 2), np.float32)
    values[..., 0], values[: SIZE[0] // 2, :, 1] = 0.25, 0.75
    found = image_of(MaskScore(reference), values)
    np.testing.assert_allclose(found[: SIZE[0] // 2], 0.75, atol=1e-6)
    np.testing.assert_allclose(found[SIZE[0] // 2 :], 0.25, atol=0.1)
    assert found[SIZE[0] // 2 :].mean() == pytest.approx(0.25, abs=0.005)


def test_a_bakes_image_is_that_of_its_figure():
    baked = job_of(probes=2048, values=maps(resolution=128)).result()
    (layer,), (image,), (told,) = baked.layers.layers, baked.layers.error_images, baked.report.layers
    assert image.name == told.error_image == "Soft Shadow Lamp Error"
    assert (image.channels, image.effect) == ("V", "")
    assert image.attributes["strata:error_of"] == layer.name
    # The floor fills the view, so that all pixels are lit.
    squares = float((image.pixels.astype(float) ** 2).mean())
    low, high = told.error.ci95
    assert told.error.value > 0.01
    # The image's own rays are few: what is left of their noise after it is taken off is about 1%.
    assert 0.98 * low < np.sqrt(squares - image.attributes["strata:noise"] ** 2) < 1.02 * high
    assert any(step.name == "error_image" and step.seconds > 0.0 for step in baked.report.steps)


@pytest.mark.parametrize("options", [{"error_images": False}, {"probes": 0}])
def test_without_being_asked_for_or_measured_there_is_none(options):
    baked = job_of(**options).result()
    assert baked.layers.error_images == ()
    assert "error_image" not in baked.report.layers[0].to_json()
    assert any("error images" in warning for warning in baked.report.warnings) == ("probes" in options)


def test_a_scene_without_lamps_has_none():
    assert job_of(lights=[]).result().layers.error_images == ()


def test_the_file_says_what_an_image_is(tmp_path):
    job = job_of()
    baked = job.result()
    write_layers(tmp_path / "x.exr", baked.layers)
    with OpenEXR.File(str(tmp_path / "x.exr"), separate_channels=True) as file:
        parts = {part.name(): part for part in file.parts}
        assert set(parts) == {"Layer.Soft Shadow Lamp", "Layer.Soft Shadow Lamp Error"}
        part = parts["Layer.Soft Shadow Lamp Error"]
        (name, channel), header = *part.channels.items(), dict(part.header)
        assert name == "Layer.Soft Shadow Lamp Error.V"
        np.testing.assert_array_equal(channel.pixels[::-1], baked.layers.error_images[0].pixels)
    assert header["strata:error_of"] == "Soft Shadow Lamp"
    assert header["strata:metric"] == "error in use, a share of the brightness"
    assert header["strata:fewest_rays"] == 16.0 <= header["strata:mean_rays"]
    assert header["strata:noise"] >= 0.0
    assert "strata:effect" not in header
    assert len(packed(baked.layers)) == 2
    (tmp_path / "file").touch()
    with pytest.raises(StrataError):
        write_layers(tmp_path / "file" / "x.exr", baked.layers)


def test_memory_counts_them():
    plain, more = job_of(error_images=False), job_of()
    plain.result(), more.result()
    assert more.memory.layers - plain.memory.layers == 4 * 64 * 64


def test_it_can_be_cancelled_in_the_middle(monkeypatch):
    job = job_of()
    seen = []
    monkeypatch.setattr(module, "PIXELS_AT_ONCE", 64)
    while not job.advance(0.0):
        images = job._measuring and job._measuring._images
        if images and 0.0 < images._done < images._ordinary:
            seen.append(images.seconds_left(1.0))
            if len(seen) == 3:
                job.cancel()
                break
    assert all(left > 0.0 for left in seen)
    with pytest.raises(Cancelled):
        job.advance()


def test_one_that_fails_costs_no_layer(monkeypatch):
    def broken(self, probed, seed, show):
        yield
        raise ValueError("no such thing")

    monkeypatch.setattr(InUseScore, "error_image", broken)
    baked = job_of().result()
    assert baked.layers.error_images == ()
    assert len(baked.layers.layers) == 1
    assert any("no such thing" in warning for warning in baked.report.warnings)


def test_names_are_short_and_nobodys():
    assert error_name("Soft Shadow Key", {"Soft Shadow Key"}) == "Soft Shadow Key Error"
    clash = error_name("Soft Shadow Key", {"Soft Shadow Key", "Soft Shadow Key Error"})
    assert clash not in ("Soft Shadow Key Error", "Soft Shadow Key")
    assert clash.endswith(" Error")
    longest = "Soft Shadow " + "ä" * 25
    assert len(error_name(longest, {longest}).encode()) <= LONGEST
    assert error_name(longest, {longest}) != error_name(longest[:-1] + "ö", {longest})
