"""Nodes that compute: constants, Math, Mix, colours and vectors, as Cycles' kernel/svm has them."""

from __future__ import annotations

import math

import numpy as np

from . import colours
from .arithmetic import MATH, VECTOR_MATH, VECTOR_MATH_VALUES, safe_divide
from .graph import At
from .registry import value_of
from .values import (
    COLOUR,
    FLOAT,
    VECTOR,
    Value,
    apply,
    complement,
    constant,
    converted,
    mixed,
    number,
    product,
    saturated,
    wide,
)

_SHARES = {"LESS_THAN", "GREATER_THAN", "COMPARE"}


@value_of("ShaderNodeValue", how="its number")
def _value(at: At, output) -> Value:
    return number(float(output.default_value))


@value_of("ShaderNodeRGB", how="its colour")
def _rgb(at: At, output) -> Value:
    return constant(COLOUR, output.default_value[:3])


@value_of("ShaderNodeMath", how="every operation, and Clamp")
def _math(at: At, output) -> Value:
    operation = at.node.operation
    a, b, c = (at.input(name) for name in ("Value", "Value_001", "Value_002"))
    if operation == "MULTIPLY":
        found = product(a, b)
    elif operation == "SUBTRACT" and a.equals(1.0):
        found = complement(b)
    elif operation in MATH:
        inputs = (a, b, c)[: _math_inputs(operation)]
        rest = [0.0] * (3 - len(inputs))
        bounds = {"low": 0.0, "high": 1.0} if operation in _SHARES else {}
        if operation in {"MINIMUM", "MAXIMUM", "ROUND"} and all(value.is_share for value in inputs):
            bounds = {"low": 0.0, "high": 1.0}
        function = MATH[operation]
        found = apply(f"math {operation}", FLOAT, lambda *v: function(*v, *rest), *inputs, **bounds)
    else:
        return at.unread(FLOAT, operation.lower())
    return saturated(found) if at.node.use_clamp else found


def _math_inputs(operation: str) -> int:
    three = {"MULTIPLY_ADD", "COMPARE", "SMOOTH_MIN", "SMOOTH_MAX", "WRAP"}
    two = {"ADD", "SUBTRACT", "DIVIDE", "POWER", "LOGARITHM", "MINIMUM", "MAXIMUM", "LESS_THAN",
           "GREATER_THAN", "MODULO", "FLOORED_MODULO", "SNAP", "PINGPONG", "ARCTAN2"}  # fmt: skip
    return 3 if operation in three else 2 if operation in two else 1


@value_of("ShaderNodeVectorMath", how="every operation but Refract")
def _vector_math(at: At, output) -> Value:
    operation = at.node.operation
    inputs = [at.input(name) for name in ("Vector", "Vector_001", "Vector_002", "Scale")]
    is_number = operation in VECTOR_MATH_VALUES
    function = VECTOR_MATH_VALUES.get(operation) or VECTOR_MATH.get(operation)
    if function is None:
        return at.unread(FLOAT if output.type == "VALUE" else VECTOR, operation.lower())
    if is_number != (output.identifier == "Value"):
        return number(0.0) if output.identifier == "Value" else constant(VECTOR, [0.0] * 3)
    used = _vector_inputs(operation)
    chosen = [inputs[index] for index in used]

    def evaluate(*values):
        arguments = [np.zeros(3), np.zeros(3), np.zeros(3), np.float64(0.0)]
        for index, value in zip(used, values, strict=True):
            arguments[index] = value
        return function(*arguments)

    return apply(f"vector math {operation}", FLOAT if is_number else VECTOR, evaluate, *chosen)


def _vector_inputs(operation: str) -> tuple[int, ...]:
    if operation == "SCALE":
        return (0, 3)
    if operation in {"MULTIPLY_ADD", "WRAP", "FACEFORWARD"}:
        return (0, 1, 2)
    one = {"LENGTH", "NORMALIZE", "ABSOLUTE", "SIGN", "ROUND", "FLOOR", "CEIL", "FRACTION", "SINE", "COSINE",
           "TANGENT"}  # fmt: skip
    return (0,) if operation in one else (0, 1)


@value_of("ShaderNodeMix", how="Float, Vector and Color with every blend mode, clamped or not",
          instead="Rotation is not read")  # fmt: skip
def _mix(at: At, output) -> Value:
    node = at.node
    if node.data_type == "ROTATION":
        return at.unread(VECTOR, "rotation")
    suffix, kind = {"FLOAT": ("Float", FLOAT), "VECTOR": ("Vector", VECTOR), "RGBA": ("Color", COLOUR)}[
        node.data_type
    ]
    a, b = at.input(f"A_{suffix}"), at.input(f"B_{suffix}")
    if node.data_type == "VECTOR" and node.factor_mode == "NON_UNIFORM":
        share = at.input("Factor_Vector")
        share = saturated(share) if node.clamp_factor else share
        return apply("mix each", VECTOR, lambda x, y, s: (1.0 - s) * x + s * y, a, b, share)
    share = at.input("Factor_Float")
    share = saturated(share) if node.clamp_factor else share
    blend = node.blend_type if node.data_type == "RGBA" else "MIX"
    found = _blended(blend, kind, a, b, share)
    return saturated(found) if node.data_type == "RGBA" and node.clamp_result else found


@value_of("ShaderNodeMixRGB", how="every blend mode, clamped or not")
def _mix_rgb(at: At, output) -> Value:
    share = saturated(at.input("Fac"))
    found = _blended(at.node.blend_type, COLOUR, at.input("Color1"), at.input("Color2"), share)
    return saturated(found) if at.node.use_clamp else found


def _blended(blend: str, kind: str, a: Value, b: Value, share: Value) -> Value:
    if blend == "MIX" and share.is_share:
        return mixed(a, b, share)
    if kind == FLOAT:
        return apply("blend float", FLOAT, lambda x, y, s: (1.0 - s) * x + s * y, a, b, share)
    if blend == "MULTIPLY" and share.is_share:
        # a (1 - share + share b): a product is found in it.
        return product(a, mixed(constant(COLOUR, [1.0] * 3), b, share))
    function = colours.BLEND[blend]
    return apply(f"blend {blend}", kind, lambda x, y, s: function(x, y, wide(s)), a, b, share)


@value_of("ShaderNodeClamp", how="both types")
def _clamp(at: At, output) -> Value:
    value, least, most = (at.input(name) for name in ("Value", "Min", "Max"))
    if least.equals(0.0) and most.equals(1.0):
        return saturated(value)
    sorts = at.node.clamp_type == "RANGE"
    return apply(f"clamp {sorts}", FLOAT, lambda v, a, b: _clamped(v, a, b, sorts), value, least, most)


def _clamped(value, least, most, sorts: bool = True):
    if sorts:
        least, most = np.minimum(least, most), np.maximum(least, most)
    return np.minimum(np.maximum(value, least), most)


@value_of("ShaderNodeMapRange", how="Float and Vector, all interpolations, and Clamp")
def _map_range(at: At, output) -> Value:
    node = at.node
    is_float = node.data_type == "FLOAT"
    end = "" if is_float else "_FLOAT3"
    names = ["Value" if is_float else "Vector"]
    names += [f"{name}{end}" if is_float else name.replace(" ", "_") + end
              for name in ("From Min", "From Max", "To Min", "To Max", "Steps")]  # fmt: skip
    kind, clamp = node.interpolation_type, node.clamp

    def evaluate(value, from_min, from_max, to_min, to_max, steps):
        factor = safe_divide(value - from_min, from_max - from_min)
        if kind == "STEPPED":
            safe = np.where(steps > 0.0, steps, 1.0)
            factor = np.where(steps > 0.0, np.floor(factor * (steps + 1.0)) / safe, 0.0)
        elif kind in {"SMOOTHSTEP", "SMOOTHERSTEP"}:
            x = np.clip(factor, 0.0, 1.0)
            smoother = x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
            factor = (3.0 - 2.0 * x) * (x * x) if kind == "SMOOTHSTEP" else smoother
        found = to_min + factor * (to_max - to_min)
        if is_float:
            # Cycles clamps a float by a node behind, a vector within, where it is not smooth.
            found = np.where(from_max != from_min, found, 0.0)
            return _clamped(found, to_min, to_max) if clamp else found
        return _clamped(found, to_min, to_max) if clamp and kind in {"LINEAR", "STEPPED"} else found

    inputs = [at.input(name) for name in names]
    return apply(f"map range {kind} {clamp}", FLOAT if is_float else VECTOR, evaluate, *inputs)


@value_of("ShaderNodeInvert", how="as Cycles")
def _invert(at: At, output) -> Value:
    colour, share = at.input("Color"), at.input("Fac")
    if share.equals(1.0):
        return complement(colour)
    return apply("invert", COLOUR, lambda c, f: wide(f) * (1.0 - c) + (1.0 - wide(f)) * c, colour, share)


@value_of("ShaderNodeGamma", how="as Cycles")
def _gamma(at: At, output) -> Value:
    def evaluate(colour, gamma):
        gamma = wide(gamma)
        found = np.where(colour > 0.0, np.power(np.where(colour > 0.0, colour, 1.0), gamma), colour)
        return np.where(gamma == 0.0, 1.0, found)

    return apply("gamma", COLOUR, evaluate, at.input("Color"), at.input("Gamma"))


@value_of("ShaderNodeBrightContrast", how="as Cycles")
def _bright_contrast(at: At, output) -> Value:
    def evaluate(colour, bright, contrast):
        return np.maximum((1.0 + wide(contrast)) * colour + wide(bright - 0.5 * contrast), 0.0)

    return apply("bright", COLOUR, evaluate, at.input("Color"), at.input("Bright"), at.input("Contrast"))


@value_of("ShaderNodeHueSaturation", how="as Cycles")
def _hue_saturation(at: At, output) -> Value:
    def evaluate(colour, hue, saturation, value, share):
        h, s, v = np.moveaxis(colours.hsv_of_rgb(colour), -1, 0)
        h = h + hue + 0.5
        turned = np.stack(
            np.broadcast_arrays(h - np.floor(h), np.clip(s * saturation, 0.0, 1.0), v * value), -1
        )
        found = wide(share) * colours.rgb_of_hsv(turned) + (1.0 - wide(share)) * colour
        return np.maximum(found, 0.0)

    names = ("Color", "Hue", "Saturation", "Value", "Fac")
    return apply("hue saturation value", COLOUR, evaluate, *(at.input(name) for name in names))


_OF_RGB = {"HSV": colours.hsv_of_rgb, "HSL": colours.hsl_of_rgb}
_TO_RGB = {"HSV": colours.rgb_of_hsv, "HSL": colours.rgb_of_hsl}


@value_of("ShaderNodeSeparateColor", how="RGB, HSV and HSL")
def _separate_color(at: At, output) -> Value:
    index = ("Red", "Green", "Blue").index(output.identifier)
    colour, model = at.input("Color"), at.node.mode
    if model == "RGB":
        return component(colour, index)
    function = _OF_RGB[model]
    return apply(f"{model} {index}", FLOAT, lambda c: function(c)[..., index], colour)


@value_of("ShaderNodeCombineColor", how="RGB, HSV and HSL")
def _combine_color(at: At, output) -> Value:
    function = _TO_RGB.get(at.node.mode, lambda c: c)
    parts = [at.input(name) for name in ("Red", "Green", "Blue")]
    return apply(f"of {at.node.mode}", COLOUR, lambda *p: function(_stacked(*p)), *parts)


@value_of("ShaderNodeSeparateXYZ", how="as Cycles")
def _separate_xyz(at: At, output) -> Value:
    return component(at.input("Vector"), "XYZ".index(output.identifier))


@value_of("ShaderNodeCombineXYZ", how="as Cycles")
def _combine_xyz(at: At, output) -> Value:
    return apply("of xyz", VECTOR, _stacked, *(at.input(name) for name in "XYZ"))


def component(value: Value, index: int) -> Value:
    """One of the numbers of a colour, a vector or a texel."""
    bounds = {"low": value.low, "high": value.high}
    return apply(f"component {index}", FLOAT, lambda v: np.asarray(v)[..., index], value, **bounds)


def _stacked(*parts):
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


@value_of("ShaderNodeRGBToBW", how="the luminance in the file's working space")
def _rgb_to_bw(at: At, output) -> Value:
    return converted(at.input("Color"), FLOAT)


@value_of("ShaderNodeBlackbody", how="of a constant temperature")
def _blackbody(at: At, output) -> Value:
    temperature = at.input("Temperature")
    if not temperature.is_constant:
        return at.unread(COLOUR, "its temperature varies")
    kelvin = temperature.number()
    return constant(COLOUR, colours.black_body(kelvin if math.isfinite(kelvin) else 0.0))


# Cycles' RAMP_TABLE_SIZE: ramps and curves are tables of so many entries, between which it is linear.
_TABLE = 256


@value_of("ShaderNodeValToRGB", how="as Cycles' table of 256 entries")
def _color_ramp(at: At, output) -> Value:
    ramp, share = at.node.color_ramp, at.input("Fac")
    if share.is_constant and not math.isfinite(share.number()):
        share = number(0.0)
    table = np.array([ramp.evaluate(i / (_TABLE - 1))[:] for i in range(_TABLE)], np.float64)
    is_linear = ramp.interpolation != "CONSTANT"
    is_alpha = output.identifier == "Alpha"
    table = table[:, 3:] if is_alpha else table[:, :3]
    name = f"ramp {is_linear} {table.tobytes().hex()}"
    if is_alpha:
        return apply(name, FLOAT, lambda f: _in_table(table, f, is_linear)[..., 0], share,
                     low=float(table.min()), high=float(table.max()))  # fmt: skip
    return apply(name, COLOUR, lambda f: _in_table(table, f, is_linear), share,
                 low=float(table.min()), high=float(table.max()))  # fmt: skip


def _in_table(table: np.ndarray, share, is_linear: bool = True, goes_on: bool = False) -> np.ndarray:
    """(..., C) from a table (256, C) over 0 to 1; beyond as at the ends or, if it `goes_on`, straight on."""
    share = np.nan_to_num(np.asarray(share, np.float64))
    place = np.clip(share, 0.0, 1.0) * (_TABLE - 1)
    first = np.minimum(place.astype(np.int64), _TABLE - 1)
    found = table[first]
    if is_linear:
        rest = wide(place - first)
        found = (1.0 - rest) * found + rest * table[np.minimum(first + 1, _TABLE - 1)]
    if goes_on:
        before = table[0] + (table[0] - table[1]) * wide(-share * (_TABLE - 1))
        after = table[-1] + (table[-1] - table[-2]) * wide((share - 1.0) * (_TABLE - 1))
        found = np.where(wide(share) < 0.0, before, np.where(wide(share) > 1.0, after, found))
    return found


@value_of("ShaderNodeRGBCurve", "ShaderNodeVectorCurve", how="as Cycles' tables of 256 entries")
def _curves(at: At, output) -> Value:
    is_rgb = at.node.bl_idname == "ShaderNodeRGBCurve"
    value = at.input("Color" if is_rgb else "Vector")
    return _curved(at, value, COLOUR if is_rgb else VECTOR, range(3), whole=3 if is_rgb else None)


@value_of("ShaderNodeFloatCurve", how="as Cycles' table of 256 entries")
def _float_curve(at: At, output) -> Value:
    return _curved(at, at.input("Value"), FLOAT, range(1))


def _curved(at: At, value: Value, kind: str, channels: range, whole: int | None = None) -> Value:
    mapping = at.node.mapping
    mapping.initialize()
    curves = mapping.curves
    points = [(p.location[0]) for channel in channels for p in curves[channel].points]
    if whole is not None:
        points += [p.location[0] for p in curves[whole].points]
    low, high = min([0.0, *points]), max([1.0, *points])
    ticks = [low + i / (_TABLE - 1) * (high - low) for i in range(_TABLE)]
    if whole is not None:
        ticks = [mapping.evaluate(curves[whole], tick) for tick in ticks]
    table = np.array([[mapping.evaluate(curves[c], tick) for c in channels] for tick in ticks], np.float64)
    goes_on = mapping.extend == "EXTRAPOLATED"

    def evaluate(numbers, share):
        place = (np.asarray(numbers) - low) / (high - low)
        if kind == FLOAT:
            return (1.0 - share) * numbers + share * _in_table(table, place, True, goes_on)[..., 0]
        found = [_in_table(table[:, i : i + 1], place[..., i], True, goes_on)[..., 0] for i in channels]
        return (1.0 - wide(share)) * numbers + wide(share) * np.stack(found, axis=-1)

    share = at.input("Factor" if kind == FLOAT else "Fac")
    name = f"curves {low} {high} {goes_on} {table.tobytes().hex()}"
    return apply(name, kind, evaluate, value, share)
