"""Colour models, the blend modes of Mix, and black bodies, on arrays (..., 3) of float64, as Cycles has them
(its util/color.h, kernel/svm/color_util.h and kernel/svm/math_util.h)."""

from __future__ import annotations

import mathutils
import numpy as np

from .values import wide


def hsv_of_rgb(rgb):
    rgb = np.asarray(rgb, np.float64)
    most, least = rgb.max(axis=-1), rgb.min(axis=-1)
    extent = most - least
    saturation = np.where(most != 0.0, extent / np.where(most != 0.0, most, 1.0), 0.0)
    r, g, b = np.moveaxis((wide(most) - rgb) / wide(np.where(extent != 0.0, extent, 1.0)), -1, 0)
    hue = np.where(rgb[..., 0] == most, b - g, np.where(rgb[..., 1] == most, 2.0 + r - b, 4.0 + g - r)) / 6.0
    hue = np.where(saturation != 0.0, np.where(hue < 0.0, hue + 1.0, hue), 0.0)
    return np.stack([hue, saturation, most], axis=-1)


def rgb_of_hsv(hsv):
    hue, saturation, value = np.moveaxis(np.asarray(hsv, np.float64), -1, 0)
    hue = np.where(hue == 1.0, 0.0, hue) * 6.0
    part = np.floor(hue)
    rest = hue - part
    p = value * (1.0 - saturation)
    q = value * (1.0 - saturation * rest)
    t = value * (1.0 - saturation * (1.0 - rest))
    choices = [(value, t, p), (q, value, p), (p, value, t), (p, q, value), (t, p, value)]
    found = np.stack([value, p, q], axis=-1)  # any other part, as in Cycles
    for index, choice in enumerate(choices):
        found = np.where(wide(part == index), np.stack(choice, axis=-1), found)
    return np.where(wide(saturation != 0.0), found, np.repeat(wide(value), 3, axis=-1))


def hsl_of_rgb(rgb):
    rgb = np.asarray(rgb, np.float64)
    most, least = rgb.max(axis=-1), rgb.min(axis=-1)
    extent, light = most - least, np.minimum(1.0, (most + least) / 2.0)
    safe = np.where(extent != 0.0, extent, 1.0)
    over = np.where(light > 0.5, 2.0 - most - least, most + least)
    saturation = np.where(extent != 0.0, extent / np.where(over != 0.0, over, 1.0), 0.0)
    r, g, b = np.moveaxis(rgb, -1, 0)
    hue = np.where(
        most == r,
        (g - b) / safe + np.where(g < b, 6.0, 0.0),
        np.where(most == g, (b - r) / safe + 2.0, (r - g) / safe + 4.0),
    )
    return np.stack([np.where(extent != 0.0, hue / 6.0, 0.0), saturation, light], axis=-1)


def rgb_of_hsl(hsl):
    hue, saturation, light = np.moveaxis(np.asarray(hsl, np.float64), -1, 0)
    parts = [np.abs(hue * 6.0 - 3.0) - 1.0, 2.0 - np.abs(hue * 6.0 - 2.0), 2.0 - np.abs(hue * 6.0 - 4.0)]
    chroma = (1.0 - np.abs(2.0 * light - 1.0)) * saturation
    return (np.clip(np.stack(parts, axis=-1), 0.0, 1.0) - 0.5) * wide(chroma) + wide(light)


def _mix(a, b, t):
    return a + t * (b - a)


def _overlay(a, b, t):
    low = a * (1.0 - t + 2.0 * t * b)
    return np.where(a < 0.5, low, 1.0 - (1.0 - t + 2.0 * t * (1.0 - b)) * (1.0 - a))


def _divide(a, b, t):
    return np.where(b != 0.0, (1.0 - t) * a + t * a / np.where(b != 0.0, b, 1.0), a)


def _dodge(a, b, t):
    rest = 1.0 - t * b
    found = np.where(rest <= 0.0, 1.0, np.minimum(a / np.where(rest > 0.0, rest, 1.0), 1.0))
    return np.where(a != 0.0, found, a)


def _burn(a, b, t):
    rest = 1.0 - t + t * b
    return np.where(rest <= 0.0, 0.0, np.clip(1.0 - (1.0 - a) / np.where(rest > 0.0, rest, 1.0), 0.0, 1.0))


def _soft_light(a, b, t):
    screen = 1.0 - (1.0 - b) * (1.0 - a)
    return (1.0 - t) * a + t * ((1.0 - a) * b * a + a * screen)


def _with_hsv(a, b, t, channels: str):
    """`a` with channels of hue, saturation and value of `b`, where it has a hue."""
    first, second = hsv_of_rgb(a), hsv_of_rgb(b)
    chosen = np.array([channel in channels for channel in "hsv"])
    found = _mix(a, rgb_of_hsv(np.where(chosen, second, first)), t)
    return np.where(second[..., 1:2] != 0.0, found, a)


def _saturation(a, b, t):
    first, second = hsv_of_rgb(a), hsv_of_rgb(b)
    found = np.array(np.broadcast_arrays(first, second, t)[0])
    found[..., 1] = _mix(first[..., 1:2], second[..., 1:2], t)[..., 0]
    return np.where(first[..., 1:2] != 0.0, rgb_of_hsv(found), a)


def _value(a, b, t):
    first, second = hsv_of_rgb(a), hsv_of_rgb(b)
    found = np.array(np.broadcast_arrays(first, second, t)[0])
    found[..., 2] = _mix(first[..., 2:], second[..., 2:], t)[..., 0]
    return rgb_of_hsv(found)


# Of two colours and a share (..., 1).
BLEND = {
    "MIX": lambda a, b, t: (1.0 - t) * a + t * b,
    "DARKEN": lambda a, b, t: _mix(a, np.minimum(a, b), t),
    "MULTIPLY": lambda a, b, t: a * (1.0 - t + t * b),
    "BURN": _burn,
    "LIGHTEN": lambda a, b, t: _mix(a, np.maximum(a, b), t),
    "SCREEN": lambda a, b, t: 1.0 - (1.0 - t + t * (1.0 - b)) * (1.0 - a),
    "DODGE": _dodge,
    "ADD": lambda a, b, t: a + t * b,
    "OVERLAY": _overlay,
    "SOFT_LIGHT": _soft_light,
    "LINEAR_LIGHT": lambda a, b, t: a + t * (2.0 * b - 1.0),
    "DIFFERENCE": lambda a, b, t: _mix(a, np.abs(a - b), t),
    "EXCLUSION": lambda a, b, t: np.maximum(_mix(a, a + b - 2.0 * a * b, t), 0.0),
    "SUBTRACT": lambda a, b, t: a - t * b,
    "DIVIDE": _divide,
    "HUE": lambda a, b, t: _with_hsv(a, b, t, "h"),
    "SATURATION": _saturation,
    "COLOR": lambda a, b, t: _with_hsv(a, b, t, "hs"),
    "VALUE": _value,
}

# kernel/tables.h: a / T + b T + c of red and green, a cubic of blue, from each temperature on.
_FROM_K = (0.0, 965.0, 1167.0, 1449.0, 1902.0, 3315.0, 6365.0)
_RED = (
    (1.61919106e03, -2.05010916e-03, 5.02995757e00),
    (2.48845471e03, -1.11330907e-03, 3.22621544e00),
    (3.34143193e03, -4.86551192e-04, 1.76486769e00),
    (4.09461742e03, -1.27446582e-04, 7.25731635e-01),
    (4.67028036e03, 2.91258199e-05, 1.26703442e-01),
    (4.59509185e03, 2.87495649e-05, 1.50345020e-01),
    (3.78717450e03, 9.35907826e-06, 3.99075871e-01),
)
_GREEN = (
    (-4.88999748e02, 6.04330754e-04, -7.55807526e-02),
    (-7.55994277e02, 3.16730098e-04, 4.78306139e-01),
    (-1.02363977e03, 1.20223470e-04, 9.36662319e-01),
    (-1.26571316e03, 4.87340896e-06, 1.27054498e00),
    (-1.42529332e03, -4.01150431e-05, 1.43972784e00),
    (-1.17554822e03, -2.16378048e-05, 1.30408023e00),
    (-5.00799571e02, -4.59832026e-06, 1.09098763e00),
)
_BLUE = (
    (5.96945309e-11, -4.85742887e-08, -9.70622247e-05, -4.07936148e-03),
    (2.40430366e-11, 5.55021075e-08, -1.98503712e-04, 2.89312858e-02),
    (-1.40949732e-11, 1.89878968e-07, -3.56632824e-04, 9.10767778e-02),
    (-3.61460868e-11, 2.84822009e-07, -4.93211319e-04, 1.56723440e-01),
    (-1.97075738e-11, 1.75359352e-07, -2.50542825e-04, -2.22783266e-02),
    (-1.61997957e-13, -1.64216008e-08, 3.86216271e-04, -7.38077418e-01),
    (6.72650283e-13, -2.73078809e-08, 4.24098264e-04, -7.52335691e-01),
)


def black_body(kelvin: float) -> list[float]:
    """Of luminance about 1, in the working space, without what is negative."""
    if kelvin >= 12000.0:
        rgb = (0.8262954810464208, 0.9945080501520986, 1.566307710274283)
    elif kelvin < 800.0:
        rgb = (5.413294490189271, -0.20319390035873933, -0.0822535242887164)
    else:
        i = max(index for index, start in enumerate(_FROM_K) if kelvin >= start)
        red, green, blue = _RED[i], _GREEN[i], _BLUE[i]
        rgb = (
            red[0] / kelvin + red[1] * kelvin + red[2],
            green[0] / kelvin + green[1] * kelvin + green[2],
            ((blue[0] * kelvin + blue[1]) * kelvin + blue[2]) * kelvin + blue[3],
        )
    return [max(c, 0.0) for c in mathutils.Color(rgb).from_rec709_linear_to_scene_linear()]
