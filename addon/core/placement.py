"""Where in a pixel its samples lie: at places that all pixels share, or at each pixel's own."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from .pixel_filter import SUBPIXELS, TABLE_LENGTH, whole_quantiles
from .random import hash_bits, pcg, text_bits
from .shot import PixelFilter, Shot


class Placement(Enum):
    """`doc` says it in a few words."""

    SHARED = "shared", "All pixels alike: the least error"
    PER_PIXEL = "per_pixel", "Each pixel by itself: fine patterns become noise instead of coarser patterns"

    def __new__(cls, value: str, doc: str):
        made = object.__new__(cls)
        made._value_, made.doc = value, doc
        return made


@dataclass(frozen=True)
class Places:
    """Each pixel's own: the filter's density at the points of Sobol's (0, 2)-sequence, which a hash of `seed`
    (32 bits) and the pixel scrambles as Owen does, for each pixel and axis anew. Nothing else counts, so that
    all that is drawn of a pixel's sample meets at one place. The first 2^n samples of every pixel are strata
    of the filter, for every n, and those between nearly."""

    seed: int
    pixel_filter: PixelFilter

    @classmethod
    def of(cls, shot: Shot) -> Places:
        """Of the shot's own filter and seed."""
        return cls(int(hash_bits(shot.seed, text_bits("placement"))), shot.pixel_filter)

    @property
    def table(self) -> np.ndarray:
        """(TABLE_LENGTH,) int16: what equal shares of the filter lie about, in 1/SUBPIXELS of a pixel."""
        return whole_quantiles(self.pixel_filter)

    @property
    def reach(self) -> float:
        """How far from its pixel's centre a place may lie, along either axis, pixels."""
        return float(np.abs(self.table).max()) / SUBPIXELS

    def offsets(self, pixels: np.ndarray, sample: int) -> np.ndarray:
        """(N, 2) float64 from the centres of `pixels` (N, 2), columns and rows, in pixels: whole multiples of
        1/SUBPIXELS. Twin of `pixel_offsets` in kernels/src/raster/places.rs, to the last bit."""
        columns, rows = np.asarray(pixels, np.int64).T
        keys = pcg(pcg(self.seed ^ (columns & 0xFFFFFFFF)) ^ (rows & 0xFFFFFFFF))
        x, y = dimensions(sample)
        bits = [_scrambled(x, pcg(keys)), _scrambled(y, keys)]
        shares = np.stack([_reversed(each) for each in bits], axis=1) >> np.uint32(32 - _BITS)
        return self.table[shares] / SUBPIXELS


_BITS = TABLE_LENGTH.bit_length() - 1


def dimensions(number: int) -> tuple[int, int]:
    """Sobol's point of this number, 32 bits of each dimension, in reverse order."""
    direction, value = 1 << 31, 0
    for bit in range(32):
        value ^= direction * (number >> bit & 1)
        direction ^= direction >> 1
    return number, _reversed(value)


def _scrambled(reversed_bits: int, seeds: np.ndarray) -> np.ndarray:
    """Owen scrambling of bits in reverse order (Laine and Karras 2011, constants of Vegdahl 2021)."""
    x = np.full(seeds.shape, reversed_bits, np.uint32)
    x ^= x * np.uint32(0x3D20ADEA)
    x += seeds
    x *= (seeds >> np.uint32(16)) | np.uint32(1)
    x ^= x * np.uint32(0x05526C56)
    x ^= x * np.uint32(0x53A22864)
    return x


def _reversed(bits):
    """32 bits from the last to the first."""
    if isinstance(bits, int):
        return int(f"{bits:032b}"[::-1], 2)
    octets = np.ascontiguousarray(bits, "<u4").view(np.uint8)
    flipped = np.packbits(np.unpackbits(octets).reshape(-1, 32)[:, ::-1])
    return flipped.view("<u4").reshape(bits.shape)
