"""Which pixels a layer's error is measured at: a random choice from each stratum, drawn as tiles stream by.

Every pixel has a priority, the hash of (seed, effect, frame, pixel); a stratum keeps its smallest ones. That
is a simple random sample without replacement, the same however the image is tiled, and its smallest ones are
such a sample too.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ..core.device import RayCaster
from ..core.graph import PlannedLayer
from ..core.outline import Outline
from ..core.random import hash_bits, text_bits
from ..core.shot import Shot
from ..core.surface import Chunk
from .difficulty import CODES, KIND_BITS, MARGIN, Difficulty, Ground, silhouettes

ALL = np.uint32(0xFFFFFFFF)
BAND_PIXELS = 1 << 15


class Band:
    """Some rows of the first sample's surface, with what several layers want to know about them. `surface`:
    arrays (rows, width[, channels])."""

    def __init__(self, surface: dict[str, np.ndarray]):
        self.surface = surface

    @cached_property
    def ground(self) -> Ground:
        return Ground(self.surface)

    @cached_property
    def silhouettes(self) -> np.ndarray:
        return silhouettes(self.surface)


class Watched(Protocol):
    """A layer to draw probes of."""

    name: str
    effect: str

    @property
    def attributes(self) -> tuple[str, ...]:
        """Of the surface, kept with each probe."""

    def codes(self, band: Band, values: np.ndarray) -> np.ndarray:
        """(rows * width,) uint16: each pixel's stratum, its Difficulty in the lowest KIND_BITS; 0 is never
        looked at. `values` (rows, width[, channels]) of the layer. Must not depend on more than MARGIN rows
        and columns around a pixel."""

    def pixels_per_probe(self, difficulty: Difficulty) -> int:
        """Pixels of one stratum to keep for each probe that is asked for."""


@dataclass(frozen=True)
class ProbeStratum:
    """A random choice of the `population` pixels of one stratum. `pixels` (N,) uint32, row * width + column,
    ascending, so that rays of neighbours run together; their random `priorities` (N,) uint32; the layer's
    `values` (N[, channels]) float64 there and the `surface`, by attribute."""

    code: int
    population: int
    pixels: np.ndarray
    priorities: np.ndarray
    values: np.ndarray
    surface: dict[str, np.ndarray]

    @property
    def difficulty(self) -> Difficulty:
        return Difficulty(self.code & ((1 << KIND_BITS) - 1))


@dataclass(frozen=True)
class Probed:
    """What a Score makes a figure of. `strata` of the layer; `total`: the sum of its values over
    all pixels and channels; `image` (height, width[, channels]): the finished layer; `jitter` of the first
    sample, which `strata` are of, in pixels; `casters` (instances,) uint8: what can block its light."""

    layer: PlannedLayer
    outline: Outline
    shot: Shot
    strata: tuple[ProbeStratum, ...]
    total: float
    image: np.ndarray
    jitter: tuple[float, float]
    rays: RayCaster
    casters: np.ndarray


class _Smallest:
    """The `capacity` rows of smallest priority of all that are offered."""

    def __init__(self, capacity: int):
        self.capacity = capacity
        self.population = 0
        self.columns: list[np.ndarray] | None = None  # priority first
        self._bound = ALL

    def bound(self, offered: int) -> np.uint32:
        """Counts `offered` more rows; priorities above the result need not be looked at, most likely."""
        self.population += offered
        wanted = self.capacity + 6.0 * self.capacity**0.5 + 16.0
        if self.population > wanted:
            self._bound = min(self._bound, np.uint32(float(ALL) * wanted / self.population))
        return self._bound

    def enough(self, chosen: int) -> bool:
        """Whether `chosen` new rows, all those up to the bound, leave nothing out."""
        held = 0 if self.columns is None else int((self.columns[0] <= self._bound).sum())
        if held + chosen >= min(self.capacity, self.population):
            return True
        self._bound = ALL
        return False

    def add(self, columns: list[np.ndarray], index: np.ndarray) -> None:
        """Offers the rows `index` of `columns`."""
        index = index[self._least(columns[0].take(index))]
        chosen = [column.take(index, axis=0) for column in columns]
        if self.columns is not None:
            chosen = [np.concatenate(pair) for pair in zip(self.columns, chosen, strict=True)]
            order = self._least(chosen[0])
            chosen = [column[order] for column in chosen]
        if len(chosen[0]) == self.capacity:
            self._bound = min(self._bound, chosen[0].max())
        self.columns = chosen

    def _least(self, priorities: np.ndarray):
        """Index of the `capacity` smallest."""
        if len(priorities) <= self.capacity:
            return slice(None)
        return np.argpartition(priorities, self.capacity - 1)[: self.capacity]


class ProbeCollector:
    """Sees the first sample's tiles and keeps, for every watched layer, each stratum's probes.

    Memory: about 50 bytes for each pixel kept. `totals`: by layer, the sum of its values over all pixels and
    channels, float64.
    """

    def __init__(self, watched: Iterable[Watched], probes: int, seed: int, frame: int):
        self._watched = tuple(watched)
        self._seed, self._frame = seed, frame
        self._probes = probes
        self._smallest: dict[str, dict[int, _Smallest]] = {layer.name: {} for layer in self._watched}
        self._held: dict = {}  # rows whose neighbours have not come yet, and theirs
        self._seen_rows = self._drawn_rows = 0
        self.totals = {layer.name: 0.0 for layer in self._watched}

    def add(
        self, chunk: Chunk, surface: dict[str, np.ndarray], layers: dict[str, np.ndarray]
    ) -> Generator[None]:
        """`surface` and `layers`: host arrays (rows, width[, channels]). Tiles come bottom up; samples after
        the first are passed over. Yields between slices of work."""
        if chunk.sample != 0 or not self._watched:
            return
        names = {"position", "depth", "instance"}.union(*(layer.attributes for layer in self._watched))
        block = {name: array for name, array in surface.items() if name in names}
        block |= {("layer", layer.name): layers[layer.name] for layer in self._watched}
        if chunk.y0 != self._seen_rows:
            raise ValueError(f"the tile at row {chunk.y0} came before that at row {self._seen_rows}")
        first_row = chunk.y0
        if self._held:
            first_row -= len(next(iter(self._held.values())))
            block = {name: np.concatenate([self._held[name], block[name]]) for name in block}
        last = chunk.y1 == chunk.height
        stop = chunk.y1 if last else max(chunk.y1 - MARGIN, self._drawn_rows)
        yield from self._draw(block, first_row, slice(self._drawn_rows, stop))
        self._seen_rows, self._drawn_rows = chunk.y1, stop
        keep = max(stop - MARGIN - first_row, 0)
        self._held = {} if last else {name: array[keep:].copy() for name, array in block.items()}

    def _draw(self, block: dict, first_row: int, rows: slice) -> Generator[None]:
        """Offers the pixels of `rows` of the image; `block` starts at row `first_row`, with neighbours."""
        width = next(iter(block.values())).shape[1]
        inner = slice(rows.start - first_row, rows.stop - first_row)
        codes = yield from self._codes(block, inner)
        pixels = np.arange(rows.start * width, rows.stop * width, dtype=np.uint32)
        priorities: dict[str, np.ndarray] = {}
        for layer in self._watched:
            if layer.effect not in priorities:
                words = text_bits(layer.effect), self._frame & 0xFFFFFFFF, pixels
                priorities[layer.effect] = hash_bits(self._seed, *words)
            names = (("layer", layer.name), *layer.attributes)
            values, *surface = (_flat(block[name][inner]) for name in names)
            self.totals[layer.name] += float(finite(values).sum())
            self._offer(layer, codes[layer.name], [priorities[layer.effect], pixels, values, *surface])
            yield

    def _codes(self, block: dict, rows: slice) -> Generator[None, None, dict[str, np.ndarray]]:
        """Each layer's codes (pixels,) uint16 at `rows` of the block: a few rows at a time, since what stays
        in the cache is twice as fast."""
        height, width = next(iter(block.values())).shape[:2]
        count = (rows.stop - rows.start) * width
        codes = {layer.name: np.empty(count, np.uint16) for layer in self._watched}
        step = max(BAND_PIXELS // width, 1)
        for y0 in range(rows.start, rows.stop, step):
            y1 = min(y0 + step, rows.stop)
            near = slice(max(y0 - MARGIN, 0), min(y1 + MARGIN, height))
            band = Band({name: block[name][near] for name in block if isinstance(name, str)})
            inner = slice((y0 - near.start) * width, (y1 - near.start) * width)
            outer = slice((y0 - rows.start) * width, (y1 - rows.start) * width)
            for layer in self._watched:
                codes[layer.name][outer] = layer.codes(band, block["layer", layer.name][near])[inner]
            yield
        return codes

    def _offer(self, layer: Watched, code: np.ndarray, columns: list[np.ndarray]) -> None:
        smallest = self._smallest[layer.name]
        counts = np.bincount(code, minlength=CODES)
        bounds = np.zeros(CODES, np.uint32)
        present = np.flatnonzero(counts[1:]) + 1  # 0 is dark
        for each in present.tolist():
            if each not in smallest:
                smallest[each] = _Smallest(layer.pixels_per_probe(_kind(each)) * self._probes)
            bounds[each] = smallest[each].bound(int(counts[each]))
        # One pass over the priorities finds the candidates of all strata.
        chosen = np.flatnonzero((columns[0] <= bounds.take(code)) & (code != Difficulty.DARK))
        code_chosen = code.take(chosen)
        for each in present.tolist():
            index = chosen[code_chosen == each]
            if not smallest[each].enough(len(index)):
                index = np.flatnonzero(code == each)
            smallest[each].add(columns, index)

    def forget(self, name: str) -> None:
        """Frees what was kept for a layer."""
        self._smallest[name].clear()

    def strata(self, name: str) -> Iterator[ProbeStratum]:
        """What was kept for a layer, once all tiles were seen; none for dark pixels."""
        attributes = next(layer.attributes for layer in self._watched if layer.name == name)
        for code, smallest in sorted(self._smallest[name].items()):
            order = np.argsort(smallest.columns[1])
            priorities, pixels, values, *surface = (column[order] for column in smallest.columns)
            surface = dict(zip(attributes, surface, strict=True))
            yield ProbeStratum(code, smallest.population, pixels, priorities, finite(values), surface)


def _flat(image: np.ndarray) -> np.ndarray:
    """(rows * width[, channels])."""
    return image.reshape(-1, *image.shape[2:])


def finite(values: np.ndarray) -> np.ndarray:
    """float64. A viewer shows what is not finite as black, so that is what it counts as."""
    return np.nan_to_num(np.asarray(values, np.float64), nan=0.0, posinf=0.0, neginf=0.0)


def _kind(code: int) -> Difficulty:
    return Difficulty(code & ((1 << KIND_BITS) - 1))
