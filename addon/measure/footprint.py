"""Pixels by many view rays each, drawn from the render's pixel filter: what a layer should be there, and what
it multiplies."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..core.device import RayCaster
from ..core.graph import PlannedLayer
from ..core.outline import Outline
from ..core.random import hash_bits, text_bits
from ..core.sampling import footprints
from ..core.shot import Shot
from ..core.view_rays import ViewRays
from .strata import Stratum, strata_of
from .watch import Watch

RAYS_AT_ONCE = 1 << 14
"""View rays between two yields: some hundredths of a second."""


@dataclass(frozen=True)
class Probed:
    """What a Score makes a figure of. `image` (height, width[, channels]): the finished layer; `weights`
    alike, or of one channel: the mean of what its samples weighed, None if they did not; `samples`: what
    some of its pixels were made of, None if nobody kept it; `casters` (instances,) uint8: what can block
    its light. `layers`: of the whole graph; `watched`: other pixels, which told when the layer had enough
    samples."""

    layer: PlannedLayer
    layers: tuple[PlannedLayer, ...]
    outline: Outline
    shot: Shot
    image: np.ndarray
    weights: np.ndarray | None
    samples: KeptSamples | None
    rays: RayCaster
    casters: np.ndarray
    watched: Watch | None = None
    _strata: dict[int, list[Stratum]] = field(default_factory=dict, repr=False, compare=False)
    found: dict[Any, Any] = field(default_factory=dict, repr=False, compare=False)
    """What a score found out for all numbers of probes, for it to find again."""

    def strata(self, codes: Callable[[], np.ndarray], seed: int) -> list[Stratum]:
        """Its pixels by their `codes()` (pixels,), with random numbers by `seed`; made once, whoever asks."""

        def priority(pixels: np.ndarray) -> np.ndarray:
            words = text_bits(self.layer.effect), self.outline.frame & 0xFFFFFFFF, pixels
            return hash_bits(seed, *words)

        if seed not in self._strata:
            self._strata[seed] = list(strata_of(codes(), priority))
        return self._strata[seed]

    def look(self, pixels: np.ndarray, views: int, seed: int) -> ViewRays:
        """`views` view rays through each of `pixels` (P,), numbered row by row; those of a pixel one after
        the other."""
        jitter = footprints(self.shot.pixel_filter, len(pixels), views, seed)
        return self.rays.look(np.repeat(self.places(pixels), views, axis=0), jitter.reshape(-1, 2))

    def places(self, pixels: np.ndarray) -> np.ndarray:
        """(P, 2) column and row."""
        rows, columns = np.divmod(pixels.astype(np.int64), self.image.shape[1])
        return np.stack([columns, rows], axis=1)


@dataclass(frozen=True)
class KeptSamples:
    """Samples of some pixels of a layer. `pixels` (P,), ascending; `values` (S, P, channels) float32;
    `jitter` (S, P, 2): where each sample's view ray went through, in pixels from its pixel's centre."""

    pixels: np.ndarray
    values: np.ndarray
    jitter: np.ndarray


Truth = Callable[[ViewRays, int, int], tuple[np.ndarray, np.ndarray]]
"""truth(view_rays, samples, seed): what a layer should be along each of N view rays, by `samples` rays of
each estimate, (1 or 2, N, channels) float64, one if it is exact; and what it multiplies (N, 3) float64,
radiance, 0 where there is nothing, not a number where it is not known; for 0 samples only that."""


@dataclass(frozen=True)
class Seen:
    """P pixels by V view rays each. `truth` (estimates, P, V, channels), `multiplied` (P, V, 3)."""

    truth: np.ndarray
    multiplied: np.ndarray


def seen(
    probed: Probed, truth: Truth, pixels: np.ndarray, views: int, samples: int, seed: int, sets: int = 1
) -> Generator[None, None, Seen]:
    """`sets` times `views` rays through each pixel, each set spread over its footprint by itself. Raises
    ValueError where the truth is not finite."""
    step, found = max(RAYS_AT_ONCE // (views * sets), 1), []
    for number, start in enumerate(range(0, len(pixels), step)):
        part = pixels[start : start + step]
        parts = []
        for each in range(sets):
            own = int(hash_bits(seed, number, each))
            rays = probed.look(part, views, own)
            parts.append(checked(truth(rays, samples, int(hash_bits(own, 1))), len(rays)))
        shape = len(part), views
        values = [value.reshape(len(value), *shape, -1) for value, _ in parts]
        light = [light.reshape(*shape, 3) for _, light in parts]
        found.append((np.concatenate(values, axis=2), np.concatenate(light, axis=1)))
        yield
    if not found:
        channels = probed.image.reshape(*probed.image.shape[:2], -1).shape[2]
        return Seen(np.zeros((1, 0, views * sets, channels)), np.zeros((0, views * sets, 3)))
    return Seen(
        np.concatenate([value for value, _ in found], axis=1),
        np.concatenate([light for _, light in found], axis=0),
    )


def checked(told: tuple[np.ndarray, np.ndarray], count: int) -> tuple[np.ndarray, np.ndarray]:
    """What a truth returned; a broken one must not look like an error of the layer."""
    values, light = (np.asarray(each, np.float64) for each in told)
    if values.ndim != 3 or values.shape[1] != count or len(values) not in (1, 2):
        raise ValueError(f"a reference returned {values.shape}, not (1 or 2, {count}, channels)")
    if light.shape != (count, 3):
        raise ValueError(f"a reference returned light {light.shape}, not ({count}, 3)")
    if not (np.isfinite(values).all() and not np.isinf(light).any()):
        raise ValueError("a reference returned values that are not finite")
    return values, light
