"""GPU twins of the steps in lit.py."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...core.emitter import Emitter, EmitterKind
from ...core.shader import LARGEST, Shader
from .joins import Join
from .membership import mask_table

MOST_SHADOWS = 4  # layers that may scale one light

MATERIAL_COLOUR = Shader(
    "effects/shared/material_colour.glsl",
    samplers=(("material", "UINT_2D"), ("colours", "FLOAT_2D")),
    images=(("colour", "RGBA32F", "WRITE"),),
    params=("size",),
)
TEXTURE_COLOUR = Shader(
    "effects/shared/texture_colour.glsl",
    samplers=(("material", "UINT_2D"), ("uv", "FLOAT_2D"), ("texels", "FLOAT_2D")),
    images=(("colour", "RGBA32F", "WRITE"),),
    params=("size", "which"),
)
IRRADIANCE = Shader(
    "effects/shared/irradiance.glsl",
    samplers=(("position", "FLOAT_2D"), ("shading_normal", "FLOAT_2D")),
    images=(("result", "R32F", "WRITE"),),
    params=("size", "centre", "right", "up", "forward", "radiance"),
)
COMPOSITE = Shader(
    "effects/shared/composite.glsl",
    samplers=(("albedo", "FLOAT_2D"),),
    images=(("total", "RGBA32F", "READ_WRITE"),),
    params=("size", "share"),
)
FIRST = replace(COMPOSITE, defines=("FIRST",), images=(("total", "RGBA32F", "WRITE"),))
FIRST_OF_PART = FIRST.defining("PART")


def _irradiance_variant(kind: EmitterKind, single: bool, linked: bool) -> Shader:
    shader = IRRADIANCE.defining(kind.name, *["SINGLE"] * single, *["LINKED"] * linked)
    if linked:
        more = (("instance", "UINT_2D"), ("receives", "FLOAT_2D"))
        shader = replace(shader, samplers=(*shader.samplers, *more))
    return shader


def _light_variant(shadows: int) -> Shader:
    images = (("irradiance", "FLOAT_2D"), *((f"shadow{i}", "FLOAT_2D") for i in range(shadows)))
    shader = COMPOSITE.defining("LIGHT", f"SHADOWS {shadows}")
    return replace(shader, samplers=(*shader.samplers, *images))


def _join_variant(join: Join, grey: bool, part: bool = False) -> Shader:
    shader = COMPOSITE.defining(join.name, *["GREY"] * grey, *["PART"] * part)
    return replace(shader, samplers=(("layer", "FLOAT_2D"),))


def variants() -> Iterator[Shader]:
    """Every program that these steps may compile."""
    yield from (MATERIAL_COLOUR, TEXTURE_COLOUR, FIRST, FIRST_OF_PART)
    for kind in EmitterKind:
        for single in (False, True):
            for linked in (False, True):
                yield _irradiance_variant(kind, single, linked)
    for shadows in range(MOST_SHADOWS + 1):
        yield _light_variant(shadows)
    for join in (Join.MULTIPLY, Join.ADD, Join.OVER):
        for grey in (False, True) if join != Join.OVER else (False,):
            yield _join_variant(join, grey)
    yield _join_variant(Join.OVER, False, part=True)


def material_colour(device, surface, colours, images, version):
    """An image (h, w, 4), as the kernel of the same name."""
    found = surface["material"]
    shape = found.shape[:2]
    size = shape[::-1]
    rows = np.ones((max(len(colours), 1), 4), np.float32)
    rows[: len(colours), :3] = np.reshape(colours, (-1, 3))
    table = device.upload_table(rows)
    result = device.new_image((*shape, 4))
    device.dispatch(
        MATERIAL_COLOUR, size, {"colour": result}, {"material": found, "colours": table}, {"size": size}
    )
    device.release(table)
    for material, image in images:
        texels = device.texture(image)
        if texels is not None:
            samplers = {"material": found, "uv": surface["uv"], "texels": texels}
            params = {"size": size, "which": (material, texels.shape[1], texels.shape[0])}
            device.dispatch(TEXTURE_COLOUR, size, {"colour": result}, samplers, params)
    return result


def irradiance(device, surface, eye, emitter: Emitter, receivers):
    """An image (h, w), as the kernel of the same name."""
    shape = surface["position"].shape[:2]
    size = shape[::-1]
    area = emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE)
    half = emitter.half_width, emitter.half_height if area else emitter.half_width
    single = bool(max(half) <= 0.0)
    # From the camera's eye, in float64, as everything that both see.
    centre = np.array(emitter.centre, np.float64) - np.array(eye, np.float64)
    edge = (1.0 - emitter.cos_cone) * emitter.blend
    params = {
        "size": size,
        "centre": (*centre, min(emitter.tan_half_spread, LARGEST)),
        "right": (*emitter.right, half[0]),
        "up": (*emitter.up, half[1]),
        "forward": (*emitter.forward, _spread_scale(emitter.tan_half_spread)),
        "radiance": (1.0 - emitter.cos_cone if emitter.cos_cone > -1.0 else LARGEST, 1.0 / max(edge, 1e-12)),
    }
    samplers = {name: surface[name] for name in ("position", "shading_normal")}
    table = None
    if receivers is not None:
        table = mask_table(device, receivers)
        samplers |= {"instance": surface["instance"], "receives": table}
    result = device.new_image(shape)
    shader = _irradiance_variant(emitter.kind, single, receivers is not None)
    device.dispatch(shader, size, {"result": result}, samplers, params)
    device.release(table)
    return result


def _spread_scale(tangent: float) -> float:
    """1 / (tan_half_spread - half_spread), as kernels/src/emitter/sample.rs."""
    if tangent <= 0.0 or not np.isfinite(tangent):
        return 0.0
    if tangent < 1e-2:
        return 3.0 / (tangent**3 * (1.0 - 0.6 * tangent * tangent))  # the difference cancels
    return float(1.0 / (tangent - np.arctan(tangent)))


def composite(device, albedo, *inputs, joins, is_rest=True):
    """An image (h, w, 4), as the kernel of the same name."""
    shape = albedo.shape[:2]
    size = shape[::-1]
    total = device.new_image((*shape, 4))
    first = FIRST if is_rest else FIRST_OF_PART
    device.dispatch(first, size, {"total": total}, {"albedo": albedo}, {"size": size, "share": ()})
    queue = iter(inputs)
    for kind, *details in joins:
        image = next(queue)
        params = {"size": size, "share": ()}
        if kind == Join.LIGHT.value:
            radiance, shadows = details
            if shadows > MOST_SHADOWS:
                raise ValueError(f"{shadows} layers scale one light, at most {MOST_SHADOWS} can")
            params["share"] = tuple(channel / np.pi for channel in radiance)
            samplers = {"albedo": albedo, "irradiance": image}
            samplers |= {f"shadow{i}": next(queue) for i in range(shadows)}
            shader = _light_variant(shadows)
        else:
            is_veil = kind == Join.OVER.value and not is_rest
            shader, samplers = _join_variant(Join(kind), image.channels == 1, is_veil), {"layer": image}
        device.dispatch(shader, size, {"total": total}, samplers, params)
    return total
