"""GPU twins of the steps of volumetric light: what to dispatch, in order. The device does the rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from enum import Enum

import numpy as np

from ...core.medium import Medium
from ...core.shader import LARGEST, Shader
from ...core.surface import Chunk
from ...core.view import View
from ..shared import gpu_steps as shared
from .lattice import lattice_of
from .sources import Source, SourceKind

FOLDER = "effects/volumetric_light"
FURTHEST_M = 1e18  # that a source is from the eye (source.rs)
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
    samplers=(("depth", "FLOAT_2D"), ("nodes", "FLOAT_2D"), ("offsets", "FLOAT_2D")),
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
TABLE = Shader(
    f"{FOLDER}/table.glsl",
    images=(("table", "RGBA32F", "WRITE"),),
    params=("size", "table", *MEDIUM_PARAMS),
)
TABLE_SIZE = (256, 512)  # distances and angles, as table.rs
TRANSMITTANCE = Shader(
    f"{FOLDER}/transmittance.glsl",
    samplers=(("depth", "FLOAT_2D"), ("offsets", "FLOAT_2D")),
    images=(("result", "RGBA32F", "WRITE"),),
    params=("size", "first", "extinction", "range"),
)
_PROFILES = {SourceKind.UNIFORM: (), SourceKind.SPOT: ("SPOT",), SourceKind.AREA: ("AREA",)}


class Reach(Enum):
    """Which medium, and how its light is found: everywhere, the same by the table; within meshes around the
    light, and within others, where the way that light has come is looked up."""

    EVERYWHERE = ()
    TABLED = ("TABLE",)
    AROUND = ("BOUNDED",)
    LOOKED_UP = ("BOUNDED", "LOOKED_UP")


_MORE = {  # by define: samplers and parameters
    "TABLE": ((("table", "FLOAT_2D"),), ("table",)),
    "BOUNDED": ((("spans", "FLOAT_2D"),), ("spans",)),
    "LOOKED_UP": ((("way", "FLOAT_2D"),), ("way_map", "way_window", "way_x", "way_y", "way_z")),
}


def _airlight_variant(kind: SourceKind, window: str, parallel: bool, reach=Reach.EVERYWHERE) -> Shader:
    """`window`: "none" (no shadows), "one" (what is outside it is lit) or "face"."""
    distant = kind == SourceKind.DISTANT
    defines = ["DISTANT"] if distant else list(_PROFILES[kind])
    defines += {"none": ["UNSHADOWED"], "one": ["OUTSIDE"], "face": []}[window]
    defines += ["ORTHOGRAPHIC"] * (distant and window != "none") + ["PARALLEL"] * parallel
    return _extended(AIRLIGHT.defining(*defines), reach.value, window != "none")


def _extended(shader: Shader, defines: tuple[str, ...], pyramid: bool = False) -> Shader:
    samplers, params = shader.samplers, shader.params
    if pyramid:
        samplers = (*samplers, ("pyramid", "FLOAT_2D"))
    for define in defines:
        samplers, params = (*samplers, *_MORE[define][0]), (*params, *_MORE[define][1])
    return replace(shader, defines=(*shader.defines, *defines), samplers=samplers, params=params)


def variants() -> Iterator[Shader]:
    """Every program that these steps may compile."""
    yield from (MAP_BASE, MAP_BASE.defining("ORTHOGRAPHIC"), MAP_LEVEL, SCATTERED, UPSAMPLE, TABLE)
    for parallel in (False, True):
        for bounded in (False, True):
            yield _transmittance_variant(parallel, bounded)
        for kind in SourceKind:
            for window in ("none", "one") if kind == SourceKind.DISTANT else ("none", "one", "face"):
                for reach in Reach:
                    if reach != Reach.TABLED or (kind == SourceKind.UNIFORM and not parallel):
                        yield _airlight_variant(kind, window, parallel, reach)


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


def medium_map(device, depth, view: View):
    """A dict: entries and exits from a light; whether all light begins inside and leaves the medium once."""
    layers = device.to_host(depth)
    once = np.isfinite(layers[0]).all() and not np.isfinite(layers[1:]).any()
    return {
        "depths": device.upload(layers),
        "view": view,
        "begins_inside": bool(once and not view.orthographic),
    }


def spans(device, geometry, view: View, instances, layers: int, stride: int, chunk: Chunk):
    """An image (layers, rows, columns) of the lattice. Raises NotImplementedError where pixels are sampled at
    places of their own."""
    if chunk.places is not None:
        raise NotImplementedError("entries and exits at pixels' own places are found on the CPU")
    lattice = lattice_of(view, chunk, stride)
    return shared.layered_depth(
        device, geometry, lattice.seen(), instances, layers, lattice.width, lattice.height
    )


def airlight(device, surface, *maps, **common):
    """An image (rows, columns, 3) of the lattice; as the kernel of the same name. `windows`: how many cube
    faces there are to a light that has any map, 1 for a single frustum; `counts`: maps of each point that
    casts shadows."""
    return _evaluate(device, surface, maps, Reach.EVERYWHERE, {}, {}, (), **common)


def airlight_by_table(device, surface, *maps, reach: float, medium: Medium, source: Source, **common):
    """The same by a table for rays of at most `reach` metres."""
    view = common["view"]
    away = float(np.linalg.norm(np.array(view.eye) - np.array(source.position)))
    table = device.new_image((TABLE_SIZE[1], TABLE_SIZE[0], 3))
    params = {"size": TABLE_SIZE, "table": (reach, away), "walk": ()}
    params |= _medium_params(medium, source, view)
    device.dispatch(TABLE, (TABLE_SIZE[1], 1), {"table": table}, {}, params)
    own = {"table": params["table"]}
    common |= {"medium": medium, "source": source, "order": 8}
    result = _evaluate(device, surface, maps, Reach.TABLED, {"table": table}, own, (), **common)
    device.release(table)
    return result


def bounded_airlight(device, surface, spans, *inputs, counts: tuple[int, ...], **common):
    """The same in a medium that fills meshes: `spans` along the lattice's rays, and after the maps of shadows
    those of the medium."""
    maps, ways = inputs[: sum(counts)], inputs[sum(counts) :]
    is_around = ways and all(way["begins_inside"] for way in ways)
    reach = Reach.AROUND if is_around else Reach.LOOKED_UP
    bound, own = {"spans": spans}, _span_params(spans)
    ways = () if is_around else ways
    return _evaluate(device, surface, maps, reach, bound, own, ways, counts=counts, **common)


def _span_params(spans) -> dict[str, tuple[float, ...]]:
    layers, height, width = spans.shape
    return {"spans": (layers, spans.columns, width, height)}


def _evaluate(
    device,
    surface,
    maps,
    reach: Reach,
    samplers,
    own,
    ways,
    *,
    view: View,
    medium: Medium,
    source: Source,
    windows: int,
    counts: tuple[int, ...],
    order: int,
    stride: int,
    chunk: Chunk,
):
    """`samplers` and `own` parameters of this reach; `ways`: maps of the medium to look up how far light has
    come through it."""
    lattice = lattice_of(view, chunk, stride)
    size, offset = (lattice.width, lattice.height), lattice.shown
    result = device.new_image((size[1], size[0], 3))
    params = {
        "first": (*lattice.first, *lattice.step),
        "right": (*view.right, lattice.origin[0]),
        "up": (*view.up, lattice.origin[1]),
        "forward": (*view.forward, view.near),
        **_medium_params(medium, source, view),
        **own,
    }
    samplers = {"depth": surface["depth"], "nodes": _nodes(device, order), **samplers}
    offsets = device.offsets(chunk)
    samplers["offsets"] = offsets or surface["depth"]
    for number, (window, seen, prepared, points) in enumerate(_passes(maps, counts, windows, ways)):
        shader = _airlight_variant(source.kind, window, view.orthographic, reach)
        now, bound = dict.fromkeys(WINDOW_PARAMS, ()), {}
        if window != "none":
            now = _window_params(seen, prepared and prepared["size"], view)
            bound["pyramid"] = prepared["pyramid"] if prepared else samplers["depth"]
        if reach == Reach.LOOKED_UP:
            way = next((way for way in ways if seen is None or _look_alike(way["view"], seen)), None)
            now |= _way_params(way, view)
            bound["way"] = way["depths"] if way else samplers["depth"]
        now |= {
            "size": (*size, float(number == 0), stride),
            "walk": (order, offset[1], points / len(counts), offsets is not None),
        }
        now["reach"] = (*(now["reach"] or (0, 0, 0)), offset[0])
        device.dispatch(shader, size, {"result": result}, samplers | bound, params | now)
    return result


def _passes(maps, counts, windows: int, ways) -> Iterator[tuple]:
    """For each dispatch the window as `_airlight_variant` has it, its view, its map, None where all in it is
    lit, and how many of the light's points it is for."""
    maps = list(maps)
    # Where the medium is looked up in cube faces, what is lit is cut into the same.
    faces = windows > 1 and len(ways) > 1
    if lit := sum(count == 0 for count in counts):
        if faces:
            yield from (("face", face, None, lit) for face in _faces_beside(ways[0]["view"], []))
        else:
            yield "none", ways[0]["view"] if ways else None, None, lit
    for count in filter(None, counts):
        own, maps = maps[:count], maps[count:]
        views = [each["view"] for each in own]
        yield from (("one" if windows == 1 else "face", each["view"], each, 1) for each in own)
        if windows > 1:
            yield from (("face", face, None, 1) for face in _faces_beside(views[0], views))


def _look_alike(one: View, other: View) -> bool:
    return float(np.dot(one.forward, other.forward)) > 0.9


def _faces_beside(first: View, views: list[View]) -> list[View]:
    """The faces of the cube around a light, whose axes one of them has, that are not among `views`."""
    axes = np.array([first.right, first.up, first.forward])
    have = np.array([view.forward for view in views]).reshape(-1, 3)
    missing = []
    for axis in (*axes, *-axes):
        if (have @ axis).max(initial=-1.0) < 0.9:
            side = axes[np.argmin(np.abs(axes @ axis))]
            up = np.cross(axis, side)
            three = (tuple(map(float, each)) for each in (side, up, axis))
            missing.append(View(first.eye, *three, (-1.0, 1.0, -1.0, 1.0), first.near, first.far))
    return missing


def _way_params(way, view: View) -> dict[str, tuple[float, ...]]:
    if way is None:
        return dict.fromkeys(_MORE["LOOKED_UP"][1], ())
    layers, height, width = way["depths"].shape
    seen = _window_params(way["view"], (width, height, 1), view)
    left, right, bottom, top = way["view"].window
    return {
        "way_map": (width, height, layers, way["depths"].columns),
        "way_window": (left, bottom, 1.0 / (right - left), 1.0 / (top - bottom)),
        **{f"way_{axis}": seen[f"map_{axis}"] for axis in "xyz"},
    }


def _window_params(seen: View, size: tuple[int, int, int] | None, view: View) -> dict[str, tuple[float, ...]]:
    axes = np.array([seen.right, seen.up, seen.forward])
    offset = axes @ (np.array(view.eye, np.float64) - np.array(seen.eye))
    left, right, bottom, top = seen.window
    width, height, levels = size or (1, 1, 1)  # none: all in the window is lit
    near = seen.near if not seen.orthographic else -LARGEST
    return {
        "window": (left, bottom, width / (right - left), height / (top - bottom)),
        "reach": (right, top, near),
        "map": (width, height, levels, float(size is not None)),
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
    elif (away := math.hypot(*relative)) > FURTHEST_M:
        relative *= FURTHEST_M / away
    # As integral.rs `blurring_scale`.
    sharp = math.sqrt((1.0 - g) / g) if medium.anisotropy > 0.5 else 1.0
    near = min(0.5 / max(source.radius, 1e-30) * sharp, LARGEST)
    cone = (0.0, 0.0, 0.0, 0.0)
    if source.kind == SourceKind.SPOT:
        width = (1.0 - source.cos_cone) * max(source.blend, 1e-12)
        inner = min(source.cos_cone + (1.0 - source.cos_cone) * source.blend, 1.0)
        middle = (1.0 - source.cos_cone) - 0.5 * width
        cone = (middle, width, math.acos(source.cos_cone), math.acos(inner))
    elif source.kind == SourceKind.AREA and math.isfinite(source.tan_half_spread):
        spread = source.tan_half_spread
        cone = (spread, 1.0 / (spread - math.atan(spread)), 1.0 / math.hypot(1.0, spread), 0.0)
    return {
        "extinction": (*medium.extinction, medium.anisotropy),
        "scattering": (*medium.scattering, float(alike)),
        "phase": (1 - g, 0.5 * g, near, (1 - g) / (1 + g)),
        "light": (*relative, source.radius),
        "axis": (*source.axis, float(source.is_sphere)),
        "cone": cone,
    }


def _nodes(device, order: int):
    def make():
        places, weights = np.polynomial.legendre.leggauss(order)
        return device.upload(np.stack([0.5 * (places + 1.0), 0.5 * weights], 1)[None].astype(np.float32))

    return device.constant(f"volumetric_light/nodes {order}", make)


def scattered(device, surface, *parts, view: View, intensity, shares, stride: int, chunk: Chunk):
    """An image (rows, width, 3) of all parts together, at every pixel."""
    height, width = parts[0].shape[:2]
    total = device.new_image((height, width, 3))
    for number, (share, part) in enumerate(zip(shares, parts, strict=True)):
        params = {"size": (width, height, float(number == 0)), "share": tuple(share * i for i in intensity)}
        device.dispatch(SCATTERED, (width, height), {"total": total}, {"part": part}, params)
    if stride == 1:
        return total
    rows, columns = chunk.shape
    result = device.new_image((rows, columns, 3))
    # The surface has as many pixels more at each side.
    shown = lattice_of(view, chunk.grown(stride), stride).shown
    params = {"size": (columns, rows, stride), "coarser": (width, height, *shown)}
    device.dispatch(
        UPSAMPLE,
        (columns, rows),
        {"result": result},
        {"coarse": total, "depth": surface["depth"]},
        params,
    )
    device.release(total)
    return result


def transmittance(device, surface, view: View, medium: Medium, chunk: Chunk):
    """An image (rows, width, 3)."""
    return _transmittance(device, surface, view, medium, chunk, {}, {})


def bounded_transmittance(device, surface, spans, view: View, medium: Medium, chunk: Chunk):
    """The same in a medium that fills meshes."""
    return _transmittance(device, surface, view, medium, chunk, {"spans": spans}, _span_params(spans))


def _transmittance_variant(parallel: bool, bounded: bool) -> Shader:
    shader = TRANSMITTANCE.defining("PARALLEL") if parallel else TRANSMITTANCE
    return _extended(shader, ("BOUNDED",) * bounded)


def _transmittance(device, surface, view: View, medium: Medium, chunk: Chunk, samplers, own):
    lattice, offsets = lattice_of(view, chunk), device.offsets(chunk)
    result = device.new_image((lattice.height, lattice.width, 3))
    size = lattice.width, lattice.height
    params = {
        "size": (*size, *lattice.origin),
        "first": (*lattice.first, *lattice.step),
        "extinction": medium.extinction,
        "range": (view.near, offsets is not None),
        **own,
    }
    shader = _transmittance_variant(view.orthographic, bool(own))
    samplers = {"depth": surface["depth"], **samplers, "offsets": offsets or surface["depth"]}
    device.dispatch(shader, size, {"result": result}, samplers, params)
    return result
