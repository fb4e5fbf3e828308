"""What a layer's effect itself gets wrong: at pixels whose samples were kept, each compared with the truth
along the very view ray that it was made for."""

from __future__ import annotations

import math
from collections.abc import Generator

import numpy as np

from ..core.random import hash_bits
from ..core.view_rays import ViewRays
from .deviation import Scale
from .footprint import RAYS_AT_ONCE, Probed, Truth, checked
from .strata import SNAP, finite

MOST_PIXELS, MOST_SAMPLES = 4096, 1 << 16
"""Kept of a layer: pixels, and samples of all of them together."""
FEWEST_PIXELS = 64

RAYS = 32
"""Of each half at a pixel whose samples are not all alike, shared out to its samples."""


def pixels_to_keep(pixels: int, samples: int, seed: int) -> np.ndarray:
    """Ascending numbers of the pixels, drawn at random, whose samples are to be kept."""
    count = min(pixels, max(MOST_SAMPLES // samples, FEWEST_PIXELS), MOST_PIXELS)
    generator = np.random.Generator(np.random.PCG64(seed))
    return np.sort(generator.choice(pixels, count, replace=False))


def method_error(
    probed: Probed, truth: Truth, scale: Scale, probes: int, seed: int
) -> Generator[None, None, float | None]:
    """Root mean square, as a share of the brightness, of the sum over a pixel's samples of light x (value -
    truth); None where no samples were kept. Half of `probes` pixels are of those whose samples are not
    all 0 or all 1."""
    kept = probed.samples
    if kept is None or not len(kept.pixels):
        return None
    values = finite(kept.values)
    varied = ~((values <= SNAP).all(axis=(0, 2)) | (values >= 1.0 - SNAP).all(axis=(0, 2)))
    total = lit = 0.0
    for number, members in enumerate((np.flatnonzero(varied), np.flatnonzero(~varied))):
        chosen = members[: max(probes // 2, 1)]  # pixels were drawn at random, and lie row by row
        if len(members) > len(chosen) > 0:
            chosen = members[np.linspace(0, len(members) - 1, len(chosen)).astype(int)]
        if not len(chosen):
            continue
        found = yield from _compared(probed, truth, scale, chosen, int(hash_bits(seed, 5, number)))
        squares, is_lit = found
        total += len(members) * float(squares.mean())
        lit += len(members) * float(is_lit.mean())
    return math.sqrt(max(total, 0.0) / lit) if lit else 0.0


def _compared(probed, truth, scale, chosen, seed) -> Generator[None, None, tuple[np.ndarray, np.ndarray]]:
    """Squares (P,) of the errors of kept pixels, and whether there is light."""
    kept, samples = probed.samples, len(probed.samples.values)
    rays, squares, is_lit = max(RAYS // samples, 1), [], []
    step = max(RAYS_AT_ONCE // samples, 1)
    for start in range(0, len(chosen), step):
        part = chosen[start : start + step]
        places = np.repeat(probed.places(kept.pixels[part]), samples, axis=0)
        jitter = kept.jitter[:, part].swapaxes(0, 1).reshape(-1, 2)
        numbers = np.tile(np.arange(samples), len(part))
        view_rays: ViewRays = probed.rays.look(places, jitter, numbers)
        halves = []
        for half in range(2):
            own = int(hash_bits(seed, start, half))
            halves.append(checked(truth(view_rays, rays, own), len(view_rays)))
        shape = len(part), samples
        values = finite(kept.values[:, part]).swapaxes(0, 1)  # (P, S, channels)
        errors = []
        for told, light in halves:
            light = scale.known(light.reshape(*shape, 3))
            wrong = values - told.mean(axis=0).reshape(*shape, -1)
            whole = scale.of(light.mean(axis=1)) + scale.mean
            by_channel = (wrong * light).mean(axis=1) / np.maximum(whole, 1e-300)[:, None]
            errors.append(scale.errors(by_channel, values.shape[2]))
        squares.append((errors[0] * errors[1]).sum(axis=1))
        is_lit.append(light.any(axis=(1, 2)))
        yield
    return np.concatenate(squares), np.concatenate(is_lit)
