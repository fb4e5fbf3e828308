"""True displacement: what a material moves a surface by when it is rendered, which no evaluated mesh has.

As Cycles (its mesh_displace.cpp and kernel/svm/displace.h): each vertex goes along its normal, by what the
material is at the first of its corners.
"""

from __future__ import annotations

import math

import bpy
import numpy as np

from ..core.arrays import MeshArrays
from .corner_values import Corners, corner_slots
from .nodes.graph import Graph, link_of
from .nodes.pictures import sample
from .nodes.textures import Texture
from .nodes.values import FLOAT, Attribute, Uv, Value, apply
from .pixels import channel_of, pixels_of

SAME_NORMAL = 0.98
"""Cosine up to which a corner's normal is that of its vertex; beyond it lies at a sharp edge."""

BySlot = tuple[Value | None, ...]
"""By material slot how far it moves a surface along its normal, metres in object space; None: not."""


def displacement_of(material: bpy.types.Material) -> tuple[Value | None, str]:
    """How far it moves a surface along its normal, metres in object space, None where it does not; and what
    of that is not read, in words, empty where all is."""
    if material.displacement_method == "BUMP" or material.node_tree is None:
        return None, ""
    output = material.node_tree.get_output_node("CYCLES")
    link = None if output is None else link_of(output.inputs["Displacement"])
    if link is None:
        return None, ""
    node, graph = link.from_node, Graph()
    if node.bl_idname != "ShaderNodeDisplacement" or node.mute:
        return None, f"node '{node.name}'"
    height, midlevel, scale = (graph.input(node.inputs[name]) for name in ("Height", "Midlevel", "Scale"))
    if scale.equals(0.0):
        return None, ""
    low, high = -math.inf, math.inf
    if midlevel.is_constant and scale.is_constant:
        ends = [(end - midlevel.number()) * scale.number() for end in (height.low, height.high)]
        low, high = min(ends), max(ends)
    found = apply(
        "displacement", FLOAT, lambda h, m, s: (h - m) * s, height, midlevel, scale, low=low, high=high
    )
    if found.equals(0.0):
        return None, ""
    unread = found.unread
    if node.space != "OBJECT":
        unread.append(f"space of node '{node.name}'")
    if node.inputs["Normal"].is_linked:
        unread.append(f"normal of node '{node.name}'")
    return (None, " and ".join(unread)) if unread else (found, "")


def displaced(
    mesh: MeshArrays, source: bpy.types.Mesh, by_slot: BySlot, owner: str, warnings: list[str]
) -> MeshArrays:
    """The mesh of the evaluated mesh `source` as its materials displace it, with normals anew."""
    corners = mesh.corner_vertices
    if not len(corners):
        return mesh
    offsets = np.zeros(len(mesh.positions))
    of_corner = corner_slots(mesh, len(by_slot))
    moving = [slot for slot, value in enumerate(by_slot) if value is not None]
    # Each vertex is moved by the first of the faces that move.
    backwards = np.flatnonzero(np.isin(of_corner, moving))[::-1]
    first = np.full(len(offsets), -1)
    first[corners[backwards]] = backwards
    places = _Places(source, mesh)
    for key in sorted({by_slot[slot].key for slot in moving}):
        slots = [slot for slot in moving if by_slot[slot].key == key]
        vertices = np.flatnonzero((first >= 0) & np.isin(of_corner[first], slots))
        places.chosen = first[vertices]
        offsets[vertices] = np.nan_to_num(by_slot[slots[0]].at(places), posinf=0.0, neginf=0.0)
    for name in sorted(places.missing):
        warnings.append(f"object '{owner}': it has no attribute '{name}', which counts as 0")
    warnings.extend(f"object '{owner}': {warning} for displacement" for warning in places.unreadable)
    before = np.empty(3 * len(mesh.positions), np.float32)
    source.vertex_normals.foreach_get("vector", before)
    before = before.reshape(-1, 3)
    positions = (mesh.positions + before * offsets[:, None]).astype(np.float32)
    moved = MeshArrays(positions, corners, mesh.face_starts, None, mesh.corner_uvs, mesh.face_slots)
    if mesh.corner_normals is None:
        return moved
    is_smooth = np.einsum("ni,ni->n", mesh.corner_normals, before[corners]) > SAME_NORMAL
    normals = _corner_normals(moved, is_smooth)
    return MeshArrays(positions, corners, mesh.face_starts, normals, mesh.corner_uvs, mesh.face_slots)


def displaced_box(source: bpy.types.Mesh, mesh: MeshArrays, by_slot: BySlot, box: np.ndarray) -> np.ndarray:
    """(2, 3): a box around the displaced mesh, whose box is `box` (2, 3) otherwise."""
    values = [value for value in by_slot if value is not None]
    most = float(np.abs([(value.low, value.high) for value in values]).max())
    # Pictures of floats have no bounds that are known before, and attributes none that hold for certain.
    if math.isfinite(most) and not any(value.hangs_on(Attribute) for value in values):
        return box + np.array([[-most], [most]])
    positions = displaced(mesh, source, by_slot, "", []).positions
    finite = positions[np.isfinite(positions).all(axis=1)].astype(np.float64)
    return np.array([finite.min(axis=0), finite.max(axis=0)]) if len(finite) else box


class _Places(Corners):
    """Those corners of faces that are `chosen`, where pictures are looked up too."""

    def __init__(self, source: bpy.types.Mesh, mesh: MeshArrays):
        super().__init__(source, mesh)
        self.chosen = np.arange(len(mesh.corner_vertices))
        self._images: dict[str, np.ndarray] = {}
        self.unreadable: dict[str, None] = {}

    def source(self, source: Uv | Attribute) -> np.ndarray:
        if not isinstance(source, Uv):
            return super().source(source)[self.chosen]
        layers = self._source.uv_layers
        layer = layers.get(source.name) if source.name else None
        layer = layer or next((each for each in layers if each.active_render), None)
        found = np.zeros((len(self.chosen), 3))
        if layer is not None:
            flat = np.empty(2 * len(self._mesh.corner_vertices), np.float32)
            layer.uv.foreach_get("vector", flat)
            found[:, :2] = np.nan_to_num(flat.reshape(-1, 2)[self.chosen], posinf=0.0, neginf=0.0)
        return found

    def look_up(self, texture: Texture, coordinates: np.ndarray) -> np.ndarray:
        if texture.key not in self._images:
            pixels = pixels_of(texture.image)
            if pixels is None:
                self.unreadable[f"image '{texture.name}' cannot be read"] = None
                pixels = np.zeros((1, 1, 4), np.float32)
            self._images[texture.key], _ = channel_of(pixels, texture.image, "COLOR", texture.is_straight)
        coordinates = np.broadcast_to(coordinates, (len(self.chosen), 3))
        image = self._images[texture.key]
        return sample(image, coordinates[:, :2], texture.extension, texture.interpolation)


def _corner_normals(mesh: MeshArrays, is_smooth: np.ndarray) -> np.ndarray:
    """(C, 3) f32: the mean of the faces around a vertex where a corner `is_smooth`, as Cycles has it, and
    else of its face."""
    corners, starts = mesh.corner_vertices, mesh.face_starts
    following = np.arange(1, len(corners) + 1)
    following[starts[1:] - 1] = starts[:-1]
    places = mesh.positions.astype(np.float64)[corners]
    places -= np.repeat(places[starts[:-1]], np.diff(starts), axis=0)
    # Newell's: twice the area of each face.
    of_face = _unit(np.add.reduceat(np.cross(places, places[following]), starts[:-1], axis=0))
    of_corner = np.repeat(of_face, np.diff(starts), axis=0)
    count = len(mesh.positions)
    summed = [np.bincount(corners, of_corner[:, axis], count) for axis in range(3)]
    of_vertex = _unit(np.stack(summed, axis=1))
    return np.where(is_smooth[:, None], of_vertex[corners], of_corner).astype(np.float32)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)
