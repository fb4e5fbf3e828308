"""The operations of Math, Vector Math and Mix, on arrays of float64, as Cycles has them (its
kernel/svm/math_util.h, kernel/svm/color_util.h, util/math_base.h and util/color.h)."""

from __future__ import annotations

import numpy as np

from .values import wide

FLOAT_EPSILON = float(np.finfo(np.float32).eps)


def safe_divide(a, b):
    return np.where(b != 0.0, a / np.where(b != 0.0, b, 1.0), 0.0)


def power(a, b):
    whole = b == np.trunc(b)
    base = np.where((a < 0.0) & ~whole, 0.0, a)
    found = np.where((base == 0.0) & (b != 0.0), 0.0, np.power(np.where(base == 0.0, 1.0, base), b))
    return np.where((a < 0.0) & ~whole, 0.0, found)


def _logarithm(a, b):
    are_positive = (a > 0.0) & (b > 0.0)
    found = safe_divide(np.log(np.where(are_positive, a, 1.0)), np.log(np.where(are_positive, b, 1.0)))
    return np.where(are_positive, found, 0.0)


def modulo(a, b):
    return np.where(b != 0.0, np.fmod(a, np.where(b != 0.0, b, 1.0)), 0.0)


def _floored_modulo(a, b):
    return np.where(b != 0.0, a - np.floor(safe_divide(a, b)) * b, 0.0)


def wrap(a, most, least):
    extent = most - least
    return np.where(extent != 0.0, a - extent * np.floor(safe_divide(a - least, extent)), least)


def _ping_pong(a, b):
    turn = safe_divide(a - b, 2.0 * b)
    return np.where(b != 0.0, np.abs((turn - np.floor(turn)) * b * 2.0 - b), 0.0)


def _smooth_minimum(a, b, k):
    h = safe_divide(np.maximum(k - np.abs(a - b), 0.0), k)
    return np.minimum(a, b) - np.where(k != 0.0, h * h * h * k / 6.0, 0.0)


def snap(a, b):
    return np.floor(safe_divide(a, b)) * b


def fraction(a):
    return a - np.floor(a)


MATH = {
    "ADD": lambda a, b, c: a + b,
    "SUBTRACT": lambda a, b, c: a - b,
    "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: safe_divide(a, b),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, c: power(a, b),
    "LOGARITHM": lambda a, b, c: _logarithm(a, b),
    "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0.0)),
    "INVERSE_SQRT": lambda a, b, c: np.where(a > 0.0, 1.0 / np.sqrt(np.where(a > 0.0, a, 1.0)), 0.0),
    "ABSOLUTE": lambda a, b, c: np.abs(a),
    "EXPONENT": lambda a, b, c: np.exp(a),
    "MINIMUM": lambda a, b, c: np.fmin(a, b),
    "MAXIMUM": lambda a, b, c: np.fmax(a, b),
    "LESS_THAN": lambda a, b, c: np.where(a < b, 1.0, 0.0),
    "GREATER_THAN": lambda a, b, c: np.where(a > b, 1.0, 0.0),
    "SIGN": lambda a, b, c: np.sign(a),
    "COMPARE": lambda a, b, c: np.where(np.abs(a - b) <= np.maximum(c, FLOAT_EPSILON), 1.0, 0.0),
    "SMOOTH_MIN": _smooth_minimum,
    "SMOOTH_MAX": lambda a, b, c: -_smooth_minimum(-a, -b, c),
    "ROUND": lambda a, b, c: np.floor(a + 0.5),
    "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a),
    "TRUNC": lambda a, b, c: np.trunc(a),
    "FRACT": lambda a, b, c: fraction(a),
    "MODULO": lambda a, b, c: modulo(a, b),
    "FLOORED_MODULO": lambda a, b, c: _floored_modulo(a, b),
    "WRAP": wrap,
    "SNAP": lambda a, b, c: snap(a, b),
    "PINGPONG": lambda a, b, c: _ping_pong(a, b),
    "SINE": lambda a, b, c: np.sin(a),
    "COSINE": lambda a, b, c: np.cos(a),
    "TANGENT": lambda a, b, c: np.tan(a),
    "ARCSINE": lambda a, b, c: np.arcsin(np.clip(a, -1.0, 1.0)),
    "ARCCOSINE": lambda a, b, c: np.arccos(np.clip(a, -1.0, 1.0)),
    "ARCTANGENT": lambda a, b, c: np.arctan(a),
    "ARCTAN2": lambda a, b, c: np.arctan2(a, b),
    "SINH": lambda a, b, c: np.sinh(a),
    "COSH": lambda a, b, c: np.cosh(a),
    "TANH": lambda a, b, c: np.tanh(a),
    "RADIANS": lambda a, b, c: np.radians(a),
    "DEGREES": lambda a, b, c: np.degrees(a),
}


def _dot(a, b):
    return np.sum(np.multiply(a, b), axis=-1)


def length(a):
    return np.sqrt(_dot(a, a))


def normalized(a):
    return safe_divide(np.asarray(a), wide(length(a)))


def _project(a, b):
    return wide(safe_divide(_dot(a, b), _dot(b, b))) * b


def _reflect(a, b):
    unit = normalized(b)
    return a - 2.0 * unit * wide(_dot(unit, a))


VECTOR_MATH = {
    "ADD": lambda a, b, c, s: a + b,
    "SUBTRACT": lambda a, b, c, s: a - b,
    "MULTIPLY": lambda a, b, c, s: a * b,
    "DIVIDE": lambda a, b, c, s: safe_divide(a, b),
    "MULTIPLY_ADD": lambda a, b, c, s: a * b + c,
    "CROSS_PRODUCT": lambda a, b, c, s: np.cross(a, b),
    "PROJECT": lambda a, b, c, s: _project(a, b),
    "REFLECT": lambda a, b, c, s: _reflect(a, b),
    "FACEFORWARD": lambda a, b, c, s: np.where(wide(_dot(c, b)) < 0.0, a, -a),
    "SCALE": lambda a, b, c, s: a * wide(s),
    "NORMALIZE": lambda a, b, c, s: normalized(a),
    "ABSOLUTE": lambda a, b, c, s: np.abs(a),
    "POWER": lambda a, b, c, s: power(a, b),
    "SIGN": lambda a, b, c, s: np.sign(a),
    "MINIMUM": lambda a, b, c, s: np.minimum(a, b),
    "MAXIMUM": lambda a, b, c, s: np.maximum(a, b),
    "ROUND": lambda a, b, c, s: np.floor(a + 0.5),
    "FLOOR": lambda a, b, c, s: np.floor(a),
    "CEIL": lambda a, b, c, s: np.ceil(a),
    "FRACTION": lambda a, b, c, s: fraction(a),
    "MODULO": lambda a, b, c, s: modulo(a, b),
    "WRAP": lambda a, b, c, s: wrap(a, b, c),
    "SNAP": lambda a, b, c, s: snap(a, b),
    "SINE": lambda a, b, c, s: np.sin(a),
    "COSINE": lambda a, b, c, s: np.cos(a),
    "TANGENT": lambda a, b, c, s: np.tan(a),
}

VECTOR_MATH_VALUES = {
    "DOT_PRODUCT": lambda a, b, c, s: _dot(a, b),
    "DISTANCE": lambda a, b, c, s: length(np.subtract(a, b)),
    "LENGTH": lambda a, b, c, s: length(a),
}
