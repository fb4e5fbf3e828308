"""The meshes that a scan finds, each once however many instances show it."""

from __future__ import annotations

from dataclasses import dataclass, field

import bpy
import numpy as np

from ..core.outline import Mesh
from .displacement import BySlot, displaced_box
from .hair import curves_mesh, is_splats, particle_hair_mesh, points_mesh
from .made_mesh import MadeMesh
from .mesh_arrays import mesh_arrays
from .missing import Missing

Data = bpy.types.Mesh | bpy.types.Curves | bpy.types.PointCloud | bpy.types.ParticleSystemModifier
"""What an object shows a shape of: its data, or its hair."""


@dataclass(eq=False)
class ScannedMeshes:
    """`owners` are session ids of the objects that make them; `boxes` (2, 3) float64 in their space;
    `displacements` are by index, of those that have any; `told` is what is to be said."""

    headers: list[Mesh] = field(default_factory=list)
    sources: list[bpy.types.Mesh | MadeMesh] = field(default_factory=list)
    owners: list[int] = field(default_factory=list)
    boxes: list[np.ndarray] = field(default_factory=list)
    displacements: dict[int, BySlot] = field(default_factory=dict)
    told: list[Missing] = field(default_factory=list)
    _indices: dict[tuple, int | None] = field(default_factory=dict)
    _keys: dict[str, int] = field(default_factory=dict)

    def index(
        self,
        depsgraph: bpy.types.Depsgraph,
        shown: bpy.types.Object,
        data: Data,
        by_slot: BySlot,
        variant: tuple = (),
    ) -> int | None:
        """None where it has no faces. `by_slot`: how its materials displace it; `variant`: what else it has
        of its materials."""
        is_displaced = isinstance(data, bpy.types.Mesh) and any(value is not None for value in by_slot)
        by_slot = by_slot if is_displaced else ()
        key = (data.as_pointer(), variant, *(value and value.key for value in by_slot))
        if key not in self._indices:
            source = self._source(depsgraph, shown, data)
            self._indices[key] = None if source is None else self._add(shown, data, source, by_slot)
        return self._indices[key]

    @property
    def own_boxes(self) -> frozenset[int]:
        """Those whose box is not their object's."""
        made = (index for index, each in enumerate(self.sources) if not isinstance(each, bpy.types.Mesh))
        return frozenset((*made, *self.displacements))

    def _source(
        self, depsgraph: bpy.types.Depsgraph, shown: bpy.types.Object, data: Data
    ) -> bpy.types.Mesh | MadeMesh | None:
        scene = depsgraph.scene_eval
        if isinstance(data, bpy.types.Mesh):
            return data if len(data.polygons) else None
        if isinstance(data, bpy.types.Curves):
            return curves_mesh(data, scene)
        if isinstance(data, bpy.types.PointCloud):
            if is_splats(data):
                line = f"object '{shown.name}': Gaussian splats are not read, they count as spheres"
                self.told.append(Missing(line, of_unknown_extent=True))
            return points_mesh(data)
        return particle_hair_mesh(shown, data, scene, depsgraph.mode == "RENDER")

    def _add(
        self, shown: bpy.types.Object, data: Data, source: bpy.types.Mesh | MadeMesh, by_slot: BySlot
    ) -> int:
        index = len(self.headers)
        # The same from one evaluation to the next, unlike pointers.
        name = f"{shown.original.name_full}/{getattr(data, 'name_full', source.name)}"
        count = self._keys[name] = self._keys.get(name, 0) + 1
        if isinstance(source, bpy.types.Mesh):
            vertices, triangles = len(source.vertices), len(source.loops) - 2 * len(source.polygons)
            box = np.array([corner[:] for corner in shown.bound_box], np.float64)
            if not np.isfinite(box).all():
                box = _finite_positions(source)
            box = np.array([box.min(axis=0), box.max(axis=0)])
            if by_slot:
                self.displacements[index] = by_slot
                if any(getattr(each, "use_adaptive_subdivision", False) for each in shown.modifiers):
                    line = f"object '{shown.name}': its adaptive subdivision is not read"
                    self.told.append(Missing(f"{line}, displacement moves the vertices that it has"))
                box = displaced_box(source, mesh_arrays(source, False, "", []), by_slot, box)
        else:
            vertices, triangles, box = source.vertices, source.triangles, source.box
        self.headers.append(Mesh(source.name, f"{name}#{count}", vertices, triangles))
        self.sources.append(source)
        self.owners.append(shown.original.session_uid)
        self.boxes.append(box)
        return index


def _finite_positions(mesh: bpy.types.Mesh) -> np.ndarray:
    """(V, 3) float64, only the finite vertices; one at the origin where there is none."""
    positions = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", positions.ravel())
    finite = positions[np.isfinite(positions).all(axis=1)].astype(np.float64)
    return finite if len(finite) else np.zeros((1, 3))
