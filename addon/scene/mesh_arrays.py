"""A mesh of Blender's as arrays."""

from __future__ import annotations

import bpy
import numpy as np

from ..core.arrays import MeshArrays


def _sums_up(values: np.ndarray) -> bool:
    """One pass over the numbers; only a suspicious sum is to be looked at closer."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(np.dot(values.ravel(), values.ravel())))


def mesh_arrays(mesh: bpy.types.Mesh, want_normals: bool, owner: str, warnings: list[str]) -> MeshArrays:
    """Without UVs. Corners are read by `attributes[...]`: `loops` goes element by element, a hundred times as
    long."""
    corner_count = len(mesh.loops)
    positions = _read(mesh.attributes["position"].data, "vector", np.float32, len(mesh.vertices), 3)
    if not _sums_up(positions):
        bad = ~np.isfinite(positions).all(axis=1)
        if bad.all():
            warnings.append(f"object '{owner}' is left out: none of its vertices is finite")
            return no_faces()
        if bad.any():
            count = f"{int(bad.sum())} of {len(bad)}"
            warnings.append(f"object '{owner}': faces are left out, {count} vertices are not finite")
    corner_vertices = _read(mesh.attributes[".corner_vert"].data, "value", np.int32, corner_count)
    normals = None
    if want_normals and mesh.normals_domain != "FACE":
        normals = _corner_normals(mesh, corner_count)
    slots = mesh.attributes.get("material_index")
    if slots is not None and (slots.domain != "FACE" or slots.data_type != "INT"):
        slots = None
    face_slots = None if slots is None else _read(slots.data, "value", np.int32, len(mesh.polygons))
    return MeshArrays(positions, corner_vertices, _face_starts(mesh), normals, None, face_slots)


def _read(elements, name: str, dtype, count: int, width: int | None = None) -> np.ndarray:
    flat = np.empty(count * (width or 1), dtype)
    elements.foreach_get(name, flat)
    return flat if width is None else flat.reshape(count, width)


def _face_starts(mesh: bpy.types.Mesh) -> np.ndarray:
    """(F + 1,) i32. Blender keeps this very array, but shows it face by face only."""
    face_count, corner_count = len(mesh.polygons), len(mesh.loops)
    # No face has fewer than three corners, so this many corners means triangles throughout.
    if corner_count == 3 * face_count:
        return np.arange(0, corner_count + 1, 3, dtype=np.int32)
    starts = np.empty(face_count + 1, np.int32)
    mesh.polygons.foreach_get("loop_start", starts[:-1])
    starts[-1] = corner_count
    return starts


def _corner_normals(mesh: bpy.types.Mesh, corner_count: int) -> np.ndarray:
    """(C, 3) f32. Normals that are not finite, at a broken corner, become zero: no normal."""
    normals = _read(mesh.corner_normals, "vector", np.float32, corner_count, 3)
    if not _sums_up(normals):
        np.nan_to_num(normals, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
    return normals


def no_faces() -> MeshArrays:
    return MeshArrays(np.zeros((0, 3), np.float32), np.zeros(0, np.int32), np.zeros(1, np.int32))
