"""Toon: each step of the GPU against the kernels on identical inputs.

Both work in float32 and in the same order, so that values agree to a few roundings, but where a comparison
falls the other way: a ramp's step, a dot's cutoff. Those may be a few pixels in ten thousand.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.core.arrays import Opacities
from strata.addon.core.placement import Places
from strata.addon.core.ramp import Ramp
from strata.addon.core.shot import PixelFilter
from strata.addon.core.surface import ATTRIBUTES, Chunk
from strata.addon.core.view import View
from strata.addon.effects.shared.steps import SURFACE
from strata.addon.effects.toon import steps
from strata.addon.effects.toon.gpu_steps import MIXES, variants
from strata.addon.effects.toon.ramp_table import table_of
from strata.tests.support.gpu_scenes import (
    gpu_device,
    on_both,
    rotation,
    scene_of,
    share_beyond,
    sheets_over_ground,
)

SIZE = (150, 90)
CAMERA = View(
    (0, -6, 5.0), (1, 0, 0), (0, 0.64, 0.7683749), (0, 0.7683749, -0.64), (-0.5, 0.5, -0.3, 0.3), 0.1, 99.0
)
RAMP = Ramp.parse("0:#101018,0.2:#605060,0.45:#c0a080,0.8:#ffffff;constant")
SMOOTH_RAMP = Ramp.parse("0:#ff0000,0.3:#20c060,1:#2040ff80;hsv;far")
LIGHTS = np.array(
    [
        [2, 1, 0, 1.0, 0, 0, -1, 0, -2, 1e6, 0, 0],
        [0, 0, 0, 0.3, 0.36, 0.48, -0.8, 2, -2, 1e6, 0, 0],
        [-1, 4, 1, 0.8, 0.1, 0.2, -0.97, 0, 0.8, 9.0, 0, 0],
        [1, 5, 1, 0.6, 0, 0, -1, 1, -2, 1e6, 0.7, 0],
    ],
    np.float32,
)


class Stage:
    """Bumpy sheets over a ground; its surface on the host, and two ways to run a step on it."""

    def __init__(self):
        meshes, instances = sheets_over_ground(6, (1, 2))
        self.outline, self.arrays = scene_of(meshes, instances, (Opacities(),) * 3)
        (self.cpu, self.geometry), (self.gpu, self.gpu_geometry) = on_both(self.outline, self.arrays)
        self.everything = frozenset(range(len(instances)))
        self.chunk = Chunk(*SIZE, 0, SIZE[1], 0, (0.2, -0.1), 4)
        self.surface = SURFACE.cpu(
            self.cpu, self.geometry, CAMERA, self.everything, self.chunk, frozenset(ATTRIBUTES)
        )
        self.light = np.random.default_rng(9).uniform(0, 1, SIZE[::-1]).astype(np.float32)

    def both(self, step, *inputs, **params):
        """What both devices make of the same host arrays."""
        first = step.cpu(self.cpu, *inputs, **params)
        second = step.gpu(self.gpu, *(self.gpu.from_host(each) for each in inputs), **params)
        return np.asarray(first, np.float64), np.asarray(self.gpu.to_host(second), np.float64)


@pytest.fixture(scope="module")
def stage() -> Stage:
    gpu_device()
    return Stage()


def test_every_program_compiles():
    device = gpu_device()
    for shader in variants():
        device.compile(shader)


@pytest.mark.parametrize("normal", ["shading_normal", "geometric_normal"])
@pytest.mark.parametrize("shadowed", [(False,) * 4, (True, False, True, False)])
@pytest.mark.parametrize("linked", [(None,) * 4, (frozenset({0, 2, 3}), None, None, frozenset({1}))])
def test_facing(stage, normal, shadowed, linked):
    shadows = [stage.light] * sum(shadowed)
    cpu, gpu = stage.both(
        steps.FACING, stage.surface, *shadows, normal=normal, lights=LIGHTS, shadowed=shadowed, linked=linked
    )
    assert 0.2 < cpu.mean() < 0.9
    np.testing.assert_allclose(gpu, cpu, atol=2e-5)  # a narrow blend multiplies the cosine's rounding by 9


def test_brightness(stage):
    inputs = [stage.light, stage.light[::-1].copy(), stage.light.T.reshape(stage.light.shape).copy()]
    cpu, gpu = stage.both(steps.BRIGHTNESS, *inputs, weights=(2.0, 0.7), shadowed=(True, False))
    np.testing.assert_allclose(gpu, cpu, atol=1e-6)
    unlit = stage.both(steps.UNLIT, stage.surface, normal="shading_normal")
    assert not np.any(unlit)


def _ramps(instances=None):
    tables = [table_of(RAMP), table_of(SMOOTH_RAMP)]
    more = {} if instances is None else {"instances": np.array(instances, np.int32)}
    return more | {
        "pieces": np.concatenate([table.packed() for table in tables]),
        "starts": np.cumsum([0, *(len(table.starts) for table in tables)]).astype(np.int32),
        "clamps": np.array([table.clamps for table in tables], np.uint8),
    }


@pytest.mark.parametrize("mix", list(MIXES))
@pytest.mark.parametrize("instances", [None, (0, -1, 1, -2, 1, 0, -1)])
@pytest.mark.parametrize("rim", [0.0, 0.7])
@pytest.mark.parametrize("base", [False, True])
def test_shade(stage, mix, instances, rim, base):
    rng = np.random.default_rng(2)
    table = rng.uniform(0, 1, (3, 6)).astype(np.float32)
    images = [rng.uniform(0, 1, (*stage.light.shape, 4)).astype(np.float32)] * base
    cpu, gpu = stage.both(
        steps.SHADE, stage.surface, stage.light, *images, normal="shading_normal", table=table,
        materials=np.array([0, 1, -2], np.int32), mix=mix, emission=0.4, rim=(0.5, rim, 1.0, 0.8, 0.2),
        forward=None, **_ramps(instances),
    )  # fmt: skip
    assert 0.2 < cpu[..., 3].mean() < 1.0
    # HSV pieces have coefficients of some tens; the rim's edge may fall the other way in a few pixels.
    assert share_beyond(gpu, cpu, 1e-4) < 1e-3


def test_spare(stage):
    shaded = np.zeros((*stage.light.shape, 4), np.float32)
    shaded[::3, 1:, 3] = 1.0
    cpu, gpu = stage.both(steps.SPARE, stage.light, shaded)
    np.testing.assert_array_equal(cpu, np.where(shaded[..., 3] > 0.0, stage.light, 1.0))
    np.testing.assert_array_equal(gpu, cpu)


def test_glow(stage):
    rng = np.random.default_rng(3)
    shaded, emission = (rng.uniform(0, 1, (*stage.light.shape, 4)).astype(np.float32) for _ in range(2))
    shaded[::3, 1:, 3] = 0.0
    cpu, gpu = stage.both(steps.GLOW, shaded, emission, strength=0.4)
    expected = shaded.astype(np.float64)
    expected[..., :3] += 0.4 * emission[..., :3] * (shaded[..., 3:] > 0.0)
    np.testing.assert_allclose(cpu, expected, atol=1e-6)
    np.testing.assert_allclose(gpu, cpu, atol=1e-6)


@pytest.mark.parametrize("anchor", ["screen", "object", "surface"])
@pytest.mark.parametrize("size", [0.7, 1.3])
@pytest.mark.parametrize("places", [None, Places(4, PixelFilter())])
def test_halftone(stage, anchor, size, places):
    rng = np.random.default_rng(4)
    anchors = np.zeros((7, 12), np.float32)
    anchors[:, :2] = rng.uniform(0, 90, (7, 2))
    if anchor == "surface":
        turns = np.array([rotation(rng) for _ in range(7)])
        anchors = np.concatenate([turns, rng.uniform(-1, 1, (7, 3, 1))], 2).reshape(7, 12).astype(np.float32)
    cell = 0.3 if anchor == "surface" else 8.0
    cpu, gpu = stage.both(
        steps.HALFTONE, stage.surface, stage.light, anchors=anchors, inked=b"\1\1\1\0\1\1\1",
        chunk=replace(stage.chunk, places=places), anchor=anchor, origin=(3, 5),
        turn=(0.8 / cell, 0.6 / cell), dot=(size, 0.1, 0.9), fade=(-0.2, 9.0), view=CAMERA,
        pixel_filter=PixelFilter("BOX", 0.6),
    )  # fmt: skip
    assert 0.3 < cpu.mean() < 0.99
    # An area of differences of areas, divided by a footprint of some hundredths of a cell.
    assert share_beyond(gpu, cpu, 2e-3) < 1e-3


@pytest.mark.parametrize(
    "wanted", [(True, False, None), (False, True, None), (False, False, 0.9), (True, True, 0.5)]
)
@pytest.mark.parametrize("width", [1, 4])
def test_lines_and_outline(stage, wanted, width):
    objects, materials, crease = wanted
    marked = stage.everything - {2}
    params = {"marked": marked, "width": width, "objects": objects, "materials": materials, "crease": crease}
    chunk = Chunk(*SIZE, 20, 70, 0, (0.0, 0.0)).grown(width // 2 + 1)
    attributes = frozenset(("instance", "object_id", "material", "shading_normal"))
    cpu, gpu = (
        SURFACE.twin(device.name)(device, geometry, CAMERA, stage.everything, chunk, attributes)
        for device, geometry in ((stage.cpu, stage.geometry), (stage.gpu, stage.gpu_geometry))
    )
    cpu = np.asarray(steps.LINES.cpu(stage.cpu, cpu, **params))
    gpu = stage.gpu.to_host(steps.LINES.gpu(stage.gpu, gpu, **params))
    assert cpu.shape == gpu.shape == (50, SIZE[0])
    assert 0.001 < cpu.mean() < 0.6
    # Each rasteriser may give a silhouette's pixel to the other side, and a line is that many pixels wide.
    assert (cpu != gpu).mean() < 2e-3 * width


def test_outline(stage):
    hull = steps.HULL.cpu(
        stage.cpu, stage.geometry, view=CAMERA, pixel=0.6 / SIZE[1], instances=(1, 2, 4, 5), width=3.0,
        in_pixels=True, least=0.0, most=9.0, scales=(1.0, 0.5, 1.0, 2.0), thickness="",
    )  # fmt: skip
    params = {"view": CAMERA, "colours": np.random.default_rng(1).uniform(0, 1, (7, 3)), "chunk": stage.chunk}
    params["colours"] = params["colours"].astype(np.float32)
    lines = (stage.light > 0.97).astype(np.uint8)
    for more in ((), (lines,)):
        cpu = steps.OUTLINE.cpu(
            stage.cpu, stage.surface, steps.HULL_GEOMETRY.cpu(stage.cpu, hull), *more, **params
        )
        gpu = steps.OUTLINE.gpu(
            stage.gpu, stage.gpu.from_host(stage.surface), steps.HULL_GEOMETRY.gpu(stage.gpu, hull),
            *(stage.gpu.from_host(each) for each in more), **params,
        )  # fmt: skip
        assert 0.02 < cpu[..., 3].mean() < 0.5
        assert share_beyond(stage.gpu.to_host(gpu), cpu, 1e-6) < 2e-3  # edges that fall the other way
    empty = steps.HULL_GEOMETRY.gpu(stage.gpu, steps.Hull(CAMERA.eye, {}))
    nothing = steps.OUTLINE.gpu(stage.gpu, stage.gpu.from_host(stage.surface), empty, **params)
    assert not stage.gpu.to_host(nothing).any()
