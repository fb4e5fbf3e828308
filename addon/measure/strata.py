"""Which pixels of a finished layer are looked at: sorted into strata by what the layer itself tells, and of
each a random choice.

Every pixel has a priority, the hash of (seed, effect, frame, pixel); the first pixels of a stratum by
priority are a simple random sample without replacement, the same on both devices and for every size of tiles.
A bad guess costs probes, never correctness.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from ..core.metrics import mean_brightness

SNAP = 1e-6  # values closer to 0 or 1 than this are 0 or 1
NEARBY = 2  # pixels, in rows and columns
JUMP = 1.2  # neighbours that differ by more than this factor are an edge
NOTHING = 1e-20
"""Weights up to this share of the largest are of nothing: floors are 1e-30 (effects/shared/weights.py)."""

SHARES = (0.05, 0.2, 0.5)
"""Of u / (u + mean u), where a stratum of brightness ends: what an error there counts for."""

DIM = 1.0 / 64.0
"""Of the mean: what is darker is all alike."""

MEAN_PIXELS = 1 << 17

KIND_BITS = 3  # of a code, the Difficulty; the bits above are the brightness
CODES = 1 << (KIND_BITS + 7)


class Difficulty(IntEnum):
    """EMPTY: the layer's samples found nothing that it multiplies, FRINGE: but those of a pixel nearby did.
    BETWEEN: neither 0 nor 1. EDGE: near a change of the layer or of what it multiplies. REST: others."""

    EMPTY = 0
    BETWEEN = 1
    EDGE = 2
    REST = 3
    FRINGE = 4


@dataclass(frozen=True)
class Stratum:
    """The pixels of one code. `members` (N,) uint32: row * width + column, ascending; `priority(members)`:
    their random numbers."""

    code: int
    members: np.ndarray
    priority: Callable[[np.ndarray], np.ndarray]

    @property
    def population(self) -> int:
        return len(self.members)

    @property
    def difficulty(self) -> Difficulty:
        return Difficulty(self.code & ((1 << KIND_BITS) - 1))

    @property
    def is_empty(self) -> bool:
        """Whether no sample of its pixels found anything that the layer multiplies."""
        return self.difficulty in (Difficulty.EMPTY, Difficulty.FRINGE)

    def chosen(self, count: int) -> np.ndarray:
        """`count` pixels, or all, in random order: fewer are the first of more."""
        priorities = self.priority(self.members)
        if count < self.population:
            first = np.argpartition(priorities, count)[:count]
            return self.members[first[np.argsort(priorities[first])]]
        return self.members[np.argsort(priorities)]


def strata_of(codes: np.ndarray, priority: Callable[[np.ndarray], np.ndarray]) -> Iterator[Stratum]:
    """Of `codes` (pixels,) uint16, in their order."""
    for code in np.flatnonzero(np.bincount(codes, minlength=CODES)).tolist():
        yield Stratum(code, np.flatnonzero(codes == code).astype(np.uint32), priority)


def scaling_codes(image: np.ndarray, weights: np.ndarray | None, is_binary: bool) -> np.ndarray:
    """(pixels,) uint16 of a layer (height, width[, channels]) that multiplies; `weights` alike: the mean of
    what it multiplies, None where that is not known. `is_binary`: a sample is 0 or 1, so that pixels of
    0 and 1 are told from others."""
    planes = image.reshape(*image.shape[:2], -1)
    low, high = (planes > SNAP).any(axis=2), (planes < 1.0 - SNAP).any(axis=2)
    side = low.view(np.uint8) - high.view(np.uint8)  # -1, 0 and 1 modulo 256: dark, between and lit
    edges = near_changes(*(a != b for a, b in _neighbours(side)))
    brightness = np.zeros(image.shape[:2], np.uint16)
    empty = np.zeros(image.shape[:2], bool)
    if weights is not None:
        light = weights.reshape(*image.shape[:2], -1).mean(axis=2)
        empty = light <= NOTHING * light.max(initial=0.0)
        edges |= near_jumps(light)
        mean = mean_weight(light) or 1.0
        for share in SHARES:  # u / (u + mean) >= share, without a division's images
            brightness += light >= np.float32(share / (1.0 - share) * mean)
    else:
        edges |= near_jumps(planes.mean(axis=2))
    code = brightness << KIND_BITS
    kind = np.where(edges, np.uint16(Difficulty.EDGE), np.uint16(Difficulty.REST))
    kind[(low & high) if is_binary else slice(None)] = Difficulty.BETWEEN
    code |= kind
    code[empty] = np.where(nearby(~empty)[empty], np.uint16(Difficulty.FRINGE), np.uint16(Difficulty.EMPTY))
    return code.reshape(-1)


def mean_weight(weights: np.ndarray) -> float:
    """Mean brightness of what a layer multiplies, where there is anything: what a share of the brightness is
    of. Of many pixels some tell."""
    some = weights.reshape(-1)[:: max(weights.size // MEAN_PIXELS, 1)]
    return mean_brightness(some[some > NOTHING * weights.max(initial=0.0)])


def image_codes(image: np.ndarray) -> np.ndarray:
    """(pixels,) uint16 of a layer (height, width[, channels]) of light, or of a mask: how bright it is within
    two pixels, in steps of a factor of 4, and whether it changes there."""
    planes = image.reshape(*image.shape[:2], -1)
    sizes = np.abs(np.where(np.isfinite(planes), planes, np.float32(0.0)))
    edges = np.zeros(image.shape[:2], bool)
    for channel in range(sizes.shape[2]):
        edges |= near_jumps(sizes[..., channel])
    # What is dark beside a bright pixel may be wrong by as much as that one.
    brightest = largest_nearby(sizes.max(axis=2))
    np.maximum(brightest, DIM * brightest.mean(dtype=np.float64), out=brightest)
    # The upper seven bits of a positive float are its exponent, halved: factors of 4.
    code = (brightest.view(np.uint32) >> np.uint32(24)).astype(np.uint16)
    code <<= KIND_BITS
    code |= np.where(edges, np.uint16(Difficulty.EDGE), np.uint16(Difficulty.REST))
    return code.reshape(-1)


def near_jumps(image: np.ndarray) -> np.ndarray:
    """(rows, width) bool: within two pixels of neighbours of which one is more than JUMP times the other."""
    return near_changes(*(_jump(*pair) for pair in _neighbours(image)))


def nearby(mask: np.ndarray) -> np.ndarray:
    """(rows, width) bool: pixels of a mask, and those within two pixels of its borders."""
    return mask | near_changes(*(a != b for a, b in _neighbours(mask)))


def largest_nearby(image: np.ndarray, steps: int = NEARBY) -> np.ndarray:
    """(rows, width): the largest value of all pixels up to so many to each side; of five by five."""
    for _ in range(steps):
        wider = image.copy()
        np.maximum(wider[:, 1:], image[:, :-1], out=wider[:, 1:])
        np.maximum(wider[:, :-1], image[:, 1:], out=wider[:, :-1])
        image = wider.copy()
        np.maximum(image[1:], wider[:-1], out=image[1:])
        np.maximum(image[:-1], wider[1:], out=image[:-1])
    return image


def _neighbours(image: np.ndarray):
    return (image[:, :-1], image[:, 1:]), (image[:-1], image[1:])


def _jump(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):
        return (a > JUMP * b) | (b > JUMP * a)


def near_changes(change_x: np.ndarray, change_y: np.ndarray) -> np.ndarray:
    """(rows, width) bool: within two pixels across a change between horizontal (rows, width - 1) or vertical
    (rows - 1, width) neighbours."""
    marked = np.zeros((len(change_x), change_y.shape[1]), bool)
    for _ in range(NEARBY):
        wider = marked.copy()
        wider[:, 1:] |= change_x
        wider[:, :-1] |= change_x
        wider[1:] |= change_y
        wider[:-1] |= change_y
        change_x = wider[:, 1:] | wider[:, :-1]
        change_y = wider[1:] | wider[:-1]
        marked = wider
    return marked


def finite(values: np.ndarray) -> np.ndarray:
    """float64. A viewer shows what is not finite as black, so that is what it counts as."""
    return np.nan_to_num(np.asarray(values, np.float64), nan=0.0, posinf=0.0, neginf=0.0)
