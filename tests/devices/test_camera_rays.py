"""View rays and what they see, against the rasteriser and against one another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.core.executor import Executor
from strata.addon.core.shot import Camera, Raster, Shot
from strata.addon.core.surface import ATTRIBUTES
from strata.addon.core.view_rays import lines_of_sight, view_rays
from strata.addon.devices.cpu import CpuDevice, CpuRays
from strata.addon.effects.shared.steps import ray_accelerator
from strata.tests.devices.facets import facets, weights_along, weights_at
from strata.tests.measure.scenes import random_scene, shot_of

NAMES = frozenset(ATTRIBUTES)
JITTER = (0.31, -0.7)
TURNED = {"right": (0.8, 0.6, 0.0), "up": (-0.36, 0.48, 0.8), "forward": (0.48, -0.64, 0.6)}


def dressed(seed: int):
    """A random scene, mirrored in places, with corner normals, uvs, colours and material slots."""
    outline, arrays = random_scene(seed)
    rng = np.random.default_rng(seed)
    matrices = arrays.matrices.copy()
    matrices[1::2, :3, :3] *= (1.0, 1.0, -1.0)  # and nothing is done to the bounds: nothing here culls
    meshes = []
    for mesh in arrays.meshes:
        corners, faces = len(mesh.corner_vertices), len(mesh.face_starts) - 1
        normals = rng.normal(size=(corners, 3))
        normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
        uvs = rng.random((corners, 2), np.float32)
        slots = rng.integers(0, 3, faces).astype(np.int32)
        colours = rng.random((corners, 3), np.float32)
        more = {"corner_uvs": uvs, "corner_colours": colours, "face_slots": slots}
        meshes.append(replace(mesh, corner_normals=normals, **more))
    materials = outline.materials * 2
    instances = tuple(replace(each, materials=(1, 0), object_id=7) for each in outline.instances)
    outline = replace(outline, materials=materials, instances=instances)
    return outline, replace(
        arrays, meshes=tuple(meshes), matrices=matrices, opacities=(*arrays.opacities, *arrays.opacities)
    )


def rays_of(outline, arrays, shot) -> tuple[CpuDevice, CpuRays, frozenset[int]]:
    device = CpuDevice()
    device.set_scene(outline, arrays)
    visible = frozenset(range(len(outline.instances)))
    accelerator = Executor(device, device).value(ray_accelerator(outline, shot), device)
    camera = device.camera_rays(shot, visible, NAMES, 0)
    return device, CpuRays(accelerator, np.array(shot.origin), camera=camera), visible


def all_pixels(width: int, height: int) -> np.ndarray:
    y, x = np.mgrid[0:height, 0:width]
    return np.stack([x, y], axis=-1).reshape(-1, 2)


def turned_shot(orthographic: bool) -> Shot:
    raster = shot_of(3).source
    raster = replace(raster, camera=replace(raster.camera, orthographic=orthographic))
    return replace(shot_of(3), source=raster)


def assert_same(surface: dict[str, np.ndarray], judge: dict[str, np.ndarray]) -> None:
    assert surface.keys() == judge.keys() == NAMES
    for name, expected in judge.items():
        assert surface[name].dtype == ATTRIBUTES[name].dtype
        if ATTRIBUTES[name].dtype is np.int32:
            assert (surface[name] == expected).all(), name
        else:
            assert np.allclose(surface[name], expected, rtol=1e-6, atol=1e-6), name


@pytest.mark.parametrize("orthographic", [False, True])
def test_what_rays_see_is_what_lies_there(orthographic):
    """The kernel, against the same triangles in numpy."""
    outline, arrays = dressed(3)
    shot = turned_shot(orthographic)
    device, rays, visible = rays_of(outline, arrays, shot)
    rays.camera = device.camera_rays(shot, visible - {0}, NAMES, 0)  # without the ground
    pixels = all_pixels(*shot.computed_size)
    jitter = np.random.default_rng(1).uniform(-0.5, 0.5, pixels.shape)
    view = shot.view
    origins, directions = lines_of_sight(view, shot.computed_size, pixels, jitter)
    starts = np.ascontiguousarray(origins + view.near * directions, np.float32)
    room = np.full(len(pixels), view.far - view.near, np.float32)
    mask = rays.camera.visible
    towards = np.ascontiguousarray(directions, np.float32)
    _, instance, triangle = rays.nearest(mask, starts, towards, room)
    seen = rays.look(pixels, jitter).surface
    for name, found in (("instance", instance), ("triangle", triangle)):
        assert (seen[name] == found).all()
    hit = instance >= 0
    assert 100 < hit.sum() < len(hit)
    origins, directions = origins[hit], directions[hit]
    judge = facets(
        outline,
        arrays,
        instance[hit],
        triangle[hit],
        np.array(view.eye),
        lambda points, uvs, rows: weights_along(points, origins[rows], directions[rows]),
        lambda winding, rows: -np.sign((winding * directions[rows]).sum(axis=1)),
    )
    judge["depth"] = judge["position"] @ np.array(view.forward)
    assert_same({name: values[hit] for name, values in seen.items()}, judge)
    for name, values in seen.items():
        assert (values[~hit] == ATTRIBUTES[name].miss).all(), name


def test_what_a_chart_shows_is_what_lies_there():
    outline, arrays = dressed(1)
    device = CpuDevice()
    device.set_scene(outline, arrays)
    rng = np.random.default_rng(2)
    count, origin = 2000, np.array((0.5, -2.0, 1.0))
    instance = rng.integers(0, len(outline.instances), count).astype(np.int32)
    triangles = np.array([outline.meshes[each.mesh].triangles for each in outline.instances])[instance]
    triangle = (rng.random(count) * triangles).astype(np.int32)
    places = rng.random((count, 2))  # most beside their triangle
    instance[::5] = -1
    there = instance >= 0
    surface = device.kernels.chart_surface(
        device.geometry(), instance, triangle, places, origin, sorted(NAMES)
    )
    judge = facets(
        outline,
        arrays,
        instance[there],
        triangle[there],
        origin,
        lambda points, uvs, rows: weights_at(uvs, places[there][rows]),
        lambda winding, rows: np.ones(len(rows)),
    )
    judge["depth"] = np.zeros(there.sum())
    assert_same({name: values[there] for name, values in surface.items()}, judge)
    for name, values in surface.items():
        assert (values[~there] == ATTRIBUTES[name].miss).all(), name


@pytest.mark.parametrize(
    ("instance", "triangle"), [(0, -1), (0, 1 << 20), (1 << 20, 0)], ids=["before", "beyond", "nobody"]
)
def test_a_chart_of_what_is_not_there_is_refused(instance, triangle):
    outline, arrays = dressed(1)
    device = CpuDevice()
    device.set_scene(outline, arrays)
    where = np.array([instance], np.int32), np.array([triangle], np.int32), np.zeros((1, 2))
    with pytest.raises(ValueError, match="not there"):
        device.kernels.chart_surface(device.geometry(), *where, np.zeros(3), ["position"])


def test_looking_stops_when_told():
    shot = turned_shot(False)
    device, rays, _ = rays_of(*dressed(3), shot)
    rays.cancel_flag = device.cancel_flag
    device.cancel_flag.set()
    with pytest.raises(device.cancelled):
        rays.look(all_pixels(8, 8), np.zeros((64, 2)))


@pytest.mark.parametrize("orthographic", [False, True])
def test_rays_see_what_the_rasteriser_sees(orthographic):
    outline, arrays = dressed(3)
    shot = turned_shot(orthographic)
    device, rays, visible = rays_of(outline, arrays, shot)
    width, height = shot.computed_size
    raster = device.kernels.raster_surface(
        device.geometry(),
        device.instance_mask(visible),
        shot.view.packed(),
        width,
        height,
        jitter=JITTER,
        attributes=sorted(NAMES),
    )
    pixels = all_pixels(width, height)
    seen = rays.look(pixels, np.broadcast_to(JITTER, pixels.shape))
    assert seen.surface.keys() == raster.keys() == NAMES
    same = np.ones(len(pixels), bool)
    for name in ("instance", "triangle"):
        same &= seen.surface[name] == raster[name].reshape(-1)
    # The raster snaps to 1/256 pixels: at outlines another triangle may win.
    assert same.mean() > 0.97
    hit = same & (seen.surface["instance"] >= 0)
    assert hit.mean() > 0.3
    for name in NAMES:
        kind, channels = ATTRIBUTES[name].dtype, ATTRIBUTES[name].channels
        ours = seen.surface[name]
        theirs = raster[name].reshape(ours.shape)
        assert ours.dtype == theirs.dtype == kind
        assert ours.shape == ((len(pixels), channels) if channels > 1 else (len(pixels),))
        if kind is np.int32:
            assert (ours[same] == theirs[same]).all(), name
        else:
            # Both are float64 rounded once, but for hits that float32 rays put a hair outside a triangle.
            assert np.allclose(ours[same], theirs[same], rtol=1e-5, atol=1e-4), name
    assert np.isinf(seen.surface["depth"][seen.surface["instance"] < 0]).all()


@pytest.mark.parametrize("orthographic", [False, True])
def test_a_view_ray_leads_to_what_it_sees(orthographic):
    camera = Camera("Camera", (1e5, -2e5, 30.0), **TURNED, orthographic=orthographic)
    shot = Shot("Camera", Raster(camera, (64, 48)))
    view = shot.view
    pixels = all_pixels(64, 48)
    jitter = np.random.default_rng(0).uniform(-1.5, 1.5, pixels.shape)
    at = (pixels + 0.5 + jitter) / (64, 48)
    left, right, bottom, top = view.window
    across = np.array([left, bottom]) + at * (right - left, top - bottom)
    depth = np.random.default_rng(1).uniform(1.0, 9.0, len(pixels))
    scale = 1.0 if orthographic else depth
    axes = np.array([view.right, view.up, view.forward])
    points = np.stack([across[:, 0] * scale, across[:, 1] * scale, depth], axis=1) @ axes
    depth[::7], points[::7] = np.inf, 0.0
    for surface in ({"depth": depth}, {"position": points.astype(np.float32)}):
        rays = view_rays(shot, pixels, jitter, surface)
        assert np.allclose(np.linalg.norm(rays.directions, axis=1), 1.0)
        hit = np.isfinite(rays.distances)
        assert (hit == np.isfinite(depth)).all()
        reached = rays.origins[hit] + rays.distances[hit, None] * rays.directions[hit]
        assert np.allclose(reached, points[hit] + view.eye, atol=1e-5)
