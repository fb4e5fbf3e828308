"""Level rectangles under lamps, seen from above."""

from __future__ import annotations

import numpy as np
from strata.addon.core.arrays import Arrays, MeshArrays, Opacities
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.material import Material
from strata.addon.core.outline import Bounds, Instance, Light, Mesh, Outline

IDENTITY = tuple(tuple(float(i == j) for j in range(4)) for i in range(4))
DOWN = {"right": (1.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0), "forward": (0.0, 0.0, -1.0)}

FLOOR = ((-3.0, -3.0, 0.0), (3.0, 3.0, 0.0))
PLATE = ((-0.5, -0.5, 1.0), (0.5, 0.5, 1.0))


def scene_of(boxes: list[tuple], lights: list[Light], **more) -> tuple[Outline, Arrays]:
    """Axis-aligned rectangles (low, high), flat along z, seen from above."""
    meshes, instances = [], []
    for index, (low, high) in enumerate(boxes):
        corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
        points = np.array([(*corner, low[2]) for corner in corners], np.float32)
        meshes.append(MeshArrays(points, np.arange(4, dtype=np.int32), np.array([0, 4], np.int32)))
        instances.append(Instance(f"Box {index}", index, IDENTITY, Bounds(low, high), index, (0,)))
    headers = tuple(Mesh(each.name, each.name, 4, 2) for each in instances)
    outline = Outline(
        "Scene",
        "Layer",
        1,
        tuple(lights),
        tuple(instances),
        headers,
        (Material("Grey"),),
        **more,
    )
    return outline, Arrays(tuple(meshes), np.array([IDENTITY] * len(boxes)), (Opacities(),))


def lamp(place=(0.0, 0.0, 5.0), side=0.5, power=1.0) -> Light:
    emitter = Emitter(EmitterKind.RECTANGLE, place, *DOWN.values(), side, side)
    return Light("Lamp", "Lamp", "AREA", emitter, (power,) * 3)
