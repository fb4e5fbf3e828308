"""The steps of toon shading, each with its two twins."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...core.arrays import Arrays, Opacities, Placed, separate_triangles
from ...core.device import Device
from ...core.graph import Rate, Step
from ...core.view import View
from ..shared.membership import belong
from ..shared.terminator import lifts_of
from . import gpu_steps
from .pattern import packed_pattern


def _facing(device, surface, *visibility, normal, lights, shadowed, linked):
    images = iter(visibility)
    receives = None
    if any(instances is not None for instances in linked):
        everything = frozenset(range(len(device.instance_mask(frozenset()))))
        receives = np.array([device.instance_mask(everything if i is None else i) for i in linked])
    return device.kernels.toon_facing(
        surface.get("position", surface[normal]),  # suns do not ask where a point is
        surface[normal],
        lights,
        [next(images) if shadow else None for shadow in shadowed],
        surface["instance"] if receives is not None else None,
        receives,
        cancel=device.cancel_flag,
    )


def _crisp_shadow(device, surface, accelerator, normal, place, is_distant, casters, offsets=None):
    shape, lifts = surface["position"].shape[:2], None
    if offsets is not None:
        lifts = lifts_of(surface, offsets).reshape(*shape, 4)
    return device.kernels.rays_towards(
        accelerator,
        device.instance_mask(casters),
        np.array(place),
        is_distant,
        surface["position"],
        surface["geometric_normal"],
        surface[normal],
        lifts,
        cancel=device.cancel_flag,
    )


def _brightness(device, *images, weights, shadowed):
    queue = iter(images)
    total = np.float32(0.0)
    for weight, shadow in zip(weights, shadowed, strict=True):
        light = next(queue) * np.float32(weight / np.pi)
        total = total + (light * next(queue) if shadow else light)
    return np.clip(total, 0.0, 1.0)


def _unlit(device, surface, normal):
    return np.zeros(surface[normal].shape[:2], np.float32)


def _shade(
    device,
    surface,
    light,
    *base,
    normal,
    table,
    materials,
    pieces,
    starts,
    clamps,
    mix,
    emission,
    rim,
    forward,
    instances=None,
):
    has_rim = rim[1] > 0.0
    return device.kernels.toon_shade(
        light,
        surface["material"],
        table,
        materials,
        pieces,
        starts,
        clamps,
        gpu_steps.MIXES[mix],
        emission,
        rim,
        base=base[0] if base else None,
        instance=surface["instance"] if instances is not None else None,
        instance_ramps=instances,
        position=surface["position"] if has_rim else None,
        normal=surface[normal] if has_rim else None,
        forward=forward,
        cancel=device.cancel_flag,
    )


def _glow(device, shaded, emission, strength):
    result, there = shaded.copy(), shaded[..., 3] > 0.0
    result[there, :3] += np.float32(strength) * emission[there, :3]
    return result


def _halftone(device, surface, light, anchors, inked, chunk, **pattern):
    on_surface = pattern["anchor"] == "surface"
    return device.kernels.toon_halftone(
        light,
        surface["instance"],
        packed_pattern(chunk, **pattern),
        inked,
        anchors,
        surface["position"] if on_surface or pattern["fade"][0] else None,
        surface["geometric_normal"] if on_surface else None,
        device.offsets(chunk),
        cancel=device.cancel_flag,
    )


def _spare(device, dots, shaded):
    return np.where(shaded[..., 3] > 0.0, dots, np.float32(1.0))


@dataclass(frozen=True, eq=False)
class Hull:
    """Triangle corners (3 T, 3) float32 relative to `eye`, by instance. No device has it: it is plain numbers
    to make a geometry of. `memo`: what its readers worked out of it."""

    eye: tuple[float, float, float]
    triangles: dict[int, np.ndarray]
    memo: dict = field(default_factory=dict)

    @property
    def nbytes(self) -> int:
        return sum(corners.nbytes for corners in self.triangles.values())


def _hull(device, geometry, view: View, pixel, instances, width, in_pixels, least, most, scales, thickness):
    triangles = device.kernels.toon_hull(
        geometry,
        list(instances),
        view.packed(),
        pixel,
        width,
        in_pixels,
        least,
        most,
        list(scales),
        device.vertex_values(thickness) if thickness else [],
        cancel=device.cancel_flag,
    )
    found = zip(instances, triangles, strict=True)
    return Hull(view.eye, {instance: corners for instance, corners in found if len(corners)})


def _hull_geometry(device: Device, hull):
    """A mesh an instance, whose object id is the instance's index."""
    triangles = hull.triangles or {0: np.zeros((0, 3), np.float32)}
    placed = [Placed(mesh, instance, (0,)) for mesh, instance in enumerate(triangles)]
    matrix = np.eye(4)
    matrix[:3, 3] = hull.eye
    meshes = tuple(map(separate_triangles, triangles.values()))
    return device.geometry_of(placed, Arrays(meshes, np.array([matrix] * len(meshes)), (Opacities(),)))


def _outline(device, surface, hull, *lines, view: View, colours, chunk):
    inked = device.kernels.raster_before(
        hull,
        np.ones(hull.instance_count(), np.uint8),
        view.packed(),
        chunk.width,
        chunk.height,
        surface["depth"],
        rows=(chunk.y0, chunk.y1),
        columns=(chunk.x0, chunk.x1),
        jitter=chunk.jitter,
        offsets=device.offsets(chunk),
        cancel=device.cancel_flag,
    )
    return device.kernels.toon_outline(
        inked,
        colours,
        lines[0] if lines else None,
        surface["instance"] if lines else None,
        cancel=device.cancel_flag,
    )


def _lines(device, surface, marked, width, objects, materials, crease):
    margin = gpu_steps.line_reach(width)
    rows = len(surface["instance"])
    lines = device.kernels.toon_edges(
        np.where(belong(device, surface, marked), surface["instance"], -1),
        margin,
        rows - margin,
        width,
        surface["object_id"] if objects else None,
        surface["material"] if materials else None,
        surface["shading_normal"] if crease is not None else None,
        -2.0 if crease is None else crease,
        cancel=device.cancel_flag,
    )
    return np.ascontiguousarray(lines[:, margin:-margin])


# How much points face the lights, in 0 to 1: what the ramp is looked up with.
FACING = Step("toon/facing", cpu=_facing, gpu=gpu_steps.facing)
# Whether a light's middle is seen, 1 or 0.
CRISP_SHADOW = Step("toon/crisp_shadow", cpu=_crisp_shadow, hole="rays live on the CPU only")
# What white surfaces would send back, instead.
BRIGHTNESS = Step("toon/brightness", cpu=_brightness, gpu=gpu_steps.brightness)
# Where no light counts.
UNLIT = Step("toon/unlit", cpu=_unlit, gpu=gpu_steps.unlit)
# The ramp's colour over the material's, then rim and emission.
SHADE = Step("toon/shade", cpu=_shade, gpu=gpu_steps.shade)
# What is emitted, where that is not the same all over a material.
GLOW = Step("toon/glow", cpu=_glow, gpu=gpu_steps.glow)
# Paper between the dots.
HALFTONE = Step("toon/halftone", cpu=_halftone, gpu=gpu_steps.halftone, rate=Rate.SAMPLE)
# No dots on what is excluded.
SPARE = Step("toon/spare", cpu=_spare, gpu=gpu_steps.spare)
# What faces away of every outlined surface, moved out by the line's width.
HULL = Step("toon/hull", cpu=_hull, hole="which faces touch is found once a frame, on the CPU")
HULL_GEOMETRY = Step("toon/hull_geometry", cpu=_hull_geometry, gpu=_hull_geometry, copyable=False)
# Ink where the hull lies before every surface.
OUTLINE = Step("toon/outline", cpu=_outline, gpu=gpu_steps.outline, rate=Rate.SAMPLE)
# Lines between objects, materials and faces.
LINES = Step(
    "toon/lines",
    cpu=_lines,
    gpu=gpu_steps.lines,
    reach=lambda node: gpu_steps.line_reach(node.params["width"]),
)
