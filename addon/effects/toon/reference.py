"""What toon layers are scored against, along single view rays: no dot is filtered, no line is sampled, and
nothing is in float32. The caller averages 64 of them over a pixel.

Written apart from the kernels: from the scene's lights, ramps and parameters as they are declared. Shadows
are traced. The outline is the hull's triangles, met by rays (hull_rays.py); tests show that hulls are right.
"""

from __future__ import annotations

import numpy as np

from ...core.device import RayCaster
from ...core.emitter import EmitterKind
from ...core.graph import PlannedLayer
from ...core.outline import Light as Lamp
from ...core.outline import Outline
from ...core.shot import Raster
from ...core.surface import SurfacePoints
from ...core.view_rays import ViewRays
from ..shared import light_truth, lit, terminator, visibility_truth
from .hull_rays import HullRays
from .object_settings import excluded_instances, settings_of
from .params import NO_FADE, Anchor, Light, Mix, Normals, ShadowEdge, ToonParams
from .ramp_table import table_of

SHADOW_RAYS = 64  # of each of two estimates at a point


def toon(rays: RayCaster, outline: Outline, layer: PlannedLayer, seen: ViewRays, seed: int) -> np.ndarray:
    """(1, N, 4) linear RGBA."""
    params = layer.params
    surface, found = seen.surface, seen.hits
    light = _light(rays, outline, params, seen, seed)
    result = np.zeros((len(seen), 4))
    for material in np.unique(surface["material"][found]):
        made = outline.materials[material]
        here = found & (surface["material"] == material)
        for ramp, chosen in _by_ramp(outline, params, made, surface, here):
            if ramp is None:
                continue
            base = np.broadcast_to(np.array(made.base_color), (len(chosen), 3))
            texels = rays.texture(made.base_color_image) if made.base_color_image is not None else None
            if texels is not None:
                base = lit.bilinear(texels, surface["uv"][chosen]).astype(np.float64)
            if made.base_color_corners:
                base = base * surface["corner_colour"][chosen]
            result[chosen, :3] = _mixed(
                table_of(ramp).evaluate(light[chosen].clip(0.0, 1.0)), base, params.mix
            )
            result[chosen, 3] = 1.0
    if params.rim > 0.0:
        cosine = np.abs(np.einsum("ni,ni->n", seen.directions, _normals(params, surface)))
        band = (result[:, 3] > 0.0) & (cosine < params.rim_width)
        result[band, :3] += (np.array(params.rim_color) - result[band, :3]) * params.rim
    shaded = result[:, 3] > 0.0
    points = {name: values[shaded] for name, values in surface.items()}
    result[shaded, :3] += params.emission * light_truth.emission(rays, outline, points)
    return result[None]


def _by_ramp(outline, params, material, surface, here):
    """The ramps of the points `here`, which are of one material, with their indices; None for excluded."""
    instances = surface.get("instance")
    of_material = settings_of(material)
    general = of_material.ramp if of_material.use_ramp else params.ramp
    general = None if of_material.excluded else general
    chosen = np.flatnonzero(here)
    if instances is None or general is None:
        yield general, chosen
        return
    for instance in np.unique(instances[chosen]):
        settings = settings_of(outline.instances[instance])
        ramp = None if settings.excluded else settings.ramp if settings.use_ramp else general
        yield ramp, chosen[instances[chosen] == instance]


def _mixed(ramp: np.ndarray, base: np.ndarray, mix: Mix) -> np.ndarray:
    colour, share = ramp[:, :3], ramp[:, 3:]
    if mix == Mix.MULTIPLY:
        colour = base * colour
    elif mix == Mix.SOFT_LIGHT:
        a, b = base.clip(0.0, 1.0), (0.5 * colour).clip(0.0, 1.0)
        dark = 2.0 * a * b + a**2 * (1.0 - 2.0 * b)
        bright = 2.0 * a * (1.0 - b) + np.sqrt(a) * (2.0 * b - 1.0)
        colour = np.where(b <= 0.5, dark, bright)
    return base * (1.0 - share) + colour * share


def _normals(params: ToonParams, surface) -> np.ndarray:
    name = "geometric_normal" if params.normals == Normals.FLAT else "shading_normal"
    return surface[name].astype(np.float64)


# Light


def _light(rays: RayCaster, outline: Outline, params: ToonParams, seen: ViewRays, seed: int) -> np.ndarray:
    """(N,) float64: how far along the ramp each point is; 0 where there is none."""
    surface = seen.surface
    found = np.flatnonzero(seen.hits)
    light, full = np.zeros(len(seen)), np.zeros(len(seen))
    normals = _normals(params, surface)[found]
    world = seen.origins[found] + seen.distances[found, None] * seen.directions[found]
    at = _points(outline, params, seen, found, world)
    for index, lamp in enumerate(outline.lights):
        power = max(float(np.dot((0.2126, 0.7152, 0.0722), lamp.intensity)), 0.0)
        if power <= 0.0 or (params.key_light and not lamp.is_called(params.key_light)):
            continue
        reached = np.ones(len(found), bool)
        if lamp.receivers is not None:
            reached = np.isin(surface["instance"][found], sorted(lamp.receivers))
        visible = _visible(rays, outline, params, lamp, at, seed + index)
        if params.light == Light.BRIGHTNESS:
            sent = light_truth.unshadowed(rays, lamp.emitter, at).astype(np.float64) * reached
            brightness = max(float(np.dot((0.2126, 0.7152, 0.0722), lit.brightness(lamp))), 0.0)
            light[found] += params.exposure * brightness / np.pi * sent * visible
            full[found] = 1.0
        else:
            weight, share = _facing(lamp, power, world, normals)
            light[found] += weight * share * visible * reached
            full[found] += weight * reached
    return np.divide(light, full, out=np.zeros_like(light), where=full > 0.0).clip(0.0, 1.0)


def _facing(lamp: Lamp, power: float, world: np.ndarray, normals: np.ndarray):
    """Weight of a lamp, and the share of it that arrives."""
    emitter = lamp.emitter
    axis = np.array(emitter.forward)
    if emitter.kind == EmitterKind.DISTANT_DISK:
        return np.full(len(world), power), (-(normals @ axis)).clip(0.0)
    to = np.array(emitter.centre) - world
    distance = np.maximum(np.linalg.norm(to, axis=1), 1e-10)
    to /= distance[:, None]
    share = np.einsum("ni,ni->n", to, normals).clip(0.0)
    along = -(to @ axis)
    if emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
        share *= along.clip(0.0)
        if np.isfinite(emitter.tan_half_spread):
            tangent = np.sqrt((1.0 - along**2).clip(0.0)) / along.clip(1e-6)
            share *= (1.0 - tangent / max(emitter.tan_half_spread, 1e-6)).clip(0.0)
    elif emitter.cos_cone > -1.0:
        width = max((1.0 - emitter.cos_cone) * emitter.blend, 1e-6)
        x = ((along - emitter.cos_cone) / width).clip(0.0, 1.0)
        share *= x * x * (3.0 - 2.0 * x)
    return power / distance**2, share


def _points(outline: Outline, params, seen: ViewRays, found, world: np.ndarray) -> SurfacePoints:
    """The points `found`, which lie at `world`; a normal that the graph did not ask for is the other one.
    Hard shadows of flat normals begin at the surface."""
    surface, eye = seen.surface, np.array(seen.shot.origin)
    other = surface.get("geometric_normal", surface.get("shading_normal"))
    normals = [surface.get(name, other)[found] for name in ("geometric_normal", "shading_normal")]
    columns = [np.ascontiguousarray(column, np.float32) for column in (world - eye, *normals)]
    lifts, offsets = None, terminator.offsets_of(outline)
    is_flat = params.shadow_edge == ShadowEdge.CRISP and params.normals == Normals.FLAT
    if offsets is not None and "terminator_lift" in surface and not is_flat:
        lifts = terminator.lifts_of(surface, offsets, found)
    return SurfacePoints(*columns, eye, lifts)


def _visible(rays, outline, params, lamp, points: SurfacePoints, seed) -> np.ndarray:
    if not (params.shadows and lamp.casts_shadow and len(points.position)):
        return np.ones(len(points.position))
    casters = np.array([i.casts_shadow for i in outline.instances], np.uint8)
    if lamp.casters is not None:
        casters[[i for i in range(len(casters)) if i not in lamp.casters]] = 0
    if params.shadow_edge == ShadowEdge.CRISP:
        return _sees_middle(rays, lamp.emitter, casters, points)
    halves, _ = visibility_truth.evaluate(rays, lamp.emitter, casters, points, SHADOW_RAYS // 2, seed)
    return halves.mean(axis=1)


def _sees_middle(rays, emitter, casters: np.ndarray, points: SurfacePoints) -> np.ndarray:
    """(N,) float64: 1 where nothing lies between a point and the middle of a lamp, or what gets through."""
    origins, is_distant = points.position, emitter.kind == EmitterKind.DISTANT_DISK
    if is_distant:
        towards = np.tile(-np.array(emitter.forward), (len(origins), 1))
        longest = np.full(len(origins), np.inf, np.float32)
    else:
        towards = np.array(emitter.centre) - points.eye - origins
        longest = np.ones(len(origins), np.float32)
    leaves = np.einsum("ni,ni->n", towards, points.geometric_normal) > 0.0
    if points.lifts is not None:
        unit = towards / np.maximum(np.linalg.norm(towards, axis=1), 1e-30)[:, None]
        normals = points.geometric_normal, points.shading_normal
        above, lit = (np.einsum("ni,ni->n", unit, normal)[None] for normal in normals)
        away = visibility_truth.away(points.lifts, above, lit)[:, 0].T
        leaves |= away.any(axis=1)
        origins = (origins + away).astype(np.float32)
        towards = towards if is_distant else towards - away
    through = rays.transmittance(casters, origins, towards.astype(np.float32), longest)
    return np.where(leaves, through, 0.0)


# Dots


def halftone(rays: RayCaster, outline: Outline, layer: PlannedLayer, seen: ViewRays, seed: int) -> np.ndarray:
    """(1, N, 1): 1 on paper."""
    params, surface = layer.params, seen.surface
    found = seen.hits
    inked = np.ones(len(outline.instances) + 1, bool)
    inked[[*excluded_instances(outline), -1]] = False
    left_out = [settings_of(material).excluded for material in outline.materials]
    inked = inked[surface["instance"]] & ~np.array([*left_out, True])[surface["material"]]
    size = (1.0 - _light(rays, outline, params, seen, seed)) * params.halftone_scale
    at, cell = _places(outline, params, seen)
    cosine, sine = np.cos(params.halftone_angle), np.sin(params.halftone_angle)
    turned = (
        np.stack([cosine * at[:, 0] + sine * at[:, 1], cosine * at[:, 1] - sine * at[:, 0]], axis=1) / cell
    )
    away = np.linalg.norm(turned - np.floor(turned) - 0.5, axis=1)
    ink = found & inked & (size >= params.halftone_cutoff) & (away < 0.5 * size)
    fade = params.halftone_opacity
    if params.halftone_fade_end_m < NO_FADE:
        start, end = params.halftone_fade_start_m, params.halftone_fade_end_m
        distance = np.linalg.norm(surface["position"].astype(np.float64), axis=1)
        x = ((distance - end) / (start - end)).clip(0.0, 1.0) if start < end else (distance < end) * 1.0
        fade = fade * x * x * (3.0 - 2.0 * x)
    return (1.0 - ink * fade)[None, :, None]


def _places(outline: Outline, params: ToonParams, seen: ViewRays) -> tuple[np.ndarray, float]:
    """(N, 2) where rays meet the pattern, and the length of its cells in the same unit."""
    raster = seen.shot.source
    frame_cell = raster.frame_size[1] / params.halftone_repeat
    start = raster.region[:2] if raster.region else (0, 0)
    at = seen.pixels + 0.5 + seen.jitter + np.array(start)
    instance = seen.surface["instance"]
    if params.halftone_anchor == Anchor.OBJECT:
        return at - _origins(outline, raster, start)[instance], frame_cell
    if params.halftone_anchor == Anchor.SURFACE:
        found = np.flatnonzero(seen.hits)
        places = np.zeros((len(seen), 2))
        world = seen.origins[found] + seen.distances[found, None] * seen.directions[found]
        for index in np.unique(instance[found]):
            here = instance[found] == index
            matrix = np.array(outline.instances[index].matrix)
            linear = matrix[:3, :3]
            metres = np.cbrt(abs(np.linalg.det(linear)))
            local = np.linalg.solve(linear, (world[here] - matrix[:3, 3]).T).T * metres
            axes = np.linalg.inv(linear)
            axes /= np.linalg.norm(axes, axis=1, keepdims=True)
            facing = np.abs(seen.surface["geometric_normal"][found[here]].astype(np.float64) @ axes.T)
            pairs = np.array([(1, 2), (0, 2), (0, 1)])[facing.argmax(axis=1)]
            places[found[here]] = np.take_along_axis(local, pairs, axis=1)
        return places, params.halftone_cell_m
    return at, frame_cell


def _origins(outline: Outline, raster: Raster, start) -> np.ndarray:
    """(I, 2) frame positions of the objects' origins, pixels."""
    view, (width, height) = raster.view, raster.computed_size
    left, right, bottom, top = view.window
    places = []
    for instance in outline.instances:
        x, y, depth = view.to_view(np.array([row[3] for row in instance.matrix[:3]]))
        depth = 1.0 if view.orthographic else max(depth, view.near)
        places.append(
            (
                start[0] + (x / depth - left) / (right - left) * width,
                start[1] + (y / depth - bottom) / (top - bottom) * height,
            )
        )
    return np.array(places)


# Lines


def outline_ink(
    rays: RayCaster, outline: Outline, layer: PlannedLayer, seen: ViewRays, seed: int
) -> np.ndarray:
    """(1, N, 4) premultiplied: the nearest triangle of the hull before the surface. Inner lines are made by
    pixels, so where they are switched on this is not their truth."""
    hull = rays.value(_hull_node(layer))
    view, size = seen.shot.view, seen.shot.computed_size
    if (view, size) not in hull.memo:
        hull.memo[view, size] = HullRays(hull.triangles, view, size)
    hull_rays = hull.memo[view, size]
    result = np.zeros((len(seen), 4))
    nearest = seen.distances * (seen.directions @ np.array(view.forward))  # depth of the surface
    places = seen.pixels + 0.5 + seen.jitter
    pixels = seen.pixels[:, 1].astype(np.int64) * size[0] + seen.pixels[:, 0]
    for pixel in np.unique(pixels):
        here = np.flatnonzero(pixels == pixel)
        depths, owners = hull_rays.first(places[here])
        inked = depths < nearest[here]
        for row, owner in zip(here[inked], owners[inked], strict=True):
            settings = settings_of(outline.instances[owner])
            colour = settings.outline_color if settings.use_outline_color else layer.params.outline_color
            result[row] = (*colour, 1.0)
    return result[None]


def _hull_node(layer: PlannedLayer):
    stack = [layer.node]
    while stack:
        node = stack.pop()
        if node.step.name == "toon/hull":
            return node
        stack += node.inputs
    raise LookupError("the outline has no hull")
