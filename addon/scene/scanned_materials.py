"""The materials that a scan finds, each once however many slots show it, or once for each mesh that Blender
bakes it on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

import bpy

from ..core.material import Material
from .displacement import displacement_of
from .exact.reading import Appearance, Exact, ExactMesh, ExactScan, Part, appearance_of
from .materials import Images, ReadMaterial, default_material, read_material
from .missing import Missing, named
from .nodes.values import Value
from .own_settings import own_settings_of


@dataclass(eq=False)
class ScannedMaterials:
    """`headers` become `Outline.materials`; `displacements` are by index, of those that have any. `warn` is
    told at once, or, with `exact`, once it is known which are shown (`told`): on some meshes more of a
    material may be read. `exactly` is what is read so."""

    exact: Exact | None
    warn: Callable[[str], None]
    images: Images = field(default_factory=Images)
    headers: list[Material] = field(default_factory=list)
    displacements: dict[int, Value] = field(default_factory=dict)
    _unread_displacements: dict[int, tuple[str, str]] = field(default_factory=dict)
    _indices: dict[int, int] = field(default_factory=dict)
    _exact_indices: dict[tuple, int] = field(default_factory=dict)
    _to_bake: dict[int, tuple[bpy.types.Material, ReadMaterial]] = field(default_factory=dict)
    _warnings: dict[int, list[str]] = field(default_factory=dict)

    def __post_init__(self):
        self.exactly = None if self.exact is None else ExactScan(self.exact, self.images)

    def slots(
        self, depsgraph: bpy.types.Depsgraph, instance: bpy.types.DepsgraphObjectInstance,
        shown: bpy.types.Object, data: bpy.types.ID,
    ) -> tuple[int, ...]:  # fmt: skip
        """The mesh's, overridden by those that the object itself fills (BKE_object_material_get_eval); the
        view layer's one for all, if it has one."""
        if (override := depsgraph.view_layer_eval.material_override) is not None:
            return (self._index(override),)
        used = list(data.materials)
        source = instance.instance_object if instance.is_instance else shown
        if (
            source is not None
            and source.data is not None
            and source.data.as_pointer() == shown.data.as_pointer()
        ):
            for index, slot in enumerate(source.material_slots):
                if slot.link == "OBJECT":
                    used += [None] * (index + 1 - len(used))
                    used[index] = slot.material
        return tuple(self._index(material) for material in used or [None])

    def exact_slots(
        self,
        instance: bpy.types.DepsgraphObjectInstance,
        shown: bpy.types.Object,
        data: bpy.types.ID,
        slots: tuple[int, ...],
    ) -> tuple[tuple[int, ...], ExactMesh | None]:
        """The slots as Blender bakes them on this mesh, and where it does; None where it bakes none."""
        lacking = [slot for slot in dict.fromkeys(slots) if slot in self._to_bake]
        if not lacking or not isinstance(data, bpy.types.Mesh):
            return slots, None
        appearance = appearance_of(instance, shown)
        for mesh in self.exactly.meshes_of(instance, shown, data):
            found = self._on(mesh, slots, lacking, appearance, instance.is_instance)
            if found:
                return tuple(found.get(slot, slot) for slot in slots), mesh
        return slots, None

    def _on(
        self,
        mesh: ExactMesh,
        slots: tuple[int, ...],
        lacking: list[int],
        appearance: Appearance,
        has_many: bool,
    ) -> dict[int, int]:
        """What stands for materials on a mesh."""
        found: dict[int, int] = {}
        for slot in lacking:
            where = tuple(number for number, each in enumerate(slots) if each == slot)
            material, fast = self._to_bake[slot]
            part = self.exactly.read(material, fast, mesh, where, len(slots), appearance, has_many)
            if not isinstance(part, Part):
                self._warnings[slot] = part
                continue
            key = slot, mesh.digest, mesh.size, part.met
            if key not in self._exact_indices:
                index = self._exact_indices[key] = self._add(material, part.read)
                self.exactly.parts[index] = part
                for told in (self.displacements, self._unread_displacements):
                    if slot in told:
                        told[index] = told[slot]
            found[slot] = self._exact_indices[key]
        return found

    def _index(self, material: bpy.types.Material | None) -> int:
        pointer = 0 if material is None else material.original.session_uid
        if pointer in self._indices:
            return self._indices[pointer]
        if material is None:
            index = self._add(None, ReadMaterial(default_material()))
        else:
            read = read_material(material, self.images)
            index = self._add(material, read)
            if self.exactly is not None and self.exactly.is_worth(read, set(read.unread)):
                self._to_bake[index] = material, read
            moved, unread = displacement_of(material)
            if moved is not None:
                self.displacements[index] = moved
            if unread:
                self._unread_displacements[index] = material.name_full, unread
        self._indices[pointer] = index
        return index

    def _add(self, material: bpy.types.Material | None, read: ReadMaterial) -> int:
        index = len(self.headers)
        self.headers.append(replace(read.material, own_settings=own_settings_of(material, "Material")))
        self._warnings[index] = read.warnings
        if self.exactly is None:
            for warning in read.warnings:
                self.warn(warning)
        return index

    def told(self, instances: Iterable[dict]) -> Iterator[Missing]:
        """What is to be said of them, once all instances are known (their `name` and `materials`)."""
        instances = list(instances)
        if self.exactly is not None:
            shown = {index for each in instances for index in each["materials"]}
            yield from (Missing(line) for index in sorted(shown) for line in self._warnings[index])
            yield from map(Missing, self.exactly.warnings)
            if self.exact.store.problem:
                yield Missing(self.exact.store.problem)
        for index, (material, unread) in self._unread_displacements.items():
            objects = named((each["name"] for each in instances if index in each["materials"]), "object")
            if objects:
                line = f"material '{material}' of {objects}: displacement by {unread} is not read"
                yield Missing(f"{line}, shapes and shadows are taken without it", True)
        for index, material in enumerate(self.headers):
            objects = material.tints and named(
                (each["name"] for each in instances if index in each["materials"]), "object"
            )
            if objects:
                verb = "colours" if len(material.tints) == 1 else "colour"
                line = f"material '{material.name}' of {objects}: {named(material.tints, 'node')} {verb} "
                line += "what comes through"
                yield Missing(f"{line}, shadows have its luminance in all channels")
