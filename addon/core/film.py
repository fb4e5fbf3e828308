"""Images while their samples come in: one accumulation for bakes and the preview."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .effect import Reduce
from .errors import StrataError
from .graph import Graph, Node, Rate
from .surface import Chunk


class Film:
    """One image of `shape` (height, width[, channels]) float32, row 0 at the bottom: the mean of its samples,
    or that of samples that weigh (`weights`: the shape of what they do, one channel or as many as the image).
    `has_squares`: it has the mean of their squares too. `samples`: each by itself (pixels, channels), at the
    ascending `kept_pixels`, numbered row by row. Raises StrataError where there is no memory for it.

    No pixel's weights may all be 0: what weighs has a floor (effects/shared/weights.py).
    """

    def __init__(
        self,
        name: str,
        shape: tuple[int, ...],
        reduce: Reduce = Reduce.MEAN,
        weights: tuple[int, ...] | None = None,
        has_squares: bool = False,
        kept_pixels: np.ndarray | None = None,
    ):
        self.reduce = reduce
        self._kept_pixels, self.samples = kept_pixels, []
        self._samples = np.zeros(shape[0], np.int32)  # of each row
        try:
            # Sums over the samples; a mean so far where they weigh, which keeps the bits of what is constant.
            self._total = np.zeros(shape, np.float32)
            self._squares = np.zeros(shape, np.float32) if has_squares else None
            self.weights = None if weights is None else np.zeros(weights, np.float32)
        except MemoryError as error:
            raise StrataError(f"not enough memory for layer '{name}': {error}") from error

    def add(self, chunk: Chunk, tile: np.ndarray, weight: np.ndarray | None = None) -> None:
        """A sample of a tile (rows, width[, channels]), and what it weighs where samples do. Of a sum's
        several terms each is added by itself, with the same sample; so is a sample in parts of its weight."""
        rows = slice(chunk.y0, chunk.y1)
        if self.reduce == Reduce.FIRST and chunk.sample:
            return
        self._samples[rows] = np.maximum(self._samples[rows], chunk.sample + 1)
        if self._kept_pixels is not None:
            self._keep(chunk, tile)
        share = None
        if self.weights is not None:
            self.weights[rows] += weight
            share = weight / self.weights[rows]
            share = share.reshape(*share.shape, *(1,) * (tile.ndim - share.ndim))
        _join(self._total[rows], tile, share)
        if self._squares is not None:
            with np.errstate(over="ignore", invalid="ignore"):  # squares of what is just finite
                _join(self._squares[rows], tile * tile, share)

    def _keep(self, chunk: Chunk, tile: np.ndarray) -> None:
        first, last = np.searchsorted(self._kept_pixels, (chunk.y0 * chunk.width, chunk.y1 * chunk.width))
        flat = tile.reshape(tile.shape[0] * tile.shape[1], -1)
        while len(self.samples) <= chunk.sample:
            self.samples.append(np.zeros((len(self._kept_pixels), flat.shape[1]), np.float32))
        inside = self._kept_pixels[first:last] - chunk.y0 * chunk.width
        self.samples[chunk.sample][first:last] = flat[inside]

    def image(self, rows: slice = slice(None)) -> np.ndarray:
        """What the samples so far make of some rows, as an array of its own."""
        return self._mean(self._total[rows], rows)

    def at(self, pixels: np.ndarray) -> np.ndarray:
        """(P, channels): the same of `pixels` (P,), numbered row by row."""
        flat = self._total.reshape(self._total.shape[0] * self._total.shape[1], -1)[pixels]
        if self.weights is not None:
            return flat
        return flat / np.maximum(self._samples[pixels // self._total.shape[1]], 1)[:, None]

    def squares(self) -> np.ndarray:
        """The mean of the samples' squares so far."""
        return self._mean(self._squares, slice(None))

    def finished(self) -> np.ndarray:
        """The image once all samples are there, made in place, as the mean of `weights` is: the film is used
        up."""
        samples = np.float32(self._samples.max(initial=1))
        if samples > 1:
            sums = self._total if self.weights is None else self.weights
            sums /= samples
        return self._total

    def join(self, image: np.ndarray, weights: np.ndarray | None) -> None:
        """Adds what another finished film holds to this one, once it is `finished`: another term of a sum, or
        another part of what samples weigh."""
        share = None
        if self.weights is not None:
            self.weights += weights
            share = weights / self.weights
            share = share.reshape(*share.shape, *(1,) * (image.ndim - share.ndim))
        _join(self._total, image, share)

    def _mean(self, sums: np.ndarray, rows: slice) -> np.ndarray:
        if self.weights is not None:
            return sums.copy()
        counts = self._samples[rows].reshape(-1, *(1,) * (sums.ndim - 1))
        return sums / np.maximum(counts, 1).astype(np.float32)


def _join(sums: np.ndarray, tile: np.ndarray, share: np.ndarray | None) -> None:
    """Adds to a sum, or to a mean of which the tile is that share."""
    sums += tile if share is None else share * (tile - sums)


@dataclass(frozen=True)
class Take:
    """What one film is made of: the values of `node`, and of `weight` where they weigh. `spread`: the
    film's channels, where the values are one number for all of them; 0: as many as they have."""

    name: str
    node: Node
    weight: Node | None = None
    reduce: Reduce = Reduce.MEAN
    has_squares: bool = False
    is_whole: bool = True
    spread: int = 0
    is_measured: bool = False


def takes_of(graph: Graph) -> tuple[Take, ...]:
    """Every film that the graph needs: of each layer that is made sample by sample, and of what only steps on
    finished images read. Those are called by their node's key."""
    takes = [
        Take(
            layer.name,
            layer.node,
            layer.weight,
            layer.kind.reduce,
            is_whole=layer.is_whole,
            spread=len(layer.channels) * layer.kind.is_spread,
            is_measured=layer.kind.score is not None,
        )
        for layer in graph.layers
        if layer.node.rate != Rate.PICTURE
    ]
    known = {take.node for take in takes if take.is_whole and not take.spread}
    for node in graph.nodes():
        if node.rate == Rate.PICTURE:
            for item in node.inputs:
                if item.rate == Rate.SAMPLE and item not in known:
                    known.add(item)
                    takes.append(Take(item.key, item))
    return tuple(takes)
