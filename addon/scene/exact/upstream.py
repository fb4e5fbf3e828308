"""What a node's output hangs on: all nodes upstream of it, as they are evaluated."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass

import bpy
import numpy as np

from ..nodes.graph import Graph, Path, link_of
from ..pixels import content_of

_DEEPEST = 1000  # links through groups, one after the other

# Of a node: where it is, how it looks in the editor, and what its sockets and links tell.
_NOT_READ = {
    "rna_type", "name", "label", "location", "location_absolute", "width", "height", "dimensions", "select",
    "hide", "mute", "parent", "color", "use_custom_color", "color_tag", "show_options", "show_preview",
    "show_texture", "inputs", "outputs", "internal_links", "warning_propagation", "type", "is_active_output",
    "active_preview", "debug_zone_body_lazy_function_graph", "debug_zone_lazy_function_graph",
}  # fmt: skip
# Of what a node holds, ramps and curves among it, all is read: there "color" and "location" are values.
_NOT_READ_WITHIN = {"rna_type", "select"}

# Nodes whose answer hangs on who looks, on other objects or on what is no mesh.
_EYES = {
    "ShaderNodeLayerWeight", "ShaderNodeFresnel", "ShaderNodeCameraData", "ShaderNodeLightPath",
    "ShaderNodeHairInfo", "ShaderNodeParticleInfo", "ShaderNodePointInfo", "ShaderNodeVolumeInfo",
    "ShaderNodeUVAlongStroke", "ShaderNodeShaderToRGB", "ShaderNodeLightFalloff", "ShaderNodeRaycast",
}  # fmt: skip
_OUTPUTS_OF_EYES = {
    "ShaderNodeNewGeometry": {"Incoming", "Backfacing"},
    "ShaderNodeTexCoord": {"Camera", "Window", "Reflection"},
}

# Nodes that tell the objects of one mesh apart, and which of their outputs do; None: all.
_OF_OBJECT = {
    "ShaderNodeObjectInfo": None, "ShaderNodeTangent": None, "ShaderNodeVectorTransform": None,
    "ShaderNodeBump": None, "ShaderNodeNormalMap": None, "ShaderNodeBevel": None, "ShaderNodeScript": None,
    "ShaderNodeAmbientOcclusion": None, "ShaderNodeTexEnvironment": None, "ShaderNodeDisplacement": None,
    "ShaderNodeVectorDisplacement": None, "ShaderNodeWireframe": None,
    "ShaderNodeNewGeometry": {"Position", "Normal", "Tangent", "True Normal"},
}  # fmt: skip


@dataclass(frozen=True)
class Upstream:
    """`digest` of it all. `eye` is the name of a node that only an eye, or another object, can answer, empty
    without one; `is_of_object`: objects that share a mesh may differ. `asks_material_index`: it hangs on the
    material's own; `runs_scripts`: on whether Cycles shades by OSL."""

    digest: str
    eye: str
    is_of_object: bool
    asks_material_index: bool
    runs_scripts: bool


Images = dict[int, str]
"""What is in images, by session ids: to go through the pixels of one may take a second."""


def upstream_of(
    graph: Graph,
    node: bpy.types.Node,
    output: bpy.types.NodeSocket,
    path: Path,
    images: Images | None = None,
) -> Upstream:
    """Of an output of a node, evaluated as its tree is. `images` gets what was not in it."""
    images = {} if images is None else images
    numbers: dict[tuple, int] = {}
    used: dict[tuple, None] = {}  # nodes with one of their outputs
    waiting: list[tuple[bpy.types.Node, Path]] = []

    def number(node: bpy.types.Node, output: bpy.types.NodeSocket, path: Path) -> str:
        key = node.as_pointer(), *(group.as_pointer() for group in path)
        if key not in numbers:
            numbers[key] = len(numbers)
            waiting.append((node, path))
        used[node, output.identifier] = None
        return f"{numbers[key]}.{output.identifier}"

    lines = [number(node, output, path)]
    while waiting:
        each, where = waiting.pop(0)
        lines.append(f"{each.bl_idname} {list(_properties(each, images))}")
        for socket in each.inputs:
            lines.append(f"{socket.identifier} {_origin(graph, socket, where, number, images)}")
        # Value, Color and Normal have their numbers there.
        for socket in each.outputs:
            lines.append(f"{socket.identifier} {_plain(getattr(socket, 'default_value', None), images)}")
    eye = next((each.name for each, name in used if _is_of_eye(each, name)), "")
    digest = hashlib.sha256("\n".join(lines).encode()).hexdigest()
    return Upstream(
        digest,
        eye,
        any(_is_of_object(each, name) for each, name in used),
        any(each.bl_idname == "ShaderNodeObjectInfo" and name == "Material Index" for each, name in used),
        any(each.bl_idname == "ShaderNodeScript" for each, _ in used),
    )


def _origin(graph: Graph, socket: bpy.types.NodeSocket, path: Path, number, images: Images) -> str:
    """Where an input's number comes from: it itself, or an output by its number. With the kinds of all
    sockets between them, which convert it."""
    kinds = [socket.type]
    for _hop in range(_DEEPEST):
        link = link_of(socket)
        if link is None:
            value = getattr(socket, "default_value", None)
            return f"{kinds} {_plain(value, images)}"
        kinds.append(link.from_socket.type)
        origin = graph.follow(link.from_node, link.from_socket, path)
        if origin is None:
            return f"{kinds} nowhere"
        if origin is False:
            return f"{kinds} {number(link.from_node, link.from_socket, path)}"
        socket, path = origin
        kinds.append(socket.type)
    return "in a circle"


def _is_of_eye(node: bpy.types.Node, output: str) -> bool:
    kind = node.bl_idname
    if kind == "ShaderNodeAmbientOcclusion":
        return not node.only_local
    if kind == "ShaderNodeVectorTransform":
        return "CAMERA" in (node.convert_from, node.convert_to)
    if kind == "ShaderNodeWireframe":
        return node.use_pixel_size
    if kind == "ShaderNodeAttribute":
        return node.attribute_type != "GEOMETRY"
    if kind in {"ShaderNodeTexCoord", "ShaderNodeUVMap"} and node.from_instancer:
        return True
    return kind in _EYES or output in _OUTPUTS_OF_EYES.get(kind, ())


def _is_of_object(node: bpy.types.Node, output: str) -> bool:
    kind = node.bl_idname
    if kind == "ShaderNodeTexCoord":
        return output == "Object" and node.object is not None
    if kind not in _OF_OBJECT:
        return False
    outputs = _OF_OBJECT[kind]
    return outputs is None or output in outputs


def _properties(thing: bpy.types.bpy_struct, images: Images, depth: int = 0) -> Iterator[str]:
    """All that is set of a node, or of what it holds."""
    not_read = _NOT_READ if isinstance(thing, bpy.types.Node) else _NOT_READ_WITHIN
    for prop in thing.bl_rna.properties:
        name = prop.identifier
        if name in not_read or name.startswith("bl_"):
            continue
        value = getattr(thing, name)
        if prop.type == "COLLECTION":
            if depth < 4:
                yield from (f"{name} {list(_properties(each, images, depth + 1))}" for each in value)
        elif prop.type != "POINTER":
            yield f"{name} {_plain(value, images)}"
            if name == "filepath" and value:
                yield _file_content(value)
        elif isinstance(value, bpy.types.ImageUser):
            if getattr(getattr(thing, "image", None), "source", "") in {"SEQUENCE", "MOVIE"}:
                shown = list(_properties(value, images, depth + 1))
                yield f"{name} {shown} {bpy.context.scene.frame_current}"
        elif isinstance(value, bpy.types.ID):
            yield f"{name} {_content(value, images)}"
        elif value is not None and depth < 4:
            yield f"{name} {list(_properties(value, images, depth + 1))}"


def _plain(value, images: Images) -> str:
    if isinstance(value, bpy.types.ID):
        return _content(value, images)
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value)
    if isinstance(value, set):
        return repr(sorted(value))
    return repr(np.asarray(value).ravel().tolist())


def _content(data: bpy.types.ID, images: Images) -> str:
    """What of other data a node may read."""
    if isinstance(data, bpy.types.Image):
        image = data.original
        if image.session_uid not in images:
            images[image.session_uid] = repr(content_of(image))
        return images[image.session_uid]
    if isinstance(data, bpy.types.Object):
        return _plain(data.matrix_world, images)
    if isinstance(data, bpy.types.Text):
        return data.as_string()
    if isinstance(data, bpy.types.NodeTree):
        return ""  # links lead into it
    return data.name_full


def _file_content(path: str) -> str:
    """Of a file that a node names; it may be written anew at any time."""
    try:
        with open(bpy.path.abspath(path), "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return os.path.basename(path)
