"""Nothing needed is ever left out: checked against segments drawn at random from light to point."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strata.addon.core.arrays import Arrays, MeshArrays, Opacities
from strata.addon.core.culling import casters_into, corners_of, drawn_from, in_frustum, lights_region
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.material import Material
from strata.addon.core.outline import Bounds, Instance, Light, Mesh, Outline
from strata.addon.core.view import View
from strata.addon.devices.cpu import CpuDevice

IDENTITY = tuple(tuple(float(i == j) for j in range(4)) for i in range(4))


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return rotation


def random_view(rng: np.random.Generator, orthographic: bool) -> View:
    right, up, forward = random_rotation(rng)
    window = (-0.4, 0.6, -0.3, 0.5) if not orthographic else (-2.0, 3.0, -1.0, 2.0)
    return View(
        tuple(rng.normal(size=3)), tuple(right), tuple(up), tuple(forward), window, 0.1, 9.0, orthographic
    )


def random_light(rng: np.random.Generator, kind: EmitterKind) -> Light:
    right, up, forward = random_rotation(rng)
    size = 0.05 if kind == EmitterKind.DISTANT_DISK else 0.7
    centre = tuple(4.0 * rng.normal(size=3))
    emitter = Emitter(kind, centre, tuple(right), tuple(up), tuple(forward), size, size)
    return Light("light", "light", "AREA", emitter, (1.0, 1.0, 1.0))


def points_on(light: Light, targets: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A point of the light for each target; far away for a sun."""
    emitter, count = light.emitter, len(targets)
    u, v = rng.uniform(-1.0, 1.0, (2, count, 1))
    if emitter.kind == EmitterKind.DISTANT_DISK:
        angle, radius = math.pi * u, np.sqrt(np.abs(v)) * emitter.half_width
        across = np.cos(angle) * radius * np.array(emitter.right)
        across = across + np.sin(angle) * radius * np.array(emitter.up)
        return targets - 100.0 * (np.array(emitter.forward) + across)
    if emitter.kind == EmitterKind.SPHERE:
        direction = rng.normal(size=(count, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        return np.array(emitter.centre) + emitter.half_width * direction
    offset = u * emitter.half_width * np.array(emitter.right) + v * emitter.half_height * np.array(emitter.up)
    return np.array(emitter.centre) + offset


@pytest.mark.parametrize("kind", [EmitterKind.RECTANGLE, EmitterKind.SPHERE, EmitterKind.DISTANT_DISK])
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_box_that_a_shadow_segment_crosses_is_kept(kind, seed):
    rng = np.random.default_rng(seed)
    light = random_light(rng, kind)
    low = rng.normal(size=3)
    region = np.stack([low, low + rng.uniform(0.1, 2.0, 3)])
    targets = rng.uniform(region[0], region[1], (64, 3))
    sources = points_on(light, targets, rng)
    on_the_way = sources + rng.uniform(0.0, 1.0, (64, 1)) * (targets - sources)
    half = rng.uniform(0.01, 0.5, (64, 3))
    boxes = np.stack([on_the_way - half, on_the_way + half], axis=1)
    assert casters_into(light, region, boxes).all()
    if kind == EmitterKind.RECTANGLE:
        in_front = (targets - np.array(light.emitter.centre)) @ np.array(light.emitter.forward) > 0.0
        assert lights_region(light, region) or not in_front.any()


@pytest.mark.parametrize("orthographic", [False, True])
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_box_around_a_visible_point_is_in_the_frustum(orthographic, seed):
    rng = np.random.default_rng(seed)
    view = random_view(rng, orthographic)
    left, right, bottom, top = view.window
    depth = rng.uniform(view.near, view.far, 64)
    scale = np.ones(64) if orthographic else depth
    x, y = rng.uniform(left, right, 64) * scale, rng.uniform(bottom, top, 64) * scale
    axes = np.array([view.right, view.up, view.forward])
    points = np.stack([x, y, depth], axis=1) @ axes + np.array(view.eye)
    half = rng.uniform(0.0, 0.5, (64, 3))
    assert in_frustum(view, np.stack([points - half, points + half], axis=1)).all()


def test_boxes_behind_the_eye_and_beside_the_light_are_left_out():
    view = View((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, -1), (-1, 1, -1, 1), 0.1, 100.0)
    behind = np.array([[[-1.0, -1.0, 2.0], [1.0, 1.0, 3.0]]])
    assert not in_frustum(view, behind).any()
    rng = np.random.default_rng(1)
    light = random_light(rng, EmitterKind.SPHERE)
    centre = np.array(light.emitter.centre)
    region = np.stack([centre + 4.0, centre + 5.0])
    beside = np.stack([centre - 9.0, centre - 8.0])[None]
    assert not casters_into(light, region, beside).any()


def test_corners_are_the_eight_of_the_box():
    corners = corners_of(np.array([[[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]]))[0]
    assert len({tuple(corner) for corner in corners}) == 8
    assert corners.min(axis=0).tolist() == [0.0, 1.0, 2.0]
    assert corners.max(axis=0).tolist() == [3.0, 4.0, 5.0]


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_a_map_of_what_may_be_drawn_is_the_map_of_all(orthographic, seed):
    """To the last bit: what is left out has no texel."""
    rng = np.random.default_rng(seed)
    view = random_view(rng, orthographic)
    device = CpuDevice()
    centres = rng.normal(size=(200, 3)) * 4.0 + view.eye
    parts, meshes, matrices = [], [], []
    for index, centre in enumerate(centres):
        corners = rng.normal(size=(3, 3)) * rng.uniform(0.01, 2.0) + centre
        box = Bounds(tuple(corners.min(axis=0).tolist()), tuple(corners.max(axis=0).tolist()))
        parts.append(Instance(str(index), index, IDENTITY, box, index, (0,)))
        starts = np.array([0, 3], np.int32)
        # Not around the origin: float32 corners may lie beside their box by a rounding.
        matrix = np.eye(4)
        matrix[:3, 3] = centre
        matrices.append(matrix)
        local = (corners - centre).astype(np.float32)
        meshes.append(MeshArrays(local, np.arange(3, dtype=np.int32), starts))
    headers = tuple(Mesh(str(i), str(i), 3, 1) for i in range(len(parts)))
    materials = (Material("m"),)
    outline = Outline("S", "L", 1, (), tuple(parts), headers, materials)
    device.set_scene(outline, Arrays(tuple(meshes), np.array(matrices), (Opacities(),)))
    geometry = device.geometry()
    everything = frozenset(range(len(parts)))
    drawn = drawn_from(view, everything, outline.instances)
    assert 0 < len(drawn) < len(parts)

    def depths(casters):
        mask = device.instance_mask(casters)
        return device.kernels.layered_depth(geometry, mask, view.packed(), 3, 64, 64)

    assert np.isfinite(depths(everything)).any()
    assert np.array_equal(depths(drawn), depths(everything))
