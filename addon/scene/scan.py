"""From an evaluated depsgraph to the cheap header of the scene."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from ..core.errors import StrataError
from ..core.outline import Bounds, Instance, Instances, Outline
from ..core.shot import Camera, Raster, Shot
from .cameras import camera_of, camera_warnings, frame_size_of, pixel_filter_of, region_of
from .displacement import BySlot
from .edit_mode import edited_mesh, is_edited, sculpted_modifiers, unseen_modifiers
from .exact.reading import Exact, ExactScan
from .hair import hair_systems
from .made_mesh import MadeMesh
from .missing import Missing, missing_parts, named
from .nodes.pictures import Picture
from .nodes.values import Value
from .own_settings import own_settings_of
from .render_depsgraph import engine_of
from .scanned_lamps import ScannedLamps
from .scanned_materials import ScannedMaterials
from .scanned_meshes import Data, ScannedMeshes
from .simulations import unbaked_simulations
from .stamp import stamp_of
from .transforms import are_usable
from .volumes import volume_of
from .world_light import gives_light

_READ = ("MESH", "CURVES", "POINTCLOUD")

# Types that would render but are not read; all others without a mesh (empties, armatures, ...) never render.
# What is assumed instead, and whether a picture may hang on it.
_NOT_READ = {
    "VOLUME": ("volumes are not read, what it takes of light and adds is missing", True),
    "GREASEPENCIL": ("grease pencil is not read, Blender draws it over the picture", False),
}


BETWEEN_LOOKS = 64
"""Instances read between two looks at the clock: one may take longer than to read an instance."""


@dataclass(frozen=True)
class ScanOptions:
    """`size` in pixels replaces the scene's. `camera` replaces the scene's: an object's name, or a camera
    that is no object (`cameras.viewport_camera`), which has neither render region nor pixel aspect. `shows`,
    called with an object of the scene, says whether to read it. `seconds`: what it may take of this
    thread's time, None for whatever it takes. `exact`: what no reader of nodes covers is read as baked."""

    size: tuple[int, int] | None = None
    camera: str | Camera | None = None
    seed: int = 0
    shows: Callable[[bpy.types.Object], bool] | None = None
    seconds: float | None = None
    exact: Exact | None = None


class TooLong(StrataError):
    """Reading takes longer than was allowed."""


@dataclass(frozen=True, eq=False)
class Scan:
    """The outline, the shot of its camera, and Blender's data behind its meshes and images: to be extracted
    from before the depsgraph changes, and not to be kept. `mesh_owners` are session ids of the objects that
    make the meshes; by the outline's indices, `instance_owners` and `light_owners` are those of objects that
    stand for themselves, 0 for what an instancer makes. `corner_sources`: what opacities' `corners` name;
    `displacements` are by mesh, of those that have any; `own_boxes`: the meshes whose box is not that of
    their object; `baked_uvs` give (C, 2) f32 by mesh: where things are baked; `exactly`: what is."""

    outline: Outline
    shot: Shot
    mesh_sources: tuple[bpy.types.Mesh | MadeMesh, ...]
    image_sources: tuple[Picture, ...]
    mesh_owners: tuple[int, ...] = ()
    instance_owners: tuple[int, ...] = ()
    light_owners: tuple[int, ...] = ()
    corner_sources: dict[str, Value] = field(default_factory=dict)
    displacements: dict[int, BySlot] = field(default_factory=dict)
    own_boxes: frozenset[int] = frozenset()
    baked_uvs: dict[int, Callable[[], np.ndarray]] = field(default_factory=dict)
    exactly: ExactScan | None = None

    def without_sources(self) -> Scan:
        """Without Blender's own data, and what leads to it."""
        kept = replace(self, mesh_sources=(), image_sources=(), corner_sources={}, displacements={})
        exactly = self.exactly and self.exactly.without_sources()
        return replace(kept, baked_uvs={}, exactly=exactly)


def scan(depsgraph: bpy.types.Depsgraph, options: ScanOptions = ScanOptions()) -> Scan:
    """Reads everything renderable. In render mode (see `render_depsgraph`) that is what F12 shows, in
    viewport mode what the viewport shows. Raises StrataError where there is no usable camera, and TooLong."""
    return _Scanner(depsgraph, options).run()


def raster_of(depsgraph: bpy.types.Depsgraph, options: ScanOptions) -> tuple[Raster, list[str]]:
    """What the scene's camera takes, or the one asked for, and warnings. Raises StrataError
    where there is no usable camera."""
    scene, asked = depsgraph.scene_eval, options.camera
    render = scene.render
    frame_size = options.size or frame_size_of(render)
    if isinstance(asked, Camera):
        return Raster(asked, frame_size), []
    camera = scene.camera if asked is None else bpy.data.objects.get(asked)
    if camera is None:
        raise StrataError(f"scene '{scene.name}' has no camera" + (f" '{asked}'" if asked else ""))
    camera = camera.evaluated_get(depsgraph)
    raster = Raster(
        camera_of(camera),
        frame_size,
        pixel_aspect=(render.pixel_aspect_x, render.pixel_aspect_y),
        region=region_of(render, frame_size),
        crop=render.use_border and render.use_crop_to_border,
    )
    return raster, camera_warnings(camera, render)


@dataclass(eq=False)
class _Scanner:
    depsgraph: bpy.types.Depsgraph
    options: ScanOptions
    baked_uvs: dict[int, Callable[[], np.ndarray]] = field(default_factory=dict)
    meshes: ScannedMeshes = field(default_factory=ScannedMeshes)
    instance_owners: list[int] = field(default_factory=list)
    appearances: dict[tuple, dict | None] = field(default_factory=dict)
    instances: list[dict] = field(default_factory=list)
    matrices: list[tuple[float, ...]] = field(default_factory=list)
    objects: list[bpy.types.Object] = field(default_factory=list)
    object_ids: dict[int, int] = field(default_factory=dict)
    lamps: ScannedLamps = field(default_factory=ScannedLamps)
    shown: dict[int, bool] = field(default_factory=dict)
    edited_meshes: dict[int, bpy.types.Mesh] = field(default_factory=dict)
    catchers: set[str] = field(default_factory=set)
    with_shading_offset: set[str] = field(default_factory=set)
    warnings: dict[str, bool] = field(default_factory=dict)

    def __post_init__(self):
        self.materials = ScannedMaterials(self.options.exact, self._warn)

    def run(self) -> Scan:
        scene = self.depsgraph.scene_eval
        end = math.inf if self.options.seconds is None else time.thread_time() + self.options.seconds
        raster, warnings = raster_of(self.depsgraph, self.options)
        for warning in warnings:
            self._warn(warning)
        if self.materials.exactly is not None:
            self.materials.exactly.raster = raster
            # Without Cycles' add-on nothing is baked.
            self.materials.exactly.uses_osl = hasattr(scene, "cycles") and scene.cycles.shading_system
            for instance, shown in self._each_shown(end, BETWEEN_LOOKS):
                self.materials.exactly.add_place(instance, shown)
        # Of one that shows what is baked, mesh and images are gone through.
        for instance, shown in self._each_shown(end, BETWEEN_LOOKS if self.options.exact is None else 1):
            if shown.type in _READ:
                self._shapes(instance, shown)
            elif shown.type == "LIGHT":
                for warning in self.lamps.add(instance, shown):
                    self._warn(warning)
            elif shown.type in _NOT_READ:
                assumed, is_unknown = _NOT_READ[shown.type]
                self._warn(f"object '{shown.name}': {assumed}", is_unknown)
        if self.is_render:
            for warning in unbaked_simulations(self.depsgraph):
                self._warn(warning)
        world, world_medium = self.depsgraph.view_layer_eval.world_override or scene.world, None
        if world is not None and world.node_tree is not None:
            world_medium, warnings = volume_of(world.node_tree, f"world '{world.name}'")
            for warning in warnings:
                self._warn(warning)
        instances = self._finished_instances()
        for part in [*self._assumed(), *missing_parts(self.depsgraph)]:
            self._warn(part.line, part.of_unknown_extent)
        outline = Outline(
            scene_name=scene.name,
            view_layer_name=self.depsgraph.view_layer.name,
            frame=scene.frame_current,
            lights=self.lamps.linked(self.objects),
            instances=instances,
            meshes=tuple(self.meshes.headers),
            materials=tuple(self.materials.headers),
            images=tuple(self.materials.images.headers),
            warnings=tuple(self.warnings),
            unknown=tuple(line for line, is_unknown in self.warnings.items() if is_unknown),
            working_space=bpy.data.colorspace.working_space,
            exposure=2.0**scene.view_settings.exposure,
            world_medium=world_medium,
            world_light=world.name if world is not None and gives_light(world) else "",
            stamp=stamp_of(scene, raster.camera.name),
        )
        pixel_filter = pixel_filter_of(scene, engine_of(self.depsgraph.scene))
        shot = Shot(raster.camera.name, raster, pixel_filter, self.options.seed)
        return Scan(
            outline,
            shot,
            tuple(self.meshes.sources),
            tuple(self.materials.images.sources),
            tuple(self.meshes.owners),
            tuple(self.instance_owners),
            tuple(self.lamps.owners),
            self.materials.images.corners,
            self.meshes.displacements,
            self.meshes.own_boxes,
            self.baked_uvs,
            self.materials.exactly,
        )

    @property
    def is_render(self) -> bool:
        return self.depsgraph.mode == "RENDER"

    def _each_shown(
        self, end: float, between: int
    ) -> Iterator[tuple[bpy.types.DepsgraphObjectInstance, bpy.types.Object]]:
        """Instances with their objects; Blender's are gone with the next one. After every `between` of them
        it is seen whether this thread has got to `end`, in seconds."""
        for number, instance in enumerate(self.depsgraph.object_instances):
            if number % between == 0 and time.thread_time() > end:
                raise TooLong(f"scene '{self.depsgraph.scene_eval.name}' takes long to read")
            if self._is_shown(instance, instance.object):
                yield instance, instance.object

    def _is_shown(self, instance: bpy.types.DepsgraphObjectInstance, shown: bpy.types.Object) -> bool:
        if self.options.shows is None:
            return True
        owner = (instance.parent if instance.is_instance else shown).original
        if owner.session_uid not in self.shown:
            self.shown[owner.session_uid] = self.options.shows(owner)
        return self.shown[owner.session_uid]

    def _warn(self, warning: str, of_unknown_extent: bool = False) -> None:
        self.warnings[warning] = of_unknown_extent or self.warnings.get(warning, False)

    def _assumed(self) -> Iterator[Missing]:
        """Of what is read in part: with its objects, and what is taken in place of the rest."""
        yield from self.materials.told([each for each in self.appearances.values() if each is not None])
        yield from self.meshes.told
        names = {each["name"] for each in self.appearances.values() if each and each["visible_camera"]}
        if objects := named(names & self.catchers, "shadow catcher"):
            light = "Cycles' passes of light, which layers are multiplied onto, have none of it"
            yield Missing(f"{objects}: layers take it for a surface like any other, and {light}")
        if objects := named(names & self.with_shading_offset, "object"):
            offset = "the shadow terminator's shading offset is not read"
            yield Missing(f"{objects}: {offset}, their light is taken to be as without it")

    # Meshes

    def _shapes(self, instance: bpy.types.DepsgraphObjectInstance, shown: bpy.types.Object) -> None:
        is_mesh = shown.type == "MESH"
        if instance.show_self:
            self._shape(instance, shown, self._mesh_of(shown) if is_mesh else shown.data)
        if is_mesh and len(shown.particle_systems) and instance.show_particles:
            for modifier in hair_systems(shown, self.is_render):
                self._shape(instance, shown, modifier)

    def _shape(
        self, instance: bpy.types.DepsgraphObjectInstance, shown: bpy.types.Object, data: Data
    ) -> None:
        owner = instance.parent if instance.is_instance else shown
        original = shown.original
        # All that instances have in common but the matrix; scenes with many have few different ones.
        key = (original.session_uid, owner.original.session_uid, data.as_pointer())
        if key not in self.appearances:
            has_faces = not isinstance(data, bpy.types.Mesh) or len(data.polygons) > 0
            self.appearances[key] = self._appearance(instance, shown, owner, data) if has_faces else None
        appearance = self.appearances[key]
        if appearance is not None:
            matrix = instance.matrix_world
            self.instances.append(appearance)
            self.objects.append(original)
            self.instance_owners.append(0 if instance.is_instance else original.session_uid)
            self.matrices.append((*matrix[0], *matrix[1], *matrix[2], *matrix[3]))

    def _mesh_of(self, shown: bpy.types.Object) -> bpy.types.Mesh:
        if not is_edited(shown):
            if not self.is_render:
                for name in sculpted_modifiers(shown.original):
                    self._warn(
                        f"object '{shown.name}' is in Sculpt Mode: the preview shows it without '{name}', "
                        "a bake shows it"
                    )
            return shown.data
        original = shown.original
        if original.session_uid not in self.edited_meshes:
            self.edited_meshes[original.session_uid] = edited_mesh(shown)
            if unseen := unseen_modifiers(original, self.is_render):
                names = ", ".join(f"'{name}'" for name in unseen)
                self._warn(f"object '{original.name}' is in Edit Mode: shown without its modifiers {names}")
        return self.edited_meshes[original.session_uid]

    def _appearance(
        self, instance, shown: bpy.types.Object, owner: bpy.types.Object, data: Data
    ) -> dict | None:
        view_layer = self.depsgraph.view_layer_eval
        indirect_only = owner.indirect_only_get(view_layer=view_layer)
        if isinstance(data, bpy.types.Modifier):  # hair has the one of its emitter's that it says
            slots = self.materials.slots(self.depsgraph, instance, shown, shown.data)
            slots = (slots[min(data.particle_system.settings.material, len(slots)) - 1],)
        else:
            slots = self.materials.slots(self.depsgraph, instance, shown, data)
        slots, baked = self.materials.exact_slots(instance, shown, data, slots)
        by_slot = tuple(self.materials.displacements.get(slot) for slot in slots)
        variant = ()
        if baked is not None:
            variant = baked.size, *(slot in self.materials.exactly.parts for slot in slots)
        mesh = self.meshes.index(self.depsgraph, shown, data, by_slot, variant)
        if mesh is None:
            return None
        if baked is not None:
            self.baked_uvs[mesh] = baked.layout
        materials = [self.materials.headers[slot] for slot in slots]
        is_surface = any(material.has_surface for material in materials)
        if shown.is_shadow_catcher or owner.is_shadow_catcher:
            self.catchers.add(shown.name)
        if shown.shadow_terminator_shading_offset > 0.0:
            self.with_shading_offset.add(shown.name)
        return {
            "name": shown.name,
            "mesh": mesh,
            "object_id": self.object_ids.setdefault(shown.original.session_uid, len(self.object_ids)),
            "materials": slots,
            "visible_camera": any(material.is_seen for material in materials)
            and shown.visible_camera
            and owner.visible_camera
            and not indirect_only,
            "casts_shadow": any(material.casts_shadow for material in materials)
            and shown.visible_shadow
            and owner.visible_shadow,
            "medium": None if is_surface else materials[0].medium,
            "is_holdout": shown.is_holdout
            or owner.holdout_get(view_layer=view_layer)
            or (is_surface and all(material.is_holdout for material in materials)),
            "own_settings": own_settings_of(shown, "Object"),
            "terminator_offset": shown.shadow_terminator_geometry_offset if _is_smooth(data) else 0.0,
        }

    def _finished_instances(self) -> Instances:
        """Without those whose matrix cannot be used; `objects` stays in step."""
        matrices = np.array(self.matrices, np.float64).reshape(-1, 4, 4)
        usable = are_usable(matrices)
        for index in np.flatnonzero(~usable):
            name = self.instances[index]["name"]
            self._warn(f"object '{name}' is left out: its matrix is singular or not finite")
        matrices = matrices[usable]
        kept = np.flatnonzero(usable).tolist()
        appearances = [self.instances[index] for index in kept]
        self.objects = [self.objects[index] for index in kept]
        self.instance_owners = [self.instance_owners[index] for index in kept]
        boxes = np.array(self.meshes.boxes).reshape(-1, 2, 3)[
            [appearance["mesh"] for appearance in appearances]
        ]
        # The box of a transformed box (Arvo, Graphics Gems 1990).
        centres = np.einsum("nij,nj->ni", matrices[:, :3, :3], boxes.mean(axis=1)) + matrices[:, :3, 3]
        extents = np.einsum("nij,nj->ni", np.abs(matrices[:, :3, :3]), 0.5 * (boxes[:, 1] - boxes[:, 0]))
        lows, highs = (centres - extents).tolist(), (centres + extents).tolist()
        made = Instances(
            Instance(matrix=tuple(map(tuple, rows)), bounds=Bounds(tuple(low), tuple(high)), **appearance)
            for appearance, rows, low, high in zip(appearances, matrices.tolist(), lows, highs, strict=True)
        )
        # Known already: of many instances they take long to be made again.
        made.matrices, made.boxes = matrices, np.stack([centres - extents, centres + extents], axis=1)
        return made


def _is_smooth(data: Data) -> bool:
    """Whether it has faces that are shaded smooth. Cycles' curves and points are no triangles."""
    return isinstance(data, bpy.types.Mesh) and data.normals_domain != "FACE"
