"""How noisy what is on screen is: its distance to a picture of any number of pixels and samples, estimated
from it alone.

Root mean square differences over all pixels, each as a share of the brightness there, where it is darker than
the mean of the mean: no pixel beside a lamp outweighs the rest. They leave out how far that other picture is
from the truth: the bake measures that, its error.
"""

from __future__ import annotations

import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
MOST_PIXELS = 1 << 17
WELL_SPREAD = 0.4
"""A whole set of samples errs by so much of what as many independent ones would. With 4 to 16 samples of
four sample scenes against 64, noise told this way is 0.9 to 1.1 of the true one, and 0.7 among the leaves of
the courtyard."""


def resolution_noise(picture: np.ndarray) -> float:
    """Of a coarse picture (height, width[, 4]): what it would lose by halving its size once more. Around an
    edge each finer octave holds half the energy of the one before, so that all octaves that the picture
    lacks hold about as much as its own last one."""
    grey = _luminance(picture)
    height, width = grey.shape[0] // 2 * 2, grey.shape[1] // 2 * 2
    if not height or not width:
        return 0.0
    blocks = grey[:height, :width].reshape(height // 2, 2, width // 2, 2)
    means = blocks.mean(axis=(1, 3), keepdims=True)
    return _share(np.mean((blocks - means) ** 2, axis=(1, 3)), means[:, 0, :, 0])


def sampling_noise(mean: np.ndarray, squares: np.ndarray, samples: int, of_samples: int) -> float:
    """Of the mean of the first `samples` out of `of_samples`, by the spread among them. Two parts: the
    distance to the mean of all, which is the standard error of a sample drawn without putting back (Cochran,
    Sampling Techniques, eq. 2.15), and what all together err by. `mean` and `squares` are means over samples,
    (height, width[, 4]). With one sample there is no spread to know it by: as much as is lost by halving the
    picture's size."""
    if samples == 1:
        return resolution_noise(mean)
    step = max(1, int(np.sqrt(mean.shape[0] * mean.shape[1] / MOST_PIXELS)))
    mean, squares = mean[::step, ::step], squares[::step, ::step]
    return _share(_wrong(mean, squares, samples, of_samples), _luminance(mean))


def noise_shares(mean: np.ndarray, squares: np.ndarray, samples: int, of_samples: int) -> np.ndarray:
    """(height, width): the same of each pixel, of which there are at least 2 samples. Few samples may agree
    by chance: squared noise is the mean of that of 3 by 3 pixels."""
    with np.errstate(over="ignore", invalid="ignore"):
        wrong = _around(_wrong(mean, squares, samples, of_samples))
        brightness = np.abs(_luminance(mean))
        usable = brightness[np.isfinite(brightness)]
        typical = float(usable.mean(dtype=np.float64)) if usable.size else 0.0
        return np.sqrt(wrong) / np.maximum(brightness, max(typical, 1e-30))


def _wrong(mean: np.ndarray, squares: np.ndarray, samples: int, of_samples: int) -> np.ndarray:
    """Squared noise of each pixel's luminance."""
    spread = np.maximum(squares - mean * mean, 0.0) * (samples / (samples - 1.0))
    return _luminance(spread * (1.0 / samples - 1.0 / of_samples + WELL_SPREAD**2 / of_samples))


def _around(image: np.ndarray) -> np.ndarray:
    """The mean over 3 by 3 pixels; a border's pixels stand for those beyond it."""
    for axis in (0, 1):
        padded = np.pad(image, [(1, 1) if each == axis else (0, 0) for each in (0, 1)], mode="edge")
        length = image.shape[axis]
        image = sum(padded.take(range(first, first + length), axis) for first in range(3)) / np.float32(3.0)
    return image


def _luminance(picture: np.ndarray) -> np.ndarray:
    return picture if picture.ndim == 2 else picture[..., :3] @ LUMINANCE


def _share(wrong: np.ndarray, brightness: np.ndarray) -> float:
    """Root of the mean of squared differences, each over its squared brightness."""
    brightness = np.abs(brightness)
    usable = np.isfinite(wrong) & np.isfinite(brightness)
    wrong, brightness = wrong[usable].astype(np.float64), brightness[usable].astype(np.float64)
    mean = float(brightness.mean()) if brightness.size else 0.0
    return float(np.sqrt(np.mean(wrong / np.maximum(brightness, mean) ** 2))) if mean > 0.0 else 0.0
