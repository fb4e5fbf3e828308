"""How wrong a mask is: the share of its pixels that many view rays over their footprints contradict."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..core.metrics import WRONG, maximum, quantile
from ..core.params import Params
from ..core.random import hash_bits
from .error_image import ErrorImage, error_image
from .estimate import Compared, noise_of, sampled_part
from .footprint import Probed
from .interval import TAIL, Part, joined, limits
from .light import Along, ImageScore, halves_of, image_strata, root
from .report import LayerError
from .strata import Difficulty, finite
from .survey import allot

RAYS_AT_ONCE = 1024
SUPERSAMPLES = 64
"""View rays of a pixel, half of them for each of two independent estimates."""
NEAR, MORE = 1.0 / 16.0, 4
"""So near to what makes a pixel wrong, or twice as far beyond it, it gets so many times as many rays: of many
that are right some are far off by chance."""
MOST_SCREENING_RAYS = 32
"""Of a pixel where the layer is smooth, where there are few pixels."""
IMAGE_VIEWS = 8, 24
"""Of each half of a pixel of an error image, and how many more where the halves disagree."""


@dataclass(frozen=True)
class MaskScore(ImageScore):
    """Of masks and pictures in flat colours: the share of wrong pixels. `reference` is asked at points inside
    the pixels: 64 view rays a pixel, drawn from the render's pixel filter, are averaged and compared with the
    finished image.

    `screening_rays`: of a pixel where the layer is smooth; more where the reference takes as long for many
    rays of a pixel as for few.
    """

    probe_seconds: float = 4e-3
    pixel_seconds: float = 1e-4
    screening_rays: int = 4
    metric: ClassVar[str] = "share of wrong pixels"

    def measure(self, probed: Probed, probes: int, seed: int) -> Generator[None, None, LayerError]:
        pixels = probed.image.shape[0] * probed.image.shape[1]
        flat, along = finite(probed.image.reshape(pixels, -1)), self.along(probed)
        strata = image_strata(probed, seed)
        yield
        # Half of the rays go to where the layer changes, and what the rest of it has no use for.
        changes = [each.difficulty == Difficulty.EDGE for each in strata]
        sizes = np.array([each.population for each in strata], np.int64)
        smooth, looks = np.where(changes, 0, sizes), probes * self.looks
        use = int(smooth.sum()) * MOST_SCREENING_RAYS // SUPERSAMPLES
        counts = np.array(allot(max(looks // 2, looks - use), sizes, sizes * changes), np.int64) * changes
        rays = max(looks - int(counts.sum()), 0) * SUPERSAMPLES
        screened = np.array(allot(rays // self.screening_rays, smooth, smooth), np.int64)
        each = min(max(rays // max(int(smooth.sum()), 1), self.screening_rays), MOST_SCREENING_RAYS)
        found = []
        for number, stratum in enumerate(strata):
            own = int(hash_bits(seed, number))
            if changes[number]:
                chosen = np.sort(stratum.chosen(int(counts[number])))
                looked = yield from _looked(probed, along, flat, chosen, own)
                found.append(_of_sample(stratum.population, looked))
            else:
                chosen = np.sort(stratum.chosen(int(screened[number])))
                agreed, flagged = yield from _screened(probed, along, flat, chosen, each, own)
                few = np.random.Generator(np.random.PCG64(own)).permutation(flagged)
                few = few[: max(probes * self.looks // 4, 2)]
                looked = yield from _looked(probed, along, flat, np.sort(few), int(hash_bits(own, 1)))
                found.append(
                    _of_screened(stratum.population, len(chosen), each, agreed, len(flagged), looked)
                )
        return _error(found, pixels, self.reference_name)

    def error_image(
        self, probed: Probed, seed: int, show: Callable[[int], None]
    ) -> Generator[None, None, ErrorImage]:
        """Of absolute differences, of several channels the largest."""
        size, along = probed.image.shape[:2], self.along(probed)
        flat = finite(probed.image.reshape(size[0] * size[1], -1))

        def halves(pixels: np.ndarray, views: int, seed: int) -> Generator[None, None, np.ndarray]:
            truth = yield from halves_of(probed, along, pixels, views, seed, RAYS_AT_ONCE)
            return (flat[pixels] - truth).swapaxes(0, 1)

        return (yield from error_image(halves, size, IMAGE_VIEWS, seed, show, "absolute difference", np.inf))

    def rms(self, value: float) -> float:
        """As if each wrong pixel were off by just what makes it wrong."""
        return math.sqrt(value) * WRONG

    def lowered_by(self, params: Params | None, error: LayerError) -> tuple[str, ...]:
        return ("samples",)


@dataclass(frozen=True)
class Looked:
    """Pixels by many rays. `errors` (P, 2, channels): of two independent halves of them; `differing` (P,):
    the share of the rays that make the pixel wrong by themselves."""

    errors: np.ndarray
    differing: np.ndarray

    @property
    def wrong(self) -> np.ndarray:
        """(P,) bool."""
        return _sizes(self.errors.mean(axis=1)) > WRONG

    @property
    def doubts(self) -> np.ndarray:
        """(P,) float64: the chance that a pixel is wrong and does not look so, or the other way round, by the
        rays' noise, which all that are near what makes one wrong tell together: too few of them are at the
        edge for the halves of each to tell it. That is the variance of its being wrong, too."""
        sizes, near = _sizes(self.errors), self.is_near
        halves = (0.5 * (sizes[near, 0] - sizes[near, 1])) ** 2
        beyond = np.abs(_sizes(self.errors.mean(axis=1)) - WRONG)
        scale = math.sqrt(2.0 * halves.mean()) if near.any() else 0.0
        chances = [0.5 * math.erfc(each / scale) if scale else 0.0 for each in beyond[near]]
        doubts = np.zeros(len(near))
        doubts[near] = chances
        return doubts

    @property
    def is_near(self) -> np.ndarray:
        """(P,) bool."""
        beyond = _sizes(self.errors.mean(axis=1)) - WRONG
        return (beyond > -NEAR) & (beyond < 2.0 * NEAR)


def _sizes(errors: np.ndarray) -> np.ndarray:
    """The largest over the channels of (..., channels)."""
    return np.abs(errors).max(axis=-1)


def _rays(
    probed: Probed, along: Along, flat: np.ndarray, pixels: np.ndarray, views: int, seed: int
) -> Generator[None, None, Looked]:
    """Of `pixels`, by twice so many view rays each."""
    step, errors, differing = max(RAYS_AT_ONCE // views, 1), [], []
    for start in range(0, len(pixels), step):
        part, halves = pixels[start : start + step], []
        for half in range(2):
            own = int(hash_bits(seed, start, half))
            told = along(probed.look(part, views, own), int(hash_bits(own, 1))).mean(axis=0)
            halves.append(flat[part, None] - told.reshape(len(part), views, -1))
            yield
        errors.append(np.stack([each.mean(axis=1) for each in halves], axis=1))
        differing.append(0.5 * sum((_sizes(each) > WRONG).mean(axis=1) for each in halves))
    if not errors:
        return Looked(np.zeros((0, 2, flat.shape[1])), np.zeros(0))
    return Looked(np.concatenate(errors), np.concatenate(differing))


def _looked(
    probed: Probed, along: Along, flat: np.ndarray, pixels: np.ndarray, seed: int
) -> Generator[None, None, Looked]:
    """By SUPERSAMPLES rays, and those that these leave in doubt by MORE times as many."""
    looked = yield from _rays(probed, along, flat, pixels, SUPERSAMPLES // 2, seed)
    near = np.flatnonzero(looked.is_near)
    more = yield from _rays(
        probed, along, flat, pixels[near], MORE * SUPERSAMPLES // 2, int(hash_bits(seed, 2))
    )
    errors, differing = looked.errors.copy(), looked.differing.copy()
    errors[near], differing[near] = more.errors, more.differing
    return Looked(errors, differing)


def _screened(
    probed: Probed, along: Along, flat: np.ndarray, pixels: np.ndarray, rays: int, seed: int
) -> Generator[None, None, tuple[np.ndarray, np.ndarray]]:
    """By `rays` that know nothing of each other: errors (A, channels) of the pixels that all of them agree
    with, and the other pixels, in their order."""
    step, agreed, flagged = max(RAYS_AT_ONCE // rays, 1), [np.zeros((0, flat.shape[1]))], []
    for number, start in enumerate(range(0, len(pixels), step)):
        part, own = pixels[start : start + step], int(hash_bits(seed, 3, number))
        told = along(probed.look(np.repeat(part, rays), 1, own), int(hash_bits(own, 1))).mean(axis=0)
        errors = flat[part, None] - told.reshape(len(part), rays, -1)
        differs = (_sizes(errors) > WRONG).any(axis=1)
        agreed.append(errors[~differs].mean(axis=1))
        flagged.append(part[differs])
        yield
    return np.concatenate(agreed), np.concatenate([pixels[:0], *flagged])


@dataclass(frozen=True)
class _Found:
    """What a stratum adds. `part`: of the number of wrong pixels; `errors` (N, channels) of pixels that stand
    for `sampling` (N,) each; `noise`: sum over the stratum of the variance of the rays' means;
    `probes`: pixels that got many rays."""

    part: Part
    errors: np.ndarray
    sampling: np.ndarray
    noise: float
    probes: int


def _noise(looked: Looked, sampling: np.ndarray) -> float:
    half = 0.25 * ((looked.errors[:, 0] - looked.errors[:, 1]) ** 2).mean(axis=1)
    return float((sampling * half).sum())


def _of_sample(population: int, looked: Looked) -> _Found:
    """Of a simple random sample."""
    count = len(looked.errors)
    wrong = looked.wrong.astype(np.float64)[:, None]
    part = sampled_part(Compared(population, wrong, np.zeros((1, *wrong.shape))), 1.0)
    sampling = np.full(count, population / max(count, 1))
    noise = noise_of(sampling**2 * looked.doubts)
    part = replace(part, noise_variance=part.noise_variance + noise)
    return _Found(part, looked.errors.mean(axis=1), sampling, _noise(looked, sampling), count)


def _of_screened(
    population: int, screened: int, rays: int, agreed: np.ndarray, flagged: int, looked: Looked
) -> _Found:
    """Of pixels of which only those that some ray contradicts were looked at: each wrong one stands for as
    many as its chance of that is small (Horvitz and Thompson), which for a wrong pixel is hardly less than
    that of a share WRONG of the rays."""
    if not screened:
        return _Found(Part(0.0, 0.0, 0.0, 0.0), agreed, np.zeros(len(agreed)), 0.0, 0)
    share, least = screened / population, 1.0 - (1.0 - WRONG) ** rays
    # So many pixels that are just wrong pass all their rays with a chance above the interval's tail.
    hidden = math.floor(math.log(TAIL) / (rays * math.log(1.0 - WRONG))) / -math.log(TAIL)
    unseen = max((1.0 - share) / (share * least), hidden)
    repeats = flagged / max(len(looked.errors), 1)
    chances = np.maximum(1.0 - (1.0 - looked.differing) ** rays, least)
    sampling = repeats / (share * chances)
    counts = sampling * looked.wrong
    variance = float(((1.0 - share * chances) * counts**2).sum()) / max(repeats, 1.0)
    if len(counts) > 1:
        variance += len(counts) * (1.0 - 1.0 / repeats) * float(counts.var(ddof=1))
    noise = noise_of(sampling**2 * looked.doubts)
    others = max(population - float(sampling.sum()), 0.0) / max(len(agreed), 1)
    return _Found(
        Part(float(counts.sum()), variance, noise, unseen),
        np.concatenate([looked.errors.mean(axis=1), agreed]),
        np.concatenate([sampling, np.full(len(agreed), others)]),
        _noise(looked, sampling),
        len(looked.errors),
    )


def _error(found: list[_Found], pixels: int, reference_name: str) -> LayerError:
    part = joined(each.part for each in found)
    low, high = (min(limit / max(pixels, 1), 1.0) for limit in limits(part))
    errors = np.concatenate([np.zeros((0, 1)), *(_sizes(each.errors)[:, None] for each in found)])[:, 0]
    sampling = np.concatenate([np.zeros(0), *(each.sampling for each in found)])

    def mean(of: Callable[[np.ndarray], np.ndarray]) -> float:
        sums = (float((each.sampling * of(each.errors).mean(axis=1)).sum()) for each in found)
        return math.fsum(sums) / max(pixels, 1)

    return LayerError(
        metric=MaskScore.metric,
        value=min(part.total / max(pixels, 1), 1.0),
        ci95=(low, high),
        bias=mean(np.positive),
        p99=quantile(errors, np.ones_like(errors), 0.99, sampling),
        max=maximum(errors, np.ones_like(errors)),
        probes=sum(each.probes for each in found),
        reference=f"{reference_name}, {SUPERSAMPLES} rays a pixel".lstrip(", "),
        reference_noise=root(sum(each.noise for each in found), pixels),
        seconds=0.0,
        mean_absolute_error=mean(np.abs),
    )
