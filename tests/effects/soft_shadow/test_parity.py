"""Soft shadows: each step of the GPU against the kernels on identical inputs.

Tolerances. The GPU projects points and texels in float32 where the kernels use float64, so an edge may fall
on the other side of a light sample, which is 1/256 of the light; a region's border may move by a texel that
covers none of it. So almost all points agree to rounding (1e-4), a few differ by some samples, and the mean
of the difference stays far below the layer's own error of 1e-2.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.arrays import Opacities
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.surface import Chunk
from strata.addon.core.view import View
from strata.addon.effects.shared.steps import LAYERED_DEPTH, SURFACE
from strata.addon.effects.soft_shadow.steps import BACKPROJECT, PREPARE, RECEIVERS, VISIBILITY
from strata.addon.effects.soft_shadow.views import cube_axes, light_views
from strata.tests.support.gpu_scenes import gpu_device, on_both, scene_of, share_beyond, sheets_over_ground

POINTS = ("position", "geometric_normal", "shading_normal", "instance")
SIZE = (120, 68)
DOWN = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
C30, S30 = math.cos(math.pi / 6), 0.5
SLANTED = ((1.0, 0.0, 0.0), (0.0, C30, S30), (0.0, S30, -C30))
CAMERA = View(
    (0, -6, 5.0), (1, 0, 0), (0, 0.64, 0.7683749), (0, 0.7683749, -0.64), (-0.5, 0.5, -0.28, 0.28), 0.1, 99.0
)
LIGHTS = {
    "rectangle": Emitter(EmitterKind.RECTANGLE, (0.5, -0.5, 5.0), *SLANTED, 0.6, 0.4),
    "rectangle of spread": Emitter(EmitterKind.RECTANGLE, (0.5, -0.5, 5.0), *DOWN, 0.6, 0.4, 1.2),
    "ellipse": Emitter(EmitterKind.ELLIPSE, (0.5, -0.5, 5.0), *DOWN, 0.6, 0.4),
    "sphere": Emitter(EmitterKind.SPHERE, (0.3, -0.2, 2.9), *DOWN, 0.2, 0.2),
    "facing disk": Emitter(EmitterKind.FACING_DISK, (0.3, -0.2, 2.9), *DOWN, 0.2, 0.2),
    "sphere too close": Emitter(EmitterKind.SPHERE, (0.3, -0.2, 0.7), *DOWN, 0.5, 0.5),
    "spot": Emitter(EmitterKind.SPHERE, (0.3, -0.2, 4.1), *DOWN, 0.3, 0.3, math.inf, 0.6, 0.3),
    "sun": Emitter(EmitterKind.DISTANT_DISK, (0.0, 0.0, 0.0), *SLANTED, 0.05, 0.05),
    "rectangle of no size": Emitter(EmitterKind.RECTANGLE, (0.5, -0.5, 5.0), *DOWN, 0.0, 0.0),
}


class Courtyard:
    """Bumpy sheets over a ground that no light's plane is parallel to; everything as host arrays."""

    def __init__(self):
        meshes, instances = sheets_over_ground(7, (0,))
        self.outline, self.arrays = scene_of(meshes, instances, (Opacities(), Opacities()))
        self.everything = frozenset(range(len(instances)))
        (self.cpu, self.geometry), _ = on_both(self.outline, self.arrays)
        chunk = Chunk(*SIZE, 0, SIZE[1], 0, (0.0, 0.0))
        self.surface = SURFACE.cpu(self.cpu, self.geometry, CAMERA, self.everything, chunk, frozenset(POINTS))
        boxes = []
        for mesh, matrix, _, _ in instances:
            world = meshes[mesh].positions @ matrix[:3, :3].T + matrix[:3, 3]
            boxes.append((world.min(axis=0), world.max(axis=0)))
        self.boxes = np.array(boxes)
        seen = self.surface["position"][self.surface["instance"] >= 0] + np.array(CAMERA.eye)
        self.region = np.array([[seen.min(axis=0), seen.max(axis=0)]])

    def depths(self, emitter, layers=4, resolution=128):
        """(view, depths) of every view of the light."""
        views, _ = light_views(emitter, self.boxes, self.region)
        for _, view in views:
            size = resolution, resolution
            yield view, LAYERED_DEPTH.cpu(self.cpu, self.geometry, view, self.everything, layers, *size)


@pytest.fixture(scope="module")
def courtyard():
    return Courtyard()


def shadows(
    courtyard,
    emitter,
    method,
    maps,
    max_samples=512,
    refinements=2,
    bias=(1.0, 1e9),
    surface=None,
    tables=(),
    spacing=1,
    leave_edges=False,
):
    """Visibility and uncertainty by the plain kernel (the thesis's sum has only one, and only the fast one
    knows a grid of points) and by the GPU."""
    gpu, surface = gpu_device(), surface or courtyard.surface
    prepared = [kernels.soft_shadow_prepare(depths, view.packed(), *bias) for view, depths in maps]
    points = [surface[name] for name in POINTS[:3]]
    arguments = (*points, np.array(CAMERA.eye), emitter.packed(), prepared, max_samples, refinements)
    twin = "area" if method == "area" else "plain" if spacing == 1 else "bitmask"
    cpu = kernels.soft_shadow_backproject(
        *arguments,
        method=twin,
        leave_uncertain=method == "hybrid",
        leave_edges=leave_edges,
        close_casters=list(tables),
        spacing=spacing,
    )
    on_gpu = [PREPARE.gpu(gpu, gpu.from_host(depths), view, *bias) for view, depths in maps]
    values = BACKPROJECT.gpu(
        gpu,
        gpu.from_host(surface),
        *on_gpu,
        *(gpu.from_host(table) for table in tables),
        eye=CAMERA.eye,
        emitter=emitter,
        method=method,
        max_samples=max_samples,
        refinements=refinements,
        spacing=spacing,
        maps=len(on_gpu),
        leave_edges=leave_edges,
    )
    values = gpu.to_host(values)
    return cpu, (values["visibility"], values["uncertain"])


def assert_alike(cpu, gpu, rounding=1e-4, told=1):
    """`told`: as how many points one evaluated point counts, as it is interpolated."""
    assert cpu[0].shape == gpu[0].shape
    assert gpu[0].dtype == np.float32
    assert gpu[1].dtype == np.uint8
    difference = np.abs(cpu[0] - gpu[0])
    assert np.isfinite(gpu[0]).all()
    assert share_beyond(cpu[0], gpu[0], rounding) < 0.01
    assert difference.max() < 0.06
    assert difference.mean() < 2e-5 * told
    assert (cpu[1] != gpu[1]).mean() < 2e-3


@pytest.mark.parametrize("method", ["bitmask", "hybrid", "area"])
@pytest.mark.parametrize("light", LIGHTS)
def test_every_kind_of_light_agrees(courtyard, light, method):
    maps = list(courtyard.depths(LIGHTS[light]))
    assert maps
    cpu, gpu = shadows(courtyard, LIGHTS[light], method, maps)
    assert cpu[0].min() < 0.2 or method == "hybrid"  # there is a shadow to compare
    assert cpu[1].any() == (method == "hybrid")
    assert_alike(cpu, gpu)


@pytest.mark.parametrize("windows", [1, 3])
def test_hard_edges_of_a_sun_are_left_to_rays_alike(courtyard, windows):
    sun = replace(LIGHTS["sun"], half_width=0.005, half_height=0.005)
    maps = list(courtyard.depths(sun) if windows == 1 else nested(courtyard, sun))
    cpu, gpu = shadows(courtyard, sun, "bitmask", maps, leave_edges=True)
    assert 0.02 < (cpu[1] == 1).mean() < 0.5
    assert_alike(cpu, gpu)


@pytest.mark.parametrize("spacing", [2, 3])
@pytest.mark.parametrize("method", ["bitmask", "hybrid"])
@pytest.mark.parametrize("light", LIGHTS)
def test_interpolated_points_agree(courtyard, light, method, spacing):
    maps = list(courtyard.depths(LIGHTS[light]))
    assert_alike(*shadows(courtyard, LIGHTS[light], method, maps, spacing=spacing), told=spacing**2)


def nested(courtyard, emitter):
    """(view, depths) of three windows, each within the next, an orthographic one about an eye of its own."""
    *_, widest = (view for view, _ in courtyard.depths(emitter))
    if not widest.orthographic:
        widest = replace(widest, window=tuple(np.clip(widest.window, -2.0, 2.0).tolist()))
    # No border on a texel's border, where rounding decides whose the texel is.
    for share in (0.27, 0.61, 1.0):
        left, right, bottom, top = (
            share**power * side for power, side in zip((1, 2, 1, 1), widest.window, strict=True)
        )
        x, y = (0.5 * (left + right), 0.5 * (bottom + top)) if widest.orthographic else (0.0, 0.0)
        eye = np.array(widest.eye) + x * np.array(widest.right) + y * np.array(widest.up)
        view = replace(widest, eye=tuple(eye.tolist()), window=(left - x, right - x, bottom - y, top - y))
        yield (
            view,
            LAYERED_DEPTH.cpu(courtyard.cpu, courtyard.geometry, view, courtyard.everything, 4, 128, 128),
        )


@pytest.mark.parametrize("method", ["bitmask", "hybrid"])
@pytest.mark.parametrize("light", ["spot", "sphere"])
def test_tables_of_close_casters_agree(courtyard, light, method):
    maps = list(courtyard.depths(LIGHTS[light]))
    rng = np.random.default_rng(5)
    tables = [rng.integers(0, 2, (6, 9)).astype(np.uint8) for _ in maps]
    cpu, gpu = shadows(courtyard, LIGHTS[light], method, maps, tables=tables)
    assert_alike(cpu, gpu)
    without, _ = shadows(courtyard, LIGHTS[light], method, maps)
    assert (cpu[1] != without[1]).mean() > 0.02


@pytest.mark.parametrize("method", ["bitmask", "hybrid", "area"])
@pytest.mark.parametrize("light", ["rectangle", "ellipse", "sun", "spot"])
def test_nested_windows_agree(courtyard, light, method):
    maps = list(nested(courtyard, LIGHTS[light]))
    cpu, gpu = shadows(courtyard, LIGHTS[light], method, maps)
    assert_alike(cpu, gpu)
    # All three are read.
    for few in (maps[:1], maps[1:]):
        without, _ = shadows(courtyard, LIGHTS[light], method, few)
        assert np.abs(without[0] - cpu[0]).max() > 0.01


@pytest.mark.parametrize("method", ["bitmask", "hybrid", "area"])
def test_faces_of_nested_windows_agree(courtyard, method):
    light = LIGHTS["facing disk"]
    maps = []
    for number, (_, axes) in enumerate(cube_axes()):
        # Of some faces one window, of others two.
        for side in (0.87, 2.3)[number % 2 :]:
            view = View(light.centre, *axes, (-side, side, -side, side), 0.01, 20.0)
            shown = courtyard.cpu, courtyard.geometry, view, courtyard.everything
            maps.append((view, LAYERED_DEPTH.cpu(*shown, 4, 128, 128)))
    cpu, gpu = shadows(courtyard, light, method, maps)
    assert_alike(cpu, gpu)
    # Both of a face's windows are read.
    without, _ = shadows(courtyard, light, method, [each for each in maps if each[0].window[1] > 1.0])
    assert np.abs(without[0] - cpu[0]).max() > 0.01


@pytest.mark.parametrize(
    ("layers", "resolution", "max_samples", "refinements", "bias"),
    [
        (2, 128, 512, 0, (1.0, 1e9)),
        (9, 96, 512, 1, (1.0, 1e9)),
        (4, 37, 4096, 2, (0.0, 1e9)),
        (4, 256, 16, 4, (4.0, 0.01)),
        (3, 200, 65536, 2, (2.0, 1e-3)),
    ],
)
@pytest.mark.parametrize("method", ["bitmask", "area"])
def test_every_setting_agrees(courtyard, method, layers, resolution, max_samples, refinements, bias):
    for light in ("rectangle", "sun"):
        maps = list(courtyard.depths(LIGHTS[light], layers, resolution))
        cpu, gpu = shadows(courtyard, LIGHTS[light], method, maps, max_samples, refinements, bias)
        # The thesis's sum adds thousands of quotients by differences that are nearly nothing.
        assert_alike(cpu, gpu, 1e-4 if method == "bitmask" else 1e-3)


@pytest.mark.parametrize("light", ["rectangle", "sphere", "sun"])
def test_a_light_without_a_map_agrees(courtyard, light):
    cpu, gpu = shadows(courtyard, LIGHTS[light], "bitmask", [])
    assert_alike(cpu, gpu)
    assert cpu[0].min() < 0.9  # the horizon alone hides some


def test_the_comparison_sees_a_light_a_centimetre_elsewhere(courtyard):
    emitter = LIGHTS["rectangle"]
    maps = list(courtyard.depths(emitter))
    moved = Emitter(EmitterKind.RECTANGLE, (0.51, -0.5, 5.0), *SLANTED, 0.6, 0.4)
    cpu, _ = shadows(courtyard, emitter, "bitmask", maps)
    _, gpu = shadows(courtyard, moved, "bitmask", list(courtyard.depths(moved)))
    with pytest.raises(AssertionError):
        assert_alike(cpu, gpu)


def test_points_that_are_not_finite_or_behind_the_light_are_lit(courtyard):
    surface = {name: array.copy() for name, array in courtyard.surface.items()}
    surface["position"][:20] = np.nan
    surface["position"][20:30, :, 2] = 50.0
    surface["position"][30:33] = np.inf
    surface["geometric_normal"][33:36] = np.nan
    surface["shading_normal"][36:40] = np.nan
    maps = list(courtyard.depths(LIGHTS["rectangle"]))
    _, (visibility, uncertain) = shadows(courtyard, LIGHTS["rectangle"], "bitmask", maps, surface=surface)
    assert np.isfinite(visibility).all()
    assert (visibility[:33] == 1.0).all()
    assert (visibility[36:40] == 1.0).all()
    assert not uncertain[:33].any()


def test_both_runs_give_the_same_bits(courtyard):
    maps = list(courtyard.depths(LIGHTS["sphere"]))
    runs = [shadows(courtyard, LIGHTS["sphere"], "bitmask", maps)[1] for _ in range(2)]
    assert np.array_equal(runs[0][0], runs[1][0])
    assert np.array_equal(runs[0][1], runs[1][1])


@pytest.mark.parametrize("light", ["rectangle", "sun"])
def test_the_pyramid_holds_the_largest_rise_of_every_square(courtyard, light):
    gpu = gpu_device()
    view, depths = next(courtyard.depths(LIGHTS[light], 3, 50))
    value = PREPARE.gpu(gpu, gpu.from_host(depths), view, 0.0, 1e9)
    pyramid = gpu.to_host(value["pyramid"])
    rise = -depths if view.orthographic else 1.0 / depths
    rise = np.where(np.isfinite(depths), rise, -np.inf).max(axis=0)
    place = np.array([0, 0])
    for level in range(7):
        count = -(-50 // (1 << level))
        squares = np.full((count << level, count << level), -np.inf)
        squares[:50, :50] = rise
        largest = squares.reshape(count, 1 << level, count, 1 << level).max(axis=(1, 3))
        found = pyramid[place[1] : place[1] + count, place[0] : place[0] + count]
        np.testing.assert_allclose(found[..., 0], largest, rtol=3e-7)
        # Without a bias both maxima are one.
        assert np.array_equal(found[..., 0], found[..., 1])
        place = np.array([50 - (50 >> level) + level, 50])


def test_receivers_and_visibility_agree(courtyard):
    gpu = gpu_device()
    rng = np.random.default_rng(8)
    share = rng.random(SIZE[::-1]).astype(np.float32)
    shadow = {"visibility": share, "uncertain": np.zeros(share.shape, np.uint8)}
    lit = frozenset({0, 3, 5})
    gpu.set_scene(courtyard.outline, courtyard.arrays)
    expected = RECEIVERS.cpu(
        courtyard.cpu, courtyard.surface, VISIBILITY.cpu(courtyard.cpu, shadow), receivers=lit
    )
    found = RECEIVERS.gpu(
        gpu, gpu.from_host(courtyard.surface), VISIBILITY.gpu(gpu, gpu.from_host(shadow)), receivers=lit
    )
    assert np.array_equal(gpu.to_host(found), expected)
    assert (expected != share).any()


@pytest.mark.parametrize("bad", [{"gradient_scale": -1.0}, {"gradient_cap_m": math.nan}])
def test_bad_settings_are_refused_as_the_kernels_refuse_them(courtyard, bad):
    gpu = gpu_device()
    view, depths = next(courtyard.depths(LIGHTS["rectangle"], 2, 32))
    scale, cap = bad.get("gradient_scale", 1.0), bad.get("gradient_cap_m", 1e9)
    with pytest.raises(ValueError, match="negative"):
        kernels.soft_shadow_prepare(depths, view.packed(), scale, cap)
    with pytest.raises(ValueError, match="negative"):
        PREPARE.gpu(gpu, gpu.from_host(depths), view, scale, cap)


def test_only_the_sum_of_areas_needs_a_second_depth(courtyard):
    maps = list(courtyard.depths(LIGHTS["rectangle"], 1, 64))
    assert_alike(*shadows(courtyard, LIGHTS["rectangle"], "bitmask", maps))
    prepared = [kernels.soft_shadow_prepare(depths, view.packed()) for view, depths in maps]
    points = [courtyard.surface[name] for name in POINTS[:3]]
    emitter = LIGHTS["rectangle"].packed()
    with pytest.raises(ValueError, match="two layers"):
        kernels.soft_shadow_backproject(*points, np.array(CAMERA.eye), emitter, prepared, method="area")
    gpu = gpu_device()
    prepared = [PREPARE.gpu(gpu, gpu.from_host(depths), view, 1.0, 1e9) for view, depths in maps]
    settings = {"max_samples": 512, "refinements": 1, "spacing": 1, "maps": len(maps)}
    with pytest.raises(ValueError, match="two layers"):
        BACKPROJECT.gpu(
            gpu,
            gpu.from_host(courtyard.surface),
            *prepared,
            eye=CAMERA.eye,
            emitter=LIGHTS["rectangle"],
            method="area",
            **settings,
        )
