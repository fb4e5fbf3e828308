"""GPU twins of the steps in lit.py."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...core.emitter import Emitter, EmitterKind
from ...core.shader import LARGEST, Shader
from .joins import Join, image_count
from .membership import mask_table

MOST_FACTORS = 4
"""Images that scale light in one program."""

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
CORNER_COLOUR = Shader(
    "effects/shared/corner_colour.glsl",
    samplers=(("material", "UINT_2D"), ("by_corner", "FLOAT_2D"), ("corner_colour", "FLOAT_2D")),
    images=(("colour", "RGBA32F", "READ_WRITE"),),
    params=("size",),
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
    params=("size", "share", "grey"),
)
FIRST = replace(COMPOSITE, defines=("FIRST",), images=(("total", "RGBA32F", "WRITE"),))
FIRST_OF_PART = FIRST.defining("PART")
STACK = Shader(
    "effects/shared/over_by_depth.glsl",
    defines=("STACK",),
    samplers=(("layer", "FLOAT_2D"), ("depth", "FLOAT_2D")),
    images=(("colours_out", "RGBA32F", "WRITE"), ("depths_out", "R32F", "WRITE")),
    params=("size", "place"),
)
OVER_BY_DEPTH = Shader(
    "effects/shared/over_by_depth.glsl",
    samplers=(("colours", "FLOAT_2D"), ("depths", "FLOAT_2D")),
    images=(("total", "RGBA32F", "READ_WRITE"),),
    params=("size", "place"),
)


WEIGHT = Shader(
    "effects/shared/weight.glsl",
    samplers=(("colour", "FLOAT_2D"),),
    images=(("weight", "RGBA32F", "WRITE"),),
    params=("size", "share", "grey", "luminance", "limits"),
)


def _irradiance_variant(kind: EmitterKind, single: bool, linked: bool) -> Shader:
    shader = IRRADIANCE.defining(kind.name, *["SINGLE"] * single, *["LINKED"] * linked)
    if linked:
        linking = (("instance", "UINT_2D"), ("receives", "FLOAT_2D"))
        shader = replace(shader, samplers=(*shader.samplers, *linking))
    return shader


def _factor_samplers(factors: int) -> tuple[tuple[str, str], ...]:
    return tuple((f"factor{k}", "FLOAT_2D") for k in range(factors))


def _light_variant(factors: int) -> Shader:
    shader = COMPOSITE.defining("LIGHT", f"FACTORS {factors}")
    samplers = (*shader.samplers, ("irradiance", "FLOAT_2D"), *_factor_samplers(factors))
    return replace(shader, samplers=samplers)


PRODUCT = replace(
    COMPOSITE,
    defines=("PRODUCT", f"FACTORS {MOST_FACTORS}"),
    samplers=_factor_samplers(MOST_FACTORS),
    images=FIRST.images,
)


def _join_variant(join: Join, grey: bool, part: bool = False) -> Shader:
    shader = COMPOSITE.defining(join.name, *["GREY"] * grey, *["PART"] * part)
    return replace(shader, samplers=(("layer", "FLOAT_2D"),))


def _weight_variant(factors: int, is_grey: bool) -> Shader:
    shader = WEIGHT.defining(f"FACTORS {factors}", *["LUMINANCE"] * is_grey)
    images = (("weight", "R32F", "WRITE"),) if is_grey else shader.images
    return replace(shader, samplers=(*shader.samplers, *_factor_samplers(factors)), images=images)


def variants() -> Iterator[Shader]:
    """Every program that these steps may compile."""
    yield from (MATERIAL_COLOUR, TEXTURE_COLOUR, CORNER_COLOUR, FIRST, FIRST_OF_PART, PRODUCT)
    yield from (STACK, OVER_BY_DEPTH, OVER_BY_DEPTH.defining("PART"))
    for kind in EmitterKind:
        for single in (False, True):
            for linked in (False, True):
                yield _irradiance_variant(kind, single, linked)
    for factors in range(MOST_FACTORS + 1):
        yield _light_variant(factors)
        yield from (_weight_variant(factors, is_grey) for is_grey in (False, True))
    for join in (Join.MULTIPLY, Join.ADD, Join.OVER):
        for grey in (False, True) if join != Join.OVER else (False,):
            yield _join_variant(join, grey)
    yield _join_variant(Join.OVER, False, part=True)


def material_colour(device, surface, colours, images, version, by_corner=()):
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
    for material, image, share in images:
        texels = device.texture(image)
        if texels is not None:
            samplers = {"material": found, "uv": surface["uv"], "texels": texels}
            params = {"size": size, "which": (material, texels.shape[1], texels.shape[0], share)}
            device.dispatch(TEXTURE_COLOUR, size, {"colour": result}, samplers, params)
    if by_corner:
        table = device.upload_table(np.isin(np.arange(len(rows)), by_corner)[:, None].astype(np.float32))
        samplers = {"material": found, "by_corner": table, "corner_colour": surface["corner_colour"]}
        device.dispatch(CORNER_COLOUR, size, {"colour": result}, samplers, {"size": size})
        device.release(table)
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
    nothing = {"size": size, "share": (), "grey": ()}
    device.dispatch(first, size, {"total": total}, {"albedo": albedo}, nothing)
    queue = iter(inputs)
    for join in joins:
        kind, *details = join
        image, *later = (next(queue) for _ in range(image_count(join)))
        if kind == Join.OVER_BY_DEPTH.value:
            _lay_over_by_depth(device, total, [image, *later], is_rest)
        elif kind == Join.LIGHT.value:
            factors, made = _folded(device, size, later, nothing)
            share = tuple(channel / np.pi for channel in details[0])
            params = nothing | {"share": share, "grey": _grey(factors)}
            samplers = {"albedo": albedo, "irradiance": image, **_factors(factors)}
            device.dispatch(_light_variant(len(factors)), size, {"total": total}, samplers, params)
            device.release(made)
        else:
            is_veil = kind == Join.OVER.value and not is_rest
            shader = _join_variant(Join(kind), image.channels == 1, is_veil)
            device.dispatch(shader, size, {"total": total}, {"layer": image}, nothing)
    return total


def weight(device, colour, *factors, share, luminance, limits):
    """An image (h, w), or (h, w, 3) without `luminance`, as the step of the same name."""
    shape = colour.shape[:2]
    size = shape[::-1]
    factors, made = _folded(device, size, factors, {"size": size, "share": (), "grey": ()})
    result = device.new_image(shape if luminance else (*shape, 3))
    params = {"size": size, "share": share, "grey": _grey(factors)}
    params |= {"luminance": luminance or (), "limits": limits}
    samplers = {"colour": colour, **_factors(factors)}
    program = _weight_variant(len(factors), luminance is not None)
    device.dispatch(program, size, {"weight": result}, samplers, params)
    device.release(made)
    return result


def _factors(images) -> dict:
    return {f"factor{k}": image for k, image in enumerate(images)}


def _grey(images) -> tuple[float, ...]:
    return tuple(float(image.channels == 1) for image in images)


def _folded(device, size, factors, params) -> tuple[list, list]:
    """As many images that scale light as one program takes, and those of them that were made for it."""
    factors, made = list(factors), []
    while len(factors) > MOST_FACTORS:
        taken, factors = factors[:MOST_FACTORS], factors[MOST_FACTORS:]
        product = device.new_image((*size[::-1], 4))
        device.dispatch(PRODUCT, size, {"total": product}, _factors(taken), params | {"grey": _grey(taken)})
        factors.insert(0, product)
        made.append(product)
    return factors, made


def _lay_over_by_depth(device, total, images, is_rest: bool) -> None:
    """Raises ValueError where no texture is so large that all layers go into it."""
    layers, depths = images[::2], images[1::2]
    height, width = total.shape[:2]
    size, rows = (width, height), height * len(layers)
    stacks = {"colours": device.new_image((rows, width, 4)), "depths": device.new_image((rows, width))}
    for number, (layer, depth) in enumerate(zip(layers, depths, strict=True)):
        outputs = {f"{name}_out": image for name, image in stacks.items()}
        params = {"size": size, "place": (number * height,)}
        device.dispatch(STACK, size, outputs, {"layer": layer, "depth": depth}, params)
    shader = OVER_BY_DEPTH if is_rest else OVER_BY_DEPTH.defining("PART")
    device.dispatch(shader, size, {"total": total}, stacks, {"size": size, "place": (len(layers),)})
    device.release(list(stacks.values()))
