"""The order of work, the same on every device."""

from __future__ import annotations

import math

import numpy as np

from ...core.culling import (
    boxes_of,
    casters_of,
    corners_of,
    frustum_corners,
    lights_region,
    partly_opaque,
)
from ...core.emitter import EmitterKind
from ...core.graph import Node
from ...core.outline import Light, Outline
from ...core.recorder import Recorder
from ...core.roles import Of, Subject
from ...core.view import Vector, View
from ..shared import steps as shared
from ..shared.light_views import NamedView, distant_view, point_views
from . import steps
from .media import Fill, fill_of, surely_none
from .params import Method, VolumetricLightParams
from .sources import Source, SourceKind, sources_of

MEDIUM_LAYERS = 8
"""Entries and exits of a bounded medium that are kept, along camera rays and from lights."""

MEDIUM_RESOLUTION = 512
"""Texels of a side of the map of a medium from a light: its depths change slowly."""


def needed(outline: Outline) -> str | None:
    """Why the scene has no volumetric light to compute, or None. Whether there is a medium is for the
    parameters to say."""
    if not outline.instances and not outline.lights:
        return "the scene is empty"
    return None


def ruled_out(kind, light: Light | None, params: VolumetricLightParams | None, has_media: bool) -> bool:
    """Whether no frame has the layer, whatever moves."""
    no_medium = params is not None and surely_none(params, has_media)
    return no_medium or (kind.of is Subject.LAMP and light is not None and light.is_dark)


def run(recorder: Recorder, outline: Outline, params: VolumetricLightParams) -> None:
    """One layer for each light that the medium scatters towards the eye, and one of transmittance."""
    from . import EFFECT

    fill, left_out = fill_of(outline, params)
    for what, reason in left_out:
        recorder.left_out(what, reason)
    if fill is None:
        lacks = (
            "give the world or an object a volume" if params.use_scene_medium else "its coefficients are 0"
        )
        return recorder.left_out("Volumetric Light", f"no fog ({lacks})")
    boxes = boxes_of(outline)
    region = _region(outline, recorder.shot.view, fill, boxes)
    if region is None:
        return recorder.left_out("Volumetric Light", "the medium is not in view")
    surface = shared.surface(recorder, outline, "depth")
    stride = params.scale.stride
    if not any(fill.medium.scattering):
        recorder.left_out("Volumetric Light, scattering", "the medium only absorbs")
    for index in recorder.lamps_for(EFFECT.layers[0]):
        light = outline.lights[index]
        if not any(fill.medium.scattering):
            break
        if reason := _unneeded(light, region):
            recorder.left_out(f"Volumetric {light.name}", reason, light.name)
            continue
        casters = casters_of(light, outline.instances, region) if light.casts_shadow else frozenset()
        own = recorder.own_params(params, Of.lamp(index))
        parts, shares = [], []
        for number, source in enumerate(sources_of(light, own.light_samples)):
            parts.append(
                _part(recorder, outline, own, stride, fill, surface, light, number, source, casters, region)
            )
            shares.append(source.share)
        scattered = recorder.step(
            steps.SCATTERED,
            surface,
            *parts,
            instance=light.name,
            view=recorder.shot.view,
            intensity=light.intensity,
            shares=tuple(shares),
            stride=stride,
        )
        recorder.layer(EFFECT.layers[0], scattered, Of.lamp(index), casters)
    step, spans = steps.TRANSMITTANCE, []
    if fill.instances is not None:
        step, spans = steps.BOUNDED_TRANSMITTANCE, [_spans(recorder, outline, fill, 1)]
    transmittance = recorder.step(step, surface, *spans, view=recorder.shot.view, medium=fill.medium)
    recorder.layer(EFFECT.layers[1], transmittance)


def _region(outline: Outline, view: View, fill: Fill, boxes: np.ndarray) -> np.ndarray | None:
    """(2, 3): a box around the medium in view, as far as anything in the scene can shadow it; None where
    there is none."""
    everything = corners_of(boxes).reshape(-1, 3)
    lamps = [light.emitter.centre for light in outline.lights if light.kind != "SUN"]
    points = np.concatenate([everything, np.array(lamps, np.float64).reshape(-1, 3)])
    depth = view.to_view(points)[:, 2].max(initial=view.near) if len(points) else view.near
    depth = float(np.clip(2.0 * depth, 2.0 * view.near + 1e-6, max(view.far, 3.0 * view.near)))
    frustum = frustum_corners(view, depth)
    low, high = frustum.min(axis=0), frustum.max(axis=0)
    if fill.instances is not None:
        inside = outline.instances.boxes_of(fill.instances)
        low, high = np.maximum(low, inside[:, 0].min(axis=0)), np.minimum(high, inside[:, 1].max(axis=0))
        if (low > high).any():
            return None
    return np.stack([low, high])


def _unneeded(light: Light, region: np.ndarray) -> str | None:
    if light.is_dark:
        return "no power"
    if not light.lights_media:
        return "its light in volumes is switched off"
    if not lights_region(light, region):
        return "reaches no view ray"
    return None


def _part(recorder, outline, params, stride, fill, surface, light, number, source, casters, region) -> Node:
    """The step that integrates one source of a light."""
    is_only = len(source.eyes) > 1 or not light.emitter.half_width
    name = light.name if is_only else f"{light.name} {number}"
    boxes = outline.instances.boxes_of(casters)
    kept = shared.DRAWN if partly_opaque(outline, casters) else shared.WHOLE
    maps, counts, windows = [], [], 6
    for index, eye in enumerate(source.eyes):
        views = _views(light, source, eye, boxes, region[None]) if casters else []
        point = f"{name} {index}" if len(source.eyes) > 1 else name
        for face, view in views:
            instance = f"{point} {face}".strip()
            size = (params.resolution, params.resolution)
            depth = shared.layered_depth(recorder, outline, view, casters, 1, size, instance, kept)
            maps.append(recorder.step(steps.LIGHT_MAP, depth, instance=instance, view=view))
        counts.append(len(views))
        # A single frustum has no name; around it all is lit. Cube faces leave nothing out.
        windows = 1 if any(face == "" for face, _ in views) else windows
    common = {
        "instance": name,
        "view": recorder.shot.view,
        "medium": fill.medium,
        "source": source,
        "counts": tuple(counts),
        "windows": windows,
        "stride": stride,
    }
    if fill.instances is not None:
        spans = _spans(recorder, outline, fill, stride)
        ways = _ways(recorder, outline, fill, light, source, name)
        inputs = (surface, spans, *maps, *ways)
        return recorder.step(steps.BOUNDED, *inputs, order=params.order, **common)
    if (
        params.method == Method.LUT
        and source.kind == SourceKind.UNIFORM
        and not recorder.shot.view.orthographic
    ):
        reach = _reach(recorder.shot.view, region)
        return recorder.step(steps.BY_TABLE, surface, *maps, reach=reach, **common)
    return recorder.step(steps.AIRLIGHT, surface, *maps, order=params.order, **common)


def _ways(recorder, outline, fill, light, source, name) -> list[Node]:
    """Maps of a bounded medium from a light, for the way that light comes through it."""
    inside = outline.instances.boxes_of(fill.instances)
    ways = []
    for face, view in _views(light, source, source.position, inside, inside):
        instance = f"{name} {face} medium"
        size = (MEDIUM_RESOLUTION, MEDIUM_RESOLUTION)
        depth = shared.layered_depth(recorder, outline, view, fill.instances, MEDIUM_LAYERS, size, instance)
        ways.append(recorder.step(steps.MEDIUM_MAP, depth, instance=instance, view=view))
    return ways


def _spans(recorder: Recorder, outline: Outline, fill: Fill, stride: int) -> Node:
    recorder.reads_instances(fill.instances)
    return recorder.step(
        steps.SPANS,
        shared.geometry(recorder, outline),
        instance="camera",
        view=recorder.shot.view,
        instances=fill.instances,
        layers=MEDIUM_LAYERS,
        stride=stride,
    )


def _views(
    light: Light, source: Source, eye: Vector, boxes: np.ndarray, region: np.ndarray
) -> list[NamedView]:
    """Of `boxes` from a point of the source; a distant one sees them along its axis."""
    emitter = light.emitter
    if source.kind == SourceKind.DISTANT:
        forward = np.array(source.axis)
        right = np.array(emitter.right) - forward * (forward @ emitter.right)
        right /= np.linalg.norm(right)
        return distant_view(
            forward, right, np.cross(forward, right), boxes, corners_of(region).reshape(-1, 3)
        )
    axes = np.array([emitter.right, emitter.up, emitter.forward])
    if source.kind == SourceKind.SPOT and source.cos_cone > 0.0:
        tangent = math.sqrt(1.0 - source.cos_cone**2) / source.cos_cone
        return point_views(eye, axes, tangent, boxes)
    is_area = emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE)
    tangent = source.tan_half_spread if is_area else math.inf
    return point_views(eye, axes, tangent, boxes, behind=not is_area)


def _reach(view: View, region: np.ndarray) -> float:
    """How long rays are at most that a table has to answer for, metres."""
    corners = corners_of(region[None])[0] - np.array(view.eye)
    return float(np.linalg.norm(corners, axis=1).max())
