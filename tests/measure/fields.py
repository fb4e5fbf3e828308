"""Made-up shadow layers whose error is known, and rays that know the truth, to test the measuring with."""

from __future__ import annotations

import numpy as np
from strata.addon.core.surface import SurfacePoints
from strata.addon.measure.difficulty import Difficulty
from strata.addon.measure.shadow_probes import PIXELS_PER_PROBE, Stratum
from strata.tests.support.figures import weighted_rmse


class Field:
    """`values`, `truths` and `weights` (N,) float64 of N pixels."""

    def __init__(self, values, truths, weights):
        self.values, self.truths, self.weights = values, truths, weights
        partly = (values > 0.0) & (values < 1.0)
        self.difficulty = np.where(partly, Difficulty.PENUMBRA, Difficulty.REST)

    @property
    def rmse(self) -> float:
        return weighted_rmse(self.values - self.truths, self.weights)

    def strata(self, probes: int, rng) -> list[Stratum]:
        """What ProbeCollector would have kept. A point's x is its pixel's number."""
        strata = []
        for kind in (Difficulty.PENUMBRA, Difficulty.REST):
            members = np.flatnonzero(self.difficulty == kind)
            if len(members):
                pixels = np.sort(rng.permutation(members)[: PIXELS_PER_PROBE[kind] * probes])
                priorities = rng.permutation(len(pixels)).astype(np.uint32)
                position = np.stack([pixels, 0 * pixels, 0 * pixels], 1).astype(np.float32)
                points = SurfacePoints(position, position, position, np.zeros(3))
                values = self.values[pixels]
                strata.append(Stratum(kind, len(members), pixels, priorities, values, points))
        return strata

    def weigh(self, points: SurfacePoints):
        return self.weights[points.position[:, 0].astype(np.int64)]

    def screen(self, points: SurfacePoints, seed: int):
        """Two single rays a point, as ray_screen."""
        pixels = points.position[:, 0].astype(np.int64)
        rng = np.random.default_rng(seed)
        return rng.random((len(pixels), 2)) < self.truths[pixels, None]

    def reference(self, points: SurfacePoints, samples: int, seed: int):
        """Two halves of `samples` stratified rays: across an edge their noise falls with n^-3/4."""
        pixels = points.position[:, 0].astype(np.int64)
        rng = np.random.default_rng(seed)
        truths = self.truths[pixels, None]
        noise = 0.7 * np.sqrt(truths * (1.0 - truths)) * samples**-0.75
        halves = truths + noise * rng.standard_normal((len(pixels), 2))
        return np.clip(np.round(halves * samples) / samples, 0.0, 1.0), self.weights[pixels]


PENUMBRA_SHARE = 0.2
NORMAL_ERROR = 0.025  # in the penumbra: RMSE .011 over the image


def healthy(rng, pixels: int, deviations=None) -> Field:
    """A fifth penumbra, off by `deviations`, a fifth umbra, the rest lit; log-normal weights."""
    partly = int(PENUMBRA_SHARE * pixels)
    truths = np.ones(pixels)
    truths[:partly] = rng.random(partly)
    truths[partly : 2 * partly] = 0.0
    values = truths.copy()
    if deviations is None:
        deviations = NORMAL_ERROR * rng.standard_normal(partly)
    values[:partly] = np.clip(truths[:partly] + deviations, 1 / 512, 511 / 512)
    return Field(values, truths, np.exp(0.5 * rng.standard_normal(pixels)))


def spoilt(rng, pixels: int, share: float) -> Field:
    """Healthy, but `share` of the pixels are wrong by 1 or nearly."""
    field = healthy(rng, pixels)
    bad = rng.choice(pixels, round(share * pixels), replace=False)
    values = field.values.copy()
    values[bad] = np.where(field.truths[bad] > 0.5, 0.0, 1.0)
    return Field(values, field.truths, field.weights)


def perfect(rng, pixels: int) -> Field:
    return healthy(rng, pixels, 0.0)


def heavy_tailed(rng, pixels: int) -> Field:
    """Errors of Student's t with 2.5 degrees of freedom: their squares have a mean but no variance."""
    return healthy(rng, pixels, 0.012 * rng.standard_t(2.5, int(PENUMBRA_SHARE * pixels)))


def lognormal(rng, pixels: int) -> Field:
    count = int(PENUMBRA_SHARE * pixels)
    return healthy(rng, pixels, rng.choice([-1, 1], count) * np.exp(1.2 * rng.standard_normal(count) - 4.8))


def slightly_leaking(rng, pixels: int) -> Field:
    """3% of the lit pixels really lose a twentieth of the light: what single rays seldom notice."""
    field = healthy(rng, pixels)
    lit = np.flatnonzero(field.truths == 1.0)
    truths = field.truths.copy()
    truths[rng.choice(lit, int(0.03 * pixels), replace=False)] = 0.95
    return Field(field.values, truths, field.weights)


def rarely_half_wrong(rng, pixels: int) -> Field:
    """One penumbra pixel in 500 is wrong by 0.35: too little for a few rays to be sure."""
    count = int(PENUMBRA_SHARE * pixels)
    deviations = NORMAL_ERROR * rng.standard_normal(count)
    field = healthy(rng, pixels, deviations)
    bad = rng.choice(count, count // 500, replace=False)
    values = field.values.copy()
    values[bad] = np.clip(field.truths[bad] + np.where(field.truths[bad] > 0.5, -0.35, 0.35), 0.01, 0.99)
    return Field(values, field.truths, field.weights)
