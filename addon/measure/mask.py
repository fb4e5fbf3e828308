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
from .estimate import Compared, sampled_part
from .footprint import Probed
from .interval import Part, joined, limits
from .light import ImageScore, halves_of, image_strata, pooled, root
from .report import LayerError
from .strata import Difficulty, finite
from .survey import allot

RAYS_AT_ONCE = 1024
SUPERSAMPLES = 64
"""View rays of a pixel, half of them for each of two independent estimates."""
IMAGE_VIEWS = 8, 24
"""Of each half of a pixel of an error image, and how many more where the halves disagree."""


@dataclass(frozen=True)
class MaskScore(ImageScore):
    """Of masks and pictures in flat colours: the share of wrong pixels. `reference` is asked at points inside
    the pixels: 64 view rays a pixel, drawn from the render's pixel filter, are averaged and compared with the
    finished image."""

    probe_seconds: float = 4e-3
    pixel_seconds: float = 1e-4
    metric: ClassVar[str] = "share of wrong pixels"

    def measure(self, probed: Probed, probes: int, seed: int) -> Generator[None, None, LayerError]:
        image = probed.image
        pixels = image.shape[0] * image.shape[1]
        flat, along = finite(image.reshape(pixels, -1)), self.along(probed)
        strata = image_strata(probed, seed)
        yield
        totals = dict.fromkeys(Difficulty, 0)
        for each in strata:
            totals[each.difficulty] += each.population
        # Half of the probes go to where the layer changes, as far as there is use for them.
        populations = [each.population for each in strata]
        wishes = [each.population / totals[each.difficulty] for each in strata]
        counts = allot(probes * self.looks, populations, wishes)
        compared = []
        for number, (stratum, count) in enumerate(zip(strata, counts, strict=True)):
            chosen, own = np.sort(stratum.chosen(count)), int(hash_bits(seed, number))
            halves = yield from halves_of(probed, along, chosen, SUPERSAMPLES // 2, own, RAYS_AT_ONCE)
            compared.append(Compared(stratum.population, flat[chosen], halves))
        return _error(compared, pixels, self.reference_name)

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


def _error(compared: list[Compared], pixels: int, reference_name: str) -> LayerError:
    errors, sampling = pooled(compared, largest_channel=True)
    part = joined(map(_part, compared))
    low, high = (min(limit / max(pixels, 1), 1.0) for limit in limits(part))
    ones = np.ones_like(errors)
    means = np.concatenate([np.zeros(0), *(np.abs(each.errors).mean(axis=1) for each in compared)])
    bias = math.fsum(each.population * float(each.errors.mean()) for each in compared)
    return LayerError(
        metric=MaskScore.metric,
        value=part.total / max(pixels, 1),
        ci95=(low, high),
        bias=bias / max(pixels, 1),
        p99=quantile(errors, ones, 0.99, sampling),
        max=maximum(errors, ones),
        probes=len(errors),
        reference=f"{reference_name}, {SUPERSAMPLES} rays a pixel".lstrip(", "),
        reference_noise=root(sum(each.noise for each in compared), pixels),
        seconds=0.0,
        mean_absolute_error=float((sampling * means).sum()) / max(pixels, 1),
    )


def _part(compared: Compared) -> Part:
    """Of the number of wrong pixels. Those near what makes one wrong are so by the chance of the rays: where
    the two halves do not agree, a pixel's being wrong has a variance of up to 1/4."""
    part = sampled_part(_counted(compared), 1.0)
    count = max(len(compared.values), 1)
    first, last = (np.abs(compared.values - half).max(axis=1) > WRONG for half in compared.estimates)
    noise = 0.25 * (compared.population / count) ** 2 * float((first != last).sum())
    return replace(part, noise_variance=part.noise_variance + noise)


def _counted(compared: Compared) -> Compared:
    """Its wrong pixels as errors of 1."""
    wrong = (np.abs(compared.errors).max(axis=1) > WRONG).astype(np.float64)[:, None]
    return Compared(compared.population, wrong, np.zeros((1, *wrong.shape)))
