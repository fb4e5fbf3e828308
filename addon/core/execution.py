"""What a run has made so far: images, what nodes took, warnings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from .film import Film, Take
from .graph import Node, Rate
from .surface import Chunk


@dataclass
class Timing:
    """Time of one node on one device, summed over its runs."""

    node: Node
    device: str
    seconds: float = 0.0
    runs: int = 0


@dataclass
class Execution:
    """What came out. `images`: finished ones, (height, width[, channels]) float32 by layer name, row 0 at the
    bottom; `films`: those under way, by the name of what they take (core/film.py). `weights`: of finished
    layers that are weighed, the mean weight of each pixel's samples, (height, width[, channels]).
    `kept_pixels`: ascending numbers, row by row, of pixels of which measured layers keep every sample; None:
    of no pixel. `parts`: of layers that several graphs make, what those before made, with their weights,
    where each has its own number of samples. `samples_of`: those of finished layers, (samples, pixels,
    channels). `samples` counts those that the whole image has (with a progressive sampling). Several runs may
    add to one."""

    images: dict[str, np.ndarray] = field(default_factory=dict)
    films: dict[str, Film] = field(default_factory=dict)
    weights: dict[str, np.ndarray] = field(default_factory=dict)
    timings: dict[tuple[str, str], Timing] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    kept_pixels: np.ndarray | None = None
    samples_of: dict[str, np.ndarray] = field(default_factory=dict)
    samples: int = 0
    parts: dict[str, list[tuple[np.ndarray, np.ndarray | None]]] = field(default_factory=dict)

    def add(self, take: Take, chunk: Chunk, tile: np.ndarray, weight: np.ndarray | None) -> None:
        """One sample of a tile."""
        if take.spread:
            tile = np.broadcast_to(tile[..., None], (*tile.shape, take.spread))
        if take.name not in self.films:
            shape = (chunk.height, *tile.shape[1:])
            weights = None if weight is None else (chunk.height, *weight.shape[1:])
            kept = self.kept_pixels if take.is_measured else None
            self.films[take.name] = Film(take.name, shape, take.reduce, weights, take.has_squares, kept)
        self.films[take.name].add(chunk, tile, weight)

    def finish(self, take: Take) -> None:
        """All samples are there."""
        film = self.films.pop(take.name)
        self.images[take.name] = film.finished()
        for image, weights in self.parts.pop(take.name, ()):
            film.join(image, weights)
        if film.weights is not None:
            self.weights[take.name] = film.weights
        if film.samples:
            self.samples_of[take.name] = np.array(film.samples)

    def set_aside(self, take: Take) -> None:
        """A part of a layer has all its samples; the next has as many as it needs."""
        film = self.films.pop(take.name)
        self.parts.setdefault(take.name, []).append((film.finished(), film.weights))

    def image(self, name: str) -> np.ndarray:
        """A finished image, or what its samples so far make."""
        return self.films[name].image() if name in self.films else self.images[name]

    def weights_of(self, name: str) -> np.ndarray | None:
        """The mean of what its samples weigh, or their sum so far; None where they weigh nothing."""
        return self.films[name].weights if name in self.films else self.weights.get(name)

    def add_time(self, node: Node, device: str, seconds: float, runs: int = 1) -> None:
        timing = self.timings.setdefault((node.key, device), Timing(node, device))
        timing.seconds += seconds
        timing.runs += runs

    def seconds(self, nodes: Iterable[Node], chunks: int = 0) -> float:
        """What these nodes took; with `chunks`, one pass of so many over nodes at the surface, which several
        runs repeat."""
        keys = {node.key for node in nodes}
        return sum(
            timing.seconds
            * (min(1.0, chunks / max(timing.runs, 1)) if chunks and timing.node.rate == Rate.SAMPLE else 1.0)
            for timing in self.timings.values()
            if timing.node.key in keys
        )
