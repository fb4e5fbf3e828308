"""The steps of volumetric light, each with its two twins."""

from __future__ import annotations

import numpy as np

from ...core.graph import Node, Rate, Step
from ...core.medium import Medium
from ...core.outline import Outline
from ...core.surface import Chunk
from . import gpu_steps
from .lattice import Lattice, lattice_of
from .sources import Source, SourceKind, share_in_cone


def _light_map(device, depth, view):
    return device.kernels.light_map(depth, view.packed(), cancel=device.cancel_flag)


def _medium_map(device, depth, view):
    return device.kernels.medium_map(depth, view.packed(), cancel=device.cancel_flag)


def _spans(device, geometry, view, instances, layers, stride, chunk: Chunk):
    lattice = lattice_of(view, chunk, stride)
    whole = lattice.of_image(chunk, stride)
    (left, bottom), width, height = lattice.origin, lattice.width, lattice.height
    return device.kernels.layered_depth(
        geometry,
        device.instance_mask(instances),
        whole.seen().packed(),
        layers,
        whole.width,
        whole.height,
        rows=(bottom, bottom + height),
        columns=(left, left + width),
        offsets=_offsets(device, chunk, lattice, stride),
        cancel=device.cancel_flag,
    )


def _coarse_depth(depth: np.ndarray, lattice: Lattice, stride: int) -> np.ndarray:
    if stride == 1:
        return depth
    left, bottom = lattice.shown
    return np.ascontiguousarray(depth[bottom::stride, left::stride])


def _offsets(device, chunk: Chunk, lattice: Lattice, stride: int) -> np.ndarray | None:
    """In steps of the lattice from where its rays begin: those of the pixels that they go through."""
    offsets = device.offsets(chunk)
    if offsets is None or stride == 1:
        return offsets
    left, bottom = lattice.shown
    return np.ascontiguousarray(offsets[bottom::stride, left::stride]) / np.float32(stride)


def _airlight(device, surface, *maps, windows, **common):
    return _kernel(device, surface, maps, **common)


def _by_table(device, surface, *maps, windows, reach, **common):
    return _kernel(device, surface, maps, order=8, table_reach=reach, **common)


def _bounded(device, surface, spans, *inputs, counts, windows, **common):
    count = sum(counts)
    maps, ways = inputs[:count], list(inputs[count:])
    return _kernel(device, surface, maps, counts=counts, spans=spans, medium_maps=ways, **common)


def _kernel(
    device,
    surface,
    maps,
    *,
    view,
    medium: Medium,
    source: Source,
    counts: tuple[int, ...],
    order: int,
    stride: int,
    chunk: Chunk,
    **more,
):
    lattice = lattice_of(view, chunk, stride)
    return device.kernels.airlight(
        _coarse_depth(surface["depth"], lattice, stride),
        lattice.packed(),
        medium.packed(),
        source.packed(),
        list(maps),
        counts=list(counts),
        order=order,
        offsets=_offsets(device, chunk, lattice, stride),
        cancel=device.cancel_flag,
        **more,
    )


def _scattered(device, surface, *parts, view, intensity, shares, stride, chunk: Chunk):
    total = sum(np.float32(share) * part for share, part in zip(shares, parts, strict=True))
    total *= np.array(intensity, np.float32)
    if stride == 1:
        return total
    lattice = lattice_of(view, chunk.grown(stride), stride)
    depth = surface["depth"]
    coarse_depth = _coarse_depth(depth, lattice, stride)
    image = device.kernels.upsample_by_depth(
        total, coarse_depth, depth, stride, lattice.shown, cancel=device.cancel_flag
    )
    # The outermost pixels have no rays around them.
    return device.cropped(image, (stride, stride), chunk.shape)


def _transmittance(device, surface, view, medium: Medium, chunk: Chunk):
    starts, ends = _limits(surface, view, chunk, device.offsets(chunk))
    metres = np.maximum(ends - starts, np.float32(0.0))
    return device.kernels.transmittance(metres, np.array(medium.extinction, np.float64))


def _bounded_transmittance(device, surface, spans, view, medium: Medium, chunk: Chunk):
    offsets = device.offsets(chunk)
    starts, ends = _limits(surface, view, chunk, offsets)
    metres = device.kernels.metres_inside(spans * lattice_of(view, chunk).lengths(offsets), starts, ends)
    return device.kernels.transmittance(metres, np.array(medium.extinction, np.float64))


def _limits(surface, view, chunk: Chunk, offsets) -> tuple[np.ndarray, np.ndarray]:
    """Metres along each ray (rows, width) where it begins, as in Cycles at the near plane, and ends."""
    lengths = lattice_of(view, chunk).lengths(offsets)
    return np.float32(view.near) * lengths, surface["depth"] * lengths


def _upsampling_reach(node: Node) -> int:
    """Four rays stand around a pixel."""
    return node.params["stride"] if node.params["stride"] > 1 else 0


LEAST_SHARE = 0.05
"""Of the work on rays that come into a spot's cone, what those beside it are."""


def _work(node: Node, outline: Outline) -> float:
    """Each point of a source has its walk along a ray, and half as much again for each more of its maps; rays
    beside a spot's cone have next to nothing to do."""
    counts, source = node.params["counts"], node.params["source"]
    work = max(0.5 * (len(counts) + sum(counts)), 1.0)
    if source.kind == SourceKind.SPOT:
        work *= max(share_in_cone(source, node.params["view"]), LEAST_SHARE)
    return work


def _light_map_bytes(node: Node, outline: Outline) -> int:
    """Lowest and highest of each texel; coarser maps add a third."""
    depth = node.inputs[0].params
    return depth["width"] * depth["height"] * 8 * 4 // 3


def _medium_map_bytes(node: Node, outline: Outline) -> int:
    """The same, all depths, and the one stretch where there is one."""
    depth = node.inputs[0].params
    return _light_map_bytes(node, outline) + depth["width"] * depth["height"] * (4 * depth["layers"] + 8)


# A light's depth map with minima and maxima, for walking along rays.
LIGHT_MAP = Step(
    "volumetric_light/light_map",
    cpu=_light_map,
    gpu=gpu_steps.light_map,
    copyable=False,
    croppable=False,
    bytes_of=_light_map_bytes,
    ordinary_seconds=0.013,
)
# A bounded medium's entries and exits from a light.
MEDIUM_MAP = Step(
    "volumetric_light/medium_map",
    cpu=_medium_map,
    gpu=gpu_steps.medium_map,
    copyable=False,
    bytes_of=_medium_map_bytes,
    ordinary_seconds=0.011,
)
# A bounded medium's entries and exits along the camera's rays.
SPANS = Step("volumetric_light/spans", cpu=_spans, gpu=gpu_steps.spans, rate=Rate.SAMPLE, croppable=False)
# Light of one source of a light, scattered once towards the eye (source, eq. 2.2) in a medium without end.
AIRLIGHT = Step(
    "volumetric_light/airlight",
    cpu=_airlight,
    gpu=gpu_steps.airlight,
    rate=Rate.SAMPLE,
    croppable=False,
    work_of=_work,
)
# The same in a medium that fills meshes.
BOUNDED = Step(
    "volumetric_light/bounded_airlight",
    cpu=_bounded,
    gpu=gpu_steps.bounded_airlight,
    ordinary_seconds=450e-9,
    rate=Rate.SAMPLE,
    croppable=False,
    work_of=_work,
)
# The same by the source's table of the antiderivative (source, listings 2.3 and 2.4).
BY_TABLE = Step(
    "volumetric_light/airlight_by_table",
    cpu=_by_table,
    gpu=gpu_steps.airlight_by_table,
    rate=Rate.SAMPLE,
    croppable=False,
    work_of=_work,
)
# All sources of a light together, at every pixel.
SCATTERED = Step(
    "volumetric_light/scattered",
    cpu=_scattered,
    gpu=gpu_steps.scattered,
    rate=Rate.SAMPLE,
    reach=_upsampling_reach,
)
# What gets through the medium from a surface to the eye.
TRANSMITTANCE = Step(
    "volumetric_light/transmittance", cpu=_transmittance, gpu=gpu_steps.transmittance, rate=Rate.SAMPLE
)
# The same in a medium that fills meshes.
BOUNDED_TRANSMITTANCE = Step(
    "volumetric_light/bounded_transmittance",
    cpu=_bounded_transmittance,
    gpu=gpu_steps.bounded_transmittance,
    ordinary_seconds=100e-9,
    rate=Rate.SAMPLE,
)
