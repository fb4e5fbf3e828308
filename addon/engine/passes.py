"""Layers as render passes: which there may be, and the pixels of those that there are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import bpy
import numpy as np

from ..bake import Baked
from ..core.effect import Effect, Registry
from ..core.layers import COLOUR_CHANNELS
from ..core.naming import layer_name
from ..core.outline import Light, Outline
from ..core.roles import Role, Subject
from ..core.shot import Raster, Shot
from ..effects.registry import EFFECTS
from ..scene.changing import is_animated, is_surely_hidden
from ..scene.lamp_names import LampNames, NamedLamp
from ..scene.own_settings import casts_shadow

COMBINED = "Combined"


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

    def pixels(self, width: int, height: int) -> np.ndarray:
        """Of its neutral value; costs nothing until it is written."""
        return np.broadcast_to(np.float32(self.neutral), (height, width, len(self.channels)))


@dataclass(frozen=True, eq=False)
class PassImage:
    """`pixels`: (height, width[, channels]) float32 of what is computed, row 0 at the bottom."""

    name: str
    channels: str
    pixels: np.ndarray


def registered(
    scene: bpy.types.Scene,
    view_layer: bpy.types.ViewLayer,
    shown: Iterable[Light] = (),
    registry: Registry = EFFECTS,
) -> Iterator[PassKind]:
    """Every pass that some frame may have, so that the compositor's sockets stay when a light leaves the
    view. Lamps of geometry nodes, particles and faces have some only where they are among `shown`: they are
    known once a frame is evaluated, and no depsgraph may be had where Blender draws node editors or is about
    to render."""
    lamps = {named.pass_name: named for named in LampNames().standing(view_layer)}
    made = [light for light in shown if light.pass_name not in lamps]
    there = [named for named in lamps.values() if not is_surely_hidden(named.path)]
    effects = [effect for effect in registry if getattr(scene.strata, effect.id).enabled]
    for effect in effects:
        for kind in effect.layers:
            kind = kind.in_colour() if scene.strata.rgb_layers else kind
            if kind.role.is_exclusive and _first_to_offer(kind.role, effects) is not effect:
                continue
            names = [""]
            if kind.of is Subject.LAMP:
                shadows = kind.role is Role.VISIBILITY
                names = [named.pass_name for named in there if not shadows or _may_shadow(named)]
                names += [light.pass_name for light in made if not shadows or light.casts_shadow]
            for name in names:
                yield PassKind(layer_name(kind.title, name), kind.channels, kind.role.neutral)


def _first_to_offer(role: Role, effects: Iterable[Effect]) -> Effect:
    """Which a render takes it from."""
    return next(effect for effect in effects if role in effect.offers)


def _may_shadow(named: NamedLamp) -> bool:
    return casts_shadow(named.lamp.data) or is_animated(named.lamp.data)


def images_of(baked: Baked, outline: Outline, shot: Shot, depsgraph: bpy.types.Depsgraph) -> list[PassImage]:
    """Combined, the baked layers, and a neutral one for every pass that this frame does not need: Blender
    would give it 0, and a shadow of 0 is black."""
    width, height = shot.computed_size
    combined = np.zeros((height, width, 4), np.float32)
    if baked.composite is not None:
        combined = _computed(shot.source, baked.composite)
    images = [PassImage(COMBINED, "RGBA", combined)]
    for layer in baked.layers.layers:
        images.append(PassImage(layer.name, layer.channels, _computed(shot.source, layer.pixels)))
    there = {image.name for image in images}
    for kind in registered(depsgraph.scene, depsgraph.view_layer, outline.lights):
        if kind.name not in there:
            there.add(kind.name)
            images.append(PassImage(kind.name, kind.channels, kind.pixels(width, height)))
    return images


def _computed(raster: Raster, framed: np.ndarray) -> np.ndarray:
    """What was computed of a whole frame: with a render region Blender puts it into the frame itself."""
    if framed.shape[1::-1] == raster.computed_size:
        return framed
    x0, y0, x1, y1 = raster.region
    return framed[y0:y1, x0:x1]
