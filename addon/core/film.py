"""Images while their samples come in: one accumulation for bakes and the preview."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .effect import Reduce
from .errors import StrataError
from .graph import Graph, Node, Rate
from .surface import Chunk


class Film:
    """One image of `shape` (height, width[, channels]) float32, row 0 at the bottom. `has_spread`: it knows
    how much its samples differ, at the price of as much memory again. Raises StrataError where there is no
    memory for it."""

    def __init__(
        self, name: str, shape: tuple[int, ...], reduce: Reduce = Reduce.MEAN, has_spread: bool = False
    ):
        self.reduce = reduce
        self._samples = np.zeros(shape[0], np.int32)  # of each row
        self._weighed = self._weights = self.squares = None
        try:
            self.total = np.zeros(shape, np.float32)
            if has_spread:
                self.squares = np.zeros(shape, np.float32)
            if reduce == Reduce.WEIGHTED:
                self._weighed = np.zeros(shape, np.float32)
                self._weights = np.zeros((*shape[:2], *(1,) * (len(shape) - 2)), np.float32)
        except MemoryError as error:
            raise StrataError(f"not enough memory for layer '{name}': {error}") from error

    def add(self, chunk: Chunk, tile: np.ndarray, weight: np.ndarray | None = None) -> None:
        """A sample of a tile (rows, width[, channels]); `weight` (rows, width) where the film is WEIGHTED. Of
        a sum's several terms each is added by itself, with the same sample."""
        rows = slice(chunk.y0, chunk.y1)
        if self.reduce == Reduce.FIRST and chunk.sample:
            return
        self._samples[rows] = np.maximum(self._samples[rows], chunk.sample + 1)
        self.total[rows] += tile
        if self.squares is not None:
            with np.errstate(over="ignore"):  # squares of what is just finite; `spread` holds them
                self.squares[rows] += tile * tile
        if self._weights is not None:
            weight = weight.reshape(*weight.shape[:2], *(1,) * (tile.ndim - 2))
            self._weights[rows] += weight
            self._weighed[rows] += weight * tile

    def image(self, rows: slice = slice(None)) -> np.ndarray:
        """What the samples so far make of some rows, as an array of its own."""
        counts = self._samples[rows].reshape(-1, *(1,) * (self.total.ndim - 1))
        image = self.total[rows] / np.maximum(counts, 1).astype(np.float32)
        if self._weights is not None:
            self._weigh(image, self._weighed[rows], self._weights[rows])
        return image

    def finished(self) -> np.ndarray:
        """The image once all samples are there, made in place: the film is used up."""
        samples = int(self._samples.max(initial=1))
        if samples > 1:
            self.total /= np.float32(samples)
        if self._weights is not None:
            self._weigh(self.total, self._weighed, self._weights)
        return self.total

    def spread(self) -> np.ndarray | None:
        """Variance among the samples of each pixel, None if it is not known. Made in place, once, before the
        film is finished."""
        samples, spread, self.squares = np.float32(self._samples.max(initial=1)), self.squares, None
        if spread is None:
            return None
        spread /= samples
        for total, square in zip(self.total, spread, strict=True):  # row by row, which takes no memory
            with np.errstate(over="ignore", invalid="ignore"):
                mean = total / samples
                np.fmax(square - mean * mean, 0.0, out=square)
            np.fmin(square, np.finfo(np.float32).max, out=square)
        return spread

    @staticmethod
    def _weigh(image: np.ndarray, weighed: np.ndarray, weights: np.ndarray) -> None:
        """Replaces plain means where anything weighs."""
        np.divide(weighed, weights, out=image, where=np.broadcast_to(weights > 0.0, image.shape))


@dataclass(frozen=True)
class Take:
    """What one film is made of: the values of `node`, and of `weight` where the film is WEIGHTED."""

    name: str
    node: Node
    weight: Node | None = None
    reduce: Reduce = Reduce.MEAN
    has_spread: bool = False
    is_whole: bool = True


def takes_of(graph: Graph) -> tuple[Take, ...]:
    """Every film that the graph needs: of each layer that is made sample by sample, and of what only steps on
    finished images read. Those are called by their node's key."""
    takes = [
        Take(layer.name, layer.node, layer.weight, layer.kind.reduce, bool(layer.effect), layer.is_whole)
        for layer in graph.layers
        if layer.node.rate != Rate.PICTURE
    ]
    known = {take.node for take in takes if take.is_whole}
    for node in graph.nodes():
        if node.rate == Rate.PICTURE:
            for item in node.inputs:
                if item.rate == Rate.SAMPLE and item not in known:
                    known.add(item)
                    takes.append(Take(item.key, item))
    return tuple(takes)
