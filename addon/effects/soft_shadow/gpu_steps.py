"""GPU twins of the soft shadow steps: what to dispatch, in order. The device does the rest."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.emitter import Emitter, EmitterKind
from ...core.shader import LARGEST, Shader
from ...core.uniforms import Two
from ...core.view import View
from ..shared.membership import mask_table
from .params import Method
from .uniforms import LightParams, MapParams, PrepareParams, PyramidParams
from .views import ROUND_KINDS, share_axes

FOLDER = "effects/soft_shadow"
SAMPLES = 256
BLOCK = 8  # texels a side (prepare.rs)
SMALLEST_LEVEL = 2 * BLOCK  # texels: no level of a map is smaller
SHARPEST = 1e30  # a hard edge (light.rs)
NOWHERE = (LARGEST, -LARGEST, LARGEST, -LARGEST)  # a window that holds nothing

PREPARE = Shader(
    f"{FOLDER}/prepare.glsl",
    samplers=(("depths", "FLOAT_2D"),),
    images=(("texels", "RGBA32UI", "WRITE"), ("pyramid", "RG32F", "WRITE")),
    params=PrepareParams,
    group=(64, 1),  # along a row: of large maps each is a page of memory
)
COARSER = Shader(f"{FOLDER}/coarser.glsl", images=(("texels", "RGBA32UI", "READ_WRITE"),), params=MapParams)
PYRAMID = Shader(f"{FOLDER}/pyramid.glsl", images=(("pyramid", "RG32F", "READ_WRITE"),), params=PyramidParams)
BLOCKS = Shader(
    f"{FOLDER}/blocks.glsl",
    samplers=(("texels", "UINT_2D"),),
    images=(("blocks", "RGBA32UI", "WRITE"),),
    params=MapParams,
    group=(64, 1),
)
FIRST_ROWS = Shader(f"{FOLDER}/first_rows.glsl", images=(("rows", "RG32UI", "WRITE"),))
CHOOSE = Shader(
    f"{FOLDER}/choose.glsl",
    samplers=(
        ("position", "FLOAT_2D"),
        ("geometric_normal", "FLOAT_2D"),
        ("pyramid", "FLOAT_2D"),
        ("texels", "UINT_2D"),
    ),
    images=(("choice", "R32UI", "READ_WRITE"),),
    params=LightParams,
)
BACKPROJECT = Shader(
    f"{FOLDER}/backproject.glsl",
    samplers=(
        ("choice", "UINT_2D"),
        ("position", "FLOAT_2D"),
        ("geometric_normal", "FLOAT_2D"),
        ("shading_normal", "FLOAT_2D"),
    ),
    images=(("visibility", "R32F", "WRITE"), ("uncertain", "R32UI", "WRITE")),
    params=LightParams,
)
RECEIVERS = Shader(
    f"{FOLDER}/receivers.glsl",
    samplers=(("instance", "UINT_2D"), ("receives", "FLOAT_2D"), ("visibility", "FLOAT_2D")),
    images=(("result", "R32F", "WRITE"),),
    params=("size",),
)

RAISED = Shader(
    f"{FOLDER}/raised.glsl",
    samplers=(
        ("position", "FLOAT_2D"),
        ("geometric_normal", "FLOAT_2D"),
        ("shading_normal", "FLOAT_2D"),
        ("terminator_lift", "FLOAT_2D"),
        ("instance", "UINT_2D"),
        ("offsets", "FLOAT_2D"),
    ),
    images=(("raised_position", "RGBA32F", "WRITE"), ("raised_normal", "RGBA32F", "WRITE")),
    params=("size", "light", "spread"),
)


def _map_variant(shader: Shader, orthographic: bool) -> Shader:
    return shader.defining("ORTHOGRAPHIC") if orthographic else shader


def _light_defines(emitter: Emitter, orthographic: bool) -> tuple[str, ...]:
    defines = ["ORTHOGRAPHIC"] * orthographic
    if emitter.kind in ROUND_KINDS:
        defines.append("ROUND")
    if emitter.kind == EmitterKind.FACING_DISK:
        defines.append("FACING")
    if emitter.kind in (EmitterKind.ELLIPSE, EmitterKind.DISTANT_DISK):
        defines.append("ELLIPTIC")
    if emitter.tan_half_spread < LARGEST:
        defines.append("SPREAD")
    if emitter.cos_cone > -1.0:
        defines.append("CONE")
    return tuple(defines)


def _choose_variant(
    defines: tuple[str, ...], method: str, has_table: bool = False, edges: bool = False
) -> Shader:
    """`has_table`: of what close casters may hide; `edges`: hard edges are left to rays."""
    is_hybrid = method == Method.HYBRID.value
    defines = (
        *defines,
        *["DOUBT"] * is_hybrid,
        *["EDGES"] * (edges and not is_hybrid),
        *["CLOSE_CASTERS"] * has_table,
    )
    shader = CHOOSE.defining(*defines)
    return replace(shader, samplers=(*shader.samplers, ("close_casters", "UINT_2D"))) if has_table else shader


def _backproject_variant(defines: tuple[str, ...], method: str, interpolates: bool = False) -> Shader:
    """`method`: a Method's value, or "unmapped"; `interpolates`: for points that a grid of others may
    tell."""
    shader = BACKPROJECT.defining(*defines, *["INTERPOLATES"] * interpolates)
    if interpolates:
        images = (("visibility", "R32F", "READ_WRITE"), ("uncertain", "R32UI", "READ_WRITE"))
        shader = replace(shader, images=images)
    of_map = (("texels", "UINT_2D"), ("pyramid", "FLOAT_2D"))
    of_bitmask = (("blocks", "UINT_2D"), ("first_rows", "UINT_2D"))
    if method == "unmapped":
        return shader.defining("UNMAPPED")
    if method == Method.AREA.value:
        images = (("visibility", "R32F", "READ_WRITE"),)
        return replace(shader.defining("AREA"), samplers=(*shader.samplers, *of_map), images=images)
    shader = replace(shader, samplers=(*shader.samplers, *of_map, *of_bitmask))
    if "NESTED" in defines:
        shader = replace(shader, images=(*shader.images, ("hidden_bits", "RGBA32UI", "READ_WRITE")))
    return shader


def variants() -> Iterator[Shader]:
    """Every program that these steps may compile."""
    yield from (COARSER, PYRAMID, BLOCKS, FIRST_ROWS, RECEIVERS, RAISED)
    for orthographic in (False, True):
        yield _map_variant(PREPARE, orthographic)
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
    for kind in EmitterKind:
        is_area = kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE)
        is_spot = kind in ROUND_KINDS
        for limited in (False, True) if is_area or is_spot else (False,):
            spread = 1.0 if limited and is_area else math.inf
            cone = 0.5 if limited and is_spot else -1.0
            emitter = Emitter(kind, (0.0, 0.0, 0.0), *axes, 1.0, 1.0, spread, cone)
            defines = _light_defines(emitter, kind == EmitterKind.DISTANT_DISK)
            for method in (Method.BITMASK.value, Method.HYBRID.value):
                yield _choose_variant(defines, method)
            yield _choose_variant(defines, Method.BITMASK.value, edges=True)
            for sharing in ((), ("NESTED",)):
                for method in (Method.AREA.value, Method.BITMASK.value):
                    yield _backproject_variant((*defines, *sharing), method)
                yield _backproject_variant((*defines, *sharing), Method.BITMASK.value, interpolates=True)
            if is_spot:
                for method in (Method.BITMASK.value, Method.HYBRID.value):
                    yield _choose_variant(defines, method, has_table=True)
            yield _backproject_variant(defines, "unmapped")


def prepare(device, depth, view: View, gradient_scale: float, gradient_cap_m: float):
    """A dict of the images that map.glsl describes, and what shaders are told of them."""
    layers, height, width = depth.shape
    if not (gradient_scale >= 0.0 and gradient_cap_m >= 0.0):
        raise ValueError("gradient_scale and gradient_cap_m cannot be negative")
    levels = 1
    while min(width, height) >> (levels - 1) >= 2 * SMALLEST_LEVEL:
        levels += 1
    nodes = 1 + math.ceil(math.log2(max(width, height)))
    pairs, cell = (width + 1) // 2, height + height // 2
    columns = device.stack_columns((layers, cell, pairs + levels))
    texels = device.new_image((-(-layers // columns) * cell, columns * (pairs + levels), 4), np.uint32)
    pyramid = device.new_image((height + (height + 1) // 2, width + nodes, 2))
    across, along = -(-width // BLOCK), -(-height // BLOCK)
    # In map.glsl's layout a level may start a block later than the halves before it end.
    blocks = device.new_image((layers * (along + along // 2 + 1), across + levels, 4), np.uint32)
    params = MapParams(
        map_size=(width, height),
        layers=layers,
        columns=columns,
        gradient_scale=gradient_scale,
        gradient_cap_m=min(gradient_cap_m, LARGEST),
        levels=levels,
        nodes=nodes,
    )
    shader, images = _map_variant(PREPARE, view.orthographic), {"texels": texels, "pyramid": pyramid}
    prepare_params = PrepareParams(**vars(params), depth_columns=depth.columns)
    device.dispatch(shader, (pairs, height), images, {"depths": depth}, prepare_params)
    if levels > 1:
        size = pairs + levels, height // 2 * layers
        device.dispatch(COARSER, size, {"texels": texels}, {}, params)
    for level in range(1, nodes):
        size = -(-width // (1 << level)), -(-height // (1 << level))
        device.dispatch(PYRAMID, size, {"pyramid": pyramid}, {}, PyramidParams(**vars(params), level=level))
    size = across + levels, along + along // 2 + 1
    device.dispatch(BLOCKS, size, {"blocks": blocks}, {"texels": texels}, params)
    return {"texels": texels, "pyramid": pyramid, "blocks": blocks, "view": view, "params": params}


def backproject(
    device,
    surface,
    *maps_and_tables,
    eye,
    emitter: Emitter,
    method: str,
    max_samples: int,
    refinements: int,
    spacing: int,
    maps: int,
    leave_edges: bool = False,
):
    """A dict of the images `visibility` and `uncertain`, as the kernels of this step."""
    if max_samples < 1:
        raise ValueError("max_samples is at least 1")
    prepared_maps, tables = maps_and_tables[:maps], maps_and_tables[maps:]
    is_area = method == Method.AREA.value
    if is_area and any(prepared["params"].layers < 2 for prepared in prepared_maps):
        raise ValueError("area needs maps of at least two layers")
    position = surface["position"]
    shape = position.shape[:2]
    size = shape[::-1]
    visibility, uncertain = device.new_image(shape), device.new_image(shape, np.uint8)
    choice = device.new_image(shape, np.uint32)
    device.clear(visibility, 1.0)
    device.clear(uncertain, 0)
    device.clear(choice, 0)
    nests = _nests([prepared["view"] for prepared in prepared_maps])
    settings = {
        "size": size,
        "most_texels": max_samples,
        "refinements": refinements,
        "leaves_uncertain": float(method == Method.HYBRID.value),  # rays will replace it
    }
    outputs = {"visibility": visibility, "uncertain": uncertain}
    written = {"visibility": visibility} if is_area else dict(outputs)
    hidden_bits = {}
    if not is_area and any(end - start > 1 for start, end in nests):
        hidden_bits = {"hidden_bits": device.new_image((shape[0], 2 * shape[1], 4), np.uint32)}
    samplers = {name: surface[name] for name in ("position", "geometric_normal", "shading_normal")}
    samplers |= {"choice": choice, "first_rows": _first_rows(device)}
    runs = []
    for nest in nests:
        for index in range(*nest):
            defines, bound, params = _of_map(prepared_maps, index, nest, emitter, eye)
            start, end = nest
            of_nest = {"index": index, "nest_first": start, "nest_end": end, "is_alone": nests == [nest]}
            runs.append((defines, samplers | bound, replace(params, **settings, **of_nest)))
    for start, end in nests:
        for index in reversed(range(start, end)):
            defines, bound, params = runs[index]
            shader = _choose_variant(defines, method, bool(tables), leave_edges)
            bound = bound | ({"close_casters": tables[index]} if tables else {})
            device.dispatch(shader, size, {"choice": choice}, bound, params)
    if not is_area:  # without a map the thesis's sum is 1
        for view in _default_views(emitter):
            shader = _backproject_variant(_light_defines(emitter, view.orthographic), "unmapped")
            params = LightParams(**_light_params(emitter, view, eye), **settings)
            device.dispatch(shader, size, outputs, samplers, params)
    # All points; or those of a grid, and then what lies between.
    strides = ((1, False),) if spacing == 1 or is_area else ((spacing, False), (1, True))
    for stride, interpolates in strides:
        points = tuple(-(-side // stride) for side in size)
        for defines, bound, params in runs:
            nested = params.nest_end - params.nest_first > 1
            shader = _backproject_variant((*defines, *["NESTED"] * nested), method, interpolates)
            images = written | hidden_bits if nested else written
            strided = replace(params, stride=stride, spacing=spacing)
            device.dispatch(shader, points, images, bound, strided)
    for image in hidden_bits.values():
        device.release(image)
    device.release(choice)
    return outputs


def _nests(views: list[View]) -> list[tuple[int, int]]:
    """First and end of each run of views that share their axes: choose.rs `Maps::new`."""
    starts = [
        index for index in range(len(views)) if not (index and share_axes(views[index - 1], views[index]))
    ]
    return list(itertools.pairwise([*starts, len(views)]))


def _of_map(prepared_maps, index: int, nest: tuple[int, int], emitter: Emitter, eye):
    """What programs that read a map are compiled for, its images, what they are told of it and its light."""
    prepared = prepared_maps[index]
    view = prepared["view"]
    defines = _light_defines(emitter, view.orthographic)
    inner = _seen_from(view, prepared_maps[index - 1]["view"]) if index > nest[0] else NOWHERE
    of_light = _light_params(emitter, view, eye) | _window_params(view, prepared["params"].map_size)
    params = LightParams(**vars(prepared["params"]), **of_light, inner=inner)
    return defines, {name: prepared[name] for name in ("texels", "pyramid", "blocks")}, params


def _seen_from(view: View, other: View) -> tuple[float, ...]:
    """The window of `other` in the coordinates of `view`: choose.rs `seen_from`."""
    shift = np.zeros(2)
    if view.orthographic:
        shift = np.array([view.right, view.up]) @ (np.array(other.eye) - np.array(view.eye))
    return tuple((np.array(other.window) + np.repeat(shift, 2)).tolist())


def visibility(device, shadow):
    """The image `visibility` of a shadow."""
    return shadow["visibility"]


def receivers(device, surface, visibility, receivers: frozenset[int]):
    """An image: `visibility`, and 1 where the instance is not among `receivers`."""
    result = device.new_image(visibility.shape)
    table = mask_table(device, receivers)
    samplers = {"instance": surface["instance"], "receives": table, "visibility": visibility}
    size = visibility.shape[::-1]
    device.dispatch(RECEIVERS, size, {"result": result}, samplers, {"size": size})
    device.release(table)
    return result


def raised(device, surface, eye, emitter: Emitter, offsets: np.ndarray):
    """A surface: its points as the kernel raises them."""
    names = "position", "geometric_normal", "shading_normal", "terminator_lift", "instance"
    shape = surface["position"].shape
    size = shape[1::-1]
    table = device.upload_table(offsets[:, None])
    images = {name: device.new_image(shape) for name in ("raised_position", "raised_normal")}
    is_distant = emitter.kind == EmitterKind.DISTANT_DISK
    light = -np.array(emitter.forward) if is_distant else np.array(emitter.centre) - np.array(eye)
    half_height = 0.0 if emitter.kind in ROUND_KINDS else emitter.half_height
    spread = (
        emitter.half_width if is_distant else math.sqrt(2.0) * math.hypot(emitter.half_width, half_height)
    )
    params = {"size": size, "light": light.tolist(), "spread": (spread, float(is_distant))}
    samplers = {name: surface[name] for name in names} | {"offsets": table}
    device.dispatch(RAISED, size, images, samplers, params)
    device.release(table)
    return {
        "position": images["raised_position"],
        "geometric_normal": images["raised_normal"],
        "shading_normal": surface["shading_normal"],
    }


def _first_rows(device):
    def make():
        rows = device.new_image((SAMPLES + 1, SAMPLES // 32, 2), np.uint32)
        device.dispatch(FIRST_ROWS, rows.size, {"rows": rows})
        return rows

    return device.constant("soft_shadow/first_rows", make)


def _light_params(emitter: Emitter, view: View, eye) -> dict[str, Any]:
    """The light in the axes of a view, composed in float64: light.rs `Light::new`."""
    axes = np.array([view.right, view.up, view.forward])
    offset = np.array(eye, np.float64) - np.array(view.eye)
    edge = (1.0 - emitter.cos_cone) * emitter.blend
    sharpness = min(1.0 / edge, SHARPEST) if edge > 0.0 else SHARPEST
    return {
        "axis_x": view.right,
        "axis_y": view.up,
        "axis_z": view.forward,
        "eye_offset": tuple(axis @ offset for axis in axes),
        "from_light": tuple(offset),
        "half_size": (emitter.half_width, emitter.half_height),
        "tan_half_spread": min(emitter.tan_half_spread, LARGEST),
        "cos_cone": emitter.cos_cone,
        "cone_sharpness": sharpness,
        "cone_axis": tuple(axes @ np.array(emitter.forward)),
    }


def _window_params(view: View, map_size: Two) -> dict[str, Two]:
    left, right, bottom, top = view.window
    width, height = map_size
    return {
        "window_low": (left, bottom),
        "window_high": (right, top),
        "texel_size": ((right - left) / width, (top - bottom) / height),
    }


def _default_views(emitter: Emitter) -> list[View]:
    """Views to see a light in where it needs no map: its own axes, or the six axes of the world."""
    if emitter.kind in ROUND_KINDS:
        unit = np.eye(3)
        axes = [
            (-sign * unit[(axis + 1) % 3], unit[(axis + 2) % 3], sign * unit[axis])
            for axis in range(3)
            for sign in (-1.0, 1.0)
        ]
    else:
        axes = [(emitter.right, emitter.up, emitter.forward)]
    window, orthographic = (-1.0, 1.0, -1.0, 1.0), emitter.kind == EmitterKind.DISTANT_DISK
    return [
        View(emitter.centre, *(tuple(map(float, axis)) for axis in three), window, 0.0, 1.0, orthographic)
        for three in axes
    ]
