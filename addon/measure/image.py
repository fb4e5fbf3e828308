"""How wrong a layer of light or a mask is, by a reference along random view rays. docs/accuracy.md explains
the method.

The image is divided into strata by how large the layer's values are and whether they change nearby. A simple
random sample of each is compared with the reference.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..core.graph import PlannedLayer
from ..core.metrics import WRONG, maximum, quantile
from ..core.outline import Outline
from ..core.params import Params
from ..core.random import hash_bits
from ..core.sampling import footprints
from ..core.shot import Shot
from ..core.view_rays import ViewRays, view_rays
from .difficulty import KIND_BITS, Difficulty, largest_nearby, near_jumps
from .estimate import Compared, sampled_part
from .interval import joined, limits
from .probes import Band, Probed, ProbeStratum, finite
from .report import LayerError
from .survey import allot, shared_looks

RAYS_AT_ONCE = 128  # view rays of one call of a reference of light
PIXELS_AT_ONCE = 32  # of one call of a mask's reference
SUPERSAMPLES = 64
"""View rays of a pixel of a mask, half of them for each of two independent estimates."""

SLIGHT = 0.01  # of a radiance, what `share_off_by_1_percent` counts from
NEARLY_BLACK = 0.01  # of a layer's mean: less light than this counts as this when errors are compared with it

CHANGING = 4.0  # how much more likely errors are where the layer's values change nearby

LightReference = Callable[[ProbeStratum, int], np.ndarray]
"""reference(pixels, seed): (estimates, N, channels) float64, one or two, at the first sample's points."""

Look = Callable[[np.ndarray, np.ndarray], ViewRays]
"""look(pixels, jitter): view rays through pixels (N, 2) beside their centres (N, 2)."""

Measuring = Generator[None, None, LayerError]
"""Yields between slices of work."""


@dataclass(frozen=True)
class WatchedImage:
    """A layer of light, or a mask, of the whole image. `looks`: pixels for each probe that is asked for."""

    name: str
    effect: str
    attributes: tuple[str, ...]
    looks: int = 1

    def codes(self, band: Band, values: np.ndarray) -> np.ndarray:
        values = values[..., None] if values.ndim == 2 else values
        sizes = np.abs(np.where(np.isfinite(values), values, np.float32(0.0)))
        edges = band.silhouettes.copy()
        for channel in range(sizes.shape[2]):
            edges |= near_jumps(sizes[..., channel])
        # What is dark beside a bright pixel may be wrong by as much as that one.
        brightest = largest_nearby(sizes.max(axis=2))
        # The upper seven bits of a positive float are its exponent, halved: factors of 4.
        code = (brightest.view(np.uint32) >> np.uint32(24)).astype(np.uint16)
        code <<= KIND_BITS
        code |= np.where(edges, np.uint16(Difficulty.EDGE), np.uint16(Difficulty.REST))
        return code.reshape(-1)

    def pixels_per_probe(self, difficulty: Difficulty) -> int:
        return self.looks


@dataclass(frozen=True)
class _ImageScore:
    """`reference(rays, outline, layer, view_rays, seed)` is the slow, independent truth: what the layer
    should hold along each of `view_rays` (core/view_rays.py), (estimates, N, channels) float64, all finite;
    one estimate where it is exact, two independent ones where it is random. Pixels of no surface count too.
    `reference_name` says in words what it is ("ray marched, 2 x 64 steps").

    `rays` is a RayCaster (core/device.py); the layer knows its light, its casters and its effect's
    parameters. Calls come in batches of at most a few thousand view rays, each with its own `seed`, and
    should take some hundredths of a second: in a window they run between redraws.

    `looks`: pixels looked at for each probe that was asked for; more than 1 where the reference is cheap.
    `probe_seconds`: see core/score.py.
    """

    reference: Callable
    reference_name: str = ""
    looks: int = 1
    probe_seconds: float = 1e-3

    def watch(
        self, layer: PlannedLayer, outline: Outline, shot: Shot, attributes: tuple[str, ...]
    ) -> WatchedImage:
        return WatchedImage(layer.name, layer.effect, attributes, self.looks)

    def _along(self, probed: Probed) -> Callable[[ViewRays, int], np.ndarray]:
        def along(seen: ViewRays, seed: int) -> np.ndarray:
            return self.reference(probed.rays, probed.outline, probed.layer, seen, seed)

        return along


@dataclass(frozen=True)
class LightScore(_ImageScore):
    """Of light or a transmittance: the L2 norm of the error over the truth's mean, at the points of the first
    sample."""

    metric: ClassVar[str] = "relative l2"

    def measure(self, probed: Probed, probes: int, seed: int) -> Measuring:
        along, (width, height) = self._along(probed), probed.shot.computed_size

        def at_pixels(stratum: ProbeStratum, seed: int) -> np.ndarray:
            pixels = np.stack([stratum.pixels % width, stratum.pixels // width], axis=1).astype(np.int32)
            return along(view_rays(probed.shot, pixels, probed.jitter, stratum.surface), seed)

        return measure_light(
            probed.strata,
            probed.total,
            width * height,
            probes * self.looks,
            at_pixels,
            self.reference_name,
            seed,
        )

    def rms(self, value: float) -> float:
        return value

    def lowered_by(self, params: Params | None) -> tuple[str, ...]:
        return params.finer() if params is not None else ()


@dataclass(frozen=True)
class MaskScore(_ImageScore):
    """Of masks and pictures in flat colours: the share of wrong pixels. `reference` is asked at points inside
    the pixels: 64 view rays a pixel, drawn from the render's pixel filter, are averaged and compared with the
    finished image."""

    metric: ClassVar[str] = "share of wrong pixels"
    probe_seconds: float = 4e-3

    def measure(self, probed: Probed, probes: int, seed: int) -> Measuring:
        def scattered(pixels: int, samples: int, seed: int) -> np.ndarray:
            return footprints(probed.shot.pixel_filter, pixels, samples, seed)

        return measure_mask(
            probed.strata,
            probed.image,
            probes * self.looks,
            self._along(probed),
            probed.rays.look,
            scattered,
            self.reference_name,
            seed,
        )

    def rms(self, value: float) -> float:
        """As if each wrong pixel were off by just what makes it wrong."""
        return math.sqrt(value) * WRONG

    def lowered_by(self, params: Params | None) -> tuple[str, ...]:
        """The finished image is scored, so samples count; other layers' points are those of one sample."""
        return ("samples",)


def measure_light(
    strata: Sequence[ProbeStratum],
    total: float,
    pixels: int,
    probes: int,
    reference: LightReference,
    reference_name: str,
    seed: int,
) -> Measuring:
    """Relative L2 of a layer of `pixels` pixels whose values add up to `total` over pixels and channels, from
    ProbeCollector.strata."""
    strata = [_with_channels(each) for each in strata if len(each.pixels)]
    channels = strata[0].values.shape[1] if strata else 1
    mean = abs(total) / max(pixels * channels, 1)
    # What is summed are squares, so bright pixels count most: errors are expected to follow the values, and
    # in dark pixels to be no smaller than in the mean one.
    wishes = [
        each.population
        * (max(float((each.values**2).mean()), mean**2) or 1.0)
        * (CHANGING if each.difficulty == Difficulty.EDGE else 1.0)
        for each in strata
    ]
    sizes, populations = [len(each.pixels) for each in strata], [each.population for each in strata]
    looks = []
    if strata:
        # Only what is not known exactly is worth a second look.
        first = _checked(reference(at(strata[0], np.arange(1)), seed), (1, channels))
        looks = shared_looks(probes, sizes, populations, wishes, again=len(first) > 1)
    compared = []
    for number, (stratum, (count, again)) in enumerate(zip(strata, looks, strict=True)):
        stratum, estimates = _smallest(stratum, count), []
        repeated = np.repeat(np.arange(count), again)
        for index, start in enumerate(range(0, len(repeated), RAYS_AT_ONCE)):
            part = at(stratum, repeated[start : start + RAYS_AT_ONCE])
            estimates.append(
                _checked(reference(part, int(hash_bits(seed, number, index))), part.values.shape)
            )
            yield
        halves = np.concatenate(estimates, axis=1).reshape(-1, count, again, channels).mean(axis=2)
        compared.append(Compared(stratum.population, stratum.values, halves))
    bias = math.fsum(each.population * float(each.errors.mean()) for each in compared) / max(pixels, 1)
    scale, scale_error = _scale(total / max(pixels * channels, 1), bias, compared, pixels)
    part = joined(sampled_part(each, max(float((each.values**2).mean()), scale**2)) for each in compared)
    value = _root(part.total, pixels) / scale
    low, high = (_root(limit, pixels) / scale for limit in limits(part))
    spread = 1.96 * scale_error / scale * value  # of the mean that it is divided by
    errors, sampling = _pooled(compared)
    truths = np.concatenate([np.zeros(0), *(each.magnitudes for each in compared)])
    off = errors > SLIGHT * np.maximum(truths, NEARLY_BLACK * scale)
    ones = np.ones_like(errors)
    return LayerError(
        metric=LightScore.metric,
        value=value,
        ci95=(max(value - math.hypot(value - low, spread), 0.0), value + math.hypot(high - value, spread)),
        bias=bias / scale,
        p99=quantile(errors, ones, 0.99, sampling) / scale,
        max=maximum(errors, ones) / scale,
        probes=len(errors),
        reference=reference_name,
        reference_noise=_root(sum(each.noise for each in compared), pixels) / scale,
        seconds=0.0,
        share_off_by_1_percent=float(sampling[off].sum()) / max(pixels, 1),
    )


def measure_mask(
    strata: Sequence[ProbeStratum],
    image: np.ndarray,
    probes: int,
    reference: Callable[[ViewRays, int], np.ndarray],
    look: Look,
    scattered: Callable[[int, int, int], np.ndarray],
    reference_name: str,
    seed: int,
) -> Measuring:
    """Share of the wrong pixels of a finished `image` (height, width[, channels]), from
    ProbeCollector.strata.

    `reference(view_rays, seed)`: (1 or 2, N, channels), of which the mean counts; `scattered(pixels,
    samples, seed)`: offsets as core/sampling.footprints.
    """
    pixels = image.shape[0] * image.shape[1]
    flat = finite(image.reshape(pixels, -1))
    strata = [each for each in strata if len(each.pixels)]
    totals = dict.fromkeys(Difficulty, 0)
    for each in strata:
        totals[each.difficulty] += each.population
    # Half of the probes go to where the layer changes, as far as there is use for them.
    wishes = [each.population / totals[each.difficulty] for each in strata]
    compared = []
    for number, stratum in enumerate(_chosen(strata, probes, wishes)):
        halves = []
        for index, start in enumerate(range(0, len(stratum.pixels), PIXELS_AT_ONCE)):
            chosen = stratum.pixels[start : start + PIXELS_AT_ONCE].astype(np.int64)
            own = int(hash_bits(seed, number, index))
            places = np.stack([chosen % image.shape[1], chosen // image.shape[1]], axis=1)
            coverage = []
            for half in range(2):
                jitter = scattered(len(chosen), SUPERSAMPLES // 2, int(hash_bits(own, half)))
                seen = look(np.repeat(places, SUPERSAMPLES // 2, axis=0), jitter.reshape(-1, 2))
                estimates = _checked(
                    reference(seen, int(hash_bits(own, 2 + half))), (len(seen), flat.shape[1])
                )
                coverage.append(
                    estimates.mean(axis=0).reshape(len(chosen), SUPERSAMPLES // 2, -1).mean(axis=1)
                )
                yield
            halves.append(np.array(coverage))
        values = flat[stratum.pixels]
        compared.append(Compared(stratum.population, values, np.concatenate(halves, axis=1)))
    errors, sampling = _pooled(compared, largest_channel=True)
    part = joined(sampled_part(_counted(each), 1.0) for each in compared)
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
        reference_noise=_root(sum(each.noise for each in compared), pixels),
        seconds=0.0,
        mean_absolute_error=float((sampling * means).sum()) / max(pixels, 1),
    )


def at(stratum: ProbeStratum, index: np.ndarray) -> ProbeStratum:
    """The same with the pixels `index` only."""
    columns = (column[index] for column in (stratum.pixels, stratum.priorities, stratum.values))
    surface = {name: array[index] for name, array in stratum.surface.items()}
    return ProbeStratum(stratum.code, stratum.population, *columns, surface)


def _with_channels(stratum: ProbeStratum) -> ProbeStratum:
    values = stratum.values.reshape(len(stratum.pixels), -1)
    return ProbeStratum(
        stratum.code, stratum.population, stratum.pixels, stratum.priorities, values, stratum.surface
    )


def _chosen(strata: Sequence[ProbeStratum], probes: int, wishes: Sequence[float]) -> list[ProbeStratum]:
    """Each stratum with the pixels that get a probe."""
    counts = allot(probes, [len(each.pixels) for each in strata], wishes)
    return [_smallest(each, count) for each, count in zip(strata, counts, strict=True)]


def _smallest(stratum: ProbeStratum, count: int) -> ProbeStratum:
    """The same with `count` pixels of smallest priority."""
    return at(stratum, np.sort(np.argsort(stratum.priorities, kind="stable")[:count]))


def _checked(estimates: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """What a reference returned, (estimates, N, channels); a broken reference must not look like an error of
    the layer."""
    estimates = np.asarray(estimates, np.float64)
    if estimates.ndim != 3 or estimates.shape[1:] != shape or estimates.shape[0] not in (1, 2):
        raise ValueError(f"a reference returned {estimates.shape}, not (1 or 2, {shape[0]}, {shape[1]})")
    if not np.isfinite(estimates).all():
        raise ValueError("a reference returned values that are not finite")
    return estimates


def _scale(mean: float, bias: float, compared: list[Compared], pixels: int) -> tuple[float, float]:
    """The truth's mean, which is the layer's exact mean less its mean error, and that one's standard error;
    where the truth is black, the layer's mean; 1 if both are."""
    variance = math.fsum(each.mean_error_variance for each in compared) / max(pixels, 1) ** 2
    truth = abs(mean - bias)
    if truth <= 1e-9 * abs(mean):
        return (abs(mean), 0.0) if mean else (1.0, 0.0)
    return truth, math.sqrt(variance)


def _pooled(compared: list[Compared], largest_channel: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Sizes of the errors of all probes (N,), over channels root mean square or the largest, and how many
    pixels each probe stands for (N,)."""
    errors = [
        np.abs(each.errors).max(axis=1) if largest_channel else np.sqrt((each.errors**2).mean(axis=1))
        for each in compared
    ]
    sampling = [np.full(len(each.values), each.population / max(len(each.values), 1)) for each in compared]
    return np.concatenate([np.zeros(0), *errors]), np.concatenate([np.zeros(0), *sampling])


def _counted(compared: Compared) -> Compared:
    """Its wrong pixels as errors of 1."""
    wrong = (np.abs(compared.errors).max(axis=1) > WRONG).astype(np.float64)[:, None]
    return Compared(compared.population, wrong, np.zeros((1, *wrong.shape)))


def _root(total: float, pixels: int) -> float:
    return math.sqrt(max(total, 0.0) / pixels) if pixels else 0.0
