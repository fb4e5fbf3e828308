"""Level cards over a floor, under a lamp and a camera that look straight down: what gets through them is a
product."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from strata.addon.bake import BakeJob
from strata.addon.core.arrays import Arrays, MeshArrays, Opacities, OpacityArrays
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.material import Image, Material, Opacity
from strata.addon.core.medium import Medium
from strata.addon.core.outline import Bounds, Instance, Light, Mesh, Outline
from strata.addon.core.shot import Camera, Raster, Shot
from strata.addon.planning import Options, plan_scene

from .settings import MAPS

IDENTITY = tuple(tuple(float(i == j) for j in range(4)) for i in range(4))
DOWN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)
SIZE = 48, 48
FLOOR_HALF, CARD_HALF = 6.0, 1.5  # metres
UVS = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)

LAMPS = {
    "hard sun": Emitter(EmitterKind.DISTANT_DISK, (0.0, 0.0, 0.0), *DOWN, 0.0, 0.0),
    "sun": Emitter(EmitterKind.DISTANT_DISK, (0.0, 0.0, 0.0), *DOWN, 0.05, 0.05),
    "area": Emitter(EmitterKind.RECTANGLE, (0.0, 0.0, 5.0), *DOWN, 0.4, 0.3),
    "point": Emitter(EmitterKind.SPHERE, (0.0, 0.0, 5.0), *DOWN, 0.2, 0.2),
    "hard point": Emitter(EmitterKind.SPHERE, (0.0, 0.0, 5.0), *DOWN, 0.0, 0.0),
}


@dataclass(frozen=True)
class Card:
    """Its opacity, and its texels (H, W) or the factors (4,) of its corners."""

    opacity: Opacity
    texels: np.ndarray | None = None
    corners: np.ndarray | None = None
    seen: Opacity | None = None  # None: the same
    turned: bool = False  # back to the lamp

    @property
    def arrays(self) -> Opacities:
        def of(opacity: Opacity) -> OpacityArrays:
            return OpacityArrays(opacity.value, self.texels, bool(opacity.corners), opacity.threshold)

        casts = of(self.opacity)
        seen = casts if self.seen is None else of(self.seen)
        return Opacities((seen, seen), (casts, casts))


def constant(value: float, **more) -> Card:
    return Card(Opacity(value), **more)


def textured(value: float, threshold: float = 0.0) -> Card:
    return Card(Opacity(image=0, threshold=threshold), np.full((4, 4), value, np.float32))


def square(half: float, z: float, **more) -> MeshArrays:
    corners = half * (2.0 * UVS.astype(np.float64) - 1.0)
    points = np.concatenate([corners, np.full((4, 1), z)], axis=1).astype(np.float32)
    order, starts = np.arange(4, dtype=np.int32), np.array([0, 4], np.int32)
    return MeshArrays(points, order, starts, corner_uvs=UVS, **more)


def scene_of(cards: list[Card], lamp: str, are_seen=False) -> tuple[Outline, Arrays]:
    """The lowest card first, 1 m over the floor. `are_seen`: by the camera, which is above them."""
    meshes, materials = [square(FLOOR_HALF, 0.0)], [Material("Floor")]
    low, high = (-FLOOR_HALF, -FLOOR_HALF, 0.0), (FLOOR_HALF, FLOOR_HALF, 0.0)
    instances = [Instance("Floor", 0, IDENTITY, Bounds(low, high), 0, (0,), casts_shadow=False)]
    for number, card in enumerate(cards, start=1):
        z = 0.9 + 0.1 * number
        mesh = square(CARD_HALF, z, corner_opacity=card.corners)
        if card.turned:
            mesh = replace(mesh, corner_vertices=mesh.corner_vertices[::-1].copy())
        meshes.append(mesh)
        bounds = Bounds((-CARD_HALF, -CARD_HALF, z), (CARD_HALF, CARD_HALF, z))
        seen = card.opacity if card.seen is None else card.seen
        materials.append(Material(f"Card {number}", seen=(seen, seen), casts=(card.opacity, card.opacity)))
        instances.append(
            Instance(f"Card {number}", number, IDENTITY, bounds, number, (number,), visible_camera=are_seen)
        )
    light = Light("Lamp", "Lamp", "AREA", LAMPS[lamp], (1.0, 1.0, 1.0))
    headers = tuple(Mesh(each.name, each.name, 4, 2) for each in instances)
    outline = Outline(
        "Cards", "Layer", 1, (light,), tuple(instances), headers, tuple(materials),
        (Image("Texels", "Texels", "ALPHA"),),
    )  # fmt: skip
    opacities = (Opacities(), *(card.arrays for card in cards))
    return outline, Arrays(tuple(meshes), np.array([IDENTITY] * len(meshes)), opacities)


def shot(half_angle: float = 0.05, seed: int = 0) -> Shot:
    """From 8 m above the floor's middle."""
    return Shot(
        "Camera", Raster(Camera("Camera", (0.0, 0.0, 8.0), *DOWN, lens=18.0 / half_angle), SIZE), seed=seed
    )


def baked(
    cards: list[Card],
    lamp: str,
    backend: str,
    samples=8,
    are_seen=False,
    half_angle=0.05,
    effect="soft_shadow",
    medium: Medium | None = None,
    **values,
):
    """What a bake of an effect gives; `medium`: of the world."""
    outline, arrays = scene_of(cards, lamp, are_seen)
    outline = replace(outline, world_medium=medium)
    values = MAPS.get(effect, {}) | {"resolution": 256} | values
    options = Options((effect,), backend, samples, 1, {effect: values})
    job = BakeJob(outline, plan_scene(outline, shot(half_angle), options), arrays, options)
    return job.result()
