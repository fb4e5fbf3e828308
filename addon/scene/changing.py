"""What may change with time. Whatever is not known not to counts as changing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import bpy

# Modifiers that follow their inputs and nothing else.
_STILL = (
    "ARMATURE ARRAY BEVEL BOOLEAN CAST COLLISION CORRECTIVE_SMOOTH CURVE DATA_TRANSFER DECIMATE "
    "DISPLACE EDGE_SPLIT HOOK LAPLACIANDEFORM LAPLACIANSMOOTH LATTICE MASK MESH_DEFORM MIRROR "
    "MULTIRES NORMAL_EDIT REMESH SCREW SHRINKWRAP SIMPLE_DEFORM SKIN SMOOTH SOLIDIFY SUBSURF "
    "SURFACE_DEFORM TRIANGULATE UV_PROJECT UV_WARP VERTEX_WEIGHT_EDIT VERTEX_WEIGHT_MIX "
    "VERTEX_WEIGHT_PROXIMITY WARP WEIGHTED_NORMAL WELD WIREFRAME "
)
_STILL_MODIFIERS = frozenset(_STILL.split())
# Nodes whose result depends on the frame, by parts of their names: also what is cached or read from files.
_TIME_NODES = ("SceneTime", "Simulation", "Bake", "Import", "ImageInfo", "ImageTexture", "MovieClip")


def is_animated(data: bpy.types.ID | None) -> bool:
    """Whether keyframes, drivers or NLA tracks may move a property of it or of its own node tree."""
    animation = getattr(data, "animation_data", None)
    if animation is not None and (animation.action or animation.nla_tracks or animation.drivers):
        return True
    tree = getattr(data, "node_tree", None)
    return tree is not None and is_animated(tree)


def moves(data: bpy.types.ID, path: str) -> bool:
    """Whether keyframes or drivers move a property of it; an NLA strip may move any."""
    animation = data.animation_data
    if animation is None:
        return False
    return bool(animation.nla_tracks) or any(curve.data_path == path for curve in _curves(animation))


def is_surely_hidden(path: Iterable[bpy.types.Object]) -> bool:
    """Whether an object, or one that shows it, is switched off for renders in every frame."""
    return any(thing.hide_render and not is_animated(thing) for thing in path)


def settings_may_change(scene: bpy.types.Scene) -> bool:
    """Whether Strata's own may."""
    animation = scene.animation_data
    if animation is None:
        return False
    if animation.nla_tracks:
        return True
    return any(curve.data_path.startswith("strata") for curve in _curves(animation))


def _curves(animation: bpy.types.AnimData) -> Iterator[bpy.types.FCurve]:
    yield from animation.drivers
    if animation.action is not None:
        for layer in animation.action.layers:
            for strip in layer.strips:
                for bag in strip.channelbags:
                    yield from bag.fcurves


def may_change(scene: bpy.types.Scene) -> bool:
    """Whether two frames may differ in anything that a bake reads."""
    handlers = bpy.app.handlers
    return bool(
        any(marker.camera for marker in scene.timeline_markers)
        or handlers.frame_change_pre
        or handlers.frame_change_post
        or bpy.data.cache_files
        or bpy.data.movieclips
        or (scene.rigidbody_world is not None and scene.rigidbody_world.enabled)
        or any(map(is_animated, bpy.data.all_ids))
        or any(image.source in ("SEQUENCE", "MOVIE") for image in bpy.data.images)
        or any(_changes_shape(thing) for thing in bpy.data.objects)
    )


def _changes_shape(thing: bpy.types.Object) -> bool:
    if len(thing.particle_systems):
        return True
    return any(
        has_nodes(modifier.node_group, _TIME_NODES)
        if modifier.type == "NODES"
        else modifier.type not in _STILL_MODIFIERS
        for modifier in thing.modifiers
    )


def has_nodes(tree: bpy.types.NodeTree | None, words: tuple[str, ...]) -> bool:
    """Whether a node whose type has one of `words` in its name is in a tree or in a group of it."""
    trees = [] if tree is None else [tree]
    for tree in trees:
        for node in tree.nodes:
            if any(word in node.bl_idname for word in words):
                return True
            group = getattr(node, "node_tree", None)
            if group is not None and group not in trees:
                trees.append(group)
    return False


def may_make_lamps() -> bool:
    """Whether lamps may appear that only an evaluated frame shows: of geometry nodes or particles that are
    given a lamp or a collection with one, and of faces and vertices."""
    if any(thing.instance_type in ("VERTS", "FACES") and thing.children for thing in bpy.data.objects):
        return True
    groups = {group for group in bpy.data.collections if any(t.type == "LIGHT" for t in group.all_objects)}
    carriers = {
        thing for thing in bpy.data.objects if thing.type == "LIGHT" or thing.instance_collection in groups
    }
    return any(
        isinstance(user, (bpy.types.NodeTree, bpy.types.ParticleSettings))
        or (isinstance(user, bpy.types.Object) and any(m.type == "NODES" for m in user.modifiers))
        for users in bpy.data.user_map(subset=groups | carriers).values()
        for user in users
    )


def may_have_media() -> bool:
    """Whether some frame may have a volume: links of nodes do not change."""
    return any(
        socket.is_linked
        for owner in (*bpy.data.materials, *bpy.data.worlds)
        if owner.node_tree is not None
        for node in owner.node_tree.nodes
        if "Output" in node.bl_idname
        for socket in node.inputs
        if socket.name == "Volume"
    )
