"""Which pixels of a lamp's visibility are measured: told apart by how likely they are to be wrong."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..core.emitter import Emitter
from ..core.surface import SurfacePoints
from .difficulty import Difficulty, classify
from .probes import Band, ProbeStratum

POINT_ATTRIBUTES = ("position", "geometric_normal", "shading_normal")

# Pixels of one stratum of a shadow that are kept for each probe asked for.
PIXELS_PER_PROBE = {
    Difficulty.PENUMBRA: 12,
    Difficulty.EDGE: 16,
    Difficulty.TERMINATOR: 16,
    Difficulty.REST: 64,
}


@dataclass(frozen=True)
class WatchedShadow:
    """A visibility layer of one light. `eye` (3,) float64: what surfaces are relative to; `receivers`:
    instances that the light lights, None for all."""

    name: str
    effect: str
    emitter: Emitter
    eye: np.ndarray
    receivers: frozenset[int] | None = None

    @property
    def attributes(self) -> tuple[str, ...]:
        return POINT_ATTRIBUTES

    def codes(self, band: Band, values: np.ndarray) -> np.ndarray:
        codes = classify(band.ground, values, self.emitter, self.eye)
        if self.receivers is not None:
            lit = np.isin(band.surface["instance"].reshape(-1), sorted(self.receivers))
            codes[~lit] = Difficulty.DARK
        return codes

    def pixels_per_probe(self, difficulty: Difficulty) -> int:
        return PIXELS_PER_PROBE[difficulty]


@dataclass(frozen=True)
class Stratum:
    """A shadow's `ProbeStratum` pixels of one difficulty that get about as much light."""

    difficulty: Difficulty
    population: int
    pixels: np.ndarray
    priorities: np.ndarray
    values: np.ndarray
    points: SurfacePoints

    def smallest(self, count: int) -> np.ndarray:
        """Ascending index of the `count` pixels of smallest priority, or of all."""
        if count >= len(self.pixels):
            return np.arange(len(self.pixels))
        return np.sort(np.argpartition(self.priorities, count)[:count])

    def at(self, index: np.ndarray) -> Stratum:
        """The same with the pixels `index` only."""
        columns = (column[index] for column in (self.pixels, self.priorities, self.values))
        return Stratum(self.difficulty, self.population, *columns, take(self.points, index))


def take(points: SurfacePoints, index) -> SurfacePoints:
    return SurfacePoints(
        points.position[index], points.geometric_normal[index], points.shading_normal[index], points.eye
    )


def together(points: list[SurfacePoints]) -> SurfacePoints:
    """One after the other; they share an eye."""
    columns = (np.concatenate([getattr(each, name) for each in points]) for name in POINT_ATTRIBUTES)
    return SurfacePoints(*columns, points[0].eye)


def shadow_strata(strata: Iterable[ProbeStratum], eye: np.ndarray) -> tuple[Stratum, ...]:
    """What was kept of a shadow; `eye` (3,) float64: what its surface is relative to."""
    return tuple(
        Stratum(
            each.difficulty,
            each.population,
            each.pixels,
            each.priorities,
            each.values,
            SurfacePoints(*(each.surface[name] for name in POINT_ATTRIBUTES), eye),
        )
        for each in strata
    )
