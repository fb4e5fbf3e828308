"""Extremes of toon: light on the ramp in double precision, dots and lines in closed form."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from strata.addon.core.arrays import MeshArrays
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.outline import Light
from strata.addon.core.shot import PixelFilter
from strata.addon.core.surface import Chunk
from strata.addon.core.view import View
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared.steps import SURFACE
from strata.addon.effects.toon import steps
from strata.addon.effects.toon.lights import packed_lights
from strata.tests.effects.extremes import Row
from strata.tests.effects.toon.hull_scenes import revolved
from strata.tests.support.gpu_scenes import scene_of

SIDE = 96  # pixels of an image
DOWN = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
LIGHT_BOUND = 1e-5
"""Of a cosine: what single precision leaves of directions."""
DOTS_BOUND = 2e-3
"""Of a mean over cells: an area is a difference of areas over a footprint of some hundredths of a cell."""
LINE_BOUND = 0.25
"""Pixels that an edge of a line is off."""


def _chunk() -> Chunk:
    return Chunk(SIDE, SIDE, 0, SIDE, 0, (0.0, 0.0))


def _largest(found, exact) -> float:
    found = np.asarray(found, np.float64)
    return float(np.abs(found - exact).max()) if np.isfinite(found).all() else math.nan


# Light


def _facing(devices) -> Iterator[Row]:
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(SIDE, SIDE, 3))
    normals = (normals / np.linalg.norm(normals, axis=2, keepdims=True)).astype(np.float32)
    for extreme, centre, spread, offset in (
        ("a lamp 1 mm away", 1e-3, 1e-4, 0.0),
        ("a lamp 1e9 m away", 1e9, 1.0, 0.0),
        ("a lamp in the middle of points 1e-8 m away", 0.0, 1e-8, 0.0),
        ("a lamp 4 m away, all 1e9 m off", 4.0, 1.0, 1e9),
        ("lamps 1e-3 and 1e9 m away, the far one 1e24 times as strong", (1e-3, 1e9), 1e-4, 0.0),
    ):
        heights = centre if isinstance(centre, tuple) else (centre,)
        emitters = [
            Emitter(EmitterKind.SPHERE, (offset, offset, offset + height), *DOWN, 0.0, 0.0)
            for height in heights
        ]
        powers = [(height / heights[0]) ** 2 if height else 1.0 for height in heights]
        lights = [
            Light(f"Lamp {i}", "", "POINT", emitter, (power,) * 3)
            for i, (emitter, power) in enumerate(zip(emitters, powers, strict=True))
        ]
        positions = (spread * rng.uniform(-1, 1, normals.shape)).astype(np.float32)
        table = packed_lights(lights, (offset,) * 3)
        total, full = 0.0, 0.0
        for height, power in zip(heights, powers, strict=True):
            to = np.array([0.0, 0.0, height]) - positions.astype(np.float64)
            distance = np.linalg.norm(to, axis=2)
            weight = power / np.maximum(distance, 1e-10) ** 2
            cosine = (to * normals).sum(axis=2) / distance
            total, full = total + weight * cosine.clip(0.0), full + weight
        errors = {}
        for device in devices:
            surface = device.from_host({"position": positions, "shading_normal": normals})
            count = len(lights)
            found = steps.FACING.twin(device.name)(
                device,
                surface,
                normal="shading_normal",
                lights=table,
                shadowed=(False,) * count,
                linked=(None,) * count,
            )
            errors[device.name] = _largest(device.to_host(found), total / full)
        yield Row(extreme, "double precision", errors, LIGHT_BOUND)


# Dots


def _covered(size: float) -> float:
    """Share of a cell that a dot of that diameter, in cells, covers within it."""
    if size >= math.sqrt(2.0):
        return 1.0
    disc = math.pi * size**2 / 4.0
    return disc if size <= 1.0 else disc - size**2 * math.acos(1.0 / size) + math.sqrt(size**2 - 1.0)


def _dots(devices) -> Iterator[Row]:
    light = np.zeros((SIDE, SIDE), np.float32)
    here = np.zeros((SIDE, SIDE, 3), np.float32)
    here[..., 1] = 10.0
    view = View((0, 0, 0), (1, 0, 0), (0, 0, 1), (0, 1, 0), (-1, 1, -1, 1), 0.1, 1e9)
    for extreme, cell, size, turn, fade in (
        ("dots a thousandth of a pixel apart", 1e-3, 0.7, 0.7, (0.0, 0.0)),
        ("dots a third of a pixel apart, nearly touching", 1.0 / 3.0, 0.999, 0.3, (0.0, 0.0)),
        ("dots that touch, 8 pixels apart", 8.0, 1.0, 0.0, (0.0, 0.0)),
        ("dots just short of everything", 8.0, 1.4142, 0.0, (0.0, 0.0)),
        ("dots of 1.5 cells", 8.0, 1.5, 1.0, (0.0, 0.0)),
        ("dots of 1e-6 cells", 8.0, 1e-6, 0.0, (0.0, 0.0)),
        ("a turn of 1e4 rad", 1e-2, 0.7, 1e4, (0.0, 0.0)),
        ("a fade that ends where it begins, in front", 8.0, 0.7, 0.0, (-1e9, 5.0)),
        ("a fade that ends where it begins, behind", 8.0, 0.7, 0.0, (-1e9, 20.0)),
    ):
        pattern = {
            "anchor": "screen",
            "origin": (0, 0),
            "turn": (math.cos(turn) / cell, math.sin(turn) / cell),
            "dot": (size, 0.0, 1.0),
            "fade": fade,
            "view": view,
            "pixel_filter": PixelFilter("BOX", 0.5),
        }
        inked = 0.0 if fade[0] and fade[1] < 10.0 else _covered(size)
        errors = {}
        for device in devices:
            surface = {"position": here, "instance": np.zeros((SIDE, SIDE), np.int32)}
            found = steps.HALFTONE.twin(device.name)(
                device,
                device.from_host(surface),
                device.from_host(light),
                anchors=np.zeros((1, 12), np.float32),
                inked=b"\1",
                chunk=_chunk(),
                **pattern,
            )
            mean = np.asarray(device.to_host(found), np.float64).mean()
            errors[device.name] = _largest(mean, 1.0 - inked)
        yield Row(extreme, "area of discs", errors, DOTS_BOUND)


# Lines


def _fine_ball(rings: int = 128, steps_around: int = 256, slit: float = 0.0):
    """Positions and quads of a ball of radius 1, with two rings `slit` apart at its equator."""
    angle = np.linspace(-math.pi / 2, math.pi / 2, rings)
    profile = list(zip(np.cos(angle), np.sin(angle), strict=True))
    profile[0], profile[-1] = (0.0, -1.0), (0.0, 1.0)
    if slit:
        middle = rings // 2
        profile[middle:middle] = [(1.0, -slit), (1.0, slit)]
    return revolved(profile, steps_around)


def _ring(
    device, shape, radius: float, distance: float, offset: float, half_field: float, width: float
) -> float:
    """How far, in pixels, the farthest wrong pixel is from where the ring of a ball begins and ends."""
    positions, faces = shape
    corners = np.concatenate(faces).astype(np.int32)
    starts = np.cumsum([0, *map(len, faces)]).astype(np.int32)
    matrix = np.diag([radius, radius, radius, 1.0])
    matrix[:3, 3] = offset, offset + distance, offset
    outline, arrays = scene_of([MeshArrays(positions, corners, starts)], [(0, matrix, 0, (0,))])
    device.set_scene(outline, arrays)
    geometry = device.geometry()
    half = math.tan(half_field)
    near, far = 1e-3 * (distance - radius), 10.0 * distance
    view = View((offset,) * 3, (1, 0, 0), (0, 0, 1), (0, 1, 0), (-half, half, -half, half), near, far)
    surface = SURFACE.twin(device.name)(
        device, geometry, view, frozenset({0}), _chunk(), frozenset({"depth"})
    )
    cpu = CpuDevice()  # hulls are made here, whoever draws them
    cpu.set_scene(outline, arrays)
    pixel = 2.0 * half / SIDE
    hull = steps.HULL.cpu(
        cpu, cpu.geometry(), view=view, pixel=pixel, instances=(0,), width=width, in_pixels=True, least=0.0,
        most=256.0, scales=(1.0,), thickness="",
    )  # fmt: skip
    made = steps.HULL_GEOMETRY.twin(device.name)(device, hull)
    ink = steps.OUTLINE.twin(device.name)(
        device, surface, made, view=view, colours=np.zeros((1, 3), np.float32), chunk=_chunk()
    )
    ink = device.to_host(ink)[..., 3]
    if not np.isfinite(ink).all():
        return math.nan
    x, y = np.meshgrid(np.arange(SIDE) + 0.5 - SIDE / 2, np.arange(SIDE) + 0.5 - SIDE / 2)
    away = np.hypot(x, y)
    inner = radius / math.sqrt(distance**2 - radius**2) / pixel
    wanted = (away > inner) & (away < inner + width)
    off = np.minimum(np.abs(away - inner), np.abs(away - inner - width))
    return float(off[wanted != (ink > 0.5)].max(initial=0.0))


def _lines(devices) -> Iterator[Row]:
    shape = _fine_ball()
    middle = math.radians(20.0)
    for extreme, made, radius, distance, offset, field, width in (
        ("a ball of 1 m, 4 m away", shape, 1.0, 4.0, 0.0, middle, 4.0),
        ("a line of 0.5 pixels", shape, 1.0, 4.0, 0.0, middle, 0.5),
        ("a ball of 1 micrometre", shape, 1e-6, 4e-6, 0.0, middle, 4.0),
        ("a ball of 1e6 m", shape, 1e6, 4e6, 0.0, middle, 4.0),
        ("everything 1e9 m off", shape, 1.0, 4.0, 1e9, middle, 4.0),
        ("a field of view of 0.1 degrees", shape, 1.0, 2000.0, 0.0, math.radians(0.05), 4.0),
        ("a field of view of 170 degrees", shape, 1.0, 1.02, 0.0, math.radians(85.0), 4.0),
        ("slivers of aspect 1e8 around its equator", _fine_ball(slit=1e-10), 1.0, 4.0, 0.0, middle, 4.0),
    ):
        errors = {d.name: _ring(d, made, radius, distance, offset, field, width) for d in devices}
        yield Row(extreme, "circles", errors, LINE_BOUND)


def rows(devices) -> Iterator[Row]:
    """Every extreme, on each of `devices`."""
    for group in (_facing, _dots, _lines):
        yield from group(devices)
