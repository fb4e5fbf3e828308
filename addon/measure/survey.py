"""A stratum under measurement: screened with few rays, then looked at with many where that pays.

Each kind of survey offers `groups` of its screened pixels (indices, in random order) with a `wish` for probes
each; `estimate` takes what the probes of each group found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .deviation import Deviations, joined_deviations
from .estimate import Contradicted, Group, binary_part, grouped_part
from .interval import Part
from .strata import Stratum

EDGES = (0.01, 0.025, 0.05, 0.1, 0.2, 0.4, 1.0)
"""The groups' largest errors in use, as the screening sees them, with its noise."""
NOISES = 2.0
"""Standard deviations of the screening's noise that an error may be beyond its group's edge."""


@dataclass(frozen=True)
class Estimate:
    """What a stratum adds to the image. `part`: the sum over its pixels of squared errors; `count`: how many
    of them multiply anything; `found` and `sampling` (N,): pixels that stand for all of it."""

    part: Part
    count: float
    found: Deviations
    sampling: np.ndarray


@dataclass(frozen=True)
class Screened:
    """Some pixels of a stratum by a few rays each. `pixels` (S,) in random order; `values` (S, channels) of
    the layer; `rays`: of each pixel; `told`: what they say; `count`: how many of the whole stratum multiply
    anything."""

    stratum: Stratum
    pixels: np.ndarray
    values: np.ndarray
    rays: int
    told: Deviations
    count: float


class BinarySurvey:
    """Pixels that the layer calls wholly lit or wholly dark: one group, those that some ray contradicts."""

    def __init__(self, screened: Screened):
        self.screened = screened
        flagged = screened.told.contradicted.any(axis=1)
        self.groups = [np.flatnonzero(flagged)]
        weight = float((screened.told.share**2).mean()) if len(flagged) else 0.0
        self.wishes = [float(flagged.mean()) * weight * screened.stratum.population if len(flagged) else 0.0]
        self._agreed = np.flatnonzero(~flagged)

    def estimate(self, measured: Sequence[Deviations]) -> Estimate:
        (found,) = measured
        screened = self.screened
        contradicted = found.contradicted.mean(axis=1)
        # How much of the light the contradicted rays are of: errors are that times their share.
        counts_for = (found.sizes / np.maximum(contradicted, 1e-9)) ** 2
        part, sampling = binary_part(
            screened.stratum.population,
            screened.told.share**2,
            len(self.groups[0]),
            screened.rays,
            Contradicted(found.contradicted, counts_for),
        )
        agreed = screened.told[self._agreed]
        others = max(screened.stratum.population - sampling.sum(), 0.0) / max(len(agreed), 1)
        return Estimate(
            part,
            screened.count,
            joined_deviations([found, agreed]),
            np.concatenate([sampling, np.full(len(agreed), others)]),
        )


class GroupedSurvey:
    """Pixels that the layer says are partly lit, or all of a layer that is exact, grouped by how far a few
    rays are from it."""

    def __init__(self, screened: Screened):
        self.screened, told = screened, screened.told
        group = np.digitize(told.sizes, EDGES[:-1])
        self.groups = [np.flatnonzero(group == each) for each in range(len(EDGES))]
        noise = 0.5 * told.noise_variances.sum(axis=1)  # of both halves' mean
        self.edges = [
            edge + NOISES * math.sqrt(noise[members].mean()) if len(members) else edge
            for members, edge in zip(self.groups, EDGES, strict=True)
        ]
        # So that a bad pixel that is missed costs the same in each.
        share = screened.stratum.population / max(len(group), 1)
        self.wishes = [
            share * len(members) * edge**2 for members, edge in zip(self.groups, self.edges, strict=True)
        ]

    def estimate(self, measured: Sequence[Deviations]) -> Estimate:
        screened = self.screened
        sizes = [len(members) for members in self.groups]
        groups = [Group(*each) for each in zip(sizes, self.edges, measured, strict=True)]
        worst = np.maximum(screened.values, 1.0 - screened.values).max(axis=1) * screened.told.share
        part, sampling = grouped_part(screened.stratum.population, worst, screened.rays, groups)
        return Estimate(part, screened.count, joined_deviations(measured), np.concatenate(sampling))


class EmptySurvey:
    """Pixels whose samples, and those of pixels nearby, found nothing that the layer multiplies: only those
    where rays find something may be wrong. One bad pixel that was missed is not counted: what no sample far
    and wide met is next to nothing."""

    def __init__(self, screened: Screened):
        self.screened = screened
        self.groups = [np.flatnonzero(screened.told.has_light)]
        self.wishes = [float(len(self.groups[0]))]

    def estimate(self, measured: Sequence[Deviations]) -> Estimate:
        (found,) = measured
        screened, share = self.screened, len(self.screened.pixels) / self.screened.stratum.population
        stands_for = len(self.groups[0]) / share if share else 0.0
        sampling = np.full(len(found), stands_for / max(len(found), 1))
        total = float((sampling * found.squares).sum())
        # How many pixels there is something in is as uncertain as what is wrong there.
        variance = float(((sampling * found.squares) ** 2).sum())
        part = Part(total, variance, 0.0, 0.0)
        return Estimate(part, screened.count, found, sampling)


Survey = BinarySurvey | GroupedSurvey | EmptySurvey


def allot(total: int, sizes: Sequence[int], wishes: Sequence[float]) -> list[int]:
    """Shares `total` probes out in proportion to `wishes`, none above its size. Every group gets two if it
    has as many, even beyond the total: an empty one would bias the estimate."""
    sizes, wishes = np.asarray(sizes, np.int64), np.asarray(wishes, np.float64)
    given = np.minimum(sizes, 2)
    open_groups = given < sizes
    while open_groups.any() and given.sum() < total:
        wish = np.where(open_groups, wishes, 0.0)
        left = total - int(given[~open_groups].sum())
        if wish.sum() <= 0.0:
            break
        wanted = np.floor(left * wish / wish.sum()).astype(np.int64)
        full = open_groups & (wanted >= sizes)
        if not full.any():
            given = np.where(open_groups, np.maximum(wanted, given), given)
            break
        given[full] = sizes[full]
        open_groups &= ~full
    return given.tolist()


def shared_looks(
    total: int, sizes: Sequence[int], populations: Sequence[int], wishes: Sequence[float], again: bool
) -> list[tuple[int, int]]:
    """Shares `total` looks of a reference out to groups: for each how many of its `sizes` pixels get any, and
    how many each of them gets.

    Three in four looks are first ones, as `allot` has it, since what was never looked at widens the interval
    most. If they may look `again`, and there are groups of which every pixel is seen, the others take
    those pixels' noise off (`looks_again`).
    """
    sizes, populations = np.asarray(sizes, np.int64), np.asarray(populations, np.int64)
    counts = np.array(allot(total - total // 4 if again else total, sizes, wishes), np.int64)
    more = [1] * len(counts)
    whole = (counts == populations) & (populations > 0)
    if again and whole.any():
        more = looks_again(total - int(counts.sum()), np.where(whole, counts, 0), wishes)
    elif again:
        counts = np.array(allot(total, sizes, wishes), np.int64)
    return list(zip(counts.tolist(), more, strict=True))


def looks_again(left: int, sizes: Sequence[int], wishes: Sequence[float]) -> list[int]:
    """How many looks each pixel of groups of `sizes` gets where one each is given already and `left` are
    left: in proportion to the power 2/3 of a pixel's wish, which is best where the noise of a square
    (Compared.square_variances) goes with the wish."""
    sizes = np.asarray(sizes, np.int64)
    each = (np.asarray(wishes, np.float64) / np.maximum(sizes, 1)) ** (2.0 / 3.0)
    more = max(left, 0) * each / max(float((each * sizes).sum()), 1e-300)
    return (1 + np.where(sizes > 0, more, 0.0).astype(np.int64)).tolist()
