"""Volumetric light on the CPU and on the GPU: the same maps, the same rays, the same light."""

from __future__ import annotations

import math

import numpy as np
import pytest
from gpu_scenes import on_both, scene_of, triangle_mesh
from strata.addon.core.medium import Medium
from strata.addon.core.surface import Chunk
from strata.addon.core.view import View
from strata.addon.effects.shared.light_views import distant_view, point_views
from strata.addon.effects.shared.steps import LAYERED_DEPTH
from strata.addon.effects.volumetric_light import steps
from strata.addon.effects.volumetric_light.lattice import lattice_of
from strata.addon.effects.volumetric_light.sources import Source, SourceKind

RNG = np.random.default_rng(11)
CAMERA = View((0.2, -5.0, 0.1), (1, 0, 0), (0, 0, 1), (0, 1, 0), (-0.5, 0.5, -0.4, 0.4), 0.1, 100.0)
FLAT = View((0.2, -5.0, 0.1), (1, 0, 0), (0, 0, 1), (0, 1, 0), (-2.0, 2.0, -1.6, 1.6), 0.1, 100.0, True)
WIDTH, HEIGHT = 45, 36
RESOLUTION = 128
SOURCES = {
    "sun": Source(SourceKind.DISTANT, (0, 0, 0), (0.48, 0.0, -0.8773), 1.0),
    "point": Source(SourceKind.UNIFORM, (0.3, 0.4, 0.2), (0, 0, -1), 1.0, 0.05),
    "bare point": Source(SourceKind.UNIFORM, (0.3, 0.4, 0.2), (0, 0, -1), 1.0),
    "spot": Source(SourceKind.SPOT, (0.3, 0.4, 2.0), (0.1, 0.0, -0.995), 1.0, 0.0, False, math.cos(0.6), 0.4),
    "area": Source(SourceKind.AREA, (0.3, 0.4, 2.0), (0, 0, -1), 1.0, 0.3),
    "spread area": Source(SourceKind.AREA, (0.3, 0.4, 2.0), (0, 0, -1), 1.0, 0.3, tan_half_spread=1.5),
}
MEDIA = {
    "grey": Medium((0.1, 0.1, 0.1), (0.02, 0.02, 0.02), 0.4),
    "coloured": Medium((0.1, 0.2, 0.05), (0.0, 0.1, 0.02), -0.3),
    "far apart": Medium((1e-3, 1.0, 5.0), (0.0, 0.0, 5.0), 0.0),
}


def _casters():
    """Small triangles around the light, none of them in it."""
    centres = RNG.uniform(-1.5, 1.5, (60, 3))
    centres = centres[np.linalg.norm(centres - [0.3, 0.4, 0.2], axis=1) > 0.3]
    return triangle_mesh(centres[:, None] + RNG.normal(0.0, 0.15, (len(centres), 3, 3)))


MESH = _casters()


def _views(source: Source):
    boxes = np.array([[MESH.positions.min(axis=0), MESH.positions.max(axis=0)]], np.float64)
    axis = np.array(source.axis) / np.linalg.norm(source.axis)
    right = np.cross(axis, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(axis, right), axis])
    if source.kind == SourceKind.DISTANT:
        return distant_view(axes[2], axes[0], axes[1], boxes, np.array([[-9.0] * 3, [9.0] * 3]))
    tangent = math.tan(0.6) if source.kind == SourceKind.SPOT else math.inf
    return point_views(source.position, axes, tangent, boxes, behind=source.kind != SourceKind.AREA)


def _made(device, geometry, depth, source, medium, camera, shadowed, stride):
    """The step's result on one device, and the maps that it read."""
    casters = frozenset({0})
    views = _views(source) if shadowed else []
    maps = []
    for _, view in views:
        twin = LAYERED_DEPTH.twin(device.name)
        layers = twin(
            device, geometry, view=view, casters=casters, layers=1, width=RESOLUTION, height=RESOLUTION
        )
        maps.append(steps.LIGHT_MAP.twin(device.name)(device, layers, view=view))
    windows = 1 if all(name == "" for name, _ in views) else 6
    chunk = Chunk(WIDTH, HEIGHT, 0, HEIGHT, 0, (0.0, 0.0))
    surface = {"depth": device.from_host(depth)}
    common = {"stride": stride, "chunk": chunk}
    part = steps.AIRLIGHT.twin(device.name)(
        device, surface, *maps, view=camera, medium=medium, source=source, windows=windows, order=4, **common
    )
    scattered = steps.SCATTERED.twin(device.name)(
        device, surface, part, part, intensity=(2.0, 1.0, 0.5), shares=(0.25, 0.75), **common
    )
    through = steps.TRANSMITTANCE.twin(device.name)(device, surface, view=camera, medium=medium, chunk=chunk)
    return tuple(device.to_host(image) for image in (part, scattered, through))


def _depth():
    depth = RNG.uniform(2.0, 9.0, (HEIGHT, WIDTH)).astype(np.float32)
    depth[:4] = np.inf
    return depth


@pytest.mark.parametrize("medium", MEDIA)
@pytest.mark.parametrize("shadowed", [False, True], ids=["open", "shadowed"])
@pytest.mark.parametrize("name", SOURCES)
def test_airlight_is_the_same_on_both(name, shadowed, medium):
    source, depth = SOURCES[name], _depth()
    (cpu, cpu_geometry), (gpu, gpu_geometry) = on_both(*scene_of([MESH]))
    arguments = depth, source, MEDIA[medium], CAMERA, shadowed, 1
    ours, ours_all, through = _made(cpu, cpu_geometry, *arguments)
    theirs, theirs_all, theirs_through = _made(gpu, gpu_geometry, *arguments)
    assert np.isfinite(theirs).all()
    scale = float(ours.mean())
    assert scale > 0.0
    if not shadowed and source.kind not in (SourceKind.SPOT, SourceKind.AREA):
        # Sixteen rays at once take the panels of the most demanding one, each by itself its own: with four
        # nodes a panel that differs by 5e-4 at most.
        assert theirs == pytest.approx(ours, rel=1e-3, abs=1e-5 * scale)
    # Where a ray grazes a cone single precision places its entry less well than double does.
    # A texel's edge may fall on either side of a crossing.
    assert np.sqrt(np.mean((theirs - ours) ** 2)) < 2e-3 * scale
    assert np.mean(np.abs(theirs - ours) > 1e-3 * scale) < 0.03
    assert theirs_all == pytest.approx(theirs * np.array([2.0, 1.0, 0.5], np.float32), rel=1e-5)
    assert ours_all == pytest.approx(ours * np.array([2.0, 1.0, 0.5], np.float32), rel=1e-5)
    assert theirs_through == pytest.approx(through, rel=1e-5, abs=1e-7)


@pytest.mark.parametrize("stride", [1, 2, 4])
@pytest.mark.parametrize("camera", [CAMERA, FLAT], ids=["perspective", "parallel"])
@pytest.mark.parametrize("name", ["sun", "point"])
def test_coarser_images_are_the_same_on_both(name, camera, stride):
    source, depth = SOURCES[name], _depth()
    (cpu, cpu_geometry), (gpu, gpu_geometry) = on_both(*scene_of([MESH]))
    arguments = depth, source, MEDIA["grey"], camera, True, stride
    _, ours, _ = _made(cpu, cpu_geometry, *arguments)
    _, theirs, _ = _made(gpu, gpu_geometry, *arguments)
    assert ours.shape == theirs.shape == (HEIGHT, WIDTH, 3)
    assert np.sqrt(np.mean((theirs - ours) ** 2)) < 2e-3 * ours.mean()


def test_coarse_rays_are_pixels_of_the_image():
    """Every ray of a coarse lattice is one of the full one."""
    chunk = Chunk(45, 36, 7, 29, 0, (0.3, -0.2))
    fine = lattice_of(CAMERA, chunk)
    for stride in (2, 4):
        coarse = lattice_of(CAMERA, chunk, stride)
        for axis in range(2):
            at = (coarse.first[axis] - fine.first[axis]) / fine.step[axis]
            assert at == pytest.approx(round(at), abs=1e-9)
            assert coarse.step[axis] == pytest.approx(stride * fine.step[axis])
