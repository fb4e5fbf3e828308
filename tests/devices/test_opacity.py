"""What the camera sees of what is partly opaque, and behind it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.core.arrays import Opacities, OpacityArrays
from strata.addon.core.sampling import jitters
from strata.addon.core.shot import PixelFilter
from strata.addon.core.surface import Chunk
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared.steps import LAYERED_DEPTH, SURFACE
from strata.tests.devices.test_camera_rays import all_pixels, rays_of, turned_shot
from strata.tests.kernels.raster_scenes import down
from strata.tests.measure.scenes import random_scene
from strata.tests.support.cards import Card, constant, scene_of, shot, textured
from strata.tests.support.gpu_scenes import (
    bumpy_sheet,
    gpu_device,
    matrix_of,
    on_both,
    rotation,
    share_beyond,
)
from strata.tests.support.gpu_scenes import scene_of as parts_of

SAMPLES = 64


def ids(device, outline, arrays, of_shot, samples: int, seed: int) -> np.ndarray:
    """(samples, h, w) object ids of a surface."""
    device.set_scene(outline, arrays)
    visible = frozenset(i for i, each in enumerate(outline.instances) if each.visible_camera)
    geometry, (width, height) = device.geometry(), of_shot.computed_size
    found = []
    for sample, jitter in enumerate(jitters(PixelFilter(), samples)):
        chunk = Chunk(width, height, 0, height, sample, tuple(map(float, jitter)), samples)
        surface = SURFACE.twin(device.name)(
            device, geometry, of_shot.view, visible, chunk, frozenset({"object_id"}), seed
        )
        found.append(device.to_host(surface)["object_id"])
    return np.array(found)


@pytest.mark.parametrize(
    "cards",
    [
        [constant(0.3)],
        [textured(0.7)],
        [constant(0.5), constant(0.3)],
        [textured(0.3), constant(0.7), constant(0.0)],
        [Card(constant(1.0).opacity, seen=constant(0.3).opacity)],
    ],
)
def test_cards_are_seen_as_often_as_they_are_opaque(backend, cards):
    device = CpuDevice() if backend == "cpu" else gpu_device()
    outline, arrays = scene_of(cards, "area", are_seen=True)
    found = ids(device, outline, arrays, shot(), SAMPLES, 5)
    left = 1.0
    for number in range(len(cards), 0, -1):
        card = cards[number - 1]
        opacity = card.opacity if card.seen is None else card.seen
        share = float(card.texels[0, 0]) if card.texels is not None else opacity.value
        # 64 samples of 2304 pixels: .0013 at most, one sigma.
        assert (found == number).mean() == pytest.approx(left * share, abs=0.005)
        left *= 1.0 - share
    assert (found == 0).mean() == pytest.approx(left, abs=0.005)


def test_few_samples_are_spread(backend):
    """Of eight samples of a card of a half just four see it, at every pixel."""
    device = CpuDevice() if backend == "cpu" else gpu_device()
    outline, arrays = scene_of([constant(0.5)], "area", are_seen=True)
    found = ids(device, outline, arrays, shot(), 8, 5)
    # Two triangles share the pixels of the diagonal.
    assert ((found == 1).sum(axis=0) == 4).mean() > 0.95


@pytest.mark.parametrize("orthographic", [False, True])
def test_rays_see_what_a_sample_of_a_pixel_sees(orthographic):
    """Told which, they meet the same of what is partly opaque: so kept samples meet their truth."""
    outline, arrays = random_scene(3, opacity=0.5)
    of_shot = turned_shot(orthographic)
    _, rays, _ = rays_of(outline, arrays, of_shot)
    rays.camera = replace(rays.camera, seed=11)
    pixels, samples = all_pixels(*of_shot.computed_size), 4
    judge = ids(CpuDevice(), outline, arrays, of_shot, samples, 11).reshape(samples, -1)

    def agreement(sample: int, jitter, numbers) -> float:
        """Where either sees more than the floor."""
        seen = rays.look(pixels, np.tile(jitter, (len(pixels), 1)), numbers).surface["object_id"]
        return (seen == judge[sample])[(seen > 0) | (judge[sample] > 0)].mean()

    for sample, jitter in enumerate(jitters(PixelFilter(), samples)):
        # Outlines, and seams between triangles, which draw by themselves.
        assert agreement(sample, jitter, np.full(len(pixels), sample)) > 0.97
        assert agreement(sample, jitter, None) < 0.8


def partly_opaque_sheets(rng):
    """Sheets, turned, mirrored and squeezed: textures, corners' factors, fronts unlike backs, casting unlike
    seen, a clip and a constant."""
    sheet = bumpy_sheet(rng, 12)
    factors = rng.random(len(sheet.corner_vertices)).astype(np.float32)
    picture = OpacityArrays(texels=rng.random((7, 5)).astype(np.float32))
    corners = OpacityArrays(0.9, by_corner=True)
    clip = replace(picture, threshold=0.4)
    opacities = (
        Opacities((picture, OpacityArrays(0.25)), (corners, picture)),
        Opacities.of(replace(picture, by_corner=True)),
        Opacities((OpacityArrays(0.5), OpacityArrays(0.0)), (OpacityArrays(1.0), OpacityArrays(0.5))),
        Opacities((clip, clip), (OpacityArrays(0.3), clip)),
    )
    instances = []
    for index in range(8):
        linear = rotation(rng) @ np.diag([1.5, -1.5 if index % 2 else 1.5, 0.3 if index == 3 else 1.5])
        pair = (index % 4, (index + 1) % 4)
        instances.append((0, matrix_of(linear, rng.uniform((-2, -2, 0.8), (2, 2, 2.5))), index, pair))
    return parts_of([replace(sheet, corner_opacity=factors)], instances, opacities)


@pytest.mark.parametrize("orthographic", [False, True])
def test_devices_draw_alike(orthographic):
    devices = on_both(*partly_opaque_sheets(np.random.default_rng(5)))
    half = 3.0 if orthographic else 0.5
    view = down((-half, half, -half, half), 0.1, 50.0, (0.3, 0.2, 6.0), orthographic)
    everything = frozenset(range(8))
    wanted = frozenset({"instance", "triangle"})
    for sample in (0, 3):
        chunk = Chunk(160, 120, 40, 110, sample, (0.2, 0.4), 8, 16, 150)
        cpu, gpu = (
            device.to_host(SURFACE.twin(device.name)(device, geometry, view, everything, chunk, wanted, 77))
            for device, geometry in devices
        )
        assert (cpu["instance"] >= 0).mean() > 0.2
        # Silhouettes and seams, as in test_parity_raster; one in a million is so near its chance.
        assert ((cpu["instance"] != gpu["instance"]) | (cpu["triangle"] != gpu["triangle"])).mean() < 4e-3
        for kept in ("whole", "partial", "drawn"):
            first, second = (
                device.to_host(
                    LAYERED_DEPTH.twin(device.name)(
                        device, geometry, view, everything, 4, 160, 120, kept, (99, sample)
                    )
                )
                for device, geometry in devices
            )
            assert np.isfinite(first[0]).mean() > 0.05, kept
            assert share_beyond(first, second, 1e-4) < 4e-3, kept
