"""GPU twins of the steps of volumetric light: what to dispatch, in order. The device does the rest."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ...core.medium import Medium
from ...core.shader import LARGEST, Shader
from ...core.surface import Chunk
from ...core.view import View
from .lattice import lattice_of, offset_of
from .sources import Source, SourceKind

FOLDER = "effects/volumetric_light"
ALIKE = 4.0  # extinctions that differ by less are integrated over the same nodes (medium.rs)

MAP_PARAMS = ("size", "level")
MAP_BASE = Shader(
    f"{FOLDER}/light_map.glsl",
    defines=("FIRST",),
    samplers=(("depths", "FLOAT_2D"),),
    images=(("pyramid", "RG32F", "WRITE"),),
    params=MAP_PARAMS,
)
MAP_LEVEL = Shader(
    f"{FOLDER}/light_map.glsl", images=(("pyramid", "RG32F", "READ_WRITE"),), params=MAP_PARAMS
)
RAY_PARAMS = ("size", "first", "right", "up", "forward")
MEDIUM_PARAMS = ("extinction", "scattering", "phase", "light", "axis", "cone", "walk")
WINDOW_PARAMS = ("window", "reach", "map", "map_x", "map_y", "map_z")
AIRLIGHT = Shader(
    f"{FOLDER}/airlight.glsl",
    samplers=(("depth", "FLOAT_2D"), ("nodes", "FLOAT_2D")),
    images=(("result", "RGBA32F", "READ_WRITE"),),
    params=(*RAY_PARAMS, *MEDIUM_PARAMS, *WINDOW_PARAMS),
)
SCATTERED = Shader(
    f"{FOLDER}/scattered.glsl",
    samplers=(("part", "FLOAT_2D"),),
    images=(("total", "RGBA32F", "READ_WRITE"),),
    params=("size", "share"),
)
UPSAMPLE = Shader(
    f"{FOLDER}/upsample.glsl",
    samplers=(("coarse", "FLOAT_2D"), ("depth", "FLOAT_2D")),
    images=(("result", "RGBA32F", "WRITE"),),
    params=("size", "coarser"),
)
TRANSMITTANCE = Shader(
    f"{FOLDER}/transmittance.glsl",
    samplers=(("depth", "FLOAT_2D"),),
    images=(("result", "RGBA32F", "WRITE"),),
    params=("size", "first", "extinction", "range"),
)
_PROFILES = {SourceKind.UNIFORM: (), SourceKind.SPOT: ("SPOT",), SourceKind.AREA: ("AREA",)}


def _airlight_variant(kind: SourceKind, window: str, parallel: bool) -> Shader:
    """`window`: "none" (no shadows), "one" (what is outside it is lit) or "face"."""
    distant = kind == SourceKind.DISTANT
    defines = ["DISTANT"] if distant else list(_PROFILES[kind])
    defines += {"none": ["UNSHADOWED"], "one": ["OUTSIDE"], "face": []}[window]
    defines += ["ORTHOGRAPHIC"] * (distant and window != "none") + ["PARALLEL"] * parallel
    shader = AIRLIGHT.defining(*defines)
    if window == "none":
        return shader
    return Shader(
        shader.source,
        defines=shader.defines,
        samplers=(*shader.samplers, ("pyramid", "FLOAT_2D")),
        images=shader.images,
        params=shader.params,
    )


def variants() -> Iterator[Shader]:
    """Every program that these steps may compile."""
    yield from (MAP_BASE, MAP_BASE.defining("ORTHOGRAPHIC"), MAP_LEVEL, SCATTERED, UPSAMPLE, TRANSMITTANCE)
    yield TRANSMITTANCE.defining("PARALLEL")
    for parallel in (False, True):
        for kind in SourceKind:
            for window in ("none", "one") if kind == SourceKind.DISTANT else ("none", "one", "face"):
                yield _airlight_variant(kind, window, parallel)


def light_map(device, depth, view: View):
    """A dict: the image of all levels, one above the other, and what shaders are told of it."""
    _, height, width = depth.shape
    sizes = [(width, height)]
    while max(sizes[-1]) > 1:
        sizes.append((-(-sizes[-1][0] // 2), -(-sizes[-1][1] // 2)))
    starts = np.cumsum([0, *(rows for _, rows in sizes)]).tolist()
    pyramid = device.new_image((starts[-1], width, 2))
    base = MAP_BASE.defining("ORTHOGRAPHIC") if view.orthographic else MAP_BASE
    device.dispatch(
        base, sizes[0], {"pyramid": pyramid}, {"depths": depth}, {"size": (*sizes[0], 0, 0), "level": (0, 0)}
    )
    for level in range(1, len(sizes)):
        params = {"size": (*sizes[level], *sizes[level - 1]), "level": (starts[level], starts[level - 1])}
        device.dispatch(MAP_LEVEL, sizes[level], {"pyramid": pyramid}, {}, params)
    return {"pyramid": pyramid, "view": view, "size": (width, height, len(sizes))}


def airlight(
    device,
    surface,
    *maps,
    view: View,
    medium: Medium,
    source: Source,
    windows: int,
    order: int,
    stride: int,
    chunk: Chunk,
):
    """An image (rows, columns, 3) of the lattice; as the kernel of the same name. `windows`: how many cube
    faces there are to a light that has any map, 1 for a single frustum."""
    lattice = lattice_of(view, chunk, stride)
    size = lattice.width, lattice.height
    offset = offset_of(chunk.width, stride), offset_of(chunk.y1 - chunk.y0, stride)
    result = device.new_image((size[1], size[0], 3))
    params = {
        "first": (*lattice.first, *lattice.step),
        "right": view.right,
        "up": view.up,
        "forward": (*view.forward, view.near),
        "walk": (order, offset[1]),
        **_medium_params(medium, source, view),
    }
    samplers = {"depth": surface["depth"], "nodes": _nodes(device, order)}
    if not maps:
        shader = _airlight_variant(source.kind, "none", view.orthographic)
        own = dict.fromkeys(WINDOW_PARAMS, ()) | {"size": (*size, 1, stride), "reach": (0, 0, 0, offset[0])}
        device.dispatch(shader, size, {"result": result}, samplers, params | own)
        return result
    shader = _airlight_variant(source.kind, "one" if windows == 1 else "face", view.orthographic)
    missing = _lit_faces([each["view"] for each in maps]) if windows > 1 else []
    passes = [(each["view"], each) for each in maps] + [(face, None) for face in missing]
    for number, (seen, prepared) in enumerate(passes):
        own = _window_params(seen, prepared, view) | {"size": (*size, float(number == 0), stride)}
        own["reach"] = (*own["reach"], offset[0])
        bound = samplers | {"pyramid": (prepared or maps[0])["pyramid"]}
        device.dispatch(shader, size, {"result": result}, bound, params | own)
    return result


def _lit_faces(views: list[View]) -> list[View]:
    """The faces of the cube around a light that nothing to shadow it lies in."""
    first = views[0]
    axes = np.array([first.right, first.up, first.forward])
    have = np.array([view.forward for view in views])
    missing = []
    for axis in (*axes, *-axes):
        if (have @ axis).max() < 0.9:
            side = axes[np.argmin(np.abs(axes @ axis))]
            up = np.cross(axis, side)
            three = (tuple(map(float, each)) for each in (side, up, axis))
            missing.append(View(first.eye, *three, (-1.0, 1.0, -1.0, 1.0), first.near, first.far))
    return missing


def _window_params(seen: View, prepared, view: View) -> dict[str, tuple[float, ...]]:
    axes = np.array([seen.right, seen.up, seen.forward])
    offset = axes @ (np.array(view.eye, np.float64) - np.array(seen.eye))
    left, right, bottom, top = seen.window
    width, height, levels = prepared["size"] if prepared else (1, 1, 1)
    near = seen.near if not seen.orthographic else -LARGEST
    return {
        "window": (left, bottom, width / (right - left), height / (top - bottom)),
        "reach": (right, top, near),
        "map": (width, height, levels, float(prepared is not None)),
        "map_x": (*axes[0], offset[0]),
        "map_y": (*axes[1], offset[1]),
        "map_z": (*axes[2], offset[2]),
    }


def _medium_params(medium: Medium, source: Source, view: View) -> dict[str, tuple[float, ...]]:
    g = abs(medium.anisotropy)
    used = [e for s, e in zip(medium.scattering, medium.extinction, strict=True) if s > 0.0]
    alike = not used or max(used) <= ALIKE * min(used)
    relative = np.array(source.position) - np.array(view.eye)
    if source.kind == SourceKind.DISTANT:
        relative = np.zeros(3)
    cone = (0.0, 0.0, 0.0, 0.0)
    if source.kind == SourceKind.SPOT:
        sharp = min(1.0 / max(source.blend, 1e-12), 1e12)
        inner = source.cos_cone + (1.0 - source.cos_cone) * source.blend
        cone = (source.cos_cone, 1.0 / (1.0 - source.cos_cone), sharp, inner)
    elif source.kind == SourceKind.AREA and math.isfinite(source.tan_half_spread):
        spread = source.tan_half_spread
        cone = (spread, 1.0 / (spread - math.atan(spread)), 1.0 / math.hypot(1.0, spread), 0.0)
    return {
        "extinction": (*medium.extinction, medium.anisotropy),
        "scattering": (*medium.scattering, float(alike)),
        "phase": ((1 - g) ** 2, 4 * g, (1 - g) * (1 + g) / (4 * math.pi), (1 - g) / (1 + g)),
        "light": (*relative, source.radius),
        "axis": (*source.axis, float(source.is_sphere)),
        "cone": cone,
    }


def _nodes(device, order: int):
    def make():
        places, weights = np.polynomial.legendre.leggauss(order)
        return device.upload(np.stack([0.5 * (places + 1.0), 0.5 * weights], 1)[None].astype(np.float32))

    return device.kept(f"volumetric_light/nodes {order}", make)


def scattered(device, surface, *parts, intensity, shares, stride: int, chunk: Chunk):
    """An image (rows, width, 3) of all parts together, at every pixel."""
    height, width = parts[0].shape[:2]
    total = device.new_image((height, width, 3))
    for number, (share, part) in enumerate(zip(shares, parts, strict=True)):
        params = {"size": (width, height, float(number == 0)), "share": tuple(share * i for i in intensity)}
        device.dispatch(SCATTERED, (width, height), {"total": total}, {"part": part}, params)
    if stride == 1:
        return total
    rows = chunk.y1 - chunk.y0
    result = device.new_image((rows, chunk.width, 3))
    offset = offset_of(chunk.width, stride), offset_of(rows, stride)
    params = {"size": (chunk.width, rows, stride), "coarser": (width, height, *offset)}
    device.dispatch(
        UPSAMPLE,
        (chunk.width, rows),
        {"result": result},
        {"coarse": total, "depth": surface["depth"]},
        params,
    )
    device.release(total)
    return result


def transmittance(device, surface, view: View, medium: Medium, chunk: Chunk):
    """An image (rows, width, 3)."""
    lattice = lattice_of(view, chunk)
    result = device.new_image((lattice.height, lattice.width, 3))
    size = lattice.width, lattice.height
    params = {
        "size": size,
        "first": (*lattice.first, *lattice.step),
        "extinction": medium.extinction,
        "range": (view.near,),
    }
    shader = TRANSMITTANCE.defining("PARALLEL") if view.orthographic else TRANSMITTANCE
    device.dispatch(shader, size, {"result": result}, {"depth": surface["depth"]}, params)
    return result
