"""Uniform blocks: places by std140, worked out by hand, and what a shader really reads there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from strata.addon.core.shader import Shader
from strata.addon.core.uniforms import Four, Three, Two, Uniforms
from strata.tests.support.gpu_scenes import gpu_device


@dataclass(frozen=True)
class Mixed(Uniforms):
    a: float
    pair: Two
    b: float
    rgb: Three
    c: float
    d: float
    e: float
    other: Two
    all_four: Four
    last: float


VALUES = Mixed(
    a=1.0,
    pair=(2.0, 3.0),
    b=4.0,
    rgb=(5.0, 6.0, 7.0),
    c=8.0,
    d=9.0,
    e=10.0,
    other=(11.0, 12.0),
    all_four=(13.0, 14.0, 15.0, 16.0),
    last=17.0,
)
ROWS = [
    [1, 0, 2, 3],
    [4, 0, 0, 0],
    [5, 6, 7, 0],
    [8, 9, 10, 0],
    [11, 12, 0, 0],
    [13, 14, 15, 16],
    [17, 0, 0, 0],
]
KINDS = ("float", "vec2", "float", "vec4", "float", "float", "float", "vec2", "vec4", "float")


def test_members_lie_where_std140_has_them():
    """A pair at even places, three and four numbers at multiples of four."""
    np.testing.assert_array_equal(VALUES.packed(), np.array(ROWS, np.float32))
    names = [name for name, _, _ in Mixed.members()]
    assert Mixed.glsl() == " ".join(f"{kind} {name};" for kind, name in zip(KINDS, names, strict=True))


def test_numbers_go_one_after_the_other_and_back():
    assert VALUES.numbers() == list(map(float, range(1, 18)))
    assert Mixed.of([*VALUES.numbers(), 99.0]) == VALUES


def test_what_single_precision_does_not_hold_is_infinite():
    assert Mixed.of([1e300, *VALUES.numbers()[1:]]).packed()[0, 0] == np.inf


def test_shaders_read_what_was_packed(tmp_path):
    """Every number, by its name, from the device's own compiler."""
    parts = []
    for name, count, _ in Mixed.members():
        parts += [f"params.{name}"] if count == 1 else [f"params.{name}.{axis}" for axis in "xyzw"[:count]]
    stores = [f"imageStore(out_numbers, ivec2({i}, 0), vec4({part}));" for i, part in enumerate(parts)]
    source = tmp_path / "mixed.glsl"
    source.write_text(f"void main() {{ {' '.join(stores)} }}\n")
    device = gpu_device()
    numbers = device.new_image((1, len(parts)))
    shader = Shader(str(source), images=(("out_numbers", "R32F", "WRITE"),), params=Mixed, group=(1, 1))
    device.dispatch(shader, (1, 1), {"out_numbers": numbers}, {}, VALUES)
    np.testing.assert_array_equal(device.to_host(numbers)[0], VALUES.numbers())
