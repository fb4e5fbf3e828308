"""Reading materials exactly: what no reader of nodes covers Blender bakes, over each mesh that shows it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import bpy
import numpy as np

from ...core.arrays import MeshArrays
from ...core.errors import StrataError, one_line
from ...core.graph import Graph
from ...core.outline import Outline
from ...core.read import TEXELS
from ...core.shot import Raster
from ..materials import BASE_COLOUR, EMISSION, METALLIC, OPACITY, Images, ReadMaterial, read_material
from ..mesh_arrays import mesh_arrays
from ..pixels import LARGEST
from .layout import LAYOUTS, layout_of
from .leaves import Appearance, BakedLeaves, Leaf, random_of
from .mesh_content import generated_of, mesh_digest
from .size import area_of, size_for, sizes_for
from .store import STORE, Store
from .workshop import SAMPLES, Work, Workshop

# What a graph calls them. Diffuse light comes back by base colour, where metallic is the same all over.
_WANTS = {
    OPACITY: {"opacity"}, BASE_COLOUR: {"base_color", "diffuse"}, METALLIC: {"diffuse"},
    EMISSION: {"emission"},
}  # fmt: skip

SECONDS_EACH, SAMPLES_PER_SECOND = 0.1, 1.6e6
"""What Cycles takes for each output of a node on each mesh, before and while it bakes, on two cores."""


@dataclass(eq=False)
class ExactMesh:
    """A mesh of the depsgraph that is being read. `layout` gives `corner_uvs`."""

    source: bpy.types.Mesh | None
    digest: str
    size: int
    layout: Callable[[], np.ndarray] | None
    generated: np.ndarray

    @property
    def corner_uvs(self) -> np.ndarray:
        """(C, 2) f32: where its faces are baked."""
        return self.layout()


@dataclass(frozen=True, eq=False)
class Part:
    """A material as it is on some slots of a mesh, of `slot_count`. `leaves` are in its textures; `met` has
    the keys of all that reading it came upon, also of those that folded to constants: parts on equal meshes
    are one where these agree. `is_of_object`: some of that hangs on more of an object than its mesh."""

    material: bpy.types.Material | None
    name: str
    mesh: ExactMesh
    slots: tuple[int, ...]
    slot_count: int
    appearance: Appearance
    read: ReadMaterial
    leaves: tuple[Leaf, ...]
    met: frozenset[str]
    is_of_object: bool


@dataclass(eq=False)
class Exact:
    """What one job reads exactly, with `texels` a side at most: it is the same for all of its scans. `made`
    is what it has baked so far, by keys, and `seconds` what that took; `failed` is what cannot be, and why.
    Without `can_bake` only what is known already is read so."""

    texels: int = TEXELS
    store: Store = field(default_factory=lambda: STORE)
    made: dict[str, np.ndarray] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    can_bake: bool = True
    _waiting: list[Work] = field(default_factory=list)
    _copies: list[bpy.types.Mesh] = field(default_factory=list)

    def known(self, key: str) -> np.ndarray | None:
        return self.made[key] if key in self.made else self.store.get(key)

    @property
    def is_waiting(self) -> bool:
        """Whether there is anything to bake before it can be read."""
        return bool(self._waiting)

    def wait_for(self, parts: Iterable[Part]) -> None:
        """Takes of the depsgraph what is needed to bake what is not known of these, before it is gone."""
        if not self.can_bake:
            return
        works: dict[tuple, Work] = {}
        copies: dict[int, bpy.types.Mesh] = {}
        waiting: set[str] = set()
        for part in parts:
            mesh, leaves = part.mesh, self.missing(part)
            leaves = [leaf for leaf in leaves if leaf.key not in waiting]
            waiting.update(leaf.key for leaf in leaves)
            if not leaves:
                continue
            if id(mesh) not in copies:
                copies[id(mesh)] = mesh.source.copy()
                self._copies.append(copies[id(mesh)])
            key = id(mesh), part.appearance
            if key not in works:
                works[key] = Work(copies[id(mesh)], mesh.corner_uvs, mesh.generated, mesh.size,
                                  part.slot_count, {}, part.appearance)  # fmt: skip
                self._waiting.append(works[key])
            for slot in part.slots:
                works[key].leaves[slot] = part.material, leaves

    def missing(self, part: Part) -> list[Leaf]:
        """What of it is not baked yet."""
        return [leaf for leaf in part.leaves if self.known(leaf.key) is None]

    def bake(self, scene: bpy.types.Scene, frame: int, show: Callable[[float], None] | None = None) -> None:
        """All that waits, outside of any render. What goes wrong with one mesh goes to `failed`. `show` is
        told the share that is done."""
        try:
            with Workshop(scene, frame, scene.frame_subframe) as workshop:
                for number, work in enumerate(self._waiting):
                    if show:
                        show(number / len(self._waiting))
                    self._bake(workshop, work)
        except StrataError as error:
            self._fail(self._waiting, error)
        finally:
            self.discard()

    def _bake(self, workshop: Workshop, work: Work) -> None:
        started = time.perf_counter()
        try:
            for leaf, values in workshop.bake(work):
                self.made[leaf.key] = values
                self.store.put(leaf.key, values)
                now = time.perf_counter()
                self.seconds[leaf.key], started = now - started, now
        except Exception as error:  # of one mesh; the others are still worth it
            self._fail([work], error)

    def _fail(self, works: Iterable[Work], error: BaseException) -> None:
        reason = one_line(error)
        keys = (leaf.key for work in works for _, leaves in work.leaves.values() for leaf in leaves)
        self.failed |= {key: reason for key in keys if key not in self.made}

    def discard(self) -> None:
        """What waits is not baked."""
        copies, self._copies = self._copies, []
        self._waiting = []
        if copies:
            bpy.data.batch_remove(copies)

    def told(self, parts: Iterable[Part]) -> list[str]:
        """A line for each material: what of it Blender bakes, and what that takes or took."""
        by_material: dict[str, list[Part]] = {}
        for part in parts:
            by_material.setdefault(part.name, []).append(part)
        return [self._line(name, of_material) for name, of_material in by_material.items()]

    def _line(self, name: str, parts: list[Part]) -> str:
        leaves = {leaf.key: part.mesh.size for part in parts for leaf in part.leaves}
        what = " and ".join(use for use in parts[0].read.baked if any(part.read.baked[use] for part in parts))
        sizes = sorted(set(leaves.values()))
        texels = (
            f"{sizes[0]} texels a side" if len(sizes) == 1 else f"{sizes[0]} to {sizes[-1]} texels a side"
        )
        where = f" of {len(parts)} meshes" if len(parts) > 1 else ""
        missing = [key for key in leaves if key not in self.made and not self.store.has(key)]
        if missing:
            seconds = sum(seconds_to_bake(leaves[key]) for key in missing)
            return (
                f"material '{name}': {what}{where} to be baked by Blender at {texels}, about {seconds:.1f} s"
            )
        seconds = sum(self.seconds.get(key, 0.0) for key in leaves)
        took = f"in {seconds:.1f} s" if seconds else "kept from before"
        return f"material '{name}': {what}{where} baked by Blender at {texels}, {took}"


def seconds_to_bake(size: int) -> float:
    """What an output of a node takes on a mesh, about."""
    return SECONDS_EACH + SAMPLES * size * size / SAMPLES_PER_SECOND


@dataclass(eq=False)
class ExactScan:
    """What one scan finds to be read exactly. `parts` are by material of the outline; `warnings` are to be
    told; `places`: matrices of instances, before anything is read."""

    exact: Exact
    images: Images
    parts: dict[int, Part] = field(default_factory=dict)
    warnings: dict[str, None] = field(default_factory=dict)
    raster: Raster | None = None
    uses_osl: bool = False
    places: dict[tuple, list[tuple[float, ...]]] = field(default_factory=dict)
    _arrays: dict[int, tuple[MeshArrays, np.ndarray, str, float]] = field(default_factory=dict)
    _meshes: dict[tuple[int, int], ExactMesh] = field(default_factory=dict)
    _upstream: dict[int, dict[tuple, object]] = field(default_factory=dict)
    _content: dict[int, str] = field(default_factory=dict)

    def add_place(self, instance: bpy.types.DepsgraphObjectInstance, shown: bpy.types.Object) -> None:
        """Of one of many instances: the nearest of them says how fine they are."""
        if instance.is_instance and shown.type == "MESH":
            matrix = instance.matrix_world
            rows = (*matrix[0], *matrix[1], *matrix[2], *matrix[3])
            self.places.setdefault(_place_key(instance, shown), []).append(rows)

    def meshes_of(
        self, instance: bpy.types.DepsgraphObjectInstance, shown: bpy.types.Object, data: bpy.types.Mesh
    ) -> Iterator[ExactMesh]:
        """As fine as it has to be where an object shows it, if it has not too many faces. Where nothing can
        be baked, others after that: another camera may have asked for them."""
        pointer = data.as_pointer()
        if pointer not in self._arrays:
            generated = generated_of(data)
            arrays = mesh_arrays(data, False, shown.name, [])
            self._arrays[pointer] = arrays, generated, mesh_digest(data, generated), area_of(data)
        arrays, generated, digest, area = self._arrays[pointer]
        if not len(arrays.corner_vertices):
            return
        places = self.places.get(_place_key(instance, shown)) or [instance.matrix_world]
        matrices = np.array(places, np.float64).reshape(-1, 4, 4)
        size = size_for(self.raster, shown, matrices, area, len(data.polygons), self.exact.texels)
        if size > LARGEST:
            told = f"object '{shown.name}': its materials are not baked, it has too many faces"
            self.warnings[told] = None
            return
        sizes = (
            [size]
            if self.exact.can_bake
            else dict.fromkeys([size, *sizes_for(len(data.polygons), self.exact.texels)])
        )
        for size in sizes:
            if (pointer, size) not in self._meshes:
                layout = partial(_layout, arrays, digest, size)
                self._meshes[pointer, size] = ExactMesh(data, digest, size, layout, generated)
            yield self._meshes[pointer, size]

    def read(
        self,
        material: bpy.types.Material,
        fast: ReadMaterial,
        mesh: ExactMesh,
        slots: tuple[int, ...],
        slot_count: int,
        appearance: Appearance,
        has_many: bool,
    ) -> Part | list[str]:
        """A material on slots of a mesh; where that is not worth it beside what its nodes give (`fast`), its
        warnings, which say why. `has_many`: it is shown by many instances, of which `appearance` is the
        first."""
        upstream = self._upstream.setdefault(material.as_pointer(), {})
        leaves = BakedLeaves(
            mesh.digest, slots, mesh.size, None if has_many else appearance,
            self.exact.known, self.exact.failed, self.exact.can_bake,
            material.pass_index, self.uses_osl, upstream, self._content,
        )  # fmt: skip
        read = read_material(material, self.images, leaves)
        if not self.is_worth(fast, set(fast.unread) - set(read.unread)):
            return _warnings_of(fast, read)
        keys = frozenset().union(*read.baked.values())
        used = tuple(leaf for key, leaf in leaves.found.items() if key in keys)
        met = frozenset(leaves.found)
        return Part(
            material.original, material.name_full, mesh, slots, slot_count, appearance, read, used, met,
            leaves.are_of_object,
        )  # fmt: skip

    def are_of_object(self, materials: Iterable[int]) -> bool:
        """Whether any of these has something baked that hangs on more of an object than its mesh."""
        return any(index in self.parts and self.parts[index].is_of_object for index in materials)

    def without_sources(self) -> ExactScan:
        """Without Blender's own data."""
        none = np.zeros((0, 3), np.float32)
        parts = {
            index: replace(
                part, material=None, mesh=replace(part.mesh, source=None, layout=None, generated=none)
            )
            for index, part in self.parts.items()
        }
        return ExactScan(self.exact, Images(), parts)

    @staticmethod
    def is_worth(fast: ReadMaterial, gained: set[str]) -> bool:
        """Whether a material is to be read exactly, if that gains so much of what is `unread` by its nodes.
        One whose opacity is read well, or never, is not for its colours' sake, nor a base colour for
        metallic's: all pictures would lie where things are baked, and be coarser."""
        if OPACITY in gained or not gained:
            return OPACITY in gained
        if any(not each.is_uniform for each in fast.material.opacities):
            return False
        return gained != {METALLIC} or fast.material.base_color_image is None

    def needed(self, graph: Graph, outline: Outline) -> list[Part]:
        """Those of which a plan reads anything that is baked, with that alone."""
        materials = outline.instances.materials_of(frozenset(graph.instances))
        found = []
        for index, part in self.parts.items():
            keys = (
                part.read.baked.get(use, frozenset()) for use, wants in _WANTS.items() if wants & graph.wants
            )
            keys = frozenset().union(*keys)
            leaves = tuple(leaf for leaf in part.leaves if leaf.key in keys)
            if leaves and index in materials:
                found.append(replace(part, leaves=leaves))
        return found


def _place_key(instance: bpy.types.DepsgraphObjectInstance, shown: bpy.types.Object) -> tuple[int, int, int]:
    """The same for all that one instancer makes of a mesh."""
    owner = instance.parent if instance.is_instance else shown
    return shown.original.session_uid, owner.original.session_uid, shown.data.as_pointer()


def _layout(mesh: MeshArrays, digest: str, size: int) -> np.ndarray:
    """(C, 2) f32: where the faces of the mesh of that digest are baked."""
    arrays = mesh.positions, mesh.corner_vertices, mesh.face_starts
    return LAYOUTS.get(digest, size, lambda: layout_of(*arrays, size))


def _warnings_of(fast: ReadMaterial, read: ReadMaterial) -> list[str]:
    """Of a material that stays as its nodes are read: with the reasons why what is unread still is."""

    def is_explained(line: str) -> bool:
        return any(f" not read for {use}" in line for use in read.unread if use in fast.unread)

    kept = [line for line in fast.warnings if not is_explained(line)]
    return kept + [line for line in read.warnings if is_explained(line)]


def appearance_of(instance: bpy.types.DepsgraphObjectInstance, shown: bpy.types.Object) -> Appearance:
    """Of an instance that stands for its object."""
    return Appearance(
        tuple(tuple(row) for row in instance.matrix_world),
        tuple(shown.color),
        shown.pass_index,
        random_of(shown.original.name),
    )
