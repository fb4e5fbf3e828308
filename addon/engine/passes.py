"""Layers as render passes: which there may be, and the pixels of those that there are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import bpy
import numpy as np

from ..bake import Baked
from ..core.effect import Blend, LayerKind
from ..core.layers import COLOUR_CHANNELS
from ..core.naming import layer_name
from ..core.outline import Outline
from ..effects.registry import EFFECTS

COMBINED = "Combined"
# What a layer that a frame does not need would be: it changes nothing where it is joined.
_NEUTRAL = {Blend.SCALE_LIGHT: 1.0, Blend.MULTIPLY: 1.0}


@dataclass(frozen=True)
class PassKind:
    """A pass that a render may have: `channels` one letter each, as in the file; `neutral` is its value where
    it has nothing to say."""

    name: str
    channels: str
    neutral: float

    @property
    def type(self) -> str:
        """Of the compositor's socket."""
        if self.channels in COLOUR_CHANNELS:
            return "COLOR"
        return "VALUE" if len(self.channels) == 1 else "VECTOR"


@dataclass(frozen=True, eq=False)
class PassImage:
    """`pixels`: (height, width[, channels]) float32 of what is computed, row 0 at the bottom."""

    name: str
    channels: str
    pixels: np.ndarray


def registered(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> Iterator[PassKind]:
    """Every pass that some frame may have, so that the compositor's sockets stay when a light leaves the
    view. What a plan leaves out at a frame is not rendered, except for `images_of`'s reason."""
    taken: list[str] = []
    for effect in EFFECTS:
        if not getattr(scene.strata, effect.id).enabled:
            continue
        for kind in effect.layers:
            shadows = kind.blend == Blend.SCALE_LIGHT
            for light in _lights(view_layer, shadows) if kind.per_light else ("",):
                taken.append(layer_name(kind.title, light, taken))
                yield _pass_kind(taken[-1], kind)


def _pass_kind(name: str, kind: LayerKind) -> PassKind:
    return PassKind(name, kind.channels, _NEUTRAL.get(kind.blend, 0.0))


def _lights(view_layer: bpy.types.ViewLayer, shadowing: bool) -> Iterator[str]:
    """All, or those that cast shadows: names as addon/scene/scan.py gives them. No depsgraph may be had here:
    Blender asks for the passes while it draws node editors and before renders."""
    for shown in view_layer.objects:
        if shown.hide_render:
            continue
        if shown.type == "LIGHT":
            if shown.data.use_shadow or not shadowing:
                yield shown.name
        elif shown.instance_type == "COLLECTION" and shown.instance_collection is not None:
            for part in shown.instance_collection.all_objects:
                wanted = part.type == "LIGHT" and (part.data.use_shadow or not shadowing)
                if wanted and not part.hide_render:
                    yield f"{part.name} {shown.name}"


def images_of(baked: Baked, outline: Outline, depsgraph: bpy.types.Depsgraph) -> list[PassImage]:
    """Combined, the baked layers, and neutral ones where the compositor reads a pass that this frame does not
    need: Blender would give it 0, and a shadow of 0 is black."""
    width, height = outline.computed_size
    combined = np.zeros((height, width, 4), np.float32)
    if baked.composite is not None:
        combined = _computed(outline, baked.composite)
    images = [PassImage(COMBINED, "RGBA", combined)]
    for layer in baked.layers.layers:
        images.append(PassImage(layer.name, layer.channels, _computed(outline, layer.pixels)))
    there = {image.name for image in images}
    read = _read_by_compositor(depsgraph.scene, depsgraph.view_layer)
    for kind in registered(depsgraph.scene, depsgraph.view_layer):
        if kind.name in read - there:
            shape = (height, width, len(kind.channels))
            images.append(PassImage(kind.name, kind.channels, np.full(shape, kind.neutral, np.float32)))
    return images


def _computed(outline: Outline, framed: np.ndarray) -> np.ndarray:
    """What was computed of a whole frame: with a render region Blender puts it into the frame itself."""
    if framed.shape[1::-1] == outline.computed_size:
        return framed
    x0, y0, x1, y1 = outline.region
    return framed[y0:y1, x0:x1]


def _read_by_compositor(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> set[str]:
    """Names of the view layer's passes that compositor nodes are linked to."""
    tree = scene.compositing_node_group
    if tree is None or not scene.render.use_compositing:
        return set()
    names, trees = set(), [tree]
    for tree in trees:
        for node in tree.nodes:
            if node.type == "R_LAYERS" and node.scene == scene and node.layer == view_layer.name:
                names.update(socket.name for socket in node.outputs if socket.is_linked)
            elif node.type == "GROUP" and node.node_tree is not None and node.node_tree not in trees:
                trees.append(node.node_tree)
    return names
