"""The steps of soft shadows, each with its two twins."""

from __future__ import annotations

import numpy as np

from ...core.graph import Node, Rate, Step
from ...core.outline import Outline
from ...core.surface import Chunk
from ..shared.membership import belong
from ..shared.terminator import EVERYWHERE, lifts_of
from . import close_casters, gpu_steps
from .params import Method

POINTS = ("position", "geometric_normal", "shading_normal")
"""What of a surface a light's maps are asked at."""

UNSURE, CLOSE, PARTIAL = 1, 2, 3
"""Of a point left to rays: the map is not to be believed, or knows nothing of what is close to the light, or
of what is partly opaque."""

EDGE_SHARE = 4
"""So many times fewer rays for what the bitmask leaves to them at hard edges: mostly all or none is lit."""

CLOSE_RAYS, FEWEST_CLOSE_RAYS = 256, 64
"""Rays at least for a pixel of the second kind: all of its penumbra is theirs, and none of it the map's. Its
samples share them, but none gets less than the second number."""


def _prepare(device, depth, view, gradient_scale, gradient_cap_m):
    return device.kernels.soft_shadow_prepare(
        depth, view.packed(), gradient_scale, gradient_cap_m, cancel=device.cancel_flag
    )


def _backproject(
    device,
    surface,
    *maps_and_tables,
    eye,
    emitter,
    method,
    max_samples,
    refinements,
    spacing,
    maps,
    leave_edges=False,
):
    visibility, uncertain = device.kernels.soft_shadow_backproject(
        surface["position"],
        surface["geometric_normal"],
        surface["shading_normal"],
        np.array(eye),
        emitter.packed(),
        list(maps_and_tables[:maps]),
        max_samples,
        refinements,
        method="area" if method == Method.AREA.value else "bitmask",
        # Rays will replace what the map is unsure of.
        leave_uncertain=method == Method.HYBRID.value,
        leave_edges=leave_edges,
        close_casters=list(maps_and_tables[maps:]),
        spacing=spacing,
        cancel=device.cancel_flag,
    )
    return {"visibility": visibility, "uncertain": uncertain}


def _spaced(backproject):
    """A twin that evaluates points of the image's grid, and others where those do not tell."""

    def twin(device, surface, *maps_and_tables, spacing: int, chunk: Chunk, **settings):
        # Whole cells of the grid, which begins at the image's first pixel.
        inside = chunk.y0 % spacing, chunk.x0 % spacing
        first = tuple(spacing - 1 - each for each in inside)
        shape = tuple(side - start for side, start in zip(chunk.grown(spacing - 1).shape, first, strict=True))
        points = device.cropped({name: surface[name] for name in POINTS}, first, shape)
        shadow = backproject(device, points, *maps_and_tables, spacing=spacing, **settings)
        return device.cropped(shadow, inside, chunk.shape)

    return twin


def _leave_partial(device, shadow, partial):
    """Rays for the points that something partly opaque may lie before, unless all else hides the light."""
    uncertain = shadow["uncertain"]
    shaded = (partial["visibility"] < 1.0) | (partial["uncertain"] != 0)
    shaded &= shadow["visibility"] > 0.0
    left = np.where(shaded & (uncertain != CLOSE), uncertain.dtype.type(PARTIAL), uncertain)
    return {"visibility": shadow["visibility"], "uncertain": left}


def _close_casters(device, *depths, emitter, view):
    return close_casters.table(device, depths, emitter, view)


def _rays(
    device, surface, shadow, accelerator, eye, emitter, casters, method, rays, seed, chunk, offsets=None
):
    visibility = shadow["visibility"].copy()
    close = max(rays, CLOSE_RAYS // chunk.samples, FEWEST_CLOSE_RAYS)
    unsure = rays if method == Method.HYBRID.value else -(-rays // EDGE_SHARE)
    for doubt, count in ((UNSURE, unsure), (CLOSE, close), (PARTIAL, rays)):
        chosen = np.flatnonzero(shadow["uncertain"] == doubt)
        if not len(chosen):
            continue
        traced = _traced(
            device, surface, chosen, accelerator, eye, emitter, casters, count, seed, chunk, offsets
        )
        visibility.reshape(-1)[chosen] = traced
    return {"visibility": visibility, "uncertain": shadow["uncertain"]}


def _traced(device, surface, chosen, accelerator, eye, emitter, casters, rays, seed, chunk, offsets):
    """(N,) float32 of points `chosen` (an index, None: all), by so many rays each. Pixels are told apart
    whatever the tiles and the device, and a pixel's samples go on with one sequence, which is well spread as
    a whole."""
    places, numbered = chosen, chosen
    if chosen is None:
        places, numbered = EVERYWHERE, np.arange(np.prod(chunk.shape))
    traced, _ = device.kernels.ray_visibility(
        accelerator,
        device.instance_mask(casters),
        emitter.packed(),
        np.array(eye),
        *(np.ascontiguousarray(surface[name].reshape(-1, 3)[places]) for name in POINTS),
        rays,
        seed,
        chunk.numbers(numbered),
        None if offsets is None else lifts_of(surface, offsets, places),
        first=chunk.sample * rays,
        cancel=device.cancel_flag,
    )
    return traced


def _rays_alone(device, surface, accelerator, eye, emitter, casters, rays, seed, chunk, offsets=None):
    traced = _traced(device, surface, None, accelerator, eye, emitter, casters, rays, seed, chunk, offsets)
    return traced.reshape(chunk.shape)


def _raised(device, surface, eye, emitter, offsets):
    position, geometric_normal = device.kernels.soft_shadow_raised(
        *(surface[name] for name in POINTS),
        surface["terminator_lift"],
        surface["instance"],
        offsets,
        eye,
        emitter.packed(),
        cancel=device.cancel_flag,
    )
    shading_normal = surface["shading_normal"]
    return dict(zip(POINTS, (position, geometric_normal, shading_normal), strict=True))


def _visibility(device, shadow):
    return shadow["visibility"]


def _receivers(device, surface, visibility, receivers):
    return np.where(belong(device, surface, receivers), visibility, np.float32(1.0))


def _prepared_bytes(node: Node, outline: Outline) -> int:
    """Of each texel a depth and a slope a layer, and two nearest depths of all; coarser maps add a third."""
    depth = node.inputs[0].params
    texels = depth["width"] * depth["height"]
    return texels * (9 * depth["layers"] + 8) * 4 // 3


# Biases and coarser maps of one layered depth map (thesis 5.3.2 and 5.3.4).
PREPARE = Step(
    "soft_shadow/prepare",
    cpu=_prepare,
    gpu=gpu_steps.prepare,
    copyable=False,
    croppable=False,
    bytes_of=_prepared_bytes,
    ordinary_seconds=0.06,
)
# Texels projected back onto the light from every shading point (thesis eq. 5.3).
BACKPROJECT = Step(
    "soft_shadow/backproject", cpu=_backproject, gpu=gpu_steps.backproject, ordinary_seconds=550e-9
)
# The same step where a grid of points is evaluated first: its cells reach into the next tile.
SPACED_BACKPROJECT = Step(
    "soft_shadow/backproject",
    cpu=_spaced(_backproject),
    gpu=_spaced(gpu_steps.backproject),
    rate=Rate.SAMPLE,
    reach=lambda node: node.params["spacing"] - 1,
    ordinary_seconds=280e-9,
)
# Where in a map's window to doubt it for what stands beside the window, close to the light.
CLOSE_CASTERS = Step("soft_shadow/close_casters", cpu=_close_casters, hole="a table of a thousand entries")
# Leaves the points behind what is partly opaque to rays, which multiply what gets through.
LEAVE_PARTIAL = Step("soft_shadow/leave_partial", cpu=_leave_partial, hole="rays follow, on the CPU")
# Points near the terminator of smooth surfaces as rays of their shadows leave them: maps are asked there.
RAISED = Step("soft_shadow/raised", cpu=_raised, gpu=gpu_steps.raised, ordinary_seconds=10e-9)
# Rays for the points that the map is unsure of.
RAYS = Step(
    "soft_shadow/rays",
    cpu=_rays,
    hole="rays live on the CPU only",
    rate=Rate.SAMPLE,
    ordinary_seconds=80e-9,
)
# Rays from every point, and no map.
RAYS_ALONE = Step(
    "soft_shadow/rays_alone",
    cpu=_rays_alone,
    hole="rays live on the CPU only",
    rate=Rate.SAMPLE,
    ordinary_seconds=300e-9,
)
VISIBILITY = Step("soft_shadow/visibility", cpu=_visibility, gpu=gpu_steps.visibility, ordinary_seconds=4e-9)
# Instances that the light does not light stay as they are (light linking).
RECEIVERS = Step("soft_shadow/receivers", cpu=_receivers, gpu=gpu_steps.receivers)
