"""GPU twins of the shared steps: what to draw and dispatch, in order. The device does the rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from ...core.shader import Shader
from ...core.surface import ATTRIBUTES, Chunk
from ...core.view import View
from .membership import mask_table

RULES = ("whole", "partial", "drawn")
"""What is kept of what is not wholly opaque (steps.py), as shaders know it."""
MAX_LAYERS = 16  # as kernels/src/raster/layers.rs
MAX_SIDE = 32768  # as kernels/src/raster/camera.rs
TRIANGLES_OF_BOX = 2  # as pull.glsl
IMAGES_AT_ONCE = 7  # OpenGL promises 8 image units

VERTEX_SAMPLERS = tuple(
    (name, "FLOAT_2D") for name in ("blocks", "runs", "triangles", "positions", "matrices")
)
VARYINGS = (("flat", "VEC2", "range"), ("flat", "UVEC2", "ids"))
LAYERED_DEPTH = Shader(
    "effects/shared/layered_depth.glsl",
    vertex="effects/shared/pull.glsl",
    samplers=VERTEX_SAMPLERS,
    atomic_images=("sorted",),
    params=("draw", "range", "map", "last", "front", "back", "rule"),
    varyings=VARYINGS,
    outputs=(("UVEC2", "nothing"),),
)
UNSORT = Shader(
    "effects/shared/unsort.glsl",
    samplers=(("sorted", "UINT_2D"),),
    images=(("depths", "R32F", "WRITE"),),
    params=("size",),
    group=(64, 1),
)
VISIBILITY = Shader(
    "effects/shared/visibility.glsl",
    vertex="effects/shared/pull.glsl",
    samplers=VERTEX_SAMPLERS,
    params=("draw", "range", "depth", "front", "back", "rule"),
    varyings=VARYINGS,
    outputs=(("UVEC2", "nearest"),),
    writes_depth=True,
)
SURFACE = Shader(
    "effects/shared/surface.glsl",
    samplers=(
        ("nearest", "UINT_2D"),
        *((name, "FLOAT_2D") for name in ("runs", "triangles", "positions", "matrices")),
    ),
    params=("size", "window", "right", "up", "forward"),
)


def raster_variant(
    shader: Shader, orthographic: bool, is_tested: bool, by_corner: bool = False, has_places: bool = False
) -> Shader:
    """The raster program for a kind of view, which looks each fragment's opacity up or not; `has_places`:
    pixels are sampled at their own."""
    samplers, varyings, defines, params = shader.samplers, shader.varyings, [], shader.params
    smooth = []
    if has_places:
        defines.append("PLACES")
        varyings = (*varyings, *(("flat", "VEC4", f"corner_{each}") for each in "abc"))
        samplers, params = (*samplers, ("offsets", "FLOAT_2D")), (*params, "places")
    if orthographic:
        defines.append("ORTHOGRAPHIC")
        smooth.append(("smooth", "FLOAT", "linear_depth"))
    if is_tested:
        defines.append("TESTED")
        varyings = (*varyings, ("flat", "UVEC2", "side"))
        smooth.append(("smooth", "VEC2", "uv"))
        samplers = (*samplers, *((name, "FLOAT_2D") for name in ("corner_uvs", "front", "back")))
    if by_corner:
        defines.append("BY_CORNER")
        smooth.append(("smooth", "FLOAT", "factor"))
        samplers = (*samplers, ("corner_opacity", "FLOAT_2D"))
    varyings = varyings if has_places else (*varyings, *smooth)
    return replace(_replaced(shader, samplers, varyings, defines), params=params)


def surface_variant(
    attributes: tuple[str, ...], orthographic: bool, has_holes: bool = False, has_places: bool = False
) -> Shader:
    """The program that writes these attributes, at most IMAGES_AT_ONCE."""
    carried = {name: ATTRIBUTES[name] for name in attributes}
    tables = dict.fromkeys(each.corners for each in carried.values() if each.corners)
    names = (*tables, *(["holdouts"] * has_holes), *(["offsets"] * has_places))
    samplers = (*SURFACE.samplers, *((name, "FLOAT_2D") for name in names))
    formats = {1: "R32F", 2: "RG32F", 3: "RGBA32F"}
    images = tuple(
        (f"{name}_out", formats[each.channels] if each.dtype == np.float32 else "R32UI", "WRITE")
        for name, each in carried.items()
    )
    defines = [name.upper() for name in attributes] + ["ORTHOGRAPHIC"] * orthographic
    defines += ["HOLDOUTS"] * has_holes + ["PLACES"] * has_places
    return _replaced(SURFACE, samplers, (), defines, images)


def _replaced(shader: Shader, samplers, varyings, defines, images=()) -> Shader:
    return replace(shader, samplers=samplers, varyings=varyings, defines=tuple(defines), images=tuple(images))


def variants() -> Iterator[Shader]:
    """Every program that these steps may compile."""
    yield UNSORT
    for orthographic in (False, True):
        for looks_up in ((False,), (True,), (True, True)):
            yield raster_variant(LAYERED_DEPTH, orthographic, *looks_up)
            for has_places in (False, True):
                tested = (*looks_up, False)[:2]
                yield raster_variant(VISIBILITY, orthographic, *tested, has_places)
        for first in range(0, len(ATTRIBUTES), IMAGES_AT_ONCE):
            names = tuple(sorted(ATTRIBUTES))[first : first + IMAGES_AT_ONCE]
            for has_holes, has_places in product((False, True), repeat=2):
                yield surface_variant(names, orthographic, has_holes, has_places)


def geometry(device, scene):
    return device.geometry()


def surface(
    device,
    geometry,
    view: View,
    visible: frozenset[int],
    chunk: Chunk,
    attributes,
    seed=0,
    holdouts: frozenset[int] = frozenset(),
):
    """A dict of images, as the CPU's twin has arrays."""
    size, shape = (chunk.width, chunk.height), chunk.shape
    _check_view(view, size)
    offsets = device.offsets(chunk)
    nearest = device.new_image((*shape, 2), np.uint32)
    device.clear(nearest, 0)
    low, high = geometry.depth_bounds(view, visible)
    low = view.near if view.orthographic else 0.0
    reach = max(min(high, view.far) - low, 1e-30)
    depth_scale = 2.0 ** -np.ceil(np.log2(reach) + 1e-6)  # a power of two: scaling rounds nothing
    matrices = geometry.clip_matrices(view, (chunk.y0, chunk.y1), size, chunk.jitter, (chunk.x0, chunk.x1))
    depth = device.new_depth((shape[1], shape[0]))
    drawn = geometry.draw_list(visible, "seen", "drawn")
    rule = RULES.index("drawn"), chunk.sample, chunk.x0, chunk.y0
    _draw_all(
        device, VISIBILITY, geometry, drawn, view, high, nearest, depth, matrices,
        {}, {"depth": (low, depth_scale), "rule": rule}, seed, offsets, chunk,
    )  # fmt: skip
    return _attributes(device, geometry, drawn, view, chunk, sorted(attributes), nearest, holdouts)


def _attributes(device, geometry, drawn, view: View, chunk: Chunk, names: list[str], nearest, holdouts):
    size, (rows, columns) = (chunk.width, chunk.height), chunk.shape
    left, right, bottom, top = view.window
    step = (right - left) / size[0], (top - bottom) / size[1]
    first = (
        left + (0.5 + chunk.jitter[0]) * step[0],
        bottom + (0.5 + chunk.jitter[1]) * step[1],
    )
    params = {
        "size": (columns, rows, chunk.x0, chunk.y0),
        "window": (*first, *step),
        "right": (*view.right, view.near),
        "up": view.up,
        "forward": view.forward,
    }
    samplers = {
        "nearest": nearest,
        "runs": drawn.runs,
        "triangles": geometry.triangles,
        "positions": geometry.positions,
        "matrices": geometry.eye_matrices(view),
    }
    if (offsets := device.offsets(chunk)) is not None:
        samplers["offsets"] = offsets
    images, holes = {}, mask_table(device, holdouts) if holdouts else None
    if holdouts:
        samplers["holdouts"] = holes
    for start in range(0, len(names), IMAGES_AT_ONCE):
        group = tuple(names[start : start + IMAGES_AT_ONCE])
        for name in group:
            each = ATTRIBUTES[name]
            shape = (rows, columns) if each.channels == 1 else (rows, columns, each.channels)
            images[name] = device.new_image(shape, each.dtype)
            if each.corners:
                samplers[each.corners] = getattr(geometry, each.corners)
        outputs = {f"{name}_out": images[name] for name in group}
        shader = surface_variant(group, view.orthographic, bool(holdouts), offsets is not None)
        device.dispatch(shader, (columns, rows), outputs, samplers, params)
    device.release(holes)
    return images


def layered_depth(
    device,
    geometry,
    view: View,
    casters: frozenset[int],
    layers: int,
    width: int,
    height: int,
    kept="whole",
    draw=(0, 0),
):
    """An image (layers, height, width) float32, as the kernel of the same name. `draw`: seed and sample."""
    if not 1 <= layers <= MAX_LAYERS:
        raise ValueError(f"a layered depth map has 1 to {MAX_LAYERS} layers, not {layers}")
    _check_view(view, (width, height))
    depths = device.new_image((layers, height, width))
    keys = device.new_image(depths.size[::-1], np.uint32)
    device.clear(keys, 0xFF800000)  # SORTABLE_INFINITE
    _, high = geometry.depth_bounds(view, casters)
    target = device.new_image((height, width, 2), np.uint32)  # drawn into, never read
    matrices = geometry.clip_matrices(view, (0, height), (width, height))
    drawn = geometry.draw_list(casters, "casts", kept)
    (seed, sample), rule = draw, RULES.index(kept)
    extent = (width, height, depths.columns, layers)
    row, column = divmod(layers - 1, depths.columns)
    _draw_all(
        device, LAYERED_DEPTH, geometry, drawn, view, high, target, None, matrices,
        {"sorted": keys},
        {"map": extent, "last": (width * column, height * row), "rule": (rule, sample, 0, 0)}, seed,
    )  # fmt: skip
    device.dispatch(UNSORT, depths.size, {"depths": depths}, {"sorted": keys}, {"size": depths.size})
    device.release([keys, target])
    return depths


def _draw_all(
    device, shader, geometry, drawn, view: View, high, target, depth, matrices, images, params, seed: int,
    offsets=None, chunk: Chunk | None = None,
):  # fmt: skip
    """Draws a draw list, each range by its own program, in pieces that one vertex buffer serves. `seed`: of
    what is there by chance; `offsets`: where the chunk's pixels are sampled, if at their own places."""
    samplers = {
        "blocks": drawn.blocks,
        "runs": drawn.runs,
        "triangles": geometry.triangles,
        "positions": geometry.positions,
        "matrices": matrices,
    }
    # Beyond every vertex, so that an orthographic view clips nothing at the back.
    behind = 0.5 / max(abs(high - view.near), 1e-30) if np.isfinite(high) else 1.0
    params = params | {"range": (view.near, min(view.far, 3.0e38), behind)}
    most = device.TRIANGLES_PER_DRAW
    if offsets is not None:
        rows, columns = chunk.shape
        # A pixel more, lest rounding leave any out.
        params |= {"places": (columns, rows, chunk.places.reach + 1.0)}
        samplers["offsets"], most = offsets, most // TRIANGLES_OF_BOX
    for part in drawn.ranges:
        bound, sides, by_corner = dict(samplers), {"front": (), "back": ()}, False
        if part.material is not None:
            opacities = geometry.opacities(part.material, drawn.use)
            # A map looks from the light, and a ray of a shadow towards it: that meets the other side.
            opacities = opacities if drawn.use == "seen" else opacities[::-1]
            for name, (texels, opacity) in zip(sides, opacities, strict=True):
                bound[name] = texels
                sides[name] = (opacity.threshold, *texels.shape[::-1], opacity.by_corner)
                by_corner |= opacity.by_corner
            bound["corner_uvs"] = geometry.corner_uvs
            if by_corner:
                bound["corner_opacity"] = geometry.corner_opacity
        has_places = offsets is not None
        program = raster_variant(shader, view.orthographic, part.material is not None, by_corner, has_places)
        for first in range(part.first, part.first + part.count, most):
            count = min(most, part.first + part.count - first) * (TRIANGLES_OF_BOX if has_places else 1)
            number = (first >> 16, first & 0xFFFF, seed >> 16, seed & 0xFFFF)
            now = params | sides | {"draw": number}
            device.draw(program, count, target, depth, images, bound, now)


def _check_view(view: View, size: tuple[int, int]) -> None:
    """Raises ValueError on a view or size that cannot be drawn, as kernels/src/raster/camera.rs."""
    if not 0 < min(size) <= max(size) <= MAX_SIDE:
        raise ValueError(f"an image is 1 to {MAX_SIDE} pixels a side, not {size[0]} x {size[1]}")
    finite = (*view.eye, *view.right, *view.up, *view.forward, *view.window, view.near)
    if not np.isfinite(finite).all() or not view.near < view.far:
        raise ValueError("a view is finite, but for the far plane, and has near < far")
    if not view.orthographic and view.near <= 0.0:
        raise ValueError("a perspective view has its near plane before the eye")
    left, right, bottom, top = view.window
    if not (left < right and bottom < top):
        raise ValueError("a view needs left < right and bottom < top")
