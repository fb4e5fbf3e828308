"""How far what is on screen is from the converged picture: estimated, from that picture alone.

Both are root mean square differences over all pixels, relative to the root mean square of the picture. They
leave out how far the converged picture, which is the bake's, is from the truth: the bake measures that.
"""

from __future__ import annotations

import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
MOST_PIXELS = 1 << 17


def resolution_error(picture: np.ndarray) -> float:
    """Of a coarse picture (height, width[, 4]): what it would lose by halving its size once more. Around an
    edge each finer octave holds half the energy of the one before, so that all octaves that the picture
    lacks hold about as much as its own last one."""
    grey = _luminance(picture)
    height, width = grey.shape[0] // 2 * 2, grey.shape[1] // 2 * 2
    if not height or not width:
        return 0.0
    blocks = grey[:height, :width].reshape(height // 2, 2, width // 2, 2)
    lost = blocks - blocks.mean(axis=(1, 3), keepdims=True)
    return _relative(float(np.mean(lost * lost)), float(np.mean(blocks * blocks)))


def sampling_error(total: np.ndarray, squares: np.ndarray, samples: int, of_samples: int) -> float:
    """Of the mean of the first `samples` out of `of_samples`, by the spread among them: standard error of a
    sample drawn without putting back (Cochran, Sampling Techniques, eq. 2.15). `total` and `squares` are
    sums over samples, (height, width[, 4]). With one sample there is no spread to know it by: as much as is
    lost by halving the picture's size."""
    if samples >= of_samples:
        return 0.0
    if samples == 1:
        return resolution_error(total)
    step = max(1, int(np.sqrt(total.shape[0] * total.shape[1] / MOST_PIXELS)))
    total, squares = total[::step, ::step], squares[::step, ::step]
    mean = total / np.float32(samples)
    spread = np.maximum(squares / np.float32(samples) - mean * mean, 0.0) * (samples / (samples - 1.0))
    wrong = spread / samples * (1.0 - samples / of_samples)
    weights = LUMINANCE if mean.ndim == 3 else np.ones(1, np.float32)
    channels = slice(0, len(weights))
    if mean.ndim == 2:
        mean, wrong = mean[..., None], wrong[..., None]
    power = np.mean((mean[..., channels] ** 2) @ weights)
    return _relative(float(np.mean(wrong[..., channels] @ weights)), float(power))


def _luminance(picture: np.ndarray) -> np.ndarray:
    return picture if picture.ndim == 2 else picture[..., :3] @ LUMINANCE


def _relative(error: float, power: float) -> float:
    return float(np.sqrt(error / power)) if power > 0.0 and np.isfinite(error) else 0.0
