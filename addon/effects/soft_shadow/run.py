"""The order of work, the same on every device."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from ...core.culling import (
    WITHOUT_CASTERS,
    around,
    casters_of,
    not_whole_in,
    partly_opaque,
    receivers_in_view,
    unlit_reason,
)
from ...core.emitter import Emitter, EmitterKind
from ...core.graph import Node
from ...core.outline import Light, Outline, emitter_measure
from ...core.random import hash_bits
from ...core.recorder import Recorder
from ...core.roles import Of
from ..shared import steps as shared
from ..shared import terminator
from . import close_casters, steps
from .params import Method, SoftShadowParams
from .views import AROUND, ROUND_KINDS, distances_of_boxes, light_views, reaching_out_of, share_axes, too_far

SMALLEST_RESOLUTION = 64
"""Texels a side of any map."""

WHY_NO_MAP = {
    "no receivers": "nothing in view would read them",
    "no casters": "nothing casts a shadow there",
}
"""By what light_views says."""

CLOSE, CLOSE_SAMPLES = 3.0, 8
"""Where something is closer to a spot or a point than so many radii, a point reads so many times as many
texels: what is close is seen at a slant, and coarser maps of it are not its shape."""


def needed(outline: Outline) -> str | None:
    """Why the scene has no soft shadow to compute, or None."""
    if not outline.instances:
        return "the scene has no surfaces"
    if not outline.lights:
        return "the scene has no lights"
    if not any(light.casts_shadow and not light.is_dark for light in outline.lights):
        return "no light casts shadows"
    return None


def ruled_out(kind, light: Light | None, params: SoftShadowParams | None, has_media: bool) -> bool:
    """Whether no frame needs the light's shadow, whatever moves."""
    return light is not None and (light.is_dark or not light.casts_shadow)


def run(recorder: Recorder, outline: Outline, params: SoftShadowParams) -> None:
    """One layer for each light whose shadow falls in view."""
    from . import EFFECT

    for index in recorder.lamps_for(EFFECT.layers[0]):
        if shadow := visibility(recorder, outline, params, Of.lamp(index)):
            node, casters = shadow
            recorder.layer(EFFECT.layers[0], node, Of.lamp(index), casters)
    seen, _ = receivers_in_view(outline, recorder.shot)
    _report_idle_instances(recorder, outline, seen)


def visibility(
    recorder: Recorder, outline: Outline, params: SoftShadowParams, of: Of
) -> tuple[Node, frozenset[int]] | None:
    """V of one light and what casts it, or None where nothing of its shadow falls in view: for other effects
    too, by Recorder.ask."""
    light = outline.lights[of.index]
    seen, receivers = receivers_in_view(outline, recorder.shot)
    region = around(receivers) if len(receivers) else np.zeros((2, 3))
    visible = outline.instances.subset(seen)
    reason = _unneeded(light, visible, region)
    casters = frozenset() if reason else casters_of(light, outline.instances, region)
    if not reason and not casters:
        reason = WITHOUT_CASTERS
    if reason:
        recorder.left_out(_told(light), reason, light.name)
        return None
    return _record_light(recorder, outline, params, of.index, casters, receivers), casters


def _told(light: Light) -> str:
    """As its layer is called, for people."""
    return f"Soft Shadow {light.name}"


def _unneeded(light: Light, visible: frozenset[int], region: np.ndarray) -> str | None:
    if light.is_dark:
        return "an area light of no size gives no light" if _is_empty_area(light) else "no power"
    if not light.casts_shadow:
        return "its shadow is switched off"
    if not visible:
        return "nothing is in view"
    if light.receivers == frozenset():
        return "it lights no diffuse surface (ray visibility or light linking)"
    return unlit_reason(light, visible, region) or too_far(light.emitter, region)


def _is_empty_area(light: Light) -> bool:
    is_area = light.emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE)
    return is_area and emitter_measure(light.emitter) == 0.0


def _record_light(recorder, outline, params, index, casters, receivers) -> Node:
    light = outline.lights[index]
    params = recorder.own_params(params, Of.lamp(index), "soft_shadow")
    if not params.rays and params.method == Method.HYBRID:
        params = replace(params, method=Method.BITMASK)
    offsets = terminator.offsets_of(outline, recorder.shot)
    attributes = {*steps.POINTS, *(terminator.READ if offsets is not None else ())}
    attributes.update(() if light.receivers is None else ("instance",))
    surface = shared.surface(recorder, outline, *attributes)
    if not _has_size(light):
        recorder.left_out(f"{_told(light)}, penumbra", "a light of no size has hard shadows", light.name)
    of_rays = {
        "instance": light.name,
        "eye": recorder.shot.origin,
        "emitter": light.emitter,
        "casters": casters,
        "seed": int(hash_bits(recorder.shot.seed, outline.frame, index)),
        "offsets": offsets,
    }
    if params.method == Method.RAYS:
        recorder.reads_instances(casters)
        accelerator = shared.ray_accelerator(outline, recorder.shot)
        visibility = recorder.step(steps.RAYS_ALONE, surface, accelerator, rays=params.sample_rays, **of_rays)
    else:
        shadow = _by_maps(recorder, outline, params, light, surface, casters, receivers, of_rays)
        visibility = recorder.step(steps.VISIBILITY, shadow, instance=light.name)
    if light.receivers is not None:
        visibility = recorder.step(
            steps.RECEIVERS, surface, visibility, instance=light.name, receivers=light.receivers
        )
    return visibility


def _by_maps(recorder, outline, params, light: Light, surface, casters, receivers, of_rays) -> Node:
    """The light's maps, what they tell of each point, and rays where they are not to be believed."""
    points, offsets = surface, of_rays["offsets"]
    if offsets is not None:
        of_light = {"eye": recorder.shot.origin, "emitter": light.emitter}
        points = recorder.step(steps.RAISED, surface, instance=light.name, **of_light, offsets=offsets)
    away = _distances(outline, light.emitter, casters)
    close = _close_casters(params, light.emitter, casters, away)
    is_looked_at = recorder.shot.seen is not None and light.emitter.kind == EmitterKind.DISTANT_DISK
    eye = recorder.shot.origin if is_looked_at else None

    def find_views():
        boxes = outline.instances.boxes_of(casters)
        return light_views(light.emitter, boxes, receivers, away, bool(close), eye)

    views, left_out = outline.instances.memo(
        ("views", light.emitter, casters, receivers.tobytes(), away.tobytes(), bool(close), eye),
        find_views,
    )
    for reason, count in Counter(reason for _, reason in left_out).items():
        maps = f"{count} of its maps" if count > 1 else "one of its maps"
        recorder.left_out(f"{_told(light)}, {maps}", WHY_NO_MAP.get(reason, reason), light.name)
    partial = partly_opaque(outline, casters)
    maps, partial_maps, inner = [], [], None
    for name, view in views:
        drawn, resolution = casters, params.resolution
        if inner is not None and share_axes(inner, view):
            # Nested windows: what the finer map holds whole has no texel that is read of this one.
            drawn = not_whole_in(inner, casters, outline.instances)
            if light.emitter.kind in ROUND_KINDS:
                # Beside the window only what is close to the light counts: large, and as blurred as it.
                resolution = max(resolution // 2, SMALLEST_RESOLUTION)
                drawn &= _reaching_out(outline, inner, light, casters, away, receivers)
        # The sum of areas stores one depth more than it uses: the last has no midpoint to the next.
        stored = params.layers + (params.method == Method.AREA)
        kept = shared.DRAWN if partial and not params.rays else shared.WHOLE
        instance = f"{light.name} {name}".strip()
        maps.append(_map(recorder, outline, params, view, drawn, resolution, instance, stored, kept))
        if partial and params.rays:
            # What is nearest to the light tells where any of them lies in its way.
            instance, kept = f"{instance} partial", shared.PARTIAL
            own = _map(recorder, outline, params, view, drawn & partial, resolution, instance, 1, kept)
            partial_maps.append(own)
        inner = view
    eye = recorder.shot.origin
    leaves_edges = _leaves_edges(params, light.emitter)
    spacing = 1 if params.method == Method.AREA else params.spacing

    def backproject(maps: list[Node], tables: list[Node], method: Method, leave_edges: bool) -> Node:
        return recorder.step(
            steps.BACKPROJECT if spacing == 1 else steps.SPACED_BACKPROJECT,
            points,
            *maps,
            *tables,
            instance=light.name,
            eye=eye,
            emitter=light.emitter,
            method=method.value,
            max_samples=_max_samples(params, light.emitter, away),
            refinements=params.refinements,
            spacing=spacing,
            maps=len(maps),
            leave_edges=leave_edges,
        )

    tables = _tables(recorder, outline, light, close, views)
    shadow = backproject(maps, tables, params.method, leaves_edges)
    if partial_maps:
        is_sun = light.emitter.kind == EmitterKind.DISTANT_DISK
        shadow = recorder.step(
            steps.LEAVE_PARTIAL,
            shadow,
            backproject(partial_maps, [], Method.BITMASK, is_sun),
            instance=light.name,
        )
    if params.method == Method.HYBRID or close or leaves_edges or partial_maps:
        recorder.reads_instances(casters)
        accelerator = shared.ray_accelerator(outline, recorder.shot)
        shadow = recorder.step(
            steps.RAYS,
            surface,
            shadow,
            accelerator,
            method=params.method.value,
            rays=params.rays,
            **of_rays,
        )
    return shadow


def _distances(outline: Outline, emitter: Emitter, casters: frozenset[int]) -> np.ndarray:
    """(C,) metres from the light to each of `casters` at least, in order: to its triangles, as soon as they
    are there, where its box comes close to a spot or a point."""

    def find() -> np.ndarray:
        away = distances_of_boxes(emitter, outline.instances.boxes_of(casters))
        reach = AROUND * emitter.half_width
        if outline.distance_m is not None and emitter.kind in ROUND_KINDS and reach > 0.0:
            ordered = np.array(sorted(casters))
            for place in np.flatnonzero(away <= reach):
                away[place] = outline.distance_m(int(ordered[place]), emitter.centre, reach)
        return away

    key = ("distances", emitter.kind, emitter.centre, emitter.half_width, casters)
    return outline.instances.memo((*key, outline.distance_m is None), find)


def _reaching_out(outline, inner, light: Light, casters, away, receivers) -> frozenset[int]:
    """Casters that count beside the window of the map `inner`."""

    def find() -> frozenset[int]:
        boxes = outline.instances.boxes_of(casters)
        out = reaching_out_of(inner, light.emitter, boxes, away, receivers)
        return frozenset(np.array(sorted(casters))[out].tolist())

    key = ("reaching out", inner, light.emitter, casters, away.tobytes(), receivers.tobytes())
    return outline.instances.memo(key, find)


def _map(recorder: Recorder, outline, params, view, casters, resolution, name, layers, kept: str) -> Node:
    size = resolution, resolution
    depth = shared.layered_depth(recorder, outline, view, casters, layers, size, name, kept)
    return recorder.step(
        steps.PREPARE,
        depth,
        instance=name,
        view=view,
        gradient_scale=params.gradient_scale,
        gradient_cap_m=params.gradient_cap_m,
    )


def _close_casters(params, emitter: Emitter, casters: frozenset[int], away: np.ndarray) -> frozenset[int]:
    """Those that may hide a part of the light where its maps do not look, if rays are to look there."""
    has_rim = emitter.kind in ROUND_KINDS and emitter.half_width >= close_casters.SMALLEST_RADIUS_M
    if not has_rim or params.method == Method.AREA or not params.rays:
        return frozenset()
    ordered = np.array(sorted(casters), int)
    return frozenset(ordered[away <= close_casters.reach_m(emitter)].tolist())


def _leaves_edges(params, emitter: Emitter) -> bool:
    """Whether rays answer where a sun's shadow has an edge among the texels around a point."""
    is_sun = emitter.kind == EmitterKind.DISTANT_DISK
    return is_sun and params.method != Method.AREA and params.rays > 0


def _max_samples(params, emitter: Emitter, away: np.ndarray) -> int:
    is_close = emitter.kind in ROUND_KINDS and (away < CLOSE * emitter.half_width).any()
    return params.max_samples * (CLOSE_SAMPLES if is_close and params.method != Method.AREA else 1)


def _tables(recorder, outline, light: Light, close: frozenset[int], views) -> list[Node]:
    """Where to doubt each map for what is close to the light; none where nothing is."""
    if not close:
        return []
    emitter = light.emitter
    size = close_casters.RESOLUTION, close_casters.RESOLUTION
    depths = [
        shared.layered_depth(recorder, outline, view, close, 1, size, f"{light.name} close {name}")
        for name, view in close_casters.surrounding_views(emitter)
    ]
    return [
        recorder.step(
            steps.CLOSE_CASTERS, *depths, instance=f"{light.name} {name}".strip(), emitter=emitter, view=view
        )
        for name, view in views
    ]


def _has_size(light: Light) -> bool:
    emitter = light.emitter
    if emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
        return emitter.half_width > 0.0 or emitter.half_height > 0.0
    return emitter.half_width > 0.0


def _report_idle_instances(recorder: Recorder, outline: Outline, seen: np.ndarray) -> None:
    """Objects that are neither seen nor cast into view are never read."""
    needed = outline.instances.subset(seen), recorder.instances
    names = outline.instances.memo(("idle", *needed), lambda: _others(outline, *needed))
    shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    if names:
        recorder.left_out(f"Objects {shown}", "neither in view nor casting a shadow into it")


def _others(outline: Outline, seen: frozenset[int], read: frozenset[int]) -> list[str]:
    """Names of the instances that are neither, those of most triangles first."""
    triangles: dict[str, int] = {}
    for index, each in enumerate(outline.instances):
        if index not in seen and index not in read:
            triangles[each.name] = max(triangles.get(each.name, 0), outline.meshes[each.mesh].triangles)
    return sorted(triangles, key=lambda name: (-triangles[name], name))
