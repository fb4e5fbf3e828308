"""What a colour ramp means, exactly as in Blender, in pieces that kernels and shaders can evaluate.

Whatever its modes, a ramp is a piecewise cubic polynomial in its position: splines are cubics, and along
a segment in which hue crosses no sixth of the circle (and lightness no half) HSV and HSL are products of
at most three linear terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...core.ramp import HuePath, Ramp, RampInterpolation, RampMode

SPLINES = (RampInterpolation.CARDINAL, RampInterpolation.B_SPLINE)
# Rows: weights of the stops right of the right one, the right, the left and left of the left one; columns:
# powers 0 to 3 of the position between them, which runs from the right stop (0) to the left (1).
TENSION = 0.71
SPLINE_WEIGHTS = {
    RampInterpolation.CARDINAL: np.array(
        [
            [0.0, -TENSION, 2.0 * TENSION, -TENSION],
            [1.0, 0.0, TENSION - 3.0, 2.0 - TENSION],
            [0.0, TENSION, 3.0 - 2.0 * TENSION, TENSION - 2.0],
            [0.0, 0.0, -TENSION, TENSION],
        ]
    ),
    RampInterpolation.B_SPLINE: np.array(
        [[1.0, -3.0, 3.0, -1.0], [4.0, 0.0, -6.0, 3.0], [1.0, 3.0, 3.0, -3.0], [0.0, 0.0, 0.0, 1.0]]
    )
    / 6.0,
}


@dataclass(frozen=True)
class RampTable:
    """Pieces in ascending order: `starts` (P,) float64, where each begins, and `coefficients` (P, 4, 4)
    float64, powers 0 to 3 of (position - start) by channel R, G, B, A. Below the first start that piece's
    value at its start holds. `clamps`: values are cut to 0 to 1 (a spline may swing beyond its stops)."""

    starts: np.ndarray
    coefficients: np.ndarray
    clamps: bool

    def evaluate(self, position) -> np.ndarray:
        """(..., 4) float64."""
        position = np.asarray(position, np.float64)
        piece = np.maximum(np.searchsorted(self.starts, position, side="right") - 1, 0)
        x = np.maximum(position - self.starts[piece], 0.0)[..., None]
        c = self.coefficients[piece]
        value = c[..., 0, :] + x * (c[..., 1, :] + x * (c[..., 2, :] + x * c[..., 3, :]))
        return np.clip(value, 0.0, 1.0) if self.clamps else value

    def packed(self) -> np.ndarray:
        """(P, 17) float32 rows: start, then coefficients by power and channel, for kernels and shaders."""
        rows = np.concatenate([self.starts[:, None], self.coefficients.reshape(-1, 16)], axis=1)
        return rows.astype(np.float32)


def table_of(ramp: Ramp) -> RampTable:
    """The pieces (Blender's BKE_colorband_evaluate)."""
    positions = np.array([position for position, _ in ramp.stops])
    colours = np.array([colour for _, colour in ramp.stops], np.float64)
    interpolation = ramp.interpolation if ramp.mode == RampMode.RGB else RampInterpolation.LINEAR
    if len(colours) == 1:
        return _joined([(0.0, 1.0, _constant(colours[0]))], False)
    if interpolation in SPLINES:
        return _joined(_spline_pieces(positions, colours, SPLINE_WEIGHTS[interpolation]), True)
    # Up to the first stop and from the last one on, their colours.
    pieces = [(-1.0, positions[0], _constant(colours[0]))]
    if positions[1] == positions[0]:
        # At its very position the first of several stops counts, beyond it the last of them.
        beyond = float(np.nextafter(np.float32(positions[0]), np.float32(2.0)))
        pieces = [(-1.0, beyond, _constant(colours[0]))]
        positions = np.maximum(positions, beyond)
    for left in range(len(colours) - 1):
        low, high = positions[left : left + 2]
        pair = colours[left], colours[left + 1]
        if interpolation == RampInterpolation.CONSTANT:
            pieces.append((low, high, _constant(pair[0])))
        elif interpolation == RampInterpolation.EASE:
            rise = pair[1] - pair[0]
            pieces.append((low, high, np.stack([pair[0], 0.0 * rise, 3.0 * rise, -2.0 * rise])))
        elif ramp.mode == RampMode.RGB:
            pieces.append((low, high, np.stack([pair[0], pair[1] - pair[0], *np.zeros((2, 4))])))
        else:
            pieces += _hue_pieces(low, high, *pair, ramp.mode, ramp.hue)
    return _joined([*pieces, (positions[-1], np.inf, _constant(colours[-1]))], False)


def _constant(colour: np.ndarray) -> np.ndarray:
    return np.stack([colour, *np.zeros((3, 4))])


def _joined(pieces, clamps: bool) -> RampTable:
    """`pieces`: (start, end, coefficients (4, 4) of the share of the way from start to end)."""
    starts, tables = [], []
    for start, end, coefficients in pieces:
        if end > start:
            length = end - start if np.isfinite(end) else 1.0
            starts.append(start)
            tables.append(coefficients / length ** np.arange(4)[:, None])
    return RampTable(np.array(starts), np.array(tables), clamps)


def _spline_pieces(positions: np.ndarray, colours: np.ndarray, weights: np.ndarray):
    """Splines bend before the first stop too, and after the last one, towards stops repeated at 0 and 1."""
    count = len(positions)
    pieces = []
    for right in range(count + 1):
        low = positions[right - 1] if right > 0 else 0.0
        high = positions[right] if right < count else 1.0
        at_right, at_left = min(right, count - 1), max(right - 1, 0)
        stops = colours[[min(at_right + 1, count - 1), at_right, at_left, max(at_left - 1, 0)]]
        if right == count:
            stops[0] = stops[1]
        backwards = np.einsum("kp,kc->pc", weights, stops)  # of 1 - share
        pieces.append((low, high, _reversed(backwards)))
    # What lies at the very end, or beyond.
    end = pieces[-1][2].sum(axis=0) if positions[-1] < 1.0 else _at_one(positions, colours, weights)
    return [*pieces, (1.0, np.inf, _constant(end))]


def _at_one(positions, colours, weights) -> np.ndarray:
    """A spline's value at 1 where the last stop lies there: the left end of a piece of no length."""
    last, before = colours[-1], colours[max(len(colours) - 2, 0)]
    return np.einsum("k,kc->c", weights.sum(axis=1), np.stack([last, last, last, before]))


def _reversed(c: np.ndarray) -> np.ndarray:
    """Coefficients of p(1 - x)."""
    return np.stack([c.sum(axis=0), -(c[1] + 2 * c[2] + 3 * c[3]), c[2] + 3 * c[3], -c[3]])


def _hue_ends(h1: float, h2: float, path: HuePath) -> tuple[float, float]:
    """Hues of the left (h1) and right stop such that going straight between them takes the path."""
    # Blender looks from the right stop, so that its words are as seen from there.
    right, left = h2 % 1.0, h1 % 1.0
    mode = 0
    if path == HuePath.NEAR:
        mode = 1 if left - right > 0.5 else 2 if left - right < -0.5 else 0
    elif path == HuePath.FAR:
        if left >= right and left - right < 0.5:
            mode = 1
        elif left < right and left - right > -0.5:
            mode = 2
    elif path == HuePath.CW:
        mode = 1 if left > right else 0
    else:
        mode = 2 if left < right else 0
    return (left + (mode == 2), right + (mode == 1))


def _hue_pieces(low, high, left, right, mode: RampMode, path: HuePath):
    """A segment in HSV or HSL, cut where hue crosses a sixth (or lightness a half): exact cubics."""
    first, second = (_to_hsv(colour) if mode == RampMode.HSV else _to_hsl(colour) for colour in (left, right))
    h1, h2 = _hue_ends(first[0], second[0], path)
    a, b = np.array([h1, *first[1:], left[3]]), np.array([h2, *second[1:], right[3]])
    cuts = {0.0, 1.0}
    if h1 != h2:
        cuts |= {(k / 6.0 - h1) / (h2 - h1) for k in range(13)}
    if mode == RampMode.HSL and a[2] != b[2]:
        cuts.add((0.5 - a[2]) / (b[2] - a[2]))
    cuts = sorted(cut for cut in cuts if 0.0 <= cut <= 1.0)
    share = np.array([0.0, 1.0, 2.0, 3.0]) / 3.0
    to_cubic = np.linalg.inv(np.vander(share, increasing=True))
    for start, end in pairwise(cuts):
        if end - start < 1e-12:
            continue
        at = start + (end - start) * share
        values = np.array([_hue_colour(a + (b - a) * x, mode) for x in at])
        yield low + start * (high - low), low + end * (high - low), to_cubic @ values


def _to_hsv(colour: np.ndarray) -> np.ndarray:
    """(3,) float32. In float32 as in Blender, since which way round is near may hang on the last bit."""
    r, g, b = (np.float32(x) for x in colour[:3])
    turn = np.float32(0.0)
    if g < b:
        g, b, turn = b, g, np.float32(-1.0)
    smallest = b
    if r < g:
        r, g, turn = g, r, np.float32(-2.0) / np.float32(6.0) - turn
        smallest = min(g, b)
    chroma, tiny = r - smallest, np.float32(1e-20)
    return np.array([abs(turn + (g - b) / (np.float32(6.0) * chroma + tiny)), chroma / (r + tiny), r])


def _to_hsl(colour: np.ndarray) -> np.ndarray:
    """(3,) float32: hue, saturation, lightness."""
    r, g, b = (np.float32(x) for x in colour[:3])
    most, least = max(r, g, b), min(r, g, b)
    light = min(np.float32(1.0), (most + least) / np.float32(2.0))
    if most == least:
        return np.array([0.0, 0.0, light], np.float32)
    chroma = most - least
    saturation = chroma / (np.float32(2.0) - most - least if light > 0.5 else most + least)
    if most == r:
        hue = (g - b) / chroma + np.float32(6.0 if g < b else 0.0)
    elif most == g:
        hue = (b - r) / chroma + np.float32(2.0)
    else:
        hue = (r - g) / chroma + np.float32(4.0)
    return np.array([hue / np.float32(6.0), saturation, light])


def _hue_colour(value: np.ndarray, mode: RampMode) -> np.ndarray:
    """RGBA of hue, saturation, value or lightness, and alpha."""
    hue, saturation, light, alpha = value
    ramps = np.array([abs(6.0 * (hue % 1.0) - 3.0) - 1.0,
                      2.0 - abs(6.0 * (hue % 1.0) - 2.0),
                      2.0 - abs(6.0 * (hue % 1.0) - 4.0)])  # fmt: skip
    ramps = np.clip(ramps, 0.0, 1.0)
    if mode == RampMode.HSV:
        rgb = ((ramps - 1.0) * saturation + 1.0) * light
    else:
        rgb = (ramps - 0.5) * ((1.0 - abs(2.0 * light - 1.0)) * saturation) + light
    return np.array([*rgb, alpha])
