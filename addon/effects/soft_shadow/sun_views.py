"""Where a sun's casters are rasterised from: orthographic views, each window within the next."""

from __future__ import annotations

import numpy as np

from ...core.emitter import Emitter
from ...core.view import View
from .windows import LeftOut, NamedView, Window, padded

NEARER = 0.5
"""Share of the receivers, the nearest to the eye, that a sun's finer window is around."""

WORTH_A_WINDOW = 0.25
"""A finer window of a sun is taken if it has so small a part of the next larger one's area for each of its
receivers: if its texels are of a quarter of the size for as many pixels."""

MOST_NEARER = 3  # finer windows, each around NEARER of the receivers of the one before

VAST = 0.5
"""A caster wider than this share of everything is a ground, and no reason to spread a sun's texels thin."""


def sun_view(
    emitter: Emitter, casters: np.ndarray, receivers: np.ndarray, eye: np.ndarray | None
) -> tuple[list[NamedView], list[LeftOut]]:
    """Orthographic views of the casters, no wider than the receivers' bounds and the penumbra's reach, so
    that neither a vast ground nor casters far aside waste texels."""
    if not len(receivers):
        return [], [("map", "no receivers")]
    if not len(casters):
        return [], [("map", "no casters")]
    axes = np.array([emitter.right, emitter.up, emitter.forward])
    middle = 0.5 * (receivers[:, 0].min(axis=0) + receivers[:, 1].max(axis=0))
    spread = np.array([emitter.half_width, emitter.half_height])
    receiver_ranges, caster_ranges = _ranges(receivers - middle, axes), _ranges(casters - middle, axes)
    low, high, depths = _shadowing(receiver_ranges, caster_ranges, spread)
    if not len(low):
        return [], [("map", "no casters")]
    windows = _sun_windows(low, high)
    if eye is not None:
        windows = [
            *_nearer_windows(receivers, receiver_ranges, caster_ranges, spread, eye, windows[0]),
            *windows,
        ]
    nearest, farthest = depths
    margin = 1e-3 * (farthest - nearest)
    near, far = float(0.5 * margin), float(farthest - nearest + 2.0 * margin)
    lamp_axes = (emitter.right, emitter.up, emitter.forward)
    # One eye, so that all see a point alike: the finest window's middle, where single precision is best.
    across = 0.5 * (windows[0][0] + windows[0][1])
    centre = middle + (nearest - margin) * axes[2] + axes[:2].T @ across
    views = []
    for number, (low, high) in enumerate(windows):
        window = padded(low - across, high - across)
        view = View(tuple(centre.tolist()), *lamp_axes, window, near, far, orthographic=True)
        views.append((f"wide {number}" if number else "", view))
    return views, []


def _shadowing(receiver_ranges, caster_ranges, spread: np.ndarray):
    """Windows (C, 2) low and high of the casters that may shadow the receivers, as far as they may, and the
    least depth of these and the greatest of the receivers. Ranges are `_ranges` along a sun's axes."""
    receiver_low, receiver_high = receiver_ranges[0].min(axis=0), receiver_ranges[1].max(axis=0)
    caster_low, caster_high = caster_ranges
    # The disk's rays spread by its radius (a tangent) per metre between caster and receiver.
    reach = np.maximum(receiver_high[2] - caster_low[:, 2:], 0.0) * spread
    low = np.maximum(caster_low[:, :2], receiver_low[:2] - reach)
    high = np.minimum(caster_high[:, :2], receiver_high[:2] + reach)
    inside = (low <= high).all(axis=1) & (caster_low[:, 2] < receiver_high[2])
    depths = (caster_low[inside, 2].min(initial=np.inf), receiver_high[2])
    return low[inside], high[inside], depths


def _nearer_windows(receivers, receiver_ranges, caster_ranges, spread, eye, widest: Window) -> list[Window]:
    """Finer windows of a sun, smallest first: a city's texels are as wide as a cape's folds otherwise."""
    away = np.linalg.norm(0.5 * (receivers[:, 0] + receivers[:, 1]) - eye, axis=1)
    order, windows, count = np.argsort(away, kind="stable"), [widest], len(receivers)
    for halving in range(1, MOST_NEARER + 1):
        nearer = order[: int(len(order) * NEARER**halving)]
        if not len(nearer):
            break
        low, high, _ = _shadowing(tuple(edge[nearer] for edge in receiver_ranges), caster_ranges, spread)
        if not len(low):
            continue
        # Within the next: a point reads each map outside the next finer one.
        window = np.maximum(low.min(axis=0), windows[0][0]), np.minimum(high.max(axis=0), windows[0][1])
        size, next_size = window[1] - window[0], windows[0][1] - windows[0][0]
        if (size > 0.0).all() and size.prod() <= WORTH_A_WINDOW * len(nearer) / count * next_size.prod():
            windows.insert(0, window)
            count = len(nearer)
    return windows[:-1]


def _ranges(boxes: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest place (N, 3) of boxes (N, 2, 3) along each of `axes` (3, 3)."""
    middle, half = 0.5 * (boxes[:, 0] + boxes[:, 1]) @ axes.T, 0.5 * (boxes[:, 1] - boxes[:, 0]) @ abs(axes).T
    return middle - half, middle + half


def _sun_windows(low: np.ndarray, high: np.ndarray) -> list[Window]:
    """Around casters whose boxes seen from the sun are `low` and `high` (C, 2): one window around all, and
    before it a smaller one around all but the vast (the ground that a town stands on), if that helps."""
    whole = low.min(axis=0), high.max(axis=0)
    size = whole[1] - whole[0]
    compact = (high - low <= VAST * size).all(axis=1)
    if not compact.any():
        return [whole]
    inner = low[compact].min(axis=0), high[compact].max(axis=0)
    if np.prod(inner[1] - inner[0]) > 0.5 * np.prod(size):
        return [whole]
    return [inner, whole]
