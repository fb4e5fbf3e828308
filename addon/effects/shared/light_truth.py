"""What layers multiply, along view rays, in float64: the truth beside weights.py, written apart from it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...core.device import RayCaster
from ...core.emitter import Emitter
from ...core.graph import PlannedLayer
from ...core.outline import Light, Outline
from ...core.random import hash_bits
from ...core.roles import PRODUCT, Of, Role
from ...core.surface import SurfacePoints
from ...core.view_rays import ViewRays
from . import lit, terminator


def points_of(outline: Outline, view_rays: ViewRays, chosen: np.ndarray) -> SurfacePoints:
    """Where the view rays `chosen` (an index) meet a surface."""
    names = "position", "geometric_normal", "shading_normal"
    surface = view_rays.surface
    arrays = (np.ascontiguousarray(surface[name][chosen]) for name in names)
    lifts, offsets = None, terminator.offsets_of(outline)
    if offsets is not None and "terminator_lift" in surface:
        lifts = terminator.lifts_of(surface, offsets, chosen)
    return SurfacePoints(*arrays, np.array(view_rays.shot.origin), lifts)


def unshadowed(rays: RayCaster, emitter: Emitter, points: SurfacePoints) -> np.ndarray:
    """(N,) float32: what each point gets at radiance 1 if nothing is in the way."""
    position, normal = points.position[None], points.shading_normal[None]
    return rays.kernels.irradiance(position, normal, points.eye, emitter.packed())[0]


def colours_of(rays: RayCaster, colours: lit.Colours, surface: dict[str, np.ndarray]) -> np.ndarray:
    """(N, 3) of points (N,) that all lie on surfaces."""
    found = surface["material"]
    result = np.array([colour for colour, _, _ in colours], np.float64).reshape(-1, 3)[found]
    for index, (_, image, corners) in enumerate(colours):
        there = found == index
        if image is not None and there.any():
            texels = rays.texture(image)
            if texels is not None:
                result[there] = lit.bilinear(texels, surface["uv"][there])
        if corners and "corner_colour" in surface:
            result[there] *= surface["corner_colour"][there]
    return result


def diffuse_albedo(rays: RayCaster, outline: Outline, surface: dict[str, np.ndarray]) -> np.ndarray:
    """(N, 3) of points (N,) that all lie on surfaces: metals have none."""
    colours = [(each.base_color, *each.diffuse) for each in outline.materials]
    dielectric = 1.0 - np.array([each.metallic for each in outline.materials])
    return colours_of(rays, colours, surface) * dielectric[surface["material"], None]


def emission(rays: RayCaster, outline: Outline, surface: dict[str, np.ndarray]) -> np.ndarray:
    """(N, 3) of points (N,) that all lie on surfaces."""
    materials = outline.materials
    return colours_of(rays, [(m.emission, m.emission_image, m.emission_corners) for m in materials], surface)


def of_lamp(rays: RayCaster, outline: Outline, light: Light, view_rays: ViewRays) -> np.ndarray:
    """(N, 3) radiance that the lamp's light would have as it leaves the surface towards the eye, were nothing
    in its way; 0 off surfaces, and where the lamp lights nothing. Not negative, also of a negative light."""
    result = np.zeros((len(view_rays), 3))
    surface = view_rays.surface
    hit = view_rays.hits
    if light.receivers is not None:
        hit &= np.isin(surface["instance"], sorted(light.receivers))
    hit = np.flatnonzero(hit)
    if not len(hit) or light.is_dark:
        return result
    sent = unshadowed(rays, light.emitter, points_of(outline, view_rays, hit))
    albedo = diffuse_albedo(rays, outline, {name: array[hit] for name, array in surface.items()})
    radiance = np.abs(albedo * sent[:, None].astype(np.float64) * lit.brightness(light) / np.pi)
    result[hit] = np.nan_to_num(radiance, nan=0.0, posinf=0.0)
    return result


def before(
    rays: RayCaster,
    outline: Outline,
    layer: PlannedLayer,
    layers: Sequence[PlannedLayer],
    view_rays: ViewRays,
    seed: int,
) -> np.ndarray:
    """(N, 3) of the lamp that `layer` is of: its light after those of its layers that come before."""
    light = of_lamp(rays, outline, outline.lights[layer.of.index], view_rays)
    for role in PRODUCT[: PRODUCT.index(layer.role)]:
        light *= _product(rays, outline, layer.of, role, layers, view_rays, seed)
    return light


def behind(
    rays: RayCaster, outline: Outline, layers: Sequence[PlannedLayer], view_rays: ViewRays, seed: int
) -> np.ndarray:
    """(N, 3) radiance of the surfaces in sight, with their shadows by a ray from each lamp; not a number
    where there is none, since what shines there is not known. Metals are as bright as the composite has
    them."""
    plain = tuple(
        replace(each, metallic=0.0, diffuse_image=None, diffuse_corners="") for each in outline.materials
    )
    outline = replace(outline, materials=plain)
    hit = view_rays.hits
    picture = np.where(hit, 0.0, np.nan)[:, None] * np.ones(3)
    for index, light in enumerate(outline.lights):
        arriving = of_lamp(rays, outline, light, view_rays)
        if arriving.any():
            for role in PRODUCT:
                own = int(hash_bits(seed, index, PRODUCT.index(role)))
                arriving *= _product(rays, outline, Of.lamp(index), role, layers, view_rays, own)
            picture += arriving
    surface = {name: values[hit] for name, values in view_rays.surface.items()}
    picture[hit] += emission(rays, outline, surface)
    return picture


def _product(rays, outline, of: Of, role: Role, layers, view_rays: ViewRays, seed: int) -> np.ndarray:
    """(N, 3 or 1) of the layers of that role that scale the lamp's light, as they should be."""
    result = np.ones((len(view_rays), 1))
    for number, layer in enumerate(layers):
        if layer.of == of and layer.role is role and layer.joins and layer.kind.score is not None:
            casters = np.zeros(len(outline.instances), np.uint8)
            casters[sorted(layer.casters)] = 1
            truth = layer.kind.score.truth
            own = int(hash_bits(seed, number))
            values, _ = truth(rays, outline, layer, (), casters, view_rays, 1, own)
            result = result * values[0]
    return result


def over_the_picture(reference: Callable) -> Callable:
    """A truth for an InUseScore, of a layer that multiplies the whole picture. `reference(rays, outline,
    layer, view_rays, seed)`: what the layer should be, (estimates, N, channels)."""

    def truth(rays, outline, layer, layers, casters, view_rays, samples, seed):
        values = reference(rays, outline, layer, view_rays, seed)
        return values, behind(rays, outline, layers, view_rays, int(hash_bits(seed, 1)))

    return truth
