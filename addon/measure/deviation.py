"""From what rays say of pixels to errors: how far a layer is off, as a share of the brightness there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .footprint import Seen

LIT_VIEWS = 8
"""View rays that tell whether there is anything to multiply in a pixel: of more, nearly every pixel beside
something has a little of it."""


@dataclass(frozen=True)
class Scale:
    """What errors are shares of. `mean`: of the luminance of what a layer multiplies, over the pixels where
    it multiplies anything; `luminance` (3,): of the working space's primaries; `exposure`: factor to what a
    display shows, white at 1; `display_mean`: as `mean`, of what it shows."""

    mean: float
    luminance: np.ndarray
    exposure: float = 1.0
    display_mean: float = 0.0
    uncertainty: float = 0.0

    def with_means(self, mean: float, display_mean: float, uncertainty: float = 0.0) -> Scale:
        return replace(self, mean=mean, display_mean=display_mean, uncertainty=uncertainty)

    def known(self, light: np.ndarray) -> np.ndarray:
        """Light (P, V, 3) that is not a number where it is not known: a pixel of which no view ray knows is
        taken to be as bright as the mean, else the others are."""
        unknown = np.isnan(light)
        return np.where(unknown, np.where(unknown.all(axis=(1, 2), keepdims=True), self.mean, 0.0), light)

    def of(self, light: np.ndarray) -> np.ndarray:
        """Luminance of (..., 3)."""
        return light @ self.luminance

    def errors(self, by_channel: np.ndarray, channels: int) -> np.ndarray:
        """Errors (..., 3) of a layer of so many channels as numbers (..., K) whose squares add up to
        luminance's: of one channel in luminance, else by channel."""
        if channels == 1:
            return self.of(by_channel)[..., None]
        return by_channel * np.sqrt(self.luminance)

    def shown(self, light: np.ndarray) -> np.ndarray:
        """Luminance of (..., 3) as a display shows it."""
        return np.clip(light * self.exposure, 0.0, 1.0) @ self.luminance


@dataclass(frozen=True)
class Deviations:
    """Of P pixels, each by two independent halves of its rays, so that noise in a square cancels.

    - `errors` (P, 2, K): of a layer of one channel in luminance (K = 1), else by channel, weighted so that
      their squares add up to luminance's; `signed` (P,): in luminance, negative where too dark
    - `chroma` (P, 2, 3): what of the light's colour one channel cannot hold
    - `display` (P, 2): the errors on a display
    - `share` (P,): light over light + mean; `has_light` (P,): whether LIT_VIEWS of the view rays find any: of
      more of them the share of such groups that do, so that it does not depend on how many there are
    - `contradicted` (P, 2): of the rays, those that say another whole number than the layer
    - `slopes` (P, 2, K): what `errors` grow by for each 1 that the layer's values grow by
    """

    errors: np.ndarray
    chroma: np.ndarray
    display: np.ndarray
    signed: np.ndarray
    share: np.ndarray
    contradicted: np.ndarray
    has_light: np.ndarray
    slopes: np.ndarray

    def __len__(self) -> int:
        return len(self.errors)

    @cached_property
    def squares(self) -> np.ndarray:
        """(P,) squared errors without the noise's own square; may be negative."""
        return (self.errors[:, 0] * self.errors[:, 1]).sum(axis=1)

    @cached_property
    def noise_variances(self) -> np.ndarray:
        """(P, K) variances of one half."""
        return 0.5 * (self.errors[:, 0] - self.errors[:, 1]) ** 2

    @cached_property
    def square_variances(self) -> np.ndarray:
        """(P,) of `squares` by noise (estimate.py, product_variances)."""
        return product_variances(self.errors[:, 0], self.errors[:, 1])

    @cached_property
    def sizes(self) -> np.ndarray:
        """(P,) of the errors, with their noise."""
        return np.sqrt((self.errors.mean(axis=1) ** 2).sum(axis=1))

    def __getitem__(self, index) -> Deviations:
        return Deviations(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


def product_variances(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """(P,) variances of the products of two noisy looks (P, K) at the same errors, summed over K, each from
    its own two looks. For m the mean of both and d their difference, m.d has mean 0 and, where the noise is
    normal with covariance C, the square (m.d)^2 has the mean 2 e'Ce + tr C^2: just the product's variance,
    whether channels share their noise or not."""
    return (0.5 * ((first**2).sum(axis=1) - (last**2).sum(axis=1))) ** 2


def joined_deviations(parts: Sequence[Deviations]) -> Deviations:
    """One after the other."""
    names = Deviations.__dataclass_fields__
    return Deviations(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def deviations(values: np.ndarray, seen: Seen, scale: Scale) -> Deviations:
    """Of a layer's `values` (P, channels) from what was `seen`; the first half of each pixel's view rays and
    the second are its halves."""
    truth, light = seen.truth.mean(axis=0), seen.multiplied
    pixels, views = light.shape[:2]
    light = scale.known(light)

    def halves(array: np.ndarray) -> np.ndarray:
        """(P, 2, ...): means over each half of (P, V, ...); one view ray is both."""
        if views == 1:
            return np.repeat(array, 2, axis=1)
        return array.reshape(pixels, 2, views // 2, *array.shape[2:]).mean(axis=2)

    differences = values[:, None] - truth
    brightness = scale.of(light.mean(axis=1))
    whole = np.maximum(brightness + scale.mean, 1e-300)
    by_channel = halves(differences * light) / whole[:, None, None]
    slopes = scale.errors(halves(light) / whole[:, None, None], values.shape[1])
    in_luminance = scale.of(by_channel)
    errors = scale.errors(by_channel, values.shape[1])
    chroma = np.zeros_like(by_channel)
    if values.shape[1] == 1:
        chroma = by_channel * np.sqrt(scale.luminance) - errors * np.sqrt(scale.luminance)
    in_use, true = values[:, None] * halves(light), halves(truth * light)
    shown = scale.shown(light.mean(axis=1)) + scale.display_mean
    display = (scale.shown(in_use) - scale.shown(true)) / np.maximum(shown, 1e-300)[:, None]
    is_lit = light.any(axis=2)
    return Deviations(
        errors,
        chroma,
        display,
        in_luminance.mean(axis=1),
        brightness / whole,
        halves(np.abs(differences).max(axis=2) * is_lit),
        _has_light(is_lit),
        slopes,
    )


def _has_light(is_lit: np.ndarray) -> np.ndarray:
    """(P,) from (P, V) bool. A group's rays lie apart in the sets that they were drawn in."""
    pixels, views = is_lit.shape
    groups = max(views // LIT_VIEWS, 1)
    apart = is_lit[:, : views // groups * groups].reshape(pixels, views // groups, groups)
    return apart.any(axis=1).mean(axis=1)
