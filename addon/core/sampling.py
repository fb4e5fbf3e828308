"""Where an image is sampled: tiles of rows, and sub-pixel offsets drawn from the render's pixel filter."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import product

import numpy as np

from .pixel_filter import TABLE_LENGTH, distribution, filter_weight, quantiles
from .placement import Placement, Places
from .shot import PixelFilter
from .surface import Chunk

PIXELS_PER_TILE = 9 << 17  # bounds the memory that a surface takes; so many that an HD image has two tiles
# Whole groups of rows as kernels share them among threads.
TILE_ROWS = 48
MOST_SAMPLES = 4096  # that anybody may ask for

# Of more samples the plain set is as good, and moving them takes long.
MOST_RELAXED = 64
DIRECTIONS, GRID, ROUNDS, TURN = 64, 64, 100, 30.0
FIRST_PASSES = 4, 5, 6
EXTENDING_ROUNDS, PLACES = 200, 32
PLASTIC = 1.0 / 1.32471795724474602596 ** np.array([1.0, 2.0])
"""Steps of a sequence that is well spread wherever it begins: powers of the plastic number (Roberts' R2)."""


@cache
def jitters(pixel_filter: PixelFilter, samples: int) -> np.ndarray:
    """(samples, 2) float64 offsets in pixels whose density is the filter: every sample then weighs the same
    and no pixel reads its neighbours. One sample is the pixel's centre; several lie one in each of as many
    rows and columns of equal weight, so that upright and level edges are met evenly, and few of them so that
    edges of other slopes are too. Not to be written to."""
    index = np.arange(samples)
    radical, bit = np.zeros(samples), 0.5
    rest = index.copy()
    while rest.any():
        radical += bit * (rest & 1)
        rest >>= 1
        bit *= 0.5
    # A ranked Hammersley set, centred for any count.
    rank = np.argsort(np.argsort(radical))
    offsets = quantiles(pixel_filter, (np.stack([index, rank], axis=1) + 0.5) / samples)
    if 1 < samples <= MOST_RELAXED and pixel_filter.radius > 0.0:
        offsets = _relaxed(pixel_filter, offsets)
    offsets.flags.writeable = False
    return offsets


def _relaxed(pixel_filter: PixelFilter, offsets: np.ndarray) -> np.ndarray:
    """Moves them until their projections on every direction follow the filter's, so that an edge in that
    direction is met evenly wherever it lies (sliced optimal transport: Paulin et al., 2020), and back into
    the middles of rows and columns."""
    samples = len(offsets)
    # Turned first, or edges along the set's diagonal would still meet its points two by two.
    turn = math.radians(TURN)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    offsets = _transported(pixel_filter, offsets @ rotation.T, ROUNDS)
    ranks = np.argsort(np.argsort(offsets, axis=0), axis=0)
    return quantiles(pixel_filter, (ranks + 0.5) / samples)


def _transported(pixel_filter: PixelFilter, offsets: np.ndarray, rounds: int, held: int = 0) -> np.ndarray:
    """All but the first `held`, moved until the projections of all follow the filter's."""
    angles = np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    directions = np.stack([np.cos(angles), np.sin(angles)])
    grid = quantiles(pixel_filter, np.stack([(np.arange(GRID) + 0.5) / GRID] * 2, axis=1))
    filtered = np.stack(np.meshgrid(*grid.T), axis=-1).reshape(-1, 2)
    middles = ((np.arange(len(offsets)) + 0.5) / len(offsets) * len(filtered)).astype(int)
    wanted = np.sort(filtered @ directions, axis=0)[middles]
    for _ in range(rounds):
        projected = offsets @ directions
        step = np.empty_like(projected)
        np.put_along_axis(step, np.argsort(projected, axis=0, kind="stable"), wanted, axis=0)
        moves = (step - projected) @ directions.T / DIRECTIONS
        moves[:held] = 0.0
        offsets = offsets + moves
    return offsets


@cache
def passes_up_to(most: int, *others: int) -> tuple[int, ...]:
    """Samples that a pixel has after each pass of a bake that goes on until there are enough, the last
    `most`: four passes to a doubling, so that no bake takes many more than it needs, and `others` between."""
    passes = [*FIRST_PASSES, *(quarters << power for power in range(1, 16) for quarters in range(4, 8))]
    return tuple(sorted({each for each in (*passes, *others) if each < most} | {most}))


@cache
def extended_jitters(pixel_filter: PixelFilter, passes: tuple[int, ...]) -> np.ndarray:
    """(passes[-1], 2) as `jitters`: the first pass's set is that of as many, and each later pass adds to
    those before it, so that all are a set as good, or nearly, after every pass. What it adds begins where
    there is most room and is then moved as `_relaxed` does, while the others stay; of many it follows a
    sequence. Not to be written to."""
    if len(passes) == 1:
        return jitters(pixel_filter, passes[0])
    offsets, (held, count) = extended_jitters(pixel_filter, passes[:-1]), passes[-2:]
    if held >= MOST_RELAXED:
        added = quantiles(pixel_filter, (np.arange(held, count)[:, None] * PLASTIC + 0.5) % 1.0)
        offsets = np.concatenate([offsets, added])
    else:
        offsets = np.concatenate([offsets, quantiles(pixel_filter, _roomiest(pixel_filter, offsets, count))])
        if pixel_filter.radius > 0.0:
            offsets = _transported(pixel_filter, offsets, EXTENDING_ROUNDS, held)
            offsets = np.clip(offsets, -pixel_filter.radius, pixel_filter.radius)
    offsets.flags.writeable = False
    return offsets


def _roomiest(pixel_filter: PixelFilter, offsets: np.ndarray, count: int) -> np.ndarray:
    """Places that make the offsets so many, (count - offsets, 2), as shares of the filter."""
    shares, edges = distribution(pixel_filter) if pixel_filter.radius > 0.0 else (np.zeros(2), np.zeros(2))
    places = np.stack(np.meshgrid(*[(np.arange(PLACES) + 0.5) / PLACES] * 2), axis=-1).reshape(-1, 2)
    room = np.square(2.0 * np.minimum(places, 1.0 - places).min(axis=1))  # to the border
    taken = list(np.interp(offsets, edges, shares))
    for number in range(count):
        if number == len(taken):
            taken.append(places[np.argmax(room)])
        room = np.minimum(room, np.square(places - taken[number]).sum(axis=1))
    return np.array(taken[len(offsets) :])


def footprint_side(pixel_filter: PixelFilter, offset: tuple[float, float] | None, samples: int) -> float:
    """Side, in pixels, of the square that a sample of `jitters` stands for. One alone blurs as much as the
    filter does (the same variance); several have their share of the filter's weight each, so that those far
    out, where the filter is thin, stand for more. None: of any sample where each pixel has its own places."""
    if pixel_filter.radius == 0.0:
        return 0.0
    x = pixel_filter.radius * ((np.arange(TABLE_LENGTH) + 0.5) / (0.5 * TABLE_LENGTH) - 1.0)
    weight = filter_weight(pixel_filter, x)
    alone = math.sqrt(12.0 * float((weight * x * x).sum() / weight.sum()))
    total = weight.mean() * 2.0 * pixel_filter.radius
    if offset is None:
        density = ((weight * weight).mean() * 2.0 * pixel_filter.radius / total**2) ** 2
    elif samples == 1:
        return alone
    else:
        density = np.prod(filter_weight(pixel_filter, np.array(offset)) / total)
    return min(1.0 / math.sqrt(samples * max(float(density), 1e-12)), alone)


def footprints(pixel_filter: PixelFilter, pixels: int, samples: int, seed: int) -> np.ndarray:
    """(pixels, samples, 2) float64 random offsets in pixels whose density is the filter, for each pixel its
    own: one in each cell of a grid of rows x columns = samples."""
    rows = next(r for r in range(math.isqrt(samples), 0, -1) if samples % r == 0)
    columns = samples // rows
    generator = np.random.Generator(np.random.PCG64(seed))
    row, column = np.divmod(np.arange(samples), columns)
    cells = np.stack([column, row], axis=1) + generator.random((pixels, samples, 2))
    return quantiles(pixel_filter, cells / (columns, rows))


@dataclass(frozen=True)
class Sampling:
    """An image of `width` x `height` pixels, `samples` jittered surfaces a pixel. `tile_pixels` is about how
    many pixels a tile holds, PIXELS_PER_TILE if None. `is_progressive`: every sample of the whole image
    before the next one, so that a preview can show their mean; each pixel sums the same numbers in the same
    order either way. `passes`: how many samples there are after each of several passes (passes_up_to), of
    which these are those from `first` to `samples`; empty: all are one set, and it is known how many.
    `places`: each pixel's own, None: all share their jitters."""

    width: int
    height: int
    samples: int = 1
    pixel_filter: PixelFilter = field(default_factory=PixelFilter)
    tile_pixels: int | None = None
    is_progressive: bool = False
    first: int = 0
    passes: tuple[int, ...] = ()
    places: Places | None = None

    @property
    def placement(self) -> Placement:
        return Placement.SHARED if self.places is None else Placement.PER_PIXEL

    @property
    def jitters(self) -> np.ndarray:
        """(samples, 2), from the very first."""
        if not self.passes:
            return jitters(self.pixel_filter, self.samples)
        passes = self.passes[: bisect_left(self.passes, self.samples) + 1]
        return extended_jitters(self.pixel_filter, passes)[: self.samples]

    @property
    def tile_rows(self) -> int:
        rows = max(1, (self.tile_pixels or PIXELS_PER_TILE) // self.width)
        if rows >= self.height:
            return self.height
        return rows - rows % TILE_ROWS if rows > TILE_ROWS else rows

    def chunks(self) -> Iterator[Chunk]:
        """Tile by tile, and within a tile sample by sample; or the other way round (`is_progressive`)."""
        tiles = [(y0, min(y0 + self.tile_rows, self.height)) for y0 in range(0, self.height, self.tile_rows)]
        numbers = range(self.first, self.samples)
        order = product(numbers, tiles) if self.is_progressive else product(tiles, numbers)
        for pair in order:
            sample, (y0, y1) = pair if self.is_progressive else pair[::-1]
            of = self.passes[bisect_right(self.passes, sample)] if self.passes else self.samples
            jitter = 0.0, 0.0
            if self.places is None:
                dx, dy = replace(self, samples=of).jitters[sample]  # of no pass that may never come
                jitter = float(dx), float(dy)
            yield Chunk(self.width, self.height, y0, y1, sample, jitter, of, places=self.places)

    def offsets(self, pixels: np.ndarray) -> np.ndarray:
        """(samples, N, 2) from the centres of `pixels` (N, 2), columns and rows: where each has its
        samples."""
        if self.places is None:
            return np.broadcast_to(self.jitters[:, None], (self.samples, len(pixels), 2))
        return np.stack([self.places.offsets(pixels, sample) for sample in range(self.samples)])

    @property
    def chunk_count(self) -> int:
        return -(-self.height // self.tile_rows) * (self.samples - self.first)
