"""Numbers on a mesh's vertices: an attribute, or a vertex group's weights."""

from __future__ import annotations

import bpy
import numpy as np


def vertex_values(mesh: bpy.types.Mesh, owner: str, name: str) -> np.ndarray | None:
    """(V,) float32 of the float attribute `name` of an evaluated mesh's vertices, or of the vertex group of
    that name of the object `owner`; None where there is neither. Values that are not finite count as 0."""
    attribute = mesh.attributes.get(name)
    if attribute is not None and (attribute.domain, attribute.data_type) == ("POINT", "FLOAT"):
        values = np.empty(len(mesh.vertices), np.float32)
        attribute.data.foreach_get("value", values)
    else:
        values = _weights(mesh, owner, name)
    return None if values is None else np.nan_to_num(values, posinf=0.0, neginf=0.0)


def _weights(mesh: bpy.types.Mesh, owner: str, name: str) -> np.ndarray | None:
    shown = bpy.data.objects.get(owner)
    group = shown.vertex_groups.get(name) if shown is not None else None
    if group is None:
        return None
    # Blender shows weights vertex by vertex only: about a second a million vertices.
    index = group.index
    weights = ((g.weight for g in vertex.groups if g.group == index) for vertex in mesh.vertices)
    return np.fromiter((next(found, 0.0) for found in weights), np.float32, len(mesh.vertices))
