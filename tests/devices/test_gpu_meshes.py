"""Meshes on the GPU: uploaded once, written over where one has changed, and the same as made anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.devices.gpu_meshes import TABLES, GpuMeshes
from strata.tests.support.gpu_scenes import bumpy_sheet, gpu_device, triangle_mesh


def meshes():
    rng = np.random.default_rng(1)
    triangles = rng.normal(size=(3000, 3, 3))  # more than a row of a table holds
    normals = rng.normal(size=(9000, 3)).astype(np.float32)
    slots = rng.integers(0, 3, 3000).astype(np.int32)
    return (
        bumpy_sheet(rng, 20),
        triangle_mesh(triangles, corner_normals=normals, face_slots=slots),
        triangle_mesh(triangles[:7]),
        bumpy_sheet(rng, 9),
    )


def contents(device, made: GpuMeshes) -> dict[str, np.ndarray]:
    return {name: device.to_host(made.table(name)) for name in TABLES}


def moved(mesh):
    return replace(mesh, positions=mesh.positions * np.float32(1.5) + np.float32(0.25))


def test_the_same_meshes_are_not_uploaded_again():
    device, given = gpu_device(), meshes()
    first = GpuMeshes.of(device, given, None)
    tables = {name: first.table(name) for name in TABLES}
    again = GpuMeshes.of(device, given, first)
    assert all(again.table(name) is table for name, table in tables.items())


@pytest.mark.parametrize("which", [(1,), (0, 3), (2,)])
def test_a_changed_mesh_is_written_into_the_tables(which):
    device, given = gpu_device(), meshes()
    first = GpuMeshes.of(device, given, None)
    tables = {name: first.table(name) for name in TABLES}
    changed = tuple(moved(mesh) if index in which else mesh for index, mesh in enumerate(given))
    patched = GpuMeshes.of(device, changed, first)
    is_patched = 1 not in which  # which is most of all rows
    assert (patched.table("positions") is tables["positions"]) == is_patched
    expected = GpuMeshes(device, changed)
    found, wanted = contents(device, patched), contents(device, expected)
    assert all(np.array_equal(found[name], wanted[name]) for name in TABLES)
    for mine, other in zip(patched.places, expected.places, strict=True):
        assert mine.slots == other.slots
        assert np.array_equal(mine.centre, other.centre)


def test_a_mesh_of_another_size_is_made_anew():
    device, given = gpu_device(), meshes()
    first = GpuMeshes.of(device, given, None)
    changed = (*given[:2], triangle_mesh(np.ones((9, 3, 3))), given[3])
    found = contents(device, GpuMeshes.of(device, changed, first))
    wanted = contents(device, GpuMeshes(device, changed))
    assert all(np.array_equal(found[name], wanted[name]) for name in TABLES)


def test_triangles_are_those_of_the_kernels():
    """A mesh of triangles throughout is not triangulated: they are as they come, by material slot."""
    device = gpu_device()
    mesh = meshes()[1]
    made = GpuMeshes(device, (mesh,))
    rows = device.to_host(made.table("triangles")).reshape(-1, 4)[:3000]
    order = np.argsort(mesh.face_slots, kind="stable")
    assert np.array_equal(rows[:, 3], order)
    assert np.array_equal(rows[:, :3], mesh.corner_vertices.reshape(-1, 3)[order])


def test_a_far_vertex_that_nothing_uses_costs_no_digits():
    device = gpu_device()
    mesh = triangle_mesh(np.eye(3)[None])
    far = replace(mesh, positions=np.concatenate([mesh.positions, np.full((1, 3), 1e7, np.float32)]))
    (place,) = GpuMeshes(device, (far,)).places
    assert np.array_equal(place.low, [0.0, 0.0, 0.0])
    assert np.array_equal(place.high, [1.0, 1.0, 1.0])
