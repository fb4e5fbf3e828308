"""Random bits by integer hashing: the same on every device, for every tiling, on every run.

Twin of `pcg`, `hash` and `unit` in kernels/src/rays/pattern.rs.
"""

from __future__ import annotations

import hashlib

import numpy as np


def pcg(bits) -> np.ndarray:
    """One step of PCG-RXS-M-XS-32 (O'Neill 2014) as a hash (Jarzynski and Olano 2020): a bijection of uint32.

    `bits`: integers of any shape, taken modulo 2^32.
    """
    bits = np.asarray(bits)
    state = bits.astype(np.uint32).reshape(-1)  # arrays wrap around in silence, numpy's scalars warn
    state *= np.uint32(747796405)
    state += np.uint32(2891336453)
    word = state >> np.uint32(28)
    word += np.uint32(4)
    np.right_shift(state, word, out=word)
    word ^= state
    word *= np.uint32(277803737)
    np.right_shift(word, np.uint32(22), out=state)
    word ^= state
    return word.reshape(bits.shape)


def hash_bits(seed: int, *values) -> np.ndarray:
    """uint32 of a 64-bit `seed` and of `values`, integers or integer arrays that broadcast together.

    Equal everything but the last value gives distinct bits for distinct last values.
    """
    state = pcg((seed & 0xFFFFFFFF) ^ int(pcg((seed >> 32) & 0xFFFFFFFF)))
    for value in values:
        state = pcg(state ^ np.asarray(value).astype(np.uint32))
    return state


def unit(bits) -> np.ndarray:
    """float32 in (0, 1), never an end, from the upper 23 bits."""
    return ((np.asarray(bits, np.uint32) >> np.uint32(9)).astype(np.float32) + np.float32(0.5)) * np.float32(
        2.0**-23
    )


def text_bits(text: str) -> int:
    """A name as 32 bits, to be hashed with numbers."""
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest(), "little")
