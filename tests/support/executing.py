"""A quad whose depths are known, and executors that run to their end."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from strata.addon.core.arrays import Arrays, MeshArrays, Opacities
from strata.addon.core.effect import LayerKind
from strata.addon.core.graph import Graph, Node, PlannedLayer, Step
from strata.addon.core.material import Material
from strata.addon.core.outline import Bounds, Instance, Mesh, Outline
from strata.addon.core.shot import Camera, Raster, Shot
from strata.addon.effects.shared.steps import GEOMETRY, SURFACE

SIZE = (16, 12)

SHOT = Shot("Camera", Raster(Camera("Camera", (0, 0, 3), (1, 0, 0), (0, 1, 0), (0, 0, -1)), SIZE))

IDENTITY = tuple(tuple(float(i == j) for j in range(4)) for i in range(4))


def tilted_quad_scene() -> tuple[Outline, Arrays]:
    """A 4 x 4 m quad below a camera that looks straight down from 3 m."""
    positions = np.array([(-2, -2, 0), (2, -2, 0), (2, 2, 0.5), (-2, 2, 0.5)], np.float32)
    mesh = MeshArrays(positions, np.arange(4, dtype=np.int32), np.array([0, 4], np.int32))
    instance = Instance("Quad", 0, IDENTITY, Bounds((-2, -2, 0), (2, 2, 0.5)), 0, (0,))
    outline = Outline("Scene", "Layer", 1, (), (instance,), (Mesh("Quad", "Quad", 4, 2),), (Material("m"),))
    return outline, Arrays((mesh,), np.array([IDENTITY]), (Opacities(),))


def depth_graph(outline: Outline, *extra: Node, step: Step | None = None) -> Graph:
    geometry = Node(GEOMETRY, "", (), {"scene": "Scene"})
    surface = Node(SURFACE, "camera", (geometry,), {"view": SHOT.view, "visible": frozenset({0})})
    pick = step or Step("pick", cpu=lambda device, surface: surface["depth"])
    node = Node(pick, "", (surface, *extra), {})
    layer = PlannedLayer("Depth", "depth", node, LayerKind("Depth", "Z"))
    return Graph((layer,), (), {surface: frozenset({"depth"})}, frozenset({0}), surface=surface)


def drain(steps: Iterator[float], progress: Callable[[float], None] | None = None) -> None:
    """Runs a generator of shares to its end."""
    for share in steps:
        if progress:
            progress(share)
