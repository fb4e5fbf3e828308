"""Steps that several effects use: geometry, shading points, layered depth, rays."""

from __future__ import annotations

import numpy as np

from ...core.culling import drawn_from, holdouts_in_view, receivers_in_view
from ...core.graph import Node, Rate, Step
from ...core.outline import Outline
from ...core.random import hash_bits, text_bits
from ...core.recorder import Recorder
from ...core.shot import Shot
from ...core.surface import Chunk, with_holes
from ...core.view import View
from . import gpu_steps

WHOLE, PARTIAL, DRAWN = "whole", "partial", "drawn"
"""What a map keeps of casters that are not wholly opaque: what is all the same, what stops a share, or each
fragment by chance."""


def _geometry(device, scene):
    return device.geometry()


def _surface(device, geometry, view, visible, chunk, attributes, seed=0, holdouts=frozenset()):
    surface = device.kernels.raster_surface(
        geometry,
        device.instance_mask(visible),
        view.packed(),
        chunk.width,
        chunk.height,
        rows=(chunk.y0, chunk.y1),
        columns=(chunk.x0, chunk.x1),
        jitter=chunk.jitter,
        attributes=sorted({*attributes, "instance"} if holdouts else attributes),
        draw=(seed, chunk.sample),
        offsets=device.offsets(chunk),
        cancel=device.cancel_flag,
    )
    return with_holes(surface, holdouts, attributes)


def _laid_out(device, geometry, instances):
    return device.laid_out(geometry, instances)


def _chart(device, laid_out, instances, origin, chunk, attributes):
    return device.chart(laid_out, origin, chunk, attributes)


def _layered_depth(device, geometry, view, casters, layers, width, height, kept=WHOLE, draw=(0, 0)):
    return device.kernels.layered_depth(
        geometry,
        device.instance_mask(casters),
        view.packed(),
        layers,
        width,
        height,
        kept=kept,
        draw=draw,
        cancel=device.cancel_flag,
    )


def _drawn(layered_depth):
    """A twin that draws anew for every sample what is partly opaque."""

    def twin(device, geometry, view, casters, layers, width, height, seed, chunk: Chunk):
        draw = seed, chunk.sample
        return layered_depth(device, geometry, view, casters, layers, width, height, DRAWN, draw)

    return twin


def _ray_accelerator(device, geometry, eye, casters):
    mask = device.instance_mask(casters)
    return device.unless_cancelled(lambda: device.kernels.Accel(geometry, np.array(eye), mask))


TRIANGLE_BYTES = 100
"""Of a mesh: half a vertex, two corners with normals, and the three that it has; about the same on a GPU."""

LEAF_BYTES = 130
"""Of each instance's triangle in the hierarchy of rays. Measured."""

LEAST_TRIANGLES = 1000
"""Fewer take as long."""


def _triangles(node: Node, outline: Outline) -> int:
    """Of all instances that it is made of."""
    casters, instances = node.params["casters"], outline.instances
    return instances.memo(
        ("triangles", casters),
        lambda: sum(outline.meshes[instances[index].mesh].triangles for index in casters),
    )


def _geometry_bytes(node: Node, outline: Outline) -> int:
    """Of meshes, and of opacities' texels: the device has its own."""
    images = frozenset().union(*(material.opacity_images for material in outline.materials))
    texels = sum(outline.images[image].nbytes for image in images)
    return TRIANGLE_BYTES * sum(mesh.triangles for mesh in outline.meshes) + texels


def _geometry_work(node: Node, outline: Outline) -> float:
    return sum(max(mesh.triangles, LEAST_TRIANGLES) for mesh in outline.meshes)


def _accelerator_bytes(node: Node, outline: Outline) -> int:
    return LEAF_BYTES * _triangles(node, outline)


def _accelerator_work(node: Node, outline: Outline) -> float:
    return max(_triangles(node, outline), LEAST_TRIANGLES)


TEXELS_A_TRIANGLE = 5
"""Filling a texel takes a share of what drawing a triangle that covers none does."""


def _depth_work(node: Node, outline: Outline) -> float:
    texels = node.params["width"] * node.params["height"]
    return texels / TEXELS_A_TRIANGLE + _triangles(node, outline)


def depth_bytes(node: Node, outline: Outline) -> int:
    """Of a layered depth map."""
    return 4 * node.params["layers"] * node.params["width"] * node.params["height"]


# The scene's meshes and instances, on the device.
GEOMETRY = Step(
    "geometry",
    cpu=_geometry,
    gpu=gpu_steps.geometry,
    copyable=False,
    bytes_of=_geometry_bytes,
    work_of=_geometry_work,
    ordinary_seconds=100e-9,
)
# Shading points of one tile and sample: a dict of attribute arrays (core/surface.py).
SURFACE = Step("surface", cpu=_surface, gpu=gpu_steps.surface, rate=Rate.SAMPLE, ordinary_seconds=200e-9)
# An object's triangles where its UV map puts them, and the shading points of a chart of them (core/shot.py).
ON_CPU = "charts are laid out on the CPU"
LAID_OUT = Step("laid_out", cpu=_laid_out, hole=ON_CPU, copyable=False)
CHART = Step("chart", cpu=_chart, hole=ON_CPU, rate=Rate.SAMPLE)
# The nearest `layers` depths along each texel's ray, ascending, by single-pass k-buffer (thesis 4.3).
LAYERED_DEPTH = Step(
    "layered_depth",
    cpu=_layered_depth,
    gpu=gpu_steps.layered_depth,
    bytes_of=depth_bytes,
    work_of=_depth_work,
    ordinary_seconds=70e-9,
)
# The same with what is partly opaque there or not by chance, as likely as it is opaque.
DRAWN_DEPTH = Step(
    "drawn_depth",
    cpu=_drawn(_layered_depth),
    gpu=_drawn(gpu_steps.layered_depth),
    rate=Rate.SAMPLE,
    croppable=False,
    bytes_of=depth_bytes,
    work_of=_depth_work,
    ordinary_seconds=70e-9,
)
# A bounding volume hierarchy over the casters.
RAY_ACCELERATOR = Step(
    "ray_accelerator",
    cpu=_ray_accelerator,
    hole="rays live on the CPU only",
    copyable=False,
    bytes_of=_accelerator_bytes,
    work_of=_accelerator_work,
    ordinary_seconds=500e-9,
)


def geometry(recorder: Recorder, outline: Outline) -> Node:
    """The scene at its frame."""
    return recorder.step(GEOMETRY, scene=_content(outline))


def _content(outline: Outline) -> tuple:
    """What the arrays of a scene are told apart by."""
    return outline.scene_name, outline.view_layer_name, outline.frame, outline.version


def surface(recorder: Recorder, outline: Outline, *attributes: str) -> Node:
    """The shot's own shading points, on all instances that it may show: the same node for every effect. One
    that looks at others tells the recorder of them by Recorder.surface."""
    seen, _ = receivers_in_view(outline, recorder.shot)
    holdouts = holdouts_in_view(outline, recorder.shot)
    visible = outline.instances.subset(seen) | holdouts if holdouts else outline.instances.subset(seen)
    recorder.reads_instances(visible)
    shot, scene = recorder.shot, geometry(recorder, outline)
    if shot.has_eye:
        own = {"seed": _draws_of(shot, outline, "surface")} | ({"holdouts": holdouts} if holdouts else {})
        node = recorder.step(SURFACE, scene, instance="camera", view=shot.view, visible=visible, **own)
    else:
        recorder.wants("uv")
        laid_out = recorder.step(LAID_OUT, scene, instance=shot.name, instances=visible)
        node = recorder.step(CHART, laid_out, instance=shot.name, instances=visible, origin=shot.origin)
    return recorder.own_surface(node, *attributes)


def layered_depth(
    recorder: Recorder,
    outline: Outline,
    view: View,
    casters: frozenset[int],
    layers: int,
    size: tuple[int, int],
    instance: str,
    kept: str = WHOLE,
) -> Node:
    """`layers` depths of `casters` from `view`, `size` texels wide and high."""
    casters = drawn_from(view, casters, outline.instances)
    recorder.reads_instances(casters)
    width, height = size
    if kept == DRAWN:
        step, own = DRAWN_DEPTH, {"seed": _draws_of(recorder.shot, outline, instance)}
    else:
        step, own = LAYERED_DEPTH, {"kept": kept}
    return recorder.step(
        step,
        geometry(recorder, outline),
        instance=instance,
        view=view,
        casters=casters,
        layers=layers,
        width=width,
        height=height,
        **own,
    )


def _draws_of(shot: Shot, outline: Outline, name: str) -> int:
    """Seed of the draws of what is partly opaque: for each map its own."""
    return int(hash_bits(shot.seed, outline.frame & 0xFFFFFFFF, text_bits(name)))


def ray_accelerator(outline: Outline, shot: Shot) -> Node:
    """A hierarchy over all that casts shadows, is seen or is a medium, relative to the eye, one for all: each
    query names its instances. Outside any graph too: measuring asks for the one that an effect may have
    built."""
    node = Node(GEOMETRY, "", (), {"scene": _content(outline)})
    casters = outline.instances.memo(
        ("traced",),
        lambda: frozenset(
            i
            for i, each in enumerate(outline.instances)
            if each.casts_shadow or each.visible_camera or each.medium is not None
        ),
    )
    return Node(RAY_ACCELERATOR, "", (node,), {"eye": shot.origin, "casters": casters})
