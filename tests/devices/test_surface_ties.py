"""Surfaces at the same place: of equal depths the lowest instance is seen, then its lowest triangle, on both
devices. Depths are equal, bit by bit, where the triangles are; of different triangles in one plane rounding
decides."""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.core.arrays import MeshArrays, Opacities, OpacityArrays
from strata.addon.core.surface import Chunk
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared.steps import SURFACE
from strata.tests.kernels.raster_scenes import down
from strata.tests.support.gpu_scenes import (
    bumpy_sheet,
    gpu_device,
    matrix_of,
    rotation,
    scene_of,
    triangle_mesh,
)

SIZE = (96, 72)
ATTRIBUTES = frozenset({"instance", "triangle", "object_id", "material", "depth"})
OPAQUE, TESTED, ABSENT = 0, 1, 2
OPACITIES = (
    Opacities(),
    Opacities.of(OpacityArrays(texels=np.ones((2, 2), np.float32), threshold=0.5)),
    Opacities.of(OpacityArrays(0.2, threshold=0.5)),
)


def seen(backend, scene, view, rows=(0, SIZE[1]), jitter=(0.0, 0.0)):
    device = CpuDevice() if backend == "cpu" else gpu_device()
    device.set_scene(*scene)
    everything = frozenset(range(len(scene[0].instances)))
    chunk = Chunk(*SIZE, *rows, 0, jitter)
    surface = SURFACE.twin(device.name)(device, device.geometry(), view, everything, chunk, ATTRIBUTES)
    return device.to_host(surface)


def stacked(materials, far=0.0):
    """A bumpy sheet, again and again at one place: by turns the same mesh and a copy of it."""
    rng = np.random.default_rng(3)
    sheet = bumpy_sheet(rng, 9)
    copy = MeshArrays(**{name: getattr(sheet, name) for name in sheet.__dataclass_fields__})
    matrix = matrix_of(2.0 * rotation(rng), (far, -far, -6.0))
    instances = [
        (index % 2, matrix, 100 - index, (material, material)) for index, material in enumerate(materials)
    ]
    return scene_of([sheet, copy], instances, OPACITIES)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("far", [0.0, 1e7])
@pytest.mark.parametrize(
    ("materials", "first"),
    [
        ((OPAQUE,) * 4, 0),
        ((TESTED, OPAQUE, OPAQUE, TESTED), 0),
        ((ABSENT, TESTED, OPAQUE, TESTED), 1),
    ],
)
def test_of_copies_at_one_place_the_first_is_seen(backend, materials, first, far, orthographic):
    scene = stacked(materials, far)
    half = 2.5 if orthographic else 0.4
    view = down((-half, half, -half, half), 0.1, 50.0, (far + 0.3, 0.2 - far, 0.0), orthographic)
    alone = stacked((ABSENT,) * first + (OPAQUE,) + (ABSENT,) * (len(materials) - first - 1), far)
    for rows, jitter in (((0, SIZE[1]), (0.0, 0.0)), ((13, 40), (0.3, -0.4)), ((40, SIZE[1]), (-0.2, 0.1))):
        found = seen(backend, scene, view, rows, jitter)
        there = found["instance"] >= 0
        assert there.mean() > 0.2
        assert (found["instance"][there] == first).all()
        assert (found["object_id"][there] == 100 - first).all()
        assert (found["material"][there] == materials[first]).all()
        # Nothing else changes: not which of its triangles, and where.
        expected = seen(backend, alone, view, rows, jitter)
        assert np.array_equal(found["triangle"], expected["triangle"])
        assert np.array_equal(found["depth"], expected["depth"])


def test_of_copies_in_one_mesh_the_first_is_seen(backend):
    sheet = np.array([[[-9.0, -9, -4], [9, -9, -5], [0, 9, -6]], [[-9, -9, -5], [9, -9, -4], [0, 9, -6]]])
    scene = scene_of([triangle_mesh(np.concatenate([sheet, sheet, sheet]))])
    found = seen(backend, scene, down())
    assert set(np.unique(found["triangle"])) == {-1, 0, 1}
