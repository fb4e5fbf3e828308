"""GPU twins of the toon steps: what to dispatch, in order. The device does the rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ...core.shader import Shader
from ...core.surface import Chunk
from ...core.uniforms import Three, Two, Uniforms
from ...core.view import View
from ..shared import gpu_steps as shared
from ..shared.membership import mask_table
from .lights import ToonLight
from .pattern import Pattern, pattern_of

FOLDER = "effects/toon"
MIXES = {"soft_light": 0, "multiply": 1, "ramp": 2}


@dataclass(frozen=True)
class FacingParams(ToonLight):
    """A light, and the tile's columns and rows."""

    size: Two = (0.0, 0.0)


@dataclass(frozen=True)
class BrightnessParams(Uniforms):
    """`share` of a light's irradiance that counts."""

    size: Two
    share: float


@dataclass(frozen=True)
class ShadeParams(Uniforms):
    """`mix`: one of MIXES; `emission`: share of it; `rim_width`: a cosine; `rim_strength` of `rim_color`;
    `forward` counts where `orthographic` is 1."""

    size: Two
    mix: float
    emission: float
    rim_width: float
    rim_strength: float
    rim_color: Three
    forward: Three
    orthographic: float


@dataclass(frozen=True)
class HalftoneParams(Pattern):
    """The pattern, and the tile's columns and rows."""

    size: Two


FACING = Shader(f"{FOLDER}/facing.glsl", images=(("summed", "RG32F", "READ_WRITE"),), params=FacingParams)
RAMP_POSITION = Shader(
    f"{FOLDER}/ramp_position.glsl",
    samplers=(("summed", "FLOAT_2D"),),
    images=(("result", "R32F", "WRITE"),),
    params=("size",),
)
SHADE = Shader(
    f"{FOLDER}/shade.glsl",
    samplers=(
        *(("light", "FLOAT_2D"), ("material", "UINT_2D")),
        *((name, "FLOAT_2D") for name in ("materials", "pieces", "ranges")),
    ),
    images=(("colour_out", "RGBA32F", "WRITE"),),
    params=ShadeParams,
)
HALFTONE = Shader(
    f"{FOLDER}/halftone.glsl",
    samplers=(
        ("light", "FLOAT_2D"),
        ("position", "FLOAT_2D"),
        ("instance", "UINT_2D"),
        ("anchors", "FLOAT_2D"),
    ),
    images=(("result", "R32F", "WRITE"),),
    params=HalftoneParams,
)
SPARE = Shader(
    f"{FOLDER}/spare.glsl",
    samplers=(("dots", "FLOAT_2D"), ("shaded", "FLOAT_2D")),
    images=(("result", "R32F", "WRITE"),),
    params=("size",),
)
GLOW = Shader(
    f"{FOLDER}/glow.glsl",
    samplers=(("shaded", "FLOAT_2D"), ("emission", "FLOAT_2D")),
    images=(("result", "RGBA32F", "WRITE"),),
    params=("size",),
)
OUTLINE = Shader(
    f"{FOLDER}/outline.glsl",
    samplers=(
        *(("depth", "FLOAT_2D"), ("hull_depth", "FLOAT_2D")),
        *(("hull_instance", "UINT_2D"), ("colours", "FLOAT_2D")),
    ),
    images=(("ink", "RGBA32F", "WRITE"),),
    params=("size",),
)
LINES = Shader(
    f"{FOLDER}/lines.glsl",
    samplers=(("instance", "UINT_2D"), ("marked", "FLOAT_2D")),
    images=(("result", "R32UI", "WRITE"),),
    params=("size", "line"),
)


def _variant(shader: Shader, wanted: dict[str, bool], samplers: dict[str, tuple] | None = None) -> Shader:
    """With the defines that are wanted, and the samplers that each of them brings."""
    defines = [name for name, on in wanted.items() if on]
    more = [sampler for name in defines for sampler in (samplers or {}).get(name, ())]
    return replace(shader, defines=tuple(defines), samplers=(*shader.samplers, *more))


def _facing_variant(first: bool, brightness: bool, shadowed: bool, linked: bool) -> Shader:
    wanted = {"FIRST": first, "BRIGHTNESS": brightness, "SHADOWED": shadowed, "LINKED": linked}
    samplers = {
        "BRIGHTNESS": (("irradiance", "FLOAT_2D"),),
        "SHADOWED": (("visibility", "FLOAT_2D"),),
        "LINKED": (("instance", "UINT_2D"), ("receives", "FLOAT_2D")),
    }
    shader = _variant(FACING, wanted, samplers)
    if brightness:
        return replace(shader, params=BrightnessParams)
    return replace(shader, samplers=(("position", "FLOAT_2D"), ("normal", "FLOAT_2D"), *shader.samplers))


def _shade_variant(base: bool, by_instance: bool, rim: bool) -> Shader:
    samplers = {
        "BASE": (("base", "FLOAT_2D"),),
        "BY_INSTANCE": (("instance", "UINT_2D"), ("instance_ramps", "FLOAT_2D")),
        "RIM": (("position", "FLOAT_2D"), ("normal", "FLOAT_2D")),
    }
    return _variant(SHADE, {"BASE": base, "BY_INSTANCE": by_instance, "RIM": rim}, samplers)


def _halftone_variant(anchor: str, has_places: bool = False) -> Shader:
    wanted = {"OBJECT": anchor == "object", "SURFACE": anchor == "surface", "PLACES": has_places}
    more = {"SURFACE": (("geometric_normal", "FLOAT_2D"),), "PLACES": (("offsets", "FLOAT_2D"),)}
    return _variant(HALFTONE, wanted, more)


def _outline_variant(lines: bool) -> Shader:
    return _variant(OUTLINE, {"LINES": lines}, {"LINES": (("lines", "UINT_2D"), ("instance", "UINT_2D"))})


def _lines_variant(objects: bool, materials: bool, creases: bool) -> Shader:
    samplers = {
        "OBJECTS": (("object_id", "UINT_2D"),),
        "MATERIALS": (("material", "UINT_2D"),),
        "CREASES": (("shading_normal", "FLOAT_2D"),),
    }
    return _variant(LINES, {"OBJECTS": objects, "MATERIALS": materials, "CREASES": creases}, samplers)


def variants() -> Iterator[Shader]:
    """Every program that these steps may compile."""
    either = (False, True)
    yield from (RAMP_POSITION, SPARE, GLOW)
    for brightness, first, shadowed, linked in product(either, repeat=4):
        if not (brightness and linked):
            yield _facing_variant(first, brightness, shadowed, linked)
    for wanted in product(either, repeat=3):
        yield _shade_variant(*wanted)
        if any(wanted):
            yield _lines_variant(*wanted)
    for anchor in ("screen", "object", "surface"):
        yield from (_halftone_variant(anchor, has_places) for has_places in (False, True))
    for lines in either:
        yield _outline_variant(lines)


def facing(device, surface, *visibility, normal, lights, shadowed, linked):
    """An image (h, w), as the kernel of the same name."""
    images = iter(visibility)
    shape = surface[normal].shape[:2]
    size = shape[::-1]
    summed = device.new_image((*shape, 2))
    for index, (light, shadow, receivers) in enumerate(zip(lights, shadowed, linked, strict=True)):
        # Suns do not ask where a point is.
        samplers = {"position": surface.get("position", surface[normal]), "normal": surface[normal]}
        table = None
        if shadow:
            samplers["visibility"] = next(images)
        if receivers is not None:
            table = mask_table(device, receivers)
            samplers |= {"instance": surface["instance"], "receives": table}
        params = FacingParams(**vars(ToonLight.of(light)), size=size)
        shader = _facing_variant(index == 0, False, shadow, receivers is not None)
        device.dispatch(shader, size, {"summed": summed}, samplers, params)
        device.release(table)
    return _ramp_position(device, summed, shape)


def brightness(device, *images, weights, shadowed):
    """An image (h, w), as the CPU twin."""
    queue = iter(images)
    summed = None
    for index, (weight, shadow) in enumerate(zip(weights, shadowed, strict=True)):
        samplers = {"irradiance": next(queue)}
        if shadow:
            samplers["visibility"] = next(queue)
        shape = samplers["irradiance"].shape[:2]
        size = shape[::-1]
        summed = summed or device.new_image((*shape, 2))
        params = BrightnessParams(size, weight / np.pi)
        shader = _facing_variant(index == 0, True, shadow, False)
        device.dispatch(shader, size, {"summed": summed}, samplers, params)
    return _ramp_position(device, summed, shape)


def _ramp_position(device, summed, shape):
    result, size = device.new_image(shape), shape[::-1]
    device.dispatch(RAMP_POSITION, size, {"result": result}, {"summed": summed}, {"size": size})
    device.release(summed)
    return result


def unlit(device, surface, normal):
    """An image (h, w) of zeros."""
    result = device.new_image(surface[normal].shape[:2])
    device.clear(result, 0.0)
    return result


def shade(
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
    """An image (h, w, 4), as the kernel of the same name."""
    shape = light.shape[:2]
    size = shape[::-1]
    rows = np.zeros((max(len(table), 1), 2, 4), np.float32)
    rows[: len(table), 0, :3], rows[: len(table), 0, 3] = table[:, :3], materials
    rows[: len(table), 1, :3] = table[:, 3:]
    of_ramps = np.zeros((len(pieces), 5, 4), np.float32)
    of_ramps[:, 0, 0], of_ramps[:, 1:] = pieces[:, 0], pieces[:, 1:].reshape(-1, 4, 4)
    ranges = np.zeros((len(clamps), 4), np.float32)
    ranges[:, 0], ranges[:, 1], ranges[:, 2] = starts[:-1], np.diff(starts), clamps
    made = {
        "materials": device.upload_table(rows.reshape(-1, 4)),
        "pieces": device.upload_table(of_ramps.reshape(-1, 4)),
        "ranges": device.upload_table(ranges),
    }
    if instances is not None:
        made["instance_ramps"] = device.upload_table(instances.astype(np.float32)[:, None])
    samplers = {"light": light, "material": surface["material"], **made}
    if base:
        samplers["base"] = base[0]
    if instances is not None:
        samplers["instance"] = surface["instance"]
    has_rim = rim[1] > 0.0
    if has_rim:
        samplers |= {"position": surface["position"], "normal": surface[normal]}
    params = ShadeParams(
        size=size,
        mix=MIXES[mix],
        emission=emission,
        rim_width=rim[0],
        rim_strength=rim[1],
        rim_color=rim[2:],
        forward=forward or (0.0, 0.0, 0.0),
        orthographic=float(forward is not None),
    )
    result = device.new_image((*shape, 4))
    shader = _shade_variant(bool(base), instances is not None, has_rim)
    device.dispatch(shader, size, {"colour_out": result}, samplers, params)
    device.release(made)
    return result


def halftone(device, surface, light, anchors, inked, chunk: Chunk, **pattern):
    """An image (h, w), as the kernel of the same name."""
    shape = light.shape[:2]
    size = shape[::-1]
    rows = np.zeros((max(len(anchors), 1), 4, 4), np.float32)
    rows[: len(anchors), :3] = anchors.reshape(-1, 3, 4)
    rows[: len(anchors), 3, 0] = np.frombuffer(inked, np.uint8)
    table = device.upload_table(rows.reshape(-1, 4))
    samplers = {"light": light, "anchors": table}
    # Dots on the screen that do not fade do not ask where a point is.
    samplers |= {"position": surface.get("position", light), "instance": surface["instance"]}
    if pattern["anchor"] == "surface":
        samplers["geometric_normal"] = surface["geometric_normal"]
    params = HalftoneParams(**vars(pattern_of(chunk, **pattern)), size=size)
    result = device.new_image(shape)
    if (offsets := device.offsets(chunk)) is not None:
        samplers["offsets"] = offsets
    shader = _halftone_variant(pattern["anchor"], offsets is not None)
    device.dispatch(shader, size, {"result": result}, samplers, params)
    device.release(table)
    return result


def spare(device, dots, shaded):
    """An image (h, w), as the CPU's twin."""
    size = dots.shape[1::-1]
    result = device.new_image(dots.shape[:2])
    device.dispatch(SPARE, size, {"result": result}, {"dots": dots, "shaded": shaded}, {"size": size})
    return result


def glow(device, shaded, emission, strength):
    """An image (h, w, 4), as the CPU's twin."""
    size = shaded.shape[1::-1]
    result, samplers = device.new_image(shaded.shape), {"shaded": shaded, "emission": emission}
    device.dispatch(GLOW, size, {"result": result}, samplers, {"size": (*size, strength)})
    return result


def outline(device, surface, hull, *lines, view: View, colours, chunk: Chunk):
    """An image (h, w, 4), as the kernel of the same name."""
    everything = frozenset(range(hull.instance_count))
    seen = shared.surface(device, hull, view, everything, chunk, frozenset({"depth", "object_id"}))
    shape = surface["depth"].shape[:2]
    size = shape[::-1]
    rows = np.zeros((max(len(colours), 1), 4), np.float32)
    rows[: len(colours), :3] = colours
    table = device.upload_table(rows)
    samplers = {"depth": surface["depth"], "hull_depth": seen["depth"], "hull_instance": seen["object_id"]}
    samplers["colours"] = table
    if lines:
        samplers |= {"lines": lines[0], "instance": surface["instance"]}
    result = device.new_image((*shape, 4))
    device.dispatch(_outline_variant(bool(lines)), size, {"ink": result}, samplers, {"size": size})
    device.release([seen, table])
    return result


def line_reach(width: int) -> int:
    """How far lines of this width look around a pixel (kernels/src/effects/toon/edges.rs, `disc`)."""
    return width // 2 + 1


def lines(device, surface, marked, width, objects, materials, crease):
    """An image (h, w) uint8, as the kernel of the same name."""
    margin = line_reach(width)
    names = ["instance"] + ["object_id"] * objects + ["material"] * materials
    names += ["shading_normal"] if crease is not None else []
    table = device.upload_table(device.instance_mask(marked).astype(np.float32)[:, None])
    rows, columns = (side - 2 * margin for side in surface["instance"].shape[:2])
    result = device.new_image((rows, columns), np.uint8)
    params = {"size": (columns, rows, margin), "line": (width, -2.0 if crease is None else crease)}
    shader = _lines_variant(objects, materials, crease is not None)
    samplers = {**{name: surface[name] for name in names}, "marked": table}
    device.dispatch(shader, (columns, rows), {"result": result}, samplers, params)
    device.release(table)
    return result
