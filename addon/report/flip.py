"""How far two pictures are apart to somebody who flips between them: FLIP of Andersson, Nilsson,
Akenine-Möller, Oskarsson, Åström and Fairchild, A Difference Evaluator for Alternating Images, HPG 2020."""

from __future__ import annotations

import math

import numpy as np

PIXELS_PER_DEGREE = 67.0206
"""A screen of 3840 pixels over 0.7 m, seen from 0.7 m: the paper's own."""
CONTRAST = (((1.0, 0.0047), (0.0, 1e-5)), ((1.0, 0.0053), (0.0, 1e-5)), ((34.1, 0.04), (13.5, 0.025)))
"""Of eyes: Gaussians (height, width) of lightness, red to green, blue to yellow (eq. 4, table 1)."""
COLOUR_POWER, KNEE, KNEE_ERROR = 0.7, 0.4, 0.95
FEATURE_WIDTH, FEATURE_POWER = 0.082, 0.5  # degrees
TO_XYZ = np.array(
    [
        [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
        [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
        [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
    ]
)
"""Of linear sRGB."""
WHITE = TO_XYZ.sum(axis=1)


def flip(test: np.ndarray, reference: np.ndarray, per_degree: float = PIXELS_PER_DEGREE) -> np.ndarray:
    """(height, width) in [0, 1], of linear pictures (height, width, 3) in sRGB's primaries, clipped to
    [0, 1]."""
    both = [_opponent(np.clip(np.asarray(image, np.float64), 0.0, 1.0)) for image in (reference, test)]
    colour = _colour_error(*(_hunt(_seen(image, per_degree)) for image in both))
    feature = _feature_error(*((image[..., 0] + 16.0) / 116.0 for image in both), per_degree)
    return colour ** (1.0 - feature)


def _opponent(linear: np.ndarray) -> np.ndarray:
    """YCxCz of linear sRGB."""
    x, y, z = np.moveaxis(linear @ TO_XYZ.T / WHITE, -1, 0)
    return np.stack([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)], axis=-1)


def _linear(opponent: np.ndarray) -> np.ndarray:
    y = (opponent[..., 0] + 16.0) / 116.0
    xyz = np.stack([y + opponent[..., 1] / 500.0, y, y - opponent[..., 2] / 200.0], axis=-1) * WHITE
    return xyz @ np.linalg.inv(TO_XYZ).T


def _seen(opponent: np.ndarray, per_degree: float) -> np.ndarray:
    """As eyes blur it: linear sRGB in [0, 1]."""
    widest = max(width for gaussians in CONTRAST for _, width in gaussians)
    radius = math.ceil(3.0 * math.sqrt(widest / (2.0 * math.pi**2)) * per_degree)
    squares = (np.arange(-radius, radius + 1) / per_degree) ** 2
    channels = []
    for plane, gaussians in zip(np.moveaxis(opponent, -1, 0), CONTRAST, strict=True):
        total, found = 0.0, np.zeros_like(plane)
        for height, width in (each for each in gaussians if each[0]):
            line = np.exp(-(math.pi**2) * squares / width)
            weight = height * math.sqrt(math.pi / width)
            found += weight * _convolved(plane, line, line)
            total += weight * line.sum() ** 2
        channels.append(found / total)
    return np.clip(_linear(np.stack(channels, axis=-1)), 0.0, 1.0)


def _hunt(linear: np.ndarray) -> np.ndarray:
    """CIELAB whose colours fade in the dark (eq. 6)."""
    share = linear @ TO_XYZ.T / WHITE
    delta = 6.0 / 29.0
    root = np.where(share > delta**3, np.cbrt(share), share / (3.0 * delta**2) + 4.0 / 29.0)
    lightness = 116.0 * root[..., 1] - 16.0
    green = 500.0 * (root[..., 0] - root[..., 1])
    blue = 200.0 * (root[..., 1] - root[..., 2])
    return np.stack([lightness, 0.01 * lightness * green, 0.01 * lightness * blue], axis=-1)


def _distance(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """HyAB, to the power of the colour error."""
    off = first - last
    return (np.abs(off[..., 0]) + np.hypot(off[..., 1], off[..., 2])) ** COLOUR_POWER


def _colour_error(reference: np.ndarray, test: np.ndarray) -> np.ndarray:
    """In [0, 1]; most of the range is for small differences (eq. 8)."""
    most = float(_distance(_hunt(np.array([0.0, 1.0, 0.0])), _hunt(np.array([0.0, 0.0, 1.0]))))
    off, knee = _distance(reference, test), KNEE * most
    above = KNEE_ERROR + (off - knee) / (most - knee) * (1.0 - KNEE_ERROR)
    return np.where(off < knee, off * KNEE_ERROR / knee, above)


def _feature_error(reference: np.ndarray, test: np.ndarray, per_degree: float) -> np.ndarray:
    """Of edges and points in lightness (height, width)."""
    deviation = 0.5 * FEATURE_WIDTH * per_degree
    radius = math.ceil(3.0 * deviation)
    x = np.arange(-radius, radius + 1)
    bell = np.exp(-(x**2) / (2.0 * deviation**2))
    errors = []
    for line in (-x * bell, (x**2 / deviation**2 - 1.0) * bell):
        # The parts above and below 0 add up to 1 and -1 each.
        line = np.where(line > 0.0, line / line[line > 0.0].sum(), line / -line[line < 0.0].sum())
        sizes = [
            np.hypot(_convolved(plane, line, bell / bell.sum()), _convolved(plane, bell / bell.sum(), line))
            for plane in (reference, test)
        ]
        errors.append(np.abs(sizes[0] - sizes[1]))
    return (np.maximum(*errors) / math.sqrt(2.0)) ** FEATURE_POWER


def _convolved(plane: np.ndarray, across: np.ndarray, along: np.ndarray) -> np.ndarray:
    """With a line across the rows and one along the columns; borders go on as they are."""
    for axis, line in ((1, across), (0, along)):
        radius = len(line) // 2
        margin = [(radius, radius) if each == axis else (0, 0) for each in (0, 1)]
        padded, size = np.pad(plane, margin, mode="edge"), plane.shape[axis]
        plane = np.zeros_like(plane)
        for number, weight in enumerate(line):
            part = slice(number, number + size)
            plane += weight * (padded[:, part] if axis else padded[part])
    return plane
