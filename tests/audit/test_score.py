"""What an audit makes of images, and which pixels it asks for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.audit.grid import grid_of
from strata.addon.audit.score import audit_of, of_added, of_multiplied
from strata.addon.core.shot import Camera, PixelFilter, Raster

GREY = (0.2126, 0.7152, 0.0722)
CAMERA = Camera("Camera", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
RASTERS = {
    "wide": Raster(CAMERA, (480, 270)),
    "high, pixels that are not square": Raster(CAMERA, (97, 301), (1.0, 1.5)),
    "shifted": Raster(replace(CAMERA, shift_x=0.2, shift_y=-0.4, sensor_fit="VERTICAL"), (640, 480)),
    "orthographic, a region": Raster(
        replace(CAMERA, orthographic=True), (320, 200), region=(17, 5, 230, 191)
    ),
    "smaller than what is asked for": Raster(CAMERA, (20, 10)),
}


@pytest.mark.parametrize("raster", RASTERS.values(), ids=RASTERS)
@pytest.mark.parametrize("pixels", [1, 50, 1000])
def test_each_pixel_of_the_picture_lies_on_one_of_the_image(raster, pixels):
    grid = grid_of(raster.computed_size, pixels)
    window = grid.window(raster)
    whole = raster.view.window
    for axis, part in enumerate(grid.slices[::-1]):
        low, high = window[2 * axis : 2 * axis + 2]
        found = low + (np.arange(grid.count[axis]) + 0.5) * (high - low) / grid.count[axis]
        left, right = whole[2 * axis : 2 * axis + 2]
        size = raster.computed_size[axis]
        expected = left + (np.arange(size)[part] + 0.5) * (right - left) / size
        assert found == pytest.approx(expected, abs=1e-12)
    # Blender makes the height of the width.
    share = (window[3] - window[2]) / (window[1] - window[0])
    across, up = raster.pixel_aspect
    assert share == pytest.approx(grid.count[1] * up / (grid.count[0] * across))
    assert grid.filter_width(PixelFilter("GAUSSIAN", 1.5)) == pytest.approx(1.0 / grid.step)


def halves(rng, truth, noise):
    return truth + noise * rng.standard_normal((2, *truth.shape))


def test_what_is_left_is_the_error_and_not_the_noise():
    rng = np.random.default_rng(3)
    layer = rng.random((40, 50))
    bare = np.ones((40, 50, 3))
    wrong = 0.02 * rng.standard_normal((40, 50))
    shadowed = bare * (layer - wrong)[..., None]
    noisy = halves(rng, shadowed, 0.1)
    found = audit_of(of_multiplied(layer, np.stack([bare, bare]), noisy, GREY), 256, 1.0)
    # A share of the brightness there and of the mean, which are both 1.
    assert found.value == pytest.approx(0.01, abs=2e-3)
    assert found.ci95[0] <= 0.01 <= found.ci95[1]
    assert found.noise == pytest.approx(0.1 * np.linalg.norm(GREY) / 2 / np.sqrt(2), rel=0.1)
    assert found.pixels == 2000


def test_an_interval_holds_what_few_pixels_are_off_by():
    """1 in 500 pixels is off by half: of 2000 that are looked at about four are, sometimes one, or none."""
    rng = np.random.default_rng(4)
    held = seen = 0
    for _ in range(200):
        errors = np.where(rng.random(2000) < 0.002, 0.5, 0.0) + 1e-3 * rng.standard_normal((2, 2000))
        seen += np.abs(errors).max() > 0.4
        low, high = audit_of(errors, 256, 1.0).ci95
        held += low <= 0.5 * np.sqrt(0.002) <= high
    assert held >= 0.9 * seen
    assert seen > 190


def test_a_layer_of_three_channels_is_compared_channel_by_channel():
    layer = np.broadcast_to((1.0, 0.5, 0.25), (4, 4, 3))
    bare = np.ones((2, 4, 4, 3))
    assert audit_of(of_multiplied(layer, bare, bare * layer, GREY), 1, 0.0).value == 0.0
    assert audit_of(of_multiplied(layer[..., 0], bare, bare * layer, GREY), 1, 0.0).value > 0.1


def test_light_is_compared_with_light():
    truth = np.random.default_rng(5).random((2, 8, 8, 3))
    truth[1] = truth[0]
    assert audit_of(of_added(truth[0], truth), 1, 0.0).value == 0.0
    assert audit_of(of_added(1.1 * truth[0], truth), 1, 0.0).value == pytest.approx(0.05, rel=0.2)


def test_where_nothing_is_lit_there_is_nothing_to_say():
    dark = np.zeros((2, 4, 4, 3))
    assert of_multiplied(np.ones((4, 4)), dark, dark, GREY) is None
    assert of_added(dark[0], dark) is None
