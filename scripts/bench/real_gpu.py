"""What a frame would move and compute on a real GPU, counted from the plan: no measurement, but a bound."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from strata.addon.core.graph import Graph, Node
from strata.addon.core.outline import Outline

BYTES_PER_SECOND = 200e9
OPERATIONS_PER_SECOND = 5e12
# What shaders read for a vertex that they pull: run, triangle, position, three rows of a matrix.
VERTEX_BYTES, VERTEX_OPERATIONS = 32 + 16 + 16 + 48, 60
OVERDRAW = 4  # fragments to a pixel or texel; a scene of more needs more
TEXEL_OPERATIONS = 50  # of one texel projected back and its bits counted
SAMPLE_OPERATIONS = 60  # of one of the sixteen samples of a light


@dataclass(frozen=True)
class Work:
    """Bytes to and from memory, none of it cached, and arithmetic operations."""

    step: str
    instance: str
    megabytes: float
    gigaoperations: float

    @property
    def milliseconds(self) -> float:
        """Limited by the one or the other."""
        moving = 1e6 * self.megabytes / BYTES_PER_SECOND
        return 1e3 * max(moving, 1e9 * self.gigaoperations / OPERATIONS_PER_SECOND)


def work_of(outline: Outline, graph: Graph, nodes) -> Iterator[Work]:
    """Of the given nodes of a plan, in order; steps that take no time are left out."""
    width, height = graph.shot.computed_size
    for node in nodes:
        counted = _counted(outline, node, width * height)
        if counted:
            yield Work(node.step.name, node.instance, counted[0] / 1e6, counted[1] / 1e9)


def _triangles(outline: Outline, instances) -> int:
    return sum(outline.meshes[outline.instances[index].mesh].triangles for index in instances)


def _counted(outline: Outline, node: Node, pixels: int) -> tuple[float, float] | None:
    params = node.params
    if node.step.name == "layered_depth":
        texels, layers = params["width"] * params["height"], params["layers"]
        vertices = 3 * _triangles(outline, params["casters"])
        insertions = OVERDRAW * texels * layers
        # Keys are cleared, inserted by atomics, and read once to become depths.
        moved = VERTEX_BYTES * vertices + 8 * insertions + 12 * texels * layers
        return moved, VERTEX_OPERATIONS * vertices + 10 * insertions
    if node.step.name == "soft_shadow/prepare":
        depth = node.inputs[0].params
        texels = depth["width"] * depth["height"] * depth["layers"]
        # Texels of all levels (4/3), a pyramid of nearest and farthest, and blocks: each written, then read.
        return texels * (4 + 4 / 3 * 16) + texels / depth["layers"] * 4 / 3 * 16, 40 * texels
    if node.step.name == "surface":
        vertices = 3 * _triangles(outline, params["visible"])
        return VERTEX_BYTES * vertices + pixels * (
            OVERDRAW * 16 + 192 + 76
        ), VERTEX_OPERATIONS * vertices + 200 * pixels
    if node.step.name == "soft_shadow/backproject":
        reads = params["max_samples"] * pixels
        return 52 * pixels + 8 * reads, TEXEL_OPERATIONS * reads
    if node.step.name == "irradiance":
        return 36 * pixels, 16 * SAMPLE_OPERATIONS * pixels
    if node.step.name == "material_colour":
        return 40 * pixels, 20 * pixels
    if node.step.name == "composite":
        return 56 * pixels * len(params["joins"]), 12 * pixels * len(params["joins"])
    return None
