"""What a run has made so far: images, what nodes took, warnings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from .errors import StrataError
from .graph import Node, PlannedLayer
from .metrics import antialiasing_error


@dataclass
class Timing:
    """Time of one node on one device, summed over its runs."""

    node: Node
    device: str
    seconds: float = 0.0
    runs: int = 0


@dataclass
class Execution:
    """What came out. `images`: (height, width[, channels]) float32 by layer name, row 0 at the bottom.
    `antialiasing`: by an effect's layer, `antialiasing_error` (core/metrics.py) of its pixels. Until a layer
    is finished its image is the sum of its samples, and `squares` that of their squares; `samples` counts
    those that the whole image has (with a progressive sampling). Several runs may add to one."""

    images: dict[str, np.ndarray] = field(default_factory=dict)
    timings: dict[tuple[str, str], Timing] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    antialiasing: dict[str, float | None] = field(default_factory=dict)
    squares: dict[str, np.ndarray] = field(default_factory=dict)
    samples: int = 0

    def begin(self, layer: PlannedLayer, shape: tuple[int, ...], samples: int) -> None:
        """Makes room for a layer, unless it is a sum that has begun. `shape`: (height, width[, channels])."""
        if layer.name in self.images:
            return
        try:
            self.images[layer.name] = np.zeros(shape, np.float32)
            if samples > 1 and layer.effect:
                self.squares[layer.name] = np.zeros(shape, np.float32)
        except MemoryError as error:
            raise StrataError(f"not enough memory for layer '{layer.name}': {error}") from error

    def add(self, layer: PlannedLayer, rows: slice, tile: np.ndarray) -> None:
        """One sample of some rows."""
        self.images[layer.name][rows] += tile
        if layer.name in self.squares:
            with np.errstate(over="ignore"):  # squares of what is just finite; `finish` holds them
                self.squares[layer.name][rows] += tile * tile

    def finish(self, layer: PlannedLayer, samples: int) -> None:
        """All samples are there: sums become means. Squares are as large as the image; of them one number
        stays."""
        image, spread = self.images[layer.name], self.squares.pop(layer.name, None)
        if samples > 1:
            image /= np.float32(samples)
        if layer.effect:
            self.antialiasing[layer.name] = None
        if spread is not None:
            spread /= np.float32(samples)
            for mean, square in zip(image, spread, strict=True):  # row by row, which takes no memory
                with np.errstate(over="ignore", invalid="ignore"):
                    np.fmax(square - mean * mean, 0.0, out=square)
                np.fmin(square, np.finfo(np.float32).max, out=square)
            self.antialiasing[layer.name] = antialiasing_error(spread, samples)

    def add_time(self, node: Node, device: str, seconds: float, runs: int = 1) -> None:
        timing = self.timings.setdefault((node.key, device), Timing(node, device))
        timing.seconds += seconds
        timing.runs += runs

    def seconds(self, nodes: Iterable[Node], chunks: int = 0) -> float:
        """What these nodes took; with `chunks`, one pass of so many over nodes at the surface, which several
        runs repeat."""
        keys = {node.key for node in nodes}
        return sum(
            timing.seconds * (min(1.0, chunks / timing.runs) if chunks and timing.node.per_surface else 1.0)
            for timing in self.timings.values()
            if timing.node.key in keys
        )
