"""How bright what a layer multiplies is in the mean: what its errors are shares of."""

from __future__ import annotations

import math
from collections.abc import Generator

import numpy as np

from ..core.metrics import BRIGHTEST, mean_brightness
from ..core.random import hash_bits
from .deviation import LIT_VIEWS, Scale
from .footprint import Probed, Truth, seen
from .strata import NOTHING, nearby

SCALE_PIXELS, SCALE_LIT, MOST_SCALE_PIXELS = 1024, 64, 1 << 16
"""Looked at for the mean brightness, and more until so many of them are lit, up to the last."""
SCALE_SETS = 2
"""Of LIT_VIEWS view rays each: they tell how sure it is."""


def scale_of(probed: Probed, truth: Truth, scale: Scale, seed: int) -> Generator[None, None, Scale]:
    """The mean light of what a layer multiplies: what rays find at some pixels, as a factor of what the
    layer's samples weighed if they did, whose mean is known."""
    pixels = probed.image.shape[0] * probed.image.shape[1]
    near, own_seed = np.ones(pixels, bool), int(hash_bits(seed, 1))
    if probed.weights is not None:
        weights = probed.weights.reshape(pixels, -1).mean(axis=1, dtype=np.float64)
        known = weights > NOTHING * weights.max(initial=0.0)
        weights[~known] = 0.0
        near = nearby(known.reshape(probed.image.shape[:2])).reshape(-1)
    generator = np.random.Generator(np.random.PCG64(seed))
    order, light, looked = generator.permutation(np.flatnonzero(near)), np.zeros((0, SCALE_SETS, 3)), 0
    # Where nothing is known of it, the light may fall on few pixels.
    while (
        looked < min(len(order), MOST_SCALE_PIXELS) and np.count_nonzero(light.any(axis=(1, 2))) < SCALE_LIT
    ):
        part = order[looked : looked + max(SCALE_PIXELS, looked)]
        own = int(hash_bits(own_seed, looked))
        found = yield from seen(probed, truth, part, LIT_VIEWS, 0, own, SCALE_SETS)
        found = np.nan_to_num(found.multiplied).reshape(len(part), SCALE_SETS, LIT_VIEWS, 3)
        light = np.concatenate([light, found.mean(axis=2)])
        looked += len(part)
    brightness, shown = scale.of(light), scale.shown(light)
    is_lit = brightness > 0.0
    if not is_lit.any():
        return scale.with_means(0.0, 0.0)
    sets = [mean_brightness(each[lit]) for each, lit in zip(brightness.T, is_lit.T, strict=True)]
    mean, shown_mean, share = float(np.mean(sets)), mean_brightness(shown[is_lit]), float(is_lit.mean())
    # By which of their rays pixels were looked at, and by which pixels.
    off = (np.minimum(brightness, BRIGHTEST * mean) - mean * is_lit) / (looked * share)
    variance = float(((off[:, 0] - off[:, 1]) ** 2).sum()) / 4.0
    own, left = brightness.mean(axis=1), 1.0 - looked / len(order)
    if probed.weights is not None and (weighed := mean_brightness(weights[order[:looked]])) > 0.0:
        # Samples may have missed what rays find in some pixels, but not on the whole.
        ratio = mean_brightness(own) / weighed
        variance += left * float(((own - ratio * weights[order[:looked]]) ** 2).sum()) / (looked * share) ** 2
        mean = mean_brightness(weights[near]) * ratio / share
    else:
        variance += left * float((off.mean(axis=1) ** 2).sum())
    return scale.with_means(mean, shown_mean, math.sqrt(variance) / mean)
