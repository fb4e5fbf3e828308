"""Volumetric light on the CPU and on the GPU: the same maps, the same rays, the same light."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from strata.addon.core.medium import Medium
from strata.addon.core.placement import Places
from strata.addon.core.shot import PixelFilter
from strata.addon.core.surface import Chunk
from strata.addon.core.view import View
from strata.addon.effects.shared.light_views import distant_view, point_views
from strata.addon.effects.shared.steps import LAYERED_DEPTH
from strata.addon.effects.volumetric_light import steps
from strata.addon.effects.volumetric_light.lattice import lattice_of
from strata.addon.effects.volumetric_light.sources import Source, SourceKind
from strata.tests.support.gpu_scenes import on_both, scene_of, triangle_mesh

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
    "wide spot": Source(
        SourceKind.SPOT, (0.3, 0.4, 2.0), (0.1, 0.0, -0.995), 1.0, 0.2, False, math.cos(0.6), 0.4
    ),
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


_CORNERS = {0: MESH.positions}


def _order(source: Source) -> int:
    """Nodes a panel. Sixteen rays at once take the panels of the most demanding one, each by itself its own:
    beside a spot with a size four nodes differ by what they are off."""
    return 16 if source.kind == SourceKind.SPOT and source.radius else 4


def _windows(source: Source) -> int:
    return 6 if source.kind in (SourceKind.UNIFORM, SourceKind.AREA) else 1


def _views(source: Source, instance: int = 0):
    corners = _CORNERS[instance]
    boxes = np.array([[corners.min(axis=0), corners.max(axis=0)]], np.float64)
    axis = np.array(source.axis) / np.linalg.norm(source.axis)
    right = np.cross(axis, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(axis, right), axis])
    if source.kind == SourceKind.DISTANT:
        return distant_view(axes[2], axes[0], axes[1], boxes, np.array([[-9.0] * 3, [9.0] * 3]))
    tangent = math.tan(0.6) if source.kind == SourceKind.SPOT else math.inf
    return point_views(source.position, axes, tangent, boxes, behind=source.kind != SourceKind.AREA)


def _made(device, geometry, depth, source, medium, camera, shadowed, stride, places=None):
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
    chunk = Chunk(WIDTH, HEIGHT, 0, HEIGHT, 0, (0.0, 0.0), places=places)
    margin = stride if stride > 1 else 0
    surface = {"depth": device.from_host(depth)}
    around = {"depth": device.from_host(np.pad(depth, margin, mode="reflect"))}
    part = steps.AIRLIGHT.twin(device.name)(
        device, around, *maps, view=camera, medium=medium, source=source, windows=windows,
        counts=(len(maps),), order=_order(source), stride=stride, chunk=chunk.grown(margin),
    )  # fmt: skip
    scattered = steps.SCATTERED.twin(device.name)(
        device, around, part, part, view=camera, intensity=(2.0, 1.0, 0.5), shares=(0.25, 0.75),
        stride=stride, chunk=chunk,
    )  # fmt: skip
    through = steps.TRANSMITTANCE.twin(device.name)(device, surface, view=camera, medium=medium, chunk=chunk)
    return tuple(device.to_host(image) for image in (part, scattered, through))


def _depth():
    depth = RNG.uniform(2.0, 9.0, (HEIGHT, WIDTH)).astype(np.float32)
    depth[:4] = np.inf
    return depth


@pytest.mark.parametrize("kind", [SourceKind.UNIFORM, SourceKind.SPOT, SourceKind.AREA])
def test_numbers_far_apart_are_held_on_both(kind):
    """Lamps from a point at the eye to beyond what single precision can square, and as different media."""
    (cpu, cpu_geometry), (gpu, gpu_geometry) = on_both(*scene_of([MESH]))
    eye = replace(CAMERA, eye=(0.0, 0.0, 0.0))
    cone = (math.cos(0.8), 0.15) if kind == SourceKind.SPOT else (-1.0, 0.0)
    depth = np.full((HEIGHT, WIDTH), np.inf, np.float32)
    depth[0], depth[1] = 1.0, 1e4
    for away in (1e-20, 1e-9, 1.0, 1e9, 1e18, 1e20):
        for extinction, off in itertools.product((1e-30, 1e-8, 1.0, 1e6), (0.0, 1.0)):
            position = (0.7 * off * away, away, -0.3 * off * away)
            source = Source(kind, position, (0.0, -1.0, 0.0), 1.0, 0.0, False, *cone)
            medium = Medium((extinction, 0.0, 1.0), (0.0, 0.0, 0.0), 0.9)
            arguments = depth, source, medium, eye, False, 1
            ours = _made(cpu, cpu_geometry, *arguments)[0]
            theirs = _made(gpu, gpu_geometry, *arguments)[0]
            assert np.isfinite(theirs).all(), (away, extinction, off)
            held = (ours > 1e-28) & (ours < 1e37)  # where a sum's parts are normal numbers too
            assert theirs[held] == pytest.approx(ours[held], rel=1e-3)


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


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("camera", [CAMERA, FLAT], ids=["perspective", "parallel"])
def test_rays_of_pixels_with_places_of_their_own_are_the_same_on_both(camera, stride):
    source, depth, places = SOURCES["point"], _depth(), Places(5, PixelFilter("GAUSSIAN", 2.25))
    (cpu, cpu_geometry), (gpu, gpu_geometry) = on_both(*scene_of([MESH]))
    arguments = depth, source, MEDIA["grey"], camera, True, stride
    ours, ours_all, through = _made(cpu, cpu_geometry, *arguments, places)
    theirs, theirs_all, theirs_through = _made(gpu, gpu_geometry, *arguments, places)
    for one, other in ((ours, theirs), (ours_all, theirs_all)):
        assert np.sqrt(np.mean((other - one) ** 2)) < 2e-3 * one.mean()
    assert theirs_through == pytest.approx(through, rel=1e-5, abs=1e-7)
    centred = _made(cpu, cpu_geometry, *arguments)[0]
    assert np.sqrt(np.mean((centred - ours) ** 2)) > 5e-3 * ours.mean()


def test_coarse_rays_are_pixels_of_the_image():
    """Every ray of a coarse lattice is one of the full one."""
    for chunk in (Chunk(45, 36, 7, 29, 0, (0.3, -0.2)), Chunk(45, 36, 7, 29, 0, (0.3, -0.2)).grown(5)):
        fine = lattice_of(CAMERA, chunk)
        assert fine.origin == (chunk.x0, chunk.y0)
        for stride in (2, 4):
            coarse = lattice_of(CAMERA, chunk, stride)
            for axis, side in enumerate((coarse.width, coarse.height)):
                at = coarse.packed()[12 + axis] - fine.packed()[12 + axis]
                assert at / fine.step[axis] == pytest.approx(coarse.shown[axis], abs=1e-9)
                assert 0 <= coarse.shown[axis] < stride
                assert coarse.step[axis] == pytest.approx(stride * fine.step[axis])
                pixels = chunk.shape[1 - axis]
                assert coarse.shown[axis] + (side - 1) * stride < pixels <= coarse.shown[axis] + side * stride


def _box(low, high):
    """Triangles of a box."""
    corners = np.array([[(low, high)[b][a] for a, b in enumerate(bits)] for bits in np.ndindex(2, 2, 2)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return triangle_mesh([corners[[f[0], f[i], f[i + 1]]] for f in faces for i in (1, 2)])


HAZE = {
    "around the light": _box((-2.5, -3.0, -2.0), (2.5, 2.5, 3.0)),
    "beside the light": _box((-1.6, -2.0, -1.7), (-0.2, 1.4, 1.1)),
}


def _bounded(device, geometry, depth, source, medium, camera, shadowed, stride):
    """Light and transmittance of a medium that fills instance 1, on one device."""
    views, name = _views(source) if shadowed else [], device.name
    chunk = Chunk(WIDTH, HEIGHT, 0, HEIGHT, 0, (0.0, 0.0))
    deep = LAYERED_DEPTH.twin(name)

    def seen_by(view, instances, layers):
        size = {"width": RESOLUTION, "height": RESOLUTION}
        return deep(device, geometry, view=view, casters=frozenset(instances), layers=layers, **size)

    maps = [steps.LIGHT_MAP.twin(name)(device, seen_by(view, {0}, 1), view=view) for _, view in views]
    ways = [
        steps.MEDIUM_MAP.twin(name)(device, seen_by(view, {1}, 8), view=view) for _, view in _views(source, 1)
    ]
    spanning = {"view": camera, "instances": frozenset({1}), "layers": 8, "chunk": chunk}
    spans = [
        steps.SPANS.twin(name)(device, geometry, stride=each, **spanning)
        for each in dict.fromkeys((stride, 1))
    ]
    surface = {"depth": device.from_host(depth)}
    light = steps.BOUNDED.twin(name)(
        device, surface, spans[0], *maps, *ways, view=camera, medium=medium, source=source,
        windows=_windows(source), counts=(len(maps),), order=_order(source), stride=stride, chunk=chunk,
    )  # fmt: skip
    through = steps.BOUNDED_TRANSMITTANCE.twin(name)(
        device, surface, spans[-1], view=camera, medium=medium, chunk=chunk
    )
    return device.to_host(light), device.to_host(through)


@pytest.mark.parametrize("haze", HAZE)
@pytest.mark.parametrize("shadowed", [False, True], ids=["open", "shadowed"])
@pytest.mark.parametrize(("name", "camera", "stride"), [
    *((name, CAMERA, 1) for name in SOURCES if name != "wide spot"), ("sun", FLAT, 2), ("point", FLAT, 2)
])  # fmt: skip
def test_a_bounded_medium_is_the_same_on_both(name, camera, stride, shadowed, haze):
    source, depth = SOURCES[name], _depth()
    (cpu, cpu_geometry), (gpu, gpu_geometry) = on_both(*scene_of([MESH, HAZE[haze]]))
    arguments = depth, source, MEDIA["coloured"], camera, shadowed, stride
    _CORNERS[1] = HAZE[haze].positions
    ours, through = _bounded(cpu, cpu_geometry, *arguments)
    theirs, theirs_through = _bounded(gpu, gpu_geometry, *arguments)
    scale = float(ours.mean())
    assert np.isfinite(theirs).all()
    if scale == 0.0:  # an area light above shines on what is beneath it only
        assert (theirs == 0.0).all()
    # Entries and exits are rasterised on both: a ray along a silhouette may miss them on one.
    assert np.sqrt(np.mean((theirs - ours) ** 2)) <= 5e-3 * scale
    assert np.mean(np.abs(theirs - ours) > 2e-3 * scale) < 0.03
    assert np.mean(np.abs(theirs_through - through) > 1e-4) < 0.005


@pytest.mark.parametrize("shadowed", [False, True], ids=["open", "shadowed"])
@pytest.mark.parametrize("name", ["point", "bare point"])
def test_the_table_is_the_same_on_both(name, shadowed):
    source, depth = SOURCES[name], np.minimum(_depth(), 20.0)
    images = []
    for device, geometry in on_both(*scene_of([MESH])):
        maps = []
        for _, view in _views(source) if shadowed else []:
            layers = LAYERED_DEPTH.twin(device.name)(
                device,
                geometry,
                view=view,
                casters=frozenset({0}),
                layers=1,
                width=RESOLUTION,
                height=RESOLUTION,
            )
            maps.append(steps.LIGHT_MAP.twin(device.name)(device, layers, view=view))
        part = steps.BY_TABLE.twin(device.name)(
            device, {"depth": device.from_host(depth)}, *maps, view=CAMERA, medium=MEDIA["coloured"],
            source=source, windows=6, counts=(len(maps),), reach=25.0, stride=1,
            chunk=Chunk(WIDTH, HEIGHT, 0, HEIGHT, 0, (0.0, 0.0)),
        )  # fmt: skip
        images.append(device.to_host(part))
    ours, theirs = images
    assert ours.mean() > 0.0
    assert np.sqrt(np.mean((theirs - ours) ** 2)) < 2e-3 * ours.mean()
