"""Made-up layers that multiply, whose error is known, to test the measuring with. Each pixel shows two
things, of which a view ray meets one: each has its own light and its own true value."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from strata.addon.core.metrics import mean_brightness
from strata.addon.core.shot import PixelFilter
from strata.addon.core.slices import finished
from strata.addon.core.view_rays import ViewRays
from strata.addon.measure.footprint import KeptSamples, Probed
from strata.addon.measure.in_use import InUseScore

WIDTH = 100
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
BOX = PixelFilter("BOX", 0.5)
TINT = np.array([1.0, 1.5, 0.7])  # exponents of a layer's colours
OUTLINE = SimpleNamespace(working_space="Linear Rec.709", exposure=1.0, frame=1)


class Rays:
    """What a RayCaster tells of a made-up layer: which pixel, and where in it."""

    def look(self, pixels: np.ndarray, jitter: np.ndarray, samples=None) -> ViewRays:
        nothing = np.zeros((len(pixels), 3))
        return ViewRays(
            pixels, np.broadcast_to(jitter, (len(pixels), 2)), nothing, nothing, nothing, {}, None
        )


def probed_of(values: np.ndarray, weights=None, samples=None, shot=None, outline=OUTLINE) -> Probed:
    """Of an image (height, width[, channels])."""
    layer = SimpleNamespace(name="Layer", effect="made up")
    shot = shot or SimpleNamespace(pixel_filter=BOX)
    return Probed(layer, (), outline, shot, values, weights, samples, Rays(), np.zeros(0, np.uint8))


@dataclass
class Field:
    """N pixels. `values` (N, channels) of the layer, `truths` (N, 2, channels) and `light` (N, 2, 3) of each
    pixel's two things, `covered` (N,): the first one's share; all float64. `noise`: standard deviation of one
    estimate of a truth that is no visibility; None: visibilities are drawn, 0 or 1."""

    values: np.ndarray
    truths: np.ndarray
    light: np.ndarray
    covered: np.ndarray
    noise: float | None = None
    exposure: float = 1.0

    def mean(self, of_things: np.ndarray) -> np.ndarray:
        """(N, channels) over the pixels of (N, 2, channels)."""
        covered = self.covered[:, None]
        return covered * of_things[:, 0] + (1.0 - covered) * of_things[:, 1]

    @property
    def known_light(self) -> np.ndarray:
        return np.nan_to_num(self.light)

    @property
    def lit(self) -> np.ndarray:
        return self.mean(self.known_light).any(axis=1) | np.isnan(self.light).all(axis=(1, 2))

    def used(self) -> np.ndarray:
        """(N, channels) that the layer should hold."""
        light = self.known_light
        if self.truths.shape[2] == 1:
            light = (light @ LUMINANCE)[..., None]
        whole = self.mean(light)
        plain = self.mean(self.truths)
        return np.where(
            whole > 0.0, self.mean(self.truths * light) / np.where(whole > 0.0, whole, 1.0), plain
        )

    def errors(self) -> np.ndarray:
        """(N,) as shares of the brightness, by the definition; 0 where there is nothing to multiply."""
        whole = self.mean(self.known_light) @ LUMINANCE
        mean = mean_brightness(whole[whole > 0.0]) or 1.0
        unknown = np.isnan(self.light).all(axis=(1, 2))
        light = np.where(unknown[:, None, None], mean, self.known_light)
        errors = self.values * self.mean(light) - self.mean(self.truths * light)
        one = self.values.shape[1] == 1
        sizes = np.abs(errors @ LUMINANCE) if one else np.sqrt(errors**2 @ LUMINANCE)
        return sizes / (np.where(unknown, mean, whole) + mean)

    @property
    def error(self) -> float:
        lit = self.lit
        return float(np.sqrt((self.errors()[lit] ** 2).mean())) if lit.any() else 0.0

    def in_colour(self, noise: float = 0.0) -> Field:
        """The same with three channels, whose truths are estimated with `noise`."""
        coloured = replace(self, truths=self.truths**TINT, noise=noise)
        values = coloured.used() + (self.values - self.used())
        return replace(coloured, values=np.clip(values, 0.0, 1.0))

    def thing(self, view_rays: ViewRays) -> tuple[np.ndarray, np.ndarray]:
        """Which pixel and which of its things each view ray meets."""
        pixels = view_rays.pixels[:, 1] * WIDTH + view_rays.pixels[:, 0]
        return pixels, (view_rays.jitter[:, 0] + 0.5 >= self.covered[pixels]).astype(int)

    def truth(self, rays, outline, layer, layers, casters, view_rays, samples, seed):
        where, rng = self.thing(view_rays), np.random.default_rng(seed)
        light, truths = self.light[where], self.truths[where]
        light[np.isnan(light).any(axis=1)] = np.nan
        if not samples:
            return np.ones((1, *truths.shape)), light
        if self.noise is not None:
            noise = self.noise * rng.standard_normal((2 if self.noise else 1, *truths.shape))
            return truths + noise, light
        drawn = rng.binomial(samples, np.broadcast_to(truths, (1 if samples == 1 else 2, *truths.shape)))
        return drawn / samples, light

    def weights(self) -> np.ndarray:
        """(N, 1) as samples would have weighed, in another unit than the light."""
        return (0.01 * self.mean(self.known_light) @ LUMINANCE)[:, None] + 1e-30

    def kept(self, samples: int, of: np.ndarray | None = None, seed: int = 0) -> KeptSamples:
        """Of every pixel, `samples` samples; what they found is `of` (N, 2, channels) or the truth."""
        jitter = np.stack([(np.arange(samples) + 0.5) / samples - 0.5, np.zeros(samples)], axis=1)
        pixels, of = np.arange(len(self.values)), self.truths if of is None else of
        second = (jitter[:, :1] + 0.5 >= self.covered).astype(int)
        jitter = np.broadcast_to(jitter[:, None], (samples, len(pixels), 2))
        return KeptSamples(pixels, of[pixels[None], second].astype(np.float32), jitter)

    def measured(self, probes: int, seed: int, weighed: bool = True, kept: KeptSamples | None = None):
        shape = -1, WIDTH, self.values.shape[1]
        image = self.values.astype(np.float32).reshape(shape)
        weights = self.weights().astype(np.float32).reshape(-1, WIDTH, 1) if weighed else None
        outline = SimpleNamespace(**{**vars(OUTLINE), "exposure": self.exposure})
        probed = probed_of(image, weights, kept, outline=outline)
        score = InUseScore(self.truth, is_binary=self.noise is None)
        return finished(score.measure(probed, probes, seed))


def wrong_by(field: Field, chosen: np.ndarray, sizes) -> Field:
    """The truth of pixels `chosen` is off by so much: the layer shows nothing of it."""
    truths = field.truths.copy()
    truths[chosen] += np.where(truths[chosen] > 0.5, -1.0, 1.0) * np.reshape(sizes, (-1, 1, 1))
    return replace(field, truths=np.clip(truths, 0.0, 1.0))


NORMAL_ERROR = 0.025


def healthy(rng, pixels: int, deviations=None) -> Field:
    """From the top: a fifth penumbra, off by `deviations`, a fifth umbra, a fifth unlit, then lit, the last
    tenth silhouettes between two things; log-normal light."""
    fifth, tenth = pixels // 5, pixels // 10
    truths, covered = np.ones((pixels, 2, 1)), np.ones(pixels)
    truths[:fifth] = rng.random((fifth, 1, 1))
    truths[fifth : 2 * fifth] = 0.0
    truths[-tenth:] = rng.integers(0, 2, (tenth, 2, 1))
    covered[-tenth:] = rng.random(tenth)
    light = np.exp(0.5 * rng.standard_normal((pixels, 2, 1))) * np.ones(3)
    light[2 * fifth : 3 * fifth] = 0.0
    field = Field(np.zeros((pixels, 1)), truths, light, covered)
    values = field.used()
    partly = np.flatnonzero((values > 0.0) & (values < 1.0))
    if deviations is None:
        deviations = NORMAL_ERROR * rng.standard_normal(pixels)
    values[partly] += np.broadcast_to(deviations, pixels)[partly, None]
    return replace(field, values=np.clip(values, 0.0, 1.0))


def perfect(rng, pixels: int) -> Field:
    return healthy(rng, pixels, 0.0)


def heavy_tailed(rng, pixels: int) -> Field:
    """Errors of Student's t with 2.5 degrees of freedom: their squares have a mean but no variance."""
    return healthy(rng, pixels, 0.012 * rng.standard_t(2.5, pixels))


def lognormal(rng, pixels: int) -> Field:
    return healthy(rng, pixels, rng.choice([-1, 1], pixels) * np.exp(1.2 * rng.standard_normal(pixels) - 4.8))


def _some(rng, field: Field, share: float, where: slice = slice(None)) -> np.ndarray:
    numbers = np.arange(len(field.values))[where]
    return rng.choice(numbers, max(round(share * len(field.values)), 1), replace=False)


def rarely_wrong(rng, pixels: int) -> Field:
    """One pixel in 2000 is wrong by 1 or nearly, and nothing in the layer shows which."""
    field = healthy(rng, pixels)
    return wrong_by(field, _some(rng, field, 5e-4), 1.0)


def very_rarely_wrong(rng, pixels: int) -> Field:
    """One in 20 000: seldom seen at all."""
    field = healthy(rng, pixels)
    return wrong_by(field, _some(rng, field, 5e-5), 1.0)


def specks(rng, pixels: int) -> Field:
    """One pixel in 2000 of the layer is inverted."""
    field = healthy(rng, pixels)
    values = field.values.copy()
    chosen = _some(rng, field, 5e-4)
    values[chosen] = 1.0 - np.round(values[chosen])
    return replace(field, values=values)


def slightly_leaking(rng, pixels: int) -> Field:
    """3% of the pixels, lit ones, really lose a twentieth of the light: single rays seldom tell."""
    field = healthy(rng, pixels)
    return wrong_by(field, _some(rng, field, 0.03, slice(3 * pixels // 5, -pixels // 10)), 0.05)


def rarely_half_wrong(rng, pixels: int) -> Field:
    """One penumbra pixel in 500 is wrong by 0.35: too little for a few rays to be sure."""
    field = healthy(rng, pixels)
    return wrong_by(field, _some(rng, field, 4e-4, slice(pixels // 5)), 0.35)


def badly_weighed(rng, pixels: int) -> Field:
    """Silhouettes hold the plain mean, whatever light each thing has."""
    field = healthy(rng, pixels, 0.0)
    light = field.light.copy()
    light[-pixels // 10 :, 1] *= 0.1
    field = replace(field, light=light)
    return replace(field, values=field.mean(field.truths))


def thinly_covered(rng, pixels: int) -> Field:
    """A twentieth of some lit pixels, and some light in unlit ones, that the layer's samples have missed."""
    field = healthy(rng, pixels)
    covered, truths, light = field.covered.copy(), field.truths.copy(), field.light.copy()
    dark = _some(rng, field, 0.05, slice(3 * pixels // 5, -pixels // 10))
    covered[dark], truths[dark, 1] = 0.95, 0.0
    bright = _some(rng, field, 0.01, slice(2 * pixels // 5, 3 * pixels // 5))
    covered[bright], truths[bright, 1], light[bright, 1] = 0.9, 0.0, 1.0
    return replace(field, covered=covered, truths=truths, light=light)


def beside_a_lamp(rng, pixels: int) -> Field:
    """Light over four orders of magnitude."""
    field = healthy(rng, pixels)
    return replace(field, light=field.light * np.exp(2.0 * rng.standard_normal((pixels, 1, 1))))


def coloured(rng, pixels: int) -> Field:
    """Red things beside green ones, under light of which each pixel's has a hue of its own."""
    field = badly_weighed(rng, pixels)
    hue = rng.random((pixels, 1, 3)) * np.array([[1.0, 0.1, 0.1], [0.1, 1.0, 0.1]])
    return replace(field, light=field.light * hue)


def before_the_sky(rng, pixels: int) -> Field:
    """What a third of the pixels multiply is not known."""
    field = healthy(rng, pixels)
    light = field.light.copy()
    light[: pixels // 6] = np.nan
    light[-pixels // 6 :, 1] = np.nan
    return replace(field, light=light)


MAKERS = [
    healthy,
    perfect,
    heavy_tailed,
    lognormal,
    rarely_wrong,
    very_rarely_wrong,
    specks,
    slightly_leaking,
    rarely_half_wrong,
    badly_weighed,
    thinly_covered,
    beside_a_lamp,
    coloured,
    before_the_sky,
]
