"""Pictures that Blender bakes of meshes: where faces lie in them, how fine they are, where they are kept."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import bpy
import numpy as np
import pytest
from strata.addon.core.shot import Raster
from strata.addon.scene.cameras import camera_of
from strata.addon.scene.exact.layout import SMALLEST, Layouts, layout_of, least_size
from strata.addon.scene.exact.size import area_of, size_for, sizes_for
from strata.addon.scene.exact.store import Store, cache_folder
from strata.tests.support.procedural import card, floor_scene


def grid(width: int, height: int):
    """Quads of a grid, as arrays of a mesh."""
    x, y = np.meshgrid(np.arange(width + 1.0), np.arange(height + 1.0))
    positions = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(np.float32)
    first = (np.arange(height)[:, None] * (width + 1) + np.arange(width)).ravel()
    corners = np.stack([first, first + 1, first + width + 2, first + width + 1], axis=1)
    return positions, corners.ravel().astype(np.int32), np.arange(0, 4 * len(first) + 1, 4, dtype=np.int32)


def covered(uvs: np.ndarray, starts: np.ndarray, size: int) -> np.ndarray:
    """(size, size) how many faces have a texel's middle in their box."""
    count = np.zeros((size, size), int)
    for start, end in itertools.pairwise(starts):
        low, high = uvs[start:end].min(axis=0) * size, uvs[start:end].max(axis=0) * size
        (x0, y0), (x1, y1) = np.ceil(low - 0.5).astype(int), np.floor(high - 0.5).astype(int)
        count[y0 : y1 + 1, x0 : x1 + 1] += 1
    return count


def test_faces_lie_apart_and_within_the_picture():
    rng = np.random.default_rng(5)
    faces = [rng.normal(size=(rng.integers(3, 7), 3)) * 10.0 ** rng.uniform(-2, 2) for _face in range(300)]
    faces += [np.zeros((3, 3)), np.full((4, 3), np.nan), np.outer(np.arange(3.0), [1, 0, 0])]
    positions = np.concatenate(faces).astype(np.float32)
    starts = np.concatenate([[0], np.cumsum([len(face) for face in faces])]).astype(np.int32)
    size = 256
    uvs = layout_of(positions, np.arange(len(positions), dtype=np.int32), starts, size)
    assert uvs.dtype == np.float32
    assert uvs.min() > 0.0
    assert uvs.max() < 1.0
    count = covered(uvs, starts, size)
    assert count.max() == 1
    assert count.mean() > 0.25  # powers of two: at worst a quarter is used


def test_what_is_baked_of_a_grid_goes_on_from_face_to_face():
    """Corners are at the outermost texels' middles: interpolation there is of what lies there."""
    positions, corners, starts = grid(6, 5)
    size = 64
    uvs = layout_of(positions, corners, starts, size)
    beside = np.abs(uvs * size - 0.5 - np.round(uvs * size - 0.5))
    np.testing.assert_allclose(beside, 0.01, atol=1e-4)
    assert covered(uvs, starts, size).max() == 1


@pytest.mark.parametrize("faces", [1, 2, 5, 1000, 65536])
def test_there_is_room_for_every_face(faces):
    size = least_size(faces)
    assert faces * SMALLEST**2 <= size * size < 4 * max(faces * SMALLEST**2, 4)
    if faces > 1000:
        return
    positions, corners, starts = grid(faces, 1)
    assert covered(layout_of(positions, corners, starts, size), starts, size).max() == 1


def test_layouts_asked_for_last_are_kept():
    made = []

    def make() -> np.ndarray:
        made.append(1)
        return np.zeros((4, 2), np.float32)

    layouts = Layouts(most_bytes=3 * make().nbytes)
    for digest in "abcaabdac":
        layouts.get(digest, 64, make)
    assert len(made) == 1 + 5  # with d goes c, which is made again


def test_a_store_keeps_what_it_is_given(tmp_path):
    values = np.random.default_rng(1).normal(size=(4, 4, 3)).astype(np.float32)
    Store(tmp_path / "cache").put("a", values)
    np.testing.assert_array_equal(Store(tmp_path / "cache").get("a"), values)
    assert Store(tmp_path / "cache").get("b") is None
    (tmp_path / "cache" / "a.npy").write_bytes(b"\x93NUMPY not whole")
    assert Store(tmp_path / "cache").get("a") is None


def test_a_store_throws_away_what_was_used_longest_ago(tmp_path):
    values = np.zeros((8, 8, 1), np.float32)
    store = Store(tmp_path, most_memory=2 * values.nbytes, most_on_disk=3 * (values.nbytes + 200))
    for number, key in enumerate("abcd"):
        store.put(key, values)
        os.utime(tmp_path / f"{key}.npy", (number, number))
    assert sorted(path.stem for path in tmp_path.glob("*.npy")) == ["b", "c", "d"]
    assert store.get("a") is None


def test_areas_are_those_of_faces_that_are_somewhere():
    bpy.ops.mesh.primitive_cube_add(size=3.0)
    mesh = bpy.context.object.data
    assert area_of(mesh) == pytest.approx(6 * 9.0, rel=1e-6)  # as floats
    mesh.vertices[0].co.x = float("nan")
    assert area_of(mesh) == pytest.approx(3 * 9.0, rel=1e-6)


@pytest.mark.parametrize("faces", [1, 5000, 100_000])
@pytest.mark.parametrize("most", [64, 1000, 4096])
def test_every_size_that_may_be_asked_for_is_among_those_looked_for(faces, most):
    scene = floor_scene()
    shown = card(bpy.data.materials.new("Card"))
    raster = Raster(camera_of(scene.camera), (960, 540))
    matrix = np.array(shown.matrix_world, np.float64)[None]
    sizes = sizes_for(faces, most)
    assert sizes == sorted(sizes, reverse=True)
    asked = [size_for(raster, shown, matrix, area, faces, most) for area in 10.0 ** np.arange(-9, 9)]
    assert set(asked) <= set(sizes)
    assert max(asked) == sizes[0]
    assert min(asked) == sizes[-1]


def test_the_folder_is_the_users_unless_the_environment_says(monkeypatch):
    monkeypatch.setenv("STRATA_CACHE", "")
    assert cache_folder() is None
    monkeypatch.setenv("STRATA_CACHE", "/elsewhere")
    assert cache_folder() == Path("/elsewhere")
    monkeypatch.delenv("STRATA_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/cache")
    monkeypatch.setattr("sys.platform", "linux")
    assert cache_folder() == Path("/cache/strata/baked")
    monkeypatch.delenv("XDG_CACHE_HOME")

    def homeless():
        raise RuntimeError("no home")

    monkeypatch.setattr(Path, "home", homeless)
    assert cache_folder() is None
