"""The order of work, the same on every device."""

from __future__ import annotations

import numpy as np

from ...core.culling import around, casters_of, receivers_in_view, unlit_reason
from ...core.effect import Need
from ...core.emitter import EmitterKind
from ...core.graph import Node
from ...core.outline import Outline
from ...core.recorder import Recorder
from ...core.roles import Of, Role
from ..shared import lit, terminator
from ..shared import steps as shared
from . import pattern, steps
from .lights import luminance, packed_lights
from .object_settings import excluded_instances, ramps_of, settings_of, without_outline
from .params import NO_CREASE, Anchor, Light, Normals, ShadowEdge, ToonParams, Unit

NO_RIM = 1.0, 0.0, 0.0, 0.0, 0.0
"""Width, strength and colour: those of none are no reason to shade anew."""


def needed(outline: Outline) -> str | None:
    """Why there is nothing to shade, or None."""
    return None if outline.instances else "the scene has no surfaces"


def ruled_out(kind, light, params: ToonParams | None, has_media: bool) -> bool:
    """Whether the dots or the lines are switched off."""
    from . import HALFTONE, OUTLINE

    if params is None:
        return False
    no_dots = not params.halftone or _no_dots(params) is not None
    return (kind is HALFTONE and no_dots) or (kind is OUTLINE and not params.outline)


def run(recorder: Recorder, outline: Outline, params: ToonParams) -> None:
    """The toon image, then dots and lines over it."""
    from . import HALFTONE, OUTLINE, TOON

    seen, receivers = receivers_in_view(outline, recorder.shot)
    if not seen.any():
        recorder.left_out("Toon", "nothing is in view")
        return
    visible = outline.instances.subset(seen)
    excluded = excluded_instances(outline)
    if visible <= excluded:
        recorder.left_out("Toon", "everything in view is excluded from it")
        return
    normal = "geometric_normal" if params.normals == Normals.FLAT else "shading_normal"
    surface = shared.surface(recorder, outline, normal)
    light, casters = _light(recorder, outline, params, surface, normal, visible, around(receivers))
    shaded = _shade(recorder, outline, params, surface, light, normal, visible)
    recorder.layer(TOON, shaded, casters=casters)
    if not params.halftone:
        recorder.left_out("Toon Halftone", "it is switched off")
    elif reason := _no_dots(params):
        recorder.left_out("Toon Halftone", reason)
    elif recorder.shot_has(HALFTONE.needs, "Toon Halftone"):
        node = _halftone(recorder, outline, params, surface, light, excluded)
        used = outline.instances.materials_of(visible - excluded)
        if any(settings_of(outline.materials[m]).excluded for m in used):
            node = recorder.step(steps.SPARE, node, shaded)
        recorder.layer(HALFTONE, node, casters=casters)
    if not params.outline:
        recorder.left_out("Toon Outline", "it is switched off")
    elif recorder.shot_has(OUTLINE.needs, "Toon Outline"):
        _outline(recorder, outline, params, surface, visible, excluded, OUTLINE)


# Light


def _light(recorder, outline, params, surface, normal, visible, region) -> tuple[Node, frozenset[int]]:
    """How far along the ramp each point is, and the instances that cast shadow on it."""
    chosen = _chosen_lights(recorder, outline, params, visible, region)
    shadows = [_shadow(recorder, outline, params, index, surface, normal, region) for index in chosen]
    casters = frozenset().union(*(shadow[1] for shadow in shadows if shadow))
    lights = [outline.lights[index] for index in chosen]
    shadowed = tuple(shadow is not None for shadow in shadows)
    if not lights:
        return recorder.step(steps.UNLIT, surface, normal=normal), casters
    if params.light == Light.BRIGHTNESS:
        inputs = []
        for light, shadow in zip(lights, shadows, strict=True):
            inputs += [lit.irradiance(recorder, surface, light), *([shadow[0]] if shadow else [])]
        weights = tuple(params.exposure * _luminance_of_brightness(light) for light in lights)
        return recorder.step(steps.BRIGHTNESS, *inputs, weights=weights, shadowed=shadowed), casters
    linked = tuple(light.receivers for light in lights)
    if any(light.emitter.kind != EmitterKind.DISTANT_DISK for light in lights):
        recorder.surface(surface, "position")
    if any(receivers is not None for receivers in linked):
        recorder.surface(surface, "instance")
    node = recorder.step(
        steps.FACING,
        surface,
        *(shadow[0] for shadow in shadows if shadow),
        normal=normal,
        lights=packed_lights(lights, recorder.shot.origin),
        shadowed=shadowed,
        linked=linked,
    )
    return node, casters


def _shadow(recorder, outline, params, index, surface, normal, region) -> tuple[Node, frozenset[int]] | None:
    """Visibility of a light from each point and what casts it, or None where nothing does."""
    light = outline.lights[index]
    if not params.shadows:
        return None
    if params.shadow_edge == ShadowEdge.SOFT:
        return recorder.ask(Role.VISIBILITY, Of.lamp(index))
    casters = casters_of(light, outline.instances, region) if light.casts_shadow else frozenset()
    if not casters:
        return None
    is_smooth = params.normals != Normals.FLAT
    offsets = terminator.offsets_of(outline, recorder.shot) if is_smooth else None
    lifted = terminator.READ if offsets is not None else ()
    recorder.surface(surface, "position", "geometric_normal", *lifted)
    recorder.reads_instances(casters)
    is_distant = light.emitter.kind == EmitterKind.DISTANT_DISK
    place = (
        -np.array(light.emitter.forward)
        if is_distant
        else light.emitter.centre - np.array(recorder.shot.origin)
    )
    node = recorder.step(
        steps.CRISP_SHADOW,
        surface,
        shared.ray_accelerator(outline, recorder.shot),
        instance=light.name,
        normal=normal,
        place=tuple(place.tolist()),
        is_distant=is_distant,
        casters=casters,
        offsets=offsets,
    )
    return node, casters


def _luminance_of_brightness(light) -> float:
    """Luminance of what the irradiance kernel's result is per unit of."""
    full = luminance(light)
    colour, intensity = lit.brightness(light), light.intensity
    largest = max(range(3), key=lambda k: intensity[k])
    return full * colour[largest] / intensity[largest] if full > 0.0 else 0.0


def _chosen_lights(recorder, outline, params, visible, region) -> list[int]:
    """Those that count; the others are noted."""
    chosen = []
    for index, light in enumerate(outline.lights):
        if params.key_light and not light.is_called(params.key_light):
            reason = f"only '{params.key_light}' counts"
        elif luminance(light) <= 0.0:
            reason = "no power"
        else:
            reason = unlit_reason(light, visible, region)
        if reason is None:
            chosen.append(index)
            continue
        recorder.left_out(f"Toon light {light.name}", reason, light.name)
    if not chosen:
        known = any(light.is_called(params.key_light) for light in outline.lights)
        reason = "no light shines on what is in view: all is shade"
        if params.key_light and not known:
            reason = f"there is no light '{params.key_light}': all is shade"
        recorder.left_out("Toon light", reason)
    return chosen


# Layers


def _shade(recorder, outline, params, surface, light, normal, visible) -> Node:
    ramps = ramps_of(outline, params)
    has_rim = params.rim > 0.0 and recorder.shot_has({Need.EYE}, "Toon rim")
    recorder.surface(surface, "material", *(["instance"] if ramps.instances is not None else []))
    if has_rim:
        recorder.surface(surface, "position")
    used = outline.instances.materials_of(visible)
    glows = params.emission > 0.0 and any(outline.materials[m].emission_varies for m in used)
    # What is not the same all over a material is added after.
    black = (0.0, 0.0, 0.0)
    table = [(*m.base_color, *(black if glows else m.emission)) for m in outline.materials]
    varies = any(outline.materials[m].base_color_varies for m in used)
    base = [lit.base_colour(recorder, outline, surface)] if varies else []
    shaded = recorder.step(
        steps.SHADE,
        surface,
        light,
        *base,
        normal=normal,
        table=np.array(table, np.float32).reshape(-1, 6),
        mix=params.mix.value,
        emission=params.emission,
        rim=(params.rim_width, params.rim, *params.rim_color) if has_rim else NO_RIM,
        forward=recorder.shot.view.forward if has_rim and recorder.shot.view.orthographic else None,
        **ramps.as_params(),
    )
    if not glows:
        return shaded
    emission = lit.emission(recorder, outline, surface, visible)
    return recorder.step(steps.GLOW, shaded, emission, strength=params.emission)


def _no_dots(params: ToonParams) -> str | None:
    """Why no dot would be seen, or None."""
    if params.halftone_opacity <= 0.0:
        return "its ink is transparent"
    if params.halftone_scale < params.halftone_cutoff or params.halftone_scale <= 0.0:
        return "its largest dots are below its cutoff"
    if params.halftone_fade_end_m <= 0.0:
        return "it has faded everywhere"
    return None


def _halftone(recorder, outline, params, surface, light, excluded) -> Node:
    attributes, settings = ["instance"], pattern.settings(params, recorder.shot)
    if params.halftone_anchor == Anchor.SURFACE:
        attributes += ["position", "geometric_normal"]
    elif settings["fade"][0]:
        attributes.append("position")
    recorder.surface(surface, *attributes)
    inked = np.ones(len(outline.instances), np.uint8)
    inked[sorted(excluded)] = 0
    return recorder.step(
        steps.HALFTONE,
        surface,
        light,
        anchors=pattern.anchors(params, outline, recorder.shot.source),
        inked=inked.tobytes(),
        **settings,
    )


def _outline(recorder, outline, params, surface, visible, excluded, kind) -> None:
    chosen = visible - excluded - without_outline(outline)
    drawn = {index: settings_of(outline.instances[index]) for index in sorted(chosen)}
    crease = None if params.crease_angle >= NO_CREASE else float(np.cos(params.crease_angle))
    has_lines = params.object_lines or params.material_lines or crease is not None
    in_pixels = params.outline_unit == Unit.PIXEL
    width = params.outline_width_px if in_pixels else params.outline_width_m
    if not drawn:
        recorder.left_out("Toon Outline", "no object in view has one")
        return
    if (width <= 0.0 or params.outline_most_px <= 0.0) and not has_lines:
        recorder.left_out("Toon Outline", "its width is 0")
        return
    geometry = shared.geometry(recorder, outline)
    view = recorder.shot.view
    if params.outline_thickness:
        recorder.wants(f"vertex:{params.outline_thickness}")
    hull = recorder.step(
        steps.HULL,
        geometry,
        view=view,
        pixel=(view.window[3] - view.window[2]) / recorder.shot.computed_size[1],
        instances=tuple(drawn),
        width=width,
        in_pixels=in_pixels,
        least=min(params.outline_least_px, params.outline_most_px),
        most=params.outline_most_px,
        scales=tuple(settings.outline_scale for settings in drawn.values()),
        thickness=params.outline_thickness,
    )
    colours = np.tile(np.array(params.outline_color, np.float32), (len(outline.instances), 1))
    for index, settings in drawn.items():
        if settings.use_outline_color:
            colours[index] = settings.outline_color
    lines = []
    if has_lines:
        wanted = ["instance"] + ["object_id"] * params.object_lines + ["material"] * params.material_lines
        wanted += ["shading_normal"] if crease is not None else []
        lines.append(
            recorder.step(
                steps.LINES,
                recorder.surface(surface, *wanted),
                marked=frozenset(drawn),
                width=params.line_width_px,
                objects=params.object_lines,
                materials=params.material_lines,
                crease=crease,
            )
        )
        if crease is not None:
            recorder.wants("corner_normals")
    recorder.surface(surface, "depth", *(["instance"] if lines else []))
    ink = recorder.step(
        steps.OUTLINE, surface, recorder.step(steps.HULL_GEOMETRY, hull), *lines, view=view, colours=colours
    )
    recorder.layer(kind, ink)
