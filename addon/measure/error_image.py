"""How far a layer is off at every pixel, as an image: the error whose root mean square its report tells."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np

from ..core.random import hash_bits

PIXELS_AT_ONCE = 1 << 10
"""Memory is for so many, not for the image."""
AGREED = 0.005
"""Pixels of which rays know the error to within this are not looked at again."""


@dataclass(frozen=True)
class ErrorImage:
    """`pixels` (height, width) float32: sizes of errors with the rays' noise in them, so that their mean
    square is larger by the square of `noise`, the root mean square of that over the pixels. `rays`: view rays
    of a pixel, the fewest and the mean."""

    pixels: np.ndarray
    noise: float
    rays: tuple[int, float]
    metric: str
    """What a pixel's number is, in words."""
    seconds: float = 0.0


Halves = Callable[[np.ndarray, int, int], Generator[None, None, np.ndarray]]
"""halves(pixels, views, seed): errors (P, 2, K) of pixels (P,), numbered row by row, by `views` rays in each
of two independent halves."""


def error_image(
    halves: Halves,
    size: tuple[int, int],
    views: tuple[int, int],
    seed: int,
    show: Callable[[int], None],
    metric: str = "error in use, a share of the brightness",
    order: float = 2.0,
) -> Generator[None, None, ErrorImage]:
    """Of `size`, height and width. `views`: of each half of every pixel, and how many more where the halves
    disagree; `metric`: in words; `order`: of the norm over an error's numbers; `show` is told of pixels as
    they are done."""
    total = size[0] * size[1]
    found, squares, looks = np.zeros(total, np.float32), 0.0, 0
    first, more = views
    for number, start in enumerate(range(0, total, PIXELS_AT_ONCE)):
        part = np.arange(start, min(start + PIXELS_AT_ONCE, total), dtype=np.uint32)
        errors = yield from halves(part, first, int(hash_bits(seed, number, 0)))
        variances = _variances(errors, order)
        unsure = np.flatnonzero(variances > AGREED**2)
        if len(unsure):
            again = yield from halves(part[unsure], more, int(hash_bits(seed, number, 1)))
            errors[unsure] += more / (first + more) * (again - errors[unsure])
            variances[unsure] = _variances(errors[unsure], order)
        found[start : start + len(part)] = np.linalg.norm(errors.mean(axis=1), order, axis=1)
        squares += float(variances.sum())
        looks += 2 * (first * len(part) + more * len(unsure))
        show(len(part))
    noise, mean = math.sqrt(squares / max(total, 1)), looks / max(total, 1)
    return ErrorImage(found.reshape(size), noise, (2 * first, mean), metric)


def _variances(errors: np.ndarray, order: float) -> np.ndarray:
    """(P,) of the mean of both halves, in the norm's numbers together."""
    return np.linalg.norm(0.5 * (errors[:, 0] - errors[:, 1]), order, axis=1) ** 2
