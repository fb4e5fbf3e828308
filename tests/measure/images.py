"""Made-up layers of light and masks whose error is known, to test the measuring with."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from strata.addon.core.metrics import WRONG
from strata.addon.core.sampling import footprints
from strata.addon.core.shot import PixelFilter
from strata.addon.core.slices import finished
from strata.addon.measure.footprint import KeptSamples
from strata.addon.measure.light import LightScore
from strata.addon.measure.mask import MaskScore
from strata.addon.measure.report import LayerError
from strata.tests.measure.fields import probed_of
from strata.tests.support.figures import in_use_of_light, wrong_share


class Light:
    """A radiance layer; `values` and `truths` (height, width, 3) float64; `noise`: standard deviation of one
    estimate of the reference over the truth's mean, 0 for an exact one; `own_noise` the same over each
    pixel's own truth, added."""

    def __init__(self, values: np.ndarray, truths: np.ndarray, noise: float = 0.0, own_noise: float = 0.0):
        self.values, self.truths = values.astype(np.float32), truths
        self.noise, self.own_noise = noise, own_noise

    @property
    def error(self) -> float:
        return in_use_of_light(self.values, self.truths)

    def measured(self, probes: int, seed: int, kept: KeptSamples | None = None) -> LayerError:
        def reference(rays, outline, layer, view_rays, seed):
            columns, rows = view_rays.pixels.T
            truth = self.truths[rows, columns]
            if not self.noise and not self.own_noise:
                return truth[None]
            spread = self.noise * self.truths.mean() + self.own_noise * truth
            return truth + spread * np.random.default_rng(seed).standard_normal((2, *truth.shape))

        probed = probed_of(self.values, samples=kept)
        return finished(LightScore(reference, "made up").measure(probed, probes, seed))


def fog(rng, side: int = 200) -> np.ndarray:
    """(side, side, 3) smooth light with a shaft, a thousand times brighter at one end than at the other."""
    y, x = np.mgrid[0:side, 0:side] / side
    glow = np.exp(-7.0 * x) * (1.0 + 0.5 * np.sin(9.0 * y + rng.uniform(0.0, 6.0)))
    shaft = 0.3 * (np.abs(x - y - rng.uniform(-0.3, 0.3)) < 0.05)
    return (glow + shaft)[..., None] * np.array([1.0, 0.8, 0.5])


def slightly_off(rng) -> Light:
    truths = fog(rng)
    return Light(truths * (1.0 + 0.02 * rng.standard_normal(truths.shape)), truths)


def noisy_reference(rng) -> Light:
    light = slightly_off(rng)
    return Light(light.values, light.truths, noise=0.05)


def beside_a_lamp(rng) -> Light:
    """A hundred pixels hold nearly all of the squares, and the reference is noisiest there."""
    truths = fog(rng)
    truths[60:70, 40:50] *= rng.uniform(20.0, 400.0, (10, 10, 1))
    return Light(truths * (1.0 + 0.01 * rng.standard_normal(truths.shape)), truths, own_noise=0.1)


def too_dark(rng) -> Light:
    """By a tenth all over: its mean is wrong too."""
    truths = fog(rng)
    return Light(0.9 * truths, truths)


def black(rng) -> Light:
    truths = fog(rng)
    return Light(np.zeros_like(truths), truths)


def exact(rng) -> Light:
    truths = fog(rng)
    return Light(truths, truths.astype(np.float32).astype(np.float64))


def rarely_wrong(rng) -> Light:
    """One pixel in 2000 has twice its light."""
    truths = fog(rng)
    values = truths.copy()
    values[rng.random(truths.shape[:2]) < 5e-4] *= 2.0
    return Light(values, truths)


def shifted(rng) -> Light:
    """By a pixel: wrong at edges only."""
    truths = fog(rng)
    return Light(np.roll(truths, 1, axis=1), truths)


class Mask:
    """A mask of stripes, 1 where sin(frequency (x + slope y)) > 0 at a point in pixels; `spoil(image)` may
    change the (height, width) float64 finished image, the mean of `samples` samples."""

    def __init__(self, rng, spoil=None, samples: int = 64, side: int = 100):
        self.frequency, self.slope, self.side = rng.uniform(0.2, 0.5), rng.uniform(-1.0, 1.0), side
        self.filter = PixelFilter("BLACKMAN_HARRIS", 1.5)
        self.image = self.covered(samples, seed=1)
        if spoil:
            spoil(self.image)

    def at(self, x, y) -> np.ndarray:
        return (np.sin(self.frequency * (x + self.slope * y)) > 0.0).astype(np.float64)

    def covered(self, samples: int, seed: int) -> np.ndarray:
        pixels = self.side * self.side
        jitter = footprints(self.filter, pixels, samples, seed)
        y, x = np.divmod(np.arange(pixels), self.side)
        values = self.at(x[:, None] + 0.5 + jitter[..., 0], y[:, None] + 0.5 + jitter[..., 1])
        return values.mean(axis=1).reshape(self.side, self.side)

    @property
    def error(self) -> float:
        """By as many rays as the reference takes: coverages of an eighth are right or wrong by one ray."""
        return wrong_share(self.image, self.covered(64, seed=2), WRONG)

    def measured(self, probes: int, seed: int) -> LayerError:
        def reference(rays, outline, layer, view_rays, seed):
            return self.at(*(view_rays.pixels + 0.5 + view_rays.jitter).T)[None, :, None]

        probed = probed_of(self.image.astype(np.float32), shot=SimpleNamespace(pixel_filter=self.filter))
        return finished(MaskScore(reference, "made up").measure(probed, probes, seed))


def good_mask(rng) -> Mask:
    return Mask(rng)


def coarse_mask(rng) -> Mask:
    """One sample a pixel: wrong along all edges."""
    return Mask(rng, samples=1)


def rarely_wrong_mask(rng) -> Mask:
    """One pixel in 300 is inverted."""

    def spoil(image):
        wrong = rng.random(image.shape) < 1.0 / 300.0
        image[wrong] = 1.0 - image[wrong]

    return Mask(rng, spoil)


def blotched_mask(rng) -> Mask:
    """A corner is missing."""

    def spoil(image):
        image[:15, :20] = 0.0

    return Mask(rng, spoil)
