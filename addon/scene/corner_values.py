"""Factors of opacity on the corners of a mesh's faces, from an attribute of its points or corners."""

from __future__ import annotations

import bpy
import numpy as np

from ..core.arrays import MeshArrays

ALPHA_OF = ".alpha"
"""Behind the name of a colour attribute: its alpha."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # Rec. 709


def corner_opacity(
    source: bpy.types.Mesh, mesh: MeshArrays, names: list[str], owner: str, warnings: list[str]
) -> np.ndarray | None:
    """(C,) float32 of the evaluated mesh `source`, each face's from the attribute in `names` of its slot, 1
    where that is empty; None without faces. What the mesh lacks counts as 0, as in Cycles, with a warning."""
    if not len(mesh.corner_vertices):
        return None
    found = np.ones(len(mesh.corner_vertices), np.float32)
    slots = np.zeros(len(mesh.face_starts) - 1, np.int64) if mesh.face_slots is None else mesh.face_slots
    of_corner = np.repeat(np.clip(slots, 0, len(names) - 1), np.diff(mesh.face_starts))
    for name in sorted(set(names) - {""}):
        values = _values(source, mesh, name)
        if values is None:
            warnings.append(f"object '{owner}': it has no attribute '{name}', which counts as 0")
            values = np.zeros(len(found), np.float32)
        chosen = np.isin(of_corner, [slot for slot, each in enumerate(names) if each == name])
        found[chosen] = values[chosen]
    return found


def _values(source: bpy.types.Mesh, mesh: MeshArrays, name: str) -> np.ndarray | None:
    """(C,) float32, finite."""
    attribute = source.attributes.get(name)
    is_alpha = attribute is None and name.endswith(ALPHA_OF)
    if is_alpha:
        attribute = source.attributes.get(name.removesuffix(ALPHA_OF))
    if attribute is None or attribute.domain not in {"POINT", "CORNER"}:
        return None
    count = len(attribute.data)
    if attribute.data_type in {"FLOAT_COLOR", "BYTE_COLOR"}:
        colours = np.empty(4 * count, np.float32)
        attribute.data.foreach_get("color", colours)
        colours = colours.reshape(count, 4)
        values = colours[:, 3] if is_alpha else colours[:, :3] @ LUMINANCE
    elif attribute.data_type == "FLOAT" and not is_alpha:
        values = np.empty(count, np.float32)
        attribute.data.foreach_get("value", values)
    else:
        return None
    if attribute.domain == "POINT":
        values = values[mesh.corner_vertices]
    return np.nan_to_num(np.ascontiguousarray(values, np.float32), posinf=0.0, neginf=0.0)
