"""Integer hashes against arithmetic in Python's unbounded integers."""

import numpy as np
import pytest
from strata.addon.core.random import hash_bits, pcg, text_bits, unit

MASK = 0xFFFFFFFF


def slow_pcg(value):
    state = (value * 747796405 + 2891336453) & MASK
    word = (((state >> ((state >> 28) + 4)) ^ state) * 277803737) & MASK
    return (word >> 22) ^ word


@pytest.mark.parametrize(
    ("value", "bits"), [(0, 129708002), (1, 2831084092), (2, 2055130248), (MASK, 3861530882)]
)
def test_pcg_known_answers(value, bits):
    assert slow_pcg(value) == bits
    assert pcg(value) == bits


def test_pcg_of_arrays_is_the_same_and_leaves_its_input_alone():
    values = np.random.default_rng(0).integers(0, 1 << 32, 1000, dtype=np.uint32)
    before = values.copy()
    assert pcg(values).tolist() == [slow_pcg(int(value)) for value in values]
    assert (values == before).all()
    assert pcg(values).dtype == np.uint32


def test_hash_of_seed_and_values():
    def slow(seed, *values):
        state = slow_pcg((seed & MASK) ^ slow_pcg(seed >> 32))
        for value in values:
            state = slow_pcg(state ^ value)
        return state

    assert hash_bits(7, 3, 5) == slow(7, 3, 5)
    assert hash_bits(0x123456789ABCDEF0, 1) == slow(0x123456789ABCDEF0, 1)
    pixels = np.arange(100)
    assert hash_bits(1, 2, pixels).tolist() == [slow(1, 2, pixel) for pixel in range(100)]
    assert hash_bits(1, 2) != hash_bits(2, 1)


def test_hash_of_distinct_pixels_is_distinct_and_even():
    bits = hash_bits(5, 1, np.arange(1 << 20))
    assert len(np.unique(bits)) == len(bits)
    # 256 bins of 4096: chi-square has 255 degrees of freedom, sd 22.6; 5 sd.
    counts = np.bincount(bits >> 24, minlength=256)
    assert ((counts - 4096.0) ** 2 / 4096.0).sum() < 255 + 5 * 22.6
    # Neighbouring pixels are unrelated: the correlation's sd is 1 / 1024.
    x = bits.astype(np.float64)
    assert abs(np.corrcoef(x[1:], x[:-1])[0, 1]) < 5 / 1024


def test_unit_never_reaches_an_end():
    low, high = unit([0, MASK])
    assert low == np.float32(2.0**-24)
    assert high == np.float32(1.0 - 2.0**-24)
    assert unit(0).dtype == np.float32


def test_text_bits_tell_names_apart():
    assert text_bits("soft_shadow") != text_bits("soft_shadow2")
    assert 0 <= text_bits("é") <= MASK
