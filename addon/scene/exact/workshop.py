"""Bakes outputs of nodes over a mesh with Cycles, in a scene of its own. Whatever happens, nothing of it is
left in the file."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import bpy
import mathutils
import numpy as np

from ...core.errors import StrataError
from .leaves import Appearance, Leaf

Instead = dict[bpy.types.NodeSocket, bpy.types.NodeSocket]

SAMPLES = 4
"""Of a texel: the first in its middle, the others within it. What changes within a texel is blurred so, as
where an image is made smaller."""

_NAME = "Strata"
_MAP, _NO_MAP, _GENERATED = "strata baked", "strata none", "strata generated"
_MARGIN = 4  # texels that faces which do not fill their squares go on beyond their edges

# All other textures take generated coordinates where nothing is linked to them.
_NOT_GENERATED = {"ShaderNodeTexImage", "ShaderNodeTexWhiteNoise", "ShaderNodeTexCoord", "ShaderNodeTexIES",
                  "ShaderNodeTexEnvironment"}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Work:
    """One mesh to bake on. `mesh` is in the file, made for this, maybe for several; `corner_uvs` (C, 2) f32:
    where its faces lie; `generated` (V, 3) f32: its texture coordinates of that name. `leaves` are by slot,
    each with its material; other slots have none."""

    mesh: bpy.types.Mesh
    corner_uvs: np.ndarray
    generated: np.ndarray
    size: int
    slots: int
    leaves: Mapping[int, tuple[bpy.types.Material, Sequence[Leaf]]]
    appearance: Appearance


class Workshop:
    """A scene to bake in, as a context. `bake` may be called many times. Only on the main thread, and not
    inside of a render."""

    def __init__(self, scene: bpy.types.Scene, frame: int, subframe: float = 0.0):
        self._for, self._frame, self._subframe = scene, frame, subframe
        self._made: list[bpy.types.ID] = []

    def __enter__(self) -> Workshop:
        _check_cycles()
        try:
            self._scene = scene = self._keep(bpy.data.scenes.new(_NAME))
            scene.frame_current, scene.frame_subframe = self._frame, self._subframe  # calls no handlers
            scene.render.engine = "CYCLES"
            settings = scene.cycles
            settings.device, settings.samples = "CPU", SAMPLES
            settings.use_adaptive_sampling = settings.use_denoising = False
            settings.time_limit = 0.0
            settings.shading_system = self._for.cycles.shading_system
            scene.render.bake.use_selected_to_active = False
        except BaseException:
            self._clear()
            raise
        return self

    def __exit__(self, *_) -> None:
        self._clear()

    def _keep[Data: bpy.types.ID](self, data: Data) -> Data:
        self._made.append(data)
        return data

    def _clear(self, count: int = 0) -> None:
        """All that was made after the first `count`."""
        made, self._made = self._made[count:], self._made[:count]
        bpy.data.batch_remove(made)

    def bake(self, work: Work) -> Iterator[tuple[Leaf, np.ndarray]]:
        """(size, size, channels) f32 of each leaf, row 0 at the bottom. Raises StrataError where Cycles bakes
        nothing."""
        count = len(self._made)
        try:
            image = self._keep(
                bpy.data.images.new(_NAME, work.size, work.size, alpha=True, float_buffer=True, is_data=True)
            )
            thing = self._object(work)
            idle = self._idle(image)
            rounds = max((len(leaves) for _, leaves in work.leaves.values()), default=0)
            trees = {slot: self._material(material, image, work.appearance)
                     for slot, (material, _) in work.leaves.items()}  # fmt: skip
            for number in range(rounds):
                baked = []
                for slot in range(work.slots):
                    _, leaves = work.leaves.get(slot, (None, ()))
                    material = idle
                    if number < len(leaves):
                        material = trees[slot].material
                        trees[slot].show(leaves[number])
                        baked.append(leaves[number])
                    thing.data.materials[slot] = material
                texels = self._baked(thing, image)
                for leaf in {leaf.key: leaf for leaf in baked}.values():
                    yield leaf, np.ascontiguousarray(texels[..., : leaf.channels])
        finally:
            self._clear(count)

    def _object(self, work: Work) -> bpy.types.Object:
        mesh = work.mesh
        if _MAP not in mesh.attributes:
            if not mesh.uv_layers:
                mesh.attributes.new(_NO_MAP, "FLOAT2", "CORNER")  # or the other would be for rendering
            uvs = mesh.attributes.new(_MAP, "FLOAT2", "CORNER")
            uvs.data.foreach_set("vector", work.corner_uvs.ravel())
            places = mesh.attributes.new(_GENERATED, "FLOAT_VECTOR", "POINT")
            places.data.foreach_set("vector", work.generated.ravel())
        slots = np.empty(len(mesh.polygons), np.int32)
        mesh.polygons.foreach_get("material_index", slots)
        mesh.materials.clear()  # and with them which face has which
        for _slot in range(work.slots):
            mesh.materials.append(None)
        mesh.polygons.foreach_set("material_index", np.clip(slots, 0, work.slots - 1))
        thing = self._keep(bpy.data.objects.new(_NAME, mesh))
        thing.matrix_world = mathutils.Matrix(work.appearance.matrix)
        thing.color, thing.pass_index = work.appearance.colour, work.appearance.pass_index
        self._scene.collection.objects.link(thing)
        layer = self._scene.view_layers[0]
        thing.select_set(True, view_layer=layer)
        layer.objects.active = thing
        return thing

    def _idle(self, image: bpy.types.Image) -> bpy.types.Material:
        material = self._keep(bpy.data.materials.new(_NAME))
        material.node_tree.nodes.clear()
        _aim(material.node_tree, image)
        return material

    def _material(self, material, image: bpy.types.Image, appearance: Appearance) -> _Tree:
        copy = self._keep(material.copy())
        copy.cycles.emission_sampling = "NONE"
        tree = _Tree(copy)
        known: dict[bpy.types.NodeTree, bpy.types.NodeTree] = {}
        waiting = [copy.node_tree]
        while waiting:
            each = waiting.pop()
            for node in [node for node in each.nodes if node.type == "GROUP" and node.node_tree]:
                original = node.node_tree
                if original not in known:
                    known[original] = self._keep(original.copy())
                    waiting.append(known[original])
                node.node_tree = known[original]
        for each in (copy.node_tree, *known.values()):
            _generate(each, tree.instead)
            _randomize(each, appearance.random, tree.instead)
        _aim(copy.node_tree, image)
        return tree

    def _baked(self, thing: bpy.types.Object, image: bpy.types.Image) -> np.ndarray:
        """(H, W, 4) f32; what no face covers is the mean of the rest."""
        layer = self._scene.view_layers[0]
        where = {"scene": self._scene, "view_layer": layer, "object": thing, "active_object": thing,
                 "selected_objects": [thing], "selected_editable_objects": [thing]}  # fmt: skip
        try:
            with bpy.context.temp_override(**where), contextlib.redirect_stdout(io.StringIO()):
                bpy.ops.object.bake(
                    type="EMIT", target="IMAGE_TEXTURES", save_mode="INTERNAL", use_clear=True,
                    margin=_MARGIN, margin_type="EXTEND", uv_layer=_MAP, use_selected_to_active=False,
                    use_cage=False, use_split_materials=False,
                )  # fmt: skip
        except RuntimeError as error:
            reason = " ".join(str(error).removeprefix("Error: ").split())
            raise StrataError(f"Blender does not bake it: {reason}") from None
        flat = np.empty(image.size[0] * image.size[1] * 4, np.float32)
        image.pixels.foreach_get(flat)
        texels = np.nan_to_num(flat.reshape(*image.size, 4), nan=0.0, posinf=0.0, neginf=0.0)
        covered = texels[..., 3] > 0.0
        if not covered.any():
            raise StrataError("Blender does not bake it: no face covers a texel")
        texels[~covered] = texels[covered].mean(axis=0)
        return texels


@dataclass(eq=False)
class _Tree:
    """A copy of a material, which shows any output of its nodes; `instead` of some, what stands for them."""

    material: bpy.types.Material
    instead: Instead = field(default_factory=dict)

    def show(self, leaf: Leaf) -> None:
        trees, groups = [self.material.node_tree], []
        for name in leaf.path:
            groups.append(trees[-1].nodes[name])
            trees.append(groups[-1].node_tree)
        socket = _named(trees[-1].nodes[leaf.node].outputs, leaf.output)
        socket = self.instead.get(socket, socket)
        for group, tree in zip(reversed(groups), reversed(trees[1:]), strict=True):
            socket = _named(group.outputs, _let_out(tree, socket))
        tree = trees[0]
        emission = tree.nodes.new("ShaderNodeEmission")
        tree.links.new(socket, emission.inputs["Color"])
        output = tree.get_output_node("CYCLES") or tree.nodes.new("ShaderNodeOutputMaterial")
        for link in list(output.inputs["Volume"].links):
            tree.links.remove(link)
        tree.links.new(emission.outputs[0], output.inputs["Surface"])


def _let_out(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> str:
    """Makes an output of a group of what a socket in it gives; the output's identifier."""
    kind = {"VALUE": "NodeSocketFloat", "VECTOR": "NodeSocketVector"}.get(socket.type, "NodeSocketColor")
    identifier = tree.interface.new_socket(_NAME, in_out="OUTPUT", socket_type=kind).identifier
    ends = [node for node in tree.nodes if node.bl_idname == "NodeGroupOutput"]
    end = next((node for node in ends if node.is_active_output), None) or tree.nodes.new("NodeGroupOutput")
    tree.links.new(socket, _named(end.inputs, identifier))
    return identifier


def _named(sockets, identifier: str) -> bpy.types.NodeSocket:
    return next(socket for socket in sockets if socket.identifier == identifier)


def _aim(tree: bpy.types.NodeTree, image: bpy.types.Image) -> None:
    """Makes an image that which is baked to."""
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.nodes.active = node


def _generate(tree: bpy.types.NodeTree, instead: Instead) -> None:
    """Generated coordinates are those of the mesh that is shown: a mesh without its modifiers has others."""
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = _GENERATED
    for node in list(tree.nodes):
        if node.bl_idname == "ShaderNodeTexCoord":
            _replace(tree, node.outputs["Generated"], attribute.outputs["Vector"], instead)
        elif node.bl_idname.startswith("ShaderNodeTex") and node.bl_idname not in _NOT_GENERATED:
            socket = node.inputs.get("Vector")
            if socket is not None and not socket.is_linked:
                tree.links.new(attribute.outputs["Vector"], socket)


def _randomize(tree: bpy.types.NodeTree, random: float, instead: Instead) -> None:
    """It hangs on the name of an object, which this one cannot have too."""
    for node in [node for node in tree.nodes if node.bl_idname == "ShaderNodeObjectInfo"]:
        value = tree.nodes.new("ShaderNodeValue")
        value.outputs[0].default_value = random
        _replace(tree, node.outputs["Random"], value.outputs[0], instead)


def _replace(tree: bpy.types.NodeTree, output, by, instead: Instead) -> None:
    for link in list(output.links):
        tree.links.new(by, link.to_socket)
    instead[output] = by


def _check_cycles() -> None:
    if hasattr(bpy.types.Scene, "cycles"):
        return
    if bpy.app.background:
        import addon_utils

        addon_utils.enable("cycles")
    if not hasattr(bpy.types.Scene, "cycles"):
        raise StrataError("Blender's add-on Cycles is switched off")
