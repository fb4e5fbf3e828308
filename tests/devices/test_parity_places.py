"""Pixels that are sampled at places of their own: the GPU against the kernels, with the tolerances of
test_parity_raster. The GPU snaps no corners, and asks edges in float32 relative to the place."""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.core.placement import Places
from strata.addon.core.shot import PixelFilter
from strata.addon.core.surface import Chunk
from strata.addon.effects.shared import gpu_steps
from strata.tests.devices.test_opacity import partly_opaque_sheets
from strata.tests.devices.test_parity_raster import HEIGHT, WIDTH, courtyard, sure_of, surfaces
from strata.tests.kernels.raster_scenes import down, random_triangles, sheet, turned_view
from strata.tests.support.gpu_scenes import (
    EPSILON,
    gpu_device,
    matrix_of,
    on_both,
    scene_of,
    triangle_mesh,
)

PLACES = Places(0x89ABCDEF, PixelFilter())


def chunk_of(width=WIDTH, height=HEIGHT, rows=None, sample=0, places=PLACES, **more) -> Chunk:
    y0, y1 = rows or (0, height)
    return Chunk(width, height, y0, y1, sample, (0.0, 0.0), 8, places=places, **more)


@pytest.mark.parametrize(
    "places", [PLACES, Places(3, PixelFilter("BOX", 0.5)), Places(0, PixelFilter("BOX", 0.0))]
)
def test_places_have_the_same_bits(places):
    (cpu, _), (gpu, _) = on_both(*scene_of([]))
    for sample in (0, 5, 4095):
        chunk = chunk_of(200, 90, (-7, 60), sample, places, x0=-30, x1=171)
        np.testing.assert_array_equal(gpu.to_host(gpu.offsets(chunk)), cpu.offsets(chunk))
    assert gpu.offsets(Chunk(8, 8, 0, 8, 0, (0.0, 0.0))) is None


def test_places_are_kept_until_others_are_asked_for():
    device = gpu_device()
    first = device.offsets(chunk_of())
    assert device.offsets(chunk_of()) is first
    other = device.offsets(chunk_of(sample=1))
    assert first.texture is None
    assert device.offsets(chunk_of(sample=1)) is other


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("kind", ["ordinary", "sliver", "near", "tiny", "huge"])
def test_surfaces_of_triangle_soup_agree(kind, orthographic):
    rng = np.random.default_rng(23)
    far = {"huge": 1e6, "near": 4.0}.get(kind, 40.0)
    view = turned_view(rng, near=0.3, far=far, orthographic=orthographic, half=2.0 if orthographic else 0.7)
    triangles = random_triangles(rng, view, kind, 60)
    devices = on_both(*scene_of([triangle_mesh(triangles)]))
    cpu, gpu = surfaces(devices, view, chunk_of())
    jitter = np.moveaxis(devices[0][0].offsets(chunk_of()), -1, 0).astype(np.float64)
    sure, tolerance = sure_of(cpu, view, triangles, jitter, kind, orthographic)
    assert sure.mean() > 0.9
    for name in ("triangle", "instance", "object_id", "material"):
        np.testing.assert_array_equal(cpu[name][sure], gpu[name][sure])
    seen = sure & (cpu["triangle"] >= 0)
    assert seen.mean() > 0.1 or kind == "tiny"
    assert (np.abs(cpu["position"] - gpu["position"])[seen].max(-1) <= 2 * tolerance[seen]).all()
    assert (np.abs(cpu["depth"][seen] - gpu["depth"][seen]) <= 2 * tolerance[seen]).all()


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_surfaces_of_a_scene_agree(offset, orthographic):
    """Instances turned, mirrored and squeezed, clips, and a tile that begins in the middle."""
    devices = on_both(*courtyard(np.random.default_rng(5), offset))
    half = 3.0 if orthographic else 0.5
    view = down((-half, half, -half, half), 0.1, 50.0, (offset + 0.3, 0.2, 6.0), orthographic)
    cpu, gpu = surfaces(devices, view, chunk_of(160, 120, (40, 110), x0=-5, x1=150))
    assert len(np.unique(cpu["instance"])) == 6
    other = (cpu["instance"] != gpu["instance"]) | (cpu["triangle"] != gpu["triangle"])
    assert other.mean() < 2e-3
    same = ~other
    assert np.abs(cpu["position"] - gpu["position"])[same].max() < 40 * EPSILON * 6.0
    for name, most in (
        ("uv", 2e-4),
        ("corner_colour", 2e-4),
        ("shading_normal", 2e-4),
        ("terminator_lift", 2e-5),
    ):
        assert np.abs(cpu[name] - gpu[name])[same].max() < most


@pytest.mark.parametrize("orthographic", [False, True])
def test_devices_draw_what_is_partly_opaque_alike(orthographic):
    devices = on_both(*partly_opaque_sheets(np.random.default_rng(5)))
    half = 3.0 if orthographic else 0.5
    view = down((-half, half, -half, half), 0.1, 50.0, (0.3, 0.2, 6.0), orthographic)
    for sample in (0, 3):
        chunk = chunk_of(160, 120, (40, 110), sample, x0=16, x1=150)
        cpu, gpu = surfaces(devices, view, chunk, ("instance", "triangle"), seed=77)
        assert (cpu["instance"] >= 0).mean() > 0.2
        assert ((cpu["instance"] != gpu["instance"]) | (cpu["triangle"] != gpu["triangle"])).mean() < 4e-3


@pytest.mark.parametrize("mirror", [1.0, -1.0])
@pytest.mark.parametrize(
    ("cells", "scale", "moved"), [(3, 1.0, 0.0), (60, 1.0, 0.0), (40, 1e-4, 0.0), (40, 1e6, 1e7)]
)
def test_a_sheet_covers_every_place_exactly_once(cells, scale, moved, mirror):
    """Of each cut of the sheet in two, at random, just one part has a place: no cracks, and nothing twice."""
    rng = np.random.default_rng(cells)
    positions, triangles = sheet(rng, cells, cells + 2, extent=1.9)
    part = rng.random(len(triangles)) < 0.5
    # As one mesh, whose corners both parts share, to the last bit.
    corners = positions[triangles]
    matrix = matrix_of(np.diag([mirror * scale, scale, scale]), (moved, moved, moved))
    device = gpu_device()
    view = down((-scale, scale, -scale, scale), 0.01 * scale, 1e3 * scale, (moved, moved, moved), True)
    seen = []
    for which in (part, ~part):
        # What is not to be seen lies behind the eye, mirrored, and mirrored copies of all with it: the mesh
        # keeps its middle, and so its corners.
        moved_away = corners.copy()
        moved_away[~which, :, 2] *= -1.0
        both = np.concatenate([moved_away, corners * [1.0, 1.0, -1.0]])
        device.set_scene(*scene_of([triangle_mesh(both)], [(0, matrix, 5, (0,))]))
        found = gpu_steps.surface(
            device, device.geometry(), view, frozenset({0}), chunk_of(130, 101), frozenset({"triangle"})
        )
        seen.append(device.to_host(found)["triangle"] >= 0)
    assert (seen[0] ^ seen[1]).all()
    assert 0.1 < seen[0].mean() < 0.9
