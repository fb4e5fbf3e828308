"""How wrong a layer is that adds light: at the delivered pixel, against the mean of many view rays over its
footprint, as a share of the brightness there. docs/accuracy.md has the method."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..core.metrics import maximum, mean_brightness, quantile
from ..core.params import Params
from ..core.random import hash_bits
from ..core.view_rays import ViewRays
from .error_image import ErrorImage, error_image
from .estimate import Compared, sampled_part
from .footprint import Probed
from .interval import joined, limits
from .report import LayerError
from .strata import NEARBY, Difficulty, Stratum, finite, image_codes
from .survey import allot, shared_looks

RAYS_AT_ONCE = 32
VIEWS = {Difficulty.EDGE: 8, Difficulty.REST: 1}
"""View rays of each half of a pixel."""
IMAGE_VIEWS = 1, 7
"""The same of an error image, and how many more where the halves disagree."""
SCALE_PIXELS = 256
"""Looked at for the mean brightness of an error image."""

ROUNDING = 1e-12  # of a sum of pixels in float64, generously
CHANGING = 4.0  # how much more likely errors are where the layer's values change nearby
UNSEEN = 0.25
"""Square of what a bad pixel is off by that is black where it should be as bright as the mean."""
MANY = 32
"""Pixels that tell what others like them may be."""
METHOD_PIXELS = 1.0 / 16.0  # for each probe, whose samples are compared one by one

Along = Callable[[ViewRays, int], np.ndarray]
"""along(view_rays, seed): the truth there, (1 or 2, N, channels) float64, one if it is exact."""


@dataclass(frozen=True)
class ImageScore:
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
    probe_seconds: float = 2e-3
    pixel_seconds: float = 2e-3

    def along(self, probed: Probed) -> Along:
        """The reference, for this layer."""

        def along(view_rays: ViewRays, seed: int) -> np.ndarray:
            told = self.reference(probed.rays, probed.outline, probed.layer, view_rays, seed)
            return checked_estimates(told, len(view_rays))

        return along


@dataclass(frozen=True)
class LightScore(ImageScore):
    """Of light that is added: the root mean square, over all pixels, of (layer - truth) / (truth + mean
    truth), the mean over channels."""

    metric: ClassVar[str] = "in use, added"

    def measure(self, probed: Probed, probes: int, seed: int) -> Generator[None, None, LayerError]:
        return _measured(probed, probes * self.looks, self.along(probed), self.reference_name, seed)

    def error_image(
        self, probed: Probed, seed: int, show: Callable[[int], None]
    ) -> Generator[None, None, ErrorImage]:
        size, along = probed.image.shape[:2], self.along(probed)
        flat = finite(probed.image.reshape(size[0] * size[1], -1))
        generator = np.random.Generator(np.random.PCG64(seed))
        looked = generator.permutation(len(flat))[:SCALE_PIXELS]
        truth = yield from halves_of(probed, along, looked, 1, int(hash_bits(seed, 1)), RAYS_AT_ONCE)
        bias = float((flat[looked] - truth.mean(axis=0)).mean())
        mean = abs(float(flat.mean()) - bias) or abs(float(flat.mean())) or 1.0

        def halves(pixels: np.ndarray, views: int, seed: int) -> Generator[None, None, np.ndarray]:
            truth = yield from halves_of(probed, along, pixels, views, seed, RAYS_AT_ONCE)
            shares = Compared(len(pixels), flat[pixels], truth).as_shares(mean)
            return (shares.values - shares.estimates).swapaxes(0, 1) / math.sqrt(flat.shape[1])

        return (yield from error_image(halves, size, IMAGE_VIEWS, seed, show))

    def rms(self, value: float) -> float:
        return value

    def lowered_by(self, params: Params | None, error: LayerError) -> tuple[str, ...]:
        return by_cause(params, error)


def by_cause(params: Params | None, error: LayerError) -> tuple[str, ...]:
    """Settings that lower an error: samples first where most of it is aliasing."""
    settings = params.finer() if params is not None else ()
    is_aliasing = (error.sampling or 0.0) > (error.method or 0.0)
    return ("samples", *settings) if is_aliasing else (*settings, "samples")


def checked_estimates(estimates: np.ndarray, count: int) -> np.ndarray:
    """What a reference returned, (estimates, N, channels); a broken one must not look like an error of the
    layer."""
    estimates = np.asarray(estimates, np.float64)
    if estimates.ndim != 3 or estimates.shape[1] != count or len(estimates) not in (1, 2):
        raise ValueError(f"a reference returned {estimates.shape}, not (1 or 2, {count}, channels)")
    if not np.isfinite(estimates).all():
        raise ValueError("a reference returned values that are not finite")
    return estimates


def image_strata(probed: Probed, seed: int) -> list[Stratum]:
    """Of a layer of light, or of a mask."""
    return probed.strata(lambda: image_codes(probed.image), seed)


def _measured(probed: Probed, probes: int, along: Along, name: str, seed: int):
    pixels = probed.image.shape[0] * probed.image.shape[1]
    flat = finite(probed.image.reshape(pixels, -1))
    strata = image_strata(probed, seed)
    yield
    mean = float(np.abs(flat).mean())
    # Errors are expected to follow the values, and in dark pixels to be no smaller than in the mean one.
    wishes = []
    for each in strata:
        bright = np.abs(flat[each.members]).mean()
        likely = CHANGING if each.difficulty == Difficulty.EDGE else 1.0
        wishes.append(each.population * likely * max((bright / (bright + mean + 1e-300)) ** 2, UNSEEN))
    populations, looks = [each.population for each in strata], []
    if strata:
        first = along(probed.look(strata[0].chosen(1), 1, seed), seed)
        # Only what is not known exactly is worth a second look.
        looks = shared_looks(probes, populations, populations, wishes, again=len(first) > 1)
    compared, chosen_of = [], []
    for number, (stratum, (count, again)) in enumerate(zip(strata, looks, strict=True)):
        chosen, own = np.sort(stratum.chosen(count)), int(hash_bits(seed, number))
        views = VIEWS[stratum.difficulty] * again
        halves = yield from halves_of(probed, along, chosen, views, own, RAYS_AT_ONCE)
        compared.append(Compared(stratum.population, flat[chosen], halves))
        chosen_of.append(chosen)
    bias = math.fsum(each.population * float(each.errors.mean()) for each in compared) / pixels
    # The truth's mean: the layer's, which is known exactly, less its mean error; its own where that is black,
    # up to rounding.
    sizes, total = np.abs(flat).mean(axis=1), float(flat.mean())
    capped = mean_brightness(sizes) / (float(sizes.mean()) or 1.0) or 1.0
    known = abs(total - bias)
    if known < ROUNDING * abs(total):
        known = 0.0
    mean = capped * known or abs(total) or 1.0
    shares = [each.as_shares(mean) for each in compared]
    swings = [_swing(probed, chosen, mean) for chosen in chosen_of]
    part = joined(map(sampled_part, shares, _worst(shares, strata, swings)))
    value = root(part.total, pixels)
    low, high = (root(limit, pixels) for limit in limits(part))
    errors, sampling = pooled(shares)
    method = yield from _method(probed, strata, max(int(METHOD_PIXELS * probes), 4), along, mean, seed)
    ones = np.ones_like(errors)
    return LayerError(
        metric=LightScore.metric,
        value=value,
        ci95=(low, high),
        bias=bias / mean,
        p99=quantile(errors, ones, 0.99, sampling),
        max=maximum(errors, ones),
        probes=len(errors),
        reference=name,
        reference_noise=root(sum(each.noise for each in shares), pixels),
        seconds=0.0,
        method=method,
        sampling=None if method is None else math.sqrt(max(value**2 - method**2, 0.0)),
    )


def _worst(shares: list[Compared], strata: list[Stratum], swings: list[np.ndarray]) -> list[float]:
    """Square of what one more bad pixel of each stratum may be off by. Where the layer changes: by as much
    (`swings`, see _swing). Where it is smooth a wrong pixel has wrong neighbours, and the worst of many that
    were looked at tells how wrong they are; of few, that one may be black which should be as bright as the
    mean."""
    is_smooth = [stratum.difficulty == Difficulty.REST for stratum in strata]
    smooth = [each.squares for each, is_one in zip(shares, is_smooth, strict=True) if is_one]
    squares = np.concatenate([np.zeros(1), *smooth])
    seen, is_known = float(squares.max()), len(squares) > MANY
    worst = []
    for each, is_one, swing in zip(shares, is_smooth, swings, strict=True):
        own = max(float((each.values**2).mean()), UNSEEN) if is_one and not is_known else 0.0
        worst.append(seen if is_one and is_known else max(own, float((swing**2).mean())))
    return worst


def _swing(probed: Probed, pixels: np.ndarray, mean: float) -> np.ndarray:
    """(P,) of `pixels`: how far off one is that shows the brightest of what the layer holds within two
    pixels where the darkest is true."""
    height, width = probed.image.shape[:2]
    rows, columns = np.divmod(pixels.astype(np.int64)[:, None], width)
    steps = np.stack(np.meshgrid(*[np.arange(-NEARBY, NEARBY + 1)] * 2), axis=-1).reshape(-1, 2)
    rows, columns = np.clip(rows + steps[:, 0], 0, height - 1), np.clip(columns + steps[:, 1], 0, width - 1)
    window = np.abs(finite(probed.image[rows, columns])).reshape(*rows.shape, -1).mean(axis=2)
    darkest = window.min(axis=1)
    return (window.max(axis=1) - darkest) / (darkest + mean)


def halves_of(
    probed: Probed, along: Along, pixels: np.ndarray, views: int, seed: int, rays_at_once: int
) -> Generator[None, None, np.ndarray]:
    """(2, P, channels): the truth of `pixels`, twice, by `views` rays each. Yields after as many rays."""
    step, found = max(rays_at_once // views, 1), []
    for start in range(0, len(pixels), step):
        part, halves = pixels[start : start + step], []
        for half in range(2):
            own = int(hash_bits(seed, start, half))
            told = along(probed.look(part, views, own), int(hash_bits(own, 1)))
            halves.append(told.mean(axis=0).reshape(len(part), views, -1).mean(axis=1))
            yield
        found.append(np.array(halves))
    return np.concatenate(found, axis=1)


def _method(probed: Probed, strata: list[Stratum], pixels: int, along: Along, mean: float, seed: int):
    """RMS of the effect's own error, at pixels whose samples were kept: each sample against the truth along
    its own view ray; half of them where the layer changes. None where none were kept."""
    kept = probed.samples
    if kept is None or not len(kept.pixels):
        return None
    changes = np.zeros(probed.image.shape[0] * probed.image.shape[1], bool)
    for each in strata:
        changes[each.members] = each.difficulty == Difficulty.EDGE
    changes = changes[kept.pixels]
    groups = [group for group in (np.flatnonzero(changes), np.flatnonzero(~changes)) if len(group)]
    samples, total = len(kept.values), 0.0
    counts = allot(pixels, [len(each) for each in groups], [1.0] * len(groups))
    for members, count in zip(groups, counts, strict=True):
        chosen, squares = members[np.linspace(0, len(members) - 1, count).astype(int)], []
        for index in chosen:
            places = np.repeat(probed.places(kept.pixels[[index]]), samples, axis=0)
            rays = probed.rays.look(places, kept.jitter[:, index], np.arange(samples))
            found = along(rays, int(hash_bits(seed, 7, index))).mean(axis=1)
            first, last = found[0], found[-1]
            value = finite(kept.values[:, index]).mean(axis=0)
            whole = np.abs(0.5 * (first + last)).mean() + mean
            squares.append(float(((value - first) * (value - last)).mean()) / whole**2)
            yield
        total += len(members) * float(np.mean(squares))
    return math.sqrt(max(total, 0.0) / len(kept.pixels))


def pooled(compared: list[Compared], largest_channel: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Sizes of the errors of all probes (N,), over channels root mean square or the largest, and how many
    pixels each probe stands for (N,)."""
    errors = [
        np.abs(each.errors).max(axis=1) if largest_channel else np.sqrt((each.errors**2).mean(axis=1))
        for each in compared
    ]
    sampling = [np.full(len(each.values), each.population / max(len(each.values), 1)) for each in compared]
    return np.concatenate([np.zeros(0), *errors]), np.concatenate([np.zeros(0), *sampling])


def root(total: float, pixels: int) -> float:
    """RMS of squares over all pixels."""
    return math.sqrt(max(total, 0.0) / pixels) if pixels else 0.0
