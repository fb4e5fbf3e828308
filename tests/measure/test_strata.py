"""How pixels are sorted and chosen, against brute force."""

import tracemalloc

import numpy as np
import pytest
from strata.addon.core.random import hash_bits
from strata.addon.measure.strata import (
    KIND_BITS,
    Difficulty,
    image_codes,
    largest_nearby,
    near_changes,
    scaling_codes,
    strata_of,
)

WIDTH, HEIGHT = 61, 47


def layer():
    """A round shadow with a soft edge, and what it multiplies: dark on the right, nothing on the left."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    weights = np.where(x > 50, 0.01, 1.0).astype(np.float32)
    weights[:, :3] = 1e-30
    return np.clip((np.hypot(x - 30, y - 20) - 8.0) / 6.0, 0.0, 1.0), weights


def priority(pixels):
    return hash_bits(3, pixels)


@pytest.mark.parametrize("count", [1, 7, 10**6])
def test_every_stratum_chooses_its_smallest_priorities(count):
    codes = scaling_codes(*layer(), is_binary=True)
    strata = list(strata_of(codes, priority))
    assert [each.code for each in strata] == np.unique(codes).tolist()
    assert {each.difficulty for each in strata} == set(Difficulty)
    for each in strata:
        members = np.flatnonzero(codes == each.code)
        assert each.members.tolist() == members.tolist()
        expected = members[np.argsort(priority(members))][:count]
        assert each.chosen(count).tolist() == expected.tolist()


def test_kinds_and_brightness_of_a_layer_that_multiplies():
    values, weights = layer()
    codes = scaling_codes(values, weights, is_binary=True).reshape(HEIGHT, WIDTH)
    kind, brightness = codes & ((1 << KIND_BITS) - 1), codes >> KIND_BITS
    partly = (values > 0) & (values < 1)
    assert (kind[:, 0] == Difficulty.EMPTY).all()
    assert (kind[:, 1:3] == Difficulty.FRINGE).all()
    assert (kind[:, 3:] < Difficulty.FRINGE).all()
    assert ((kind == Difficulty.BETWEEN) == (partly & (weights > 1e-20))).all()
    assert kind[20, 30] == kind[2, 10] == Difficulty.REST
    assert kind[20, 30 + 15] == kind[20, 30 + 7] == Difficulty.EDGE  # just beyond the ends of the penumbra
    assert (kind[:, 49:53][~partly[:, 49:53]] == Difficulty.EDGE).all()  # of the light
    assert (brightness[:, 5:50] == 3).all()  # above the mean: over half of light + mean
    assert (brightness[:, 51:] == 0).all()
    exact = scaling_codes(values, weights, is_binary=False).reshape(HEIGHT, WIDTH)
    assert (exact[:, 3:] & 7 == Difficulty.BETWEEN).all()
    unknown = scaling_codes(values, None, is_binary=True)
    assert (unknown >> KIND_BITS == 0).all()
    assert Difficulty.EMPTY not in unknown
    colour = scaling_codes(np.stack([values] * 3, axis=2), np.stack([weights] * 3, axis=2), is_binary=True)
    assert (colour == codes.reshape(-1)).all()


def test_brightness_and_edges_of_an_image():
    image = np.full((9, 40), 1.0, np.float32)
    image[:, 20:] = 16.0
    image[4, 35] = np.nan  # shown black
    codes = image_codes(image).reshape(9, 40)
    step = codes >> KIND_BITS
    assert (step[:, :18] == step[0, 0]).all()
    assert (step[:, 18:] == step[0, 0] + 2).all()  # two factors of 4, and two pixels around
    is_edge = codes & 7 == Difficulty.EDGE
    assert is_edge[:, 18:22].all()
    assert is_edge[4, 34:37].all()
    assert not is_edge[:, :17].any()


def test_the_largest_nearby_against_brute_force():
    image = np.random.default_rng(1).random((9, 12)).astype(np.float32)
    padded = np.pad(image, 2, constant_values=-1.0)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (5, 5))
    assert (largest_nearby(image) == windows.max(axis=(2, 3))).all()


def test_near_changes_against_brute_force():
    rng = np.random.default_rng(0)
    change_x, change_y = rng.random((9, 11)) < 0.03, rng.random((8, 12)) < 0.03
    near = near_changes(change_x, change_y)
    assert near.shape == (9, 12)
    beside = {(y, x + side) for y, x in zip(*np.nonzero(change_x), strict=True) for side in (0, 1)}
    beside |= {(y + side, x) for y, x in zip(*np.nonzero(change_y), strict=True) for side in (0, 1)}
    for y, x in np.ndindex(near.shape):
        expected = any(abs(y - b) + abs(x - a) <= 1 for b, a in beside)
        widened = any(max(abs(y - b), abs(x - a)) <= 2 for b, a in beside)
        assert widened >= near[y, x] >= expected


def test_one_pixel_beside_a_lamp_does_not_make_all_others_dark():
    values, weights = layer()
    expected = scaling_codes(values, weights, is_binary=True)
    weights[20, 30] = 1e6
    changed = scaling_codes(values, weights, is_binary=True) != expected
    assert np.flatnonzero(changed.reshape(HEIGHT, WIDTH)[:, 40:]).size == 0


def test_kinds_of_a_layer_do_not_take_much_memory():
    """Bytes a pixel at once, beside the layer and what it multiplies: of float32 and booleans."""
    values, weights = (np.tile(each, (10, 10)) for each in layer())
    tracemalloc.start()
    list(strata_of(scaling_codes(values, weights, is_binary=True), priority))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak <= 24 * values.size
