"""What a file has and Blender could not load or run, each with the objects concerned and what is assumed
instead: Blender says so on a terminal at most, and goes on without."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import bpy

MOST_NAMES = 3  # told one by one

# What is lost with a datablock of other types than these is a colour or an opacity, and not a shape or place.
_SHAPES = (
    *("Action", "Armature", "Collection", "Curve", "Curves", "GeometryNodeTree", "Key", "Lattice", "Mesh"),
    *("MetaBall", "Object", "ParticleSettings", "PointCloud", "SurfaceCurve", "TextCurve", "Volume"),
)
_WITHOUT_SHAPE = "their shapes and shadows are missing"
_BY_DEFAULT = "Blender's defaults stand in"
_SCRIPTS_ARE_OFF = "as scripts of the file are off (--trust-scripts runs them)"


@dataclass(frozen=True)
class Missing:
    """One line; `of_unknown_extent`: no one can say how much of a picture hangs on it."""

    line: str
    of_unknown_extent: bool = False


def named(names: Iterable[str], one: str, several: str = "") -> str:
    """`object 'A'`, `objects 'A', 'B', 'C' and 4 more`; empty where there are none."""
    found = sorted(dict.fromkeys(names))
    shown = ", ".join(f"'{name}'" for name in found[:MOST_NAMES])
    more = f" and {len(found) - MOST_NAMES} more" if len(found) > MOST_NAMES else ""
    return f"{one if len(found) == 1 else several or f'{one}s'} {shown}{more}" if found else ""


def _kind(datablock: bpy.types.ID) -> str:
    kind = datablock.id_type.lower()
    return {"nodetree": "node group"}.get(kind, kind.replace("_", " "))


def missing_parts(depsgraph: bpy.types.Depsgraph) -> list[Missing]:
    """Of all that the depsgraph evaluates: datablocks of libraries, types of nodes, scripts and drivers; and
    what Cycles leaves out by itself."""
    found = _Evaluated([each.original for each in depsgraph.ids])
    return [*_datablocks(found), *_nodes(found), *_scripts(), *_drivers(found), *_culled(found, depsgraph)]


class _Evaluated:
    """The datablocks of a depsgraph, and which of its objects show one, found where somebody asks."""

    def __init__(self, all_ids: list[bpy.types.ID]):
        self.all = all_ids
        self._uids = {each.session_uid for each in all_ids}

    @cached_property
    def _users(self) -> dict[bpy.types.ID, set[bpy.types.ID]]:
        return bpy.data.user_map()

    def is_shape(self, datablock: bpy.types.ID) -> bool:
        """Whether what it says is the shape or the place of something."""
        if datablock.bl_rna.identifier in _SHAPES:
            return True
        # A node group that is missing has lost its type, too.
        return isinstance(datablock, bpy.types.NodeTree) and any(
            isinstance(user, bpy.types.Object)
            or (isinstance(user, bpy.types.NodeTree) and self.is_shape(user))
            for user in self._users.get(datablock, ())
        )

    def objects_with(self, datablocks: Collection[bpy.types.ID]) -> list[str]:
        """Names of the objects that show one, by whatever way."""
        names, seen, asked = [], set(datablocks), list(datablocks)
        while asked:
            each = asked.pop()
            if isinstance(each, bpy.types.Object):
                if each.session_uid in self._uids:
                    names.append(each.name)
                continue
            asked += (fresh := self._users.get(each, set()) - seen)
            seen |= fresh
        return names


def _datablocks(found: _Evaluated) -> Iterator[Missing]:
    """A line for each library and each kind of what is lost."""
    groups: dict[tuple[bpy.types.Library, bool], list[bpy.types.ID]] = {}
    if bpy.data.libraries:
        for each in found.all:
            if each.is_missing:
                groups.setdefault((each.library, found.is_shape(each)), []).append(each)
    for (library, is_shape), datablocks in groups.items():
        by_kind: dict[str, list[str]] = {}
        for each in datablocks:
            by_kind.setdefault(_kind(each), []).append(each.name)
        what = ", ".join(named(names, kind) for kind, names in sorted(by_kind.items()))
        where = f"library '{library.filepath}' " + ("is missing, with" if library.is_missing else "lacks")
        objects = named(found.objects_with(datablocks), "object")
        assumed = _WITHOUT_SHAPE if is_shape else _BY_DEFAULT
        yield Missing(f"{where} {what}{f' of {objects}' if objects else ''}: {assumed}", is_shape)


def _nodes(found: _Evaluated) -> Iterator[Missing]:
    for each in found.all:
        tree = each if isinstance(each, bpy.types.NodeTree) else getattr(each, "node_tree", None)
        if tree is None or (tree is each and tree.is_embedded_data):
            continue
        unknown = [node.label or node.name for node in tree.nodes if node.bl_idname == "NodeUndefined"]
        if unknown:
            is_shape = tree.bl_idname == "GeometryNodeTree"
            objects = named(found.objects_with([each]), "object")
            yield Missing(
                f"{_kind(each)} '{each.name_full}'{f' of {objects}' if objects else ''} has "
                f"{named(unknown, 'node')} of a type that this Blender does not know"
                f"{f': {_WITHOUT_SHAPE}' if is_shape else ', which gives nothing'}",
                is_shape,
            )


def _scripts() -> Iterator[Missing]:
    """Texts that a file runs when it opens, where that was not allowed."""
    if bpy.app.autoexec_fail:
        texts = [text.name for text in bpy.data.texts if text.use_module]
        if texts:
            yield Missing(f"{named(texts, 'text')} did not run, {_SCRIPTS_ARE_OFF}")


def _drivers(found: _Evaluated) -> Iterator[Missing]:
    """Drivers written in Python that did not run; what Blender reads without Python did."""
    if not bpy.app.autoexec_fail:
        return
    for each in found.all:
        animation = getattr(each, "animation_data", None)
        blocked = [
            curve.data_path
            for curve in (animation.drivers if animation is not None else ())
            if curve.driver.type == "SCRIPTED"
            and not curve.driver.is_simple_expression
            and not curve.driver.is_valid
        ]
        if blocked:
            objects = [] if isinstance(each, bpy.types.Object) else found.objects_with([each])
            yield Missing(
                f"{_kind(each)} '{each.name_full}'{f' of {named(objects, "object")}' if objects else ''}: "
                f"{named(blocked, 'driver of', 'drivers of')} did not run, {_SCRIPTS_ARE_OFF}: "
                "it is taken as the file was saved",
                found.is_shape(each),
            )


def _culled(found: _Evaluated, depsgraph: bpy.types.Depsgraph) -> Iterator[Missing]:
    """Objects that Cycles (its object_cull.cpp) leaves out where they are out of sight, shadows and all."""
    scene = depsgraph.scene
    cycles = getattr(scene, "cycles", None)  # not there where Cycles is switched off
    ways = [way for way in ("use_camera_cull", "use_distance_cull") if getattr(cycles, way, False)]
    if scene.render.use_simplify and ways:
        objects = (each for each in found.all if isinstance(each, bpy.types.Object))
        names = [each.name for each in objects if any(getattr(each.cycles, way) for way in ways)]
        if names:
            line = (
                f"{named(names, 'object')}: Cycles' culling is not read, shadows are there wherever they are"
            )
            yield Missing(line)
