"""What light does to diffuse surfaces: their colour, what each lamp sends to them, and the sum of it all."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ...core.culling import unlit_reason
from ...core.effect import LayerKind
from ...core.graph import Node, Step, Sum
from ...core.material import Colour
from ...core.outline import Light, Outline, emitter_measure
from ...core.recorder import Recorder
from ...core.roles import Of, Subject
from . import gpu_lit, steps
from .joins import Join, image_count
from .membership import belong

LIT = LayerKind(title="Lit", channels="RGBA", of=Subject.LAMP)
_TERMS = (Join.LIGHT.value, Join.ADD.value)
_VEILS = (Join.OVER.value, Join.OVER_BY_DEPTH.value)


def _material_colour(device, surface, colours, images, version, by_corner=()):
    """(h, w, 4) float32: the colour of each point's material, alpha 1; all 0 where there is no surface."""
    textures = [(material, device.texture(image), share) for material, image, share in images]
    corners = ()
    if by_corner:
        corners = surface["corner_colour"], np.isin(np.arange(len(colours)), by_corner).astype(np.uint8)
    return device.kernels.material_colour(
        surface["material"],
        surface["uv"] if images else None,
        np.array(colours, np.float32).reshape(-1, 3),
        [each for each in textures if each[1] is not None],
        *corners,
    )


def bilinear(texels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(N, 3) float32: texels (height, width, 4) at uv (N, 2), repeated; texel centres at halves."""
    height, width = texels.shape[:2]
    # Whole turns are taken off first: float32 keeps few digits of a uv far from 0.
    x = (uv[:, 0] - np.floor(uv[:, 0])) * np.float32(width) - np.float32(0.5)
    y = (uv[:, 1] - np.floor(uv[:, 1])) * np.float32(height) - np.float32(0.5)
    column, row = np.floor(x), np.floor(y)
    along, up = (x - column)[:, None], (y - row)[:, None]
    columns = [(column.astype(np.int64) + step) % width for step in (0, 1)]
    rows = [(row.astype(np.int64) + step) % height for step in (0, 1)]
    low, high = (texels[r, columns[0], :3] * (1 - along) + texels[r, columns[1], :3] * along for r in rows)
    return low * (1 - up) + high * up


def _irradiance(device, surface, eye, emitter, receivers):
    irradiance = device.kernels.irradiance(
        surface["position"],
        surface["shading_normal"],
        np.array(eye),
        emitter.packed(),
        cancel=device.cancel_flag,
    )
    if receivers is not None:
        irradiance[~belong(device, surface, receivers)] = 0.0
    return irradiance


def _composite(device, albedo, *inputs, joins, is_rest=True):
    queue, for_kernel = iter(inputs), []
    for join in joins:
        kind, *details = join
        images, share = [next(queue) for _ in range(image_count(join))], np.zeros(3, np.float32)
        if kind == Join.LIGHT.value:
            share = np.array(details[0], np.float32) / np.float32(np.pi)
        elif kind in _VEILS and not is_rest:  # of what lies over the light, only what it hides
            hides = np.array((0.0, 0.0, 0.0, 1.0), np.float32)
            images[::2] = [image * hides for image in images[::2]]
        for_kernel.append((kind, [np.ascontiguousarray(image) for image in images], share.tolist()))
    total = device.kernels.composite(np.ascontiguousarray(albedo), for_kernel)
    if not is_rest:
        total[..., 3] = 0.0
    return total


def _joined_inputs(node: Node) -> list[tuple[tuple, tuple[Node, ...]]]:
    """Each join with the nodes of its images."""
    queue = iter(node.inputs[1:])
    return [(join, tuple(next(queue) for _ in range(image_count(join)))) for join in node.params["joins"]]


def _terms(node: Node) -> tuple[tuple[Node, ...], ...]:
    """First the rest, which is alpha and the colour of what lies over the light, then each light and each
    layer that adds."""
    joins = _joined_inputs(node)
    return ((), *(images for join, images in joins if join[0] in _TERMS))


def _part(node: Node, numbers: Collection[int]) -> Node:
    """What multiplies or covers light multiplies or covers each term alike."""
    joins, inputs, term = [], [], 0
    for join, images in _joined_inputs(node):
        is_term = join[0] in _TERMS
        term += is_term
        if not is_term or term in numbers:
            joins.append(join)
            inputs += images
    if len(joins) == len(node.params["joins"]) and 0 in numbers:
        return node
    params = {"joins": tuple(joins), "is_rest": 0 in numbers}
    return Node(node.step, node.instance, (node.inputs[0], *inputs), params)


# Base colour or emission of every shading point, RGBA with alpha 1 on a surface.
MATERIAL_COLOUR = Step("material_colour", cpu=_material_colour, gpu=gpu_lit.material_colour)
# What a light sends to every shading point if nothing is in the way, per unit of its radiance.
IRRADIANCE = Step("irradiance", cpu=_irradiance, gpu=gpu_lit.irradiance)
# Diffuse radiance towards the eye, RGBA, premultiplied.
COMPOSITE = Step("composite", cpu=_composite, gpu=gpu_lit.composite, sum=Sum(_terms, _part))


def brightness(light: Light) -> tuple[float, float, float]:
    """What the kernel's irradiance is per unit of: radiance, or intensity for a light of no size."""
    return light.radiance if emitter_measure(light.emitter) > 0.0 else light.intensity


def magnitude(light: Light) -> tuple[float, float, float]:
    """The same of a light that is not negative."""
    return tuple(abs(channel) for channel in brightness(light))


def shines(light: Light, visible: frozenset[int], region: np.ndarray) -> bool:
    """Whether any of the instances `visible` may get light of it; `region` (2, 3) is the box around them."""
    return not light.is_dark and unlit_reason(light, visible, region) is None


Colours = Sequence[tuple[Colour, int | None, str]]
"""By material a constant, or the image in its place, and what corners of faces carry to be multiplied."""


def base_colour(recorder: Recorder, outline: Outline, surface: Node) -> Node:
    """The surface's colour, as the composite has it."""
    colours = [(m.base_color, m.base_color_image, m.base_color_corners) for m in outline.materials]
    return _colour(recorder, outline, surface, "base colour", "base_color", colours)


def diffuse_albedo(recorder: Recorder, outline: Outline, surface: Node) -> Node:
    """What of light the surface sends back in all directions: a metal nothing."""
    colours = [(m.base_color, *m.diffuse) for m in outline.materials]
    shares = [1.0 - min(max(material.metallic, 0.0), 1.0) for material in outline.materials]
    return _colour(recorder, outline, surface, "diffuse albedo", "diffuse", colours, shares)


def white(recorder: Recorder, outline: Outline, surface: Node) -> Node:
    """1 where there is a surface, in all channels."""
    recorder.surface(surface, "material")
    colours = ((1.0, 1.0, 1.0),) * len(outline.materials)
    return recorder.step(MATERIAL_COLOUR, surface, instance="white", colours=colours, images=(), version=0)


def _colour(
    recorder: Recorder,
    outline: Outline,
    surface: Node,
    name: str,
    want: str,
    colours: Colours,
    shares: Sequence[float] | None = None,
) -> Node:
    """Each material's colour times its share; `want`: the textures, for the extraction."""
    shares = shares or [1.0] * len(colours)
    parts = list(enumerate(zip(colours, shares, strict=True)))
    images = tuple(
        (index, image, share) for index, ((_, image, _), share) in parts if image is not None and share > 0.0
    )
    by_corner = tuple(index for index, ((_, _, corners), share) in parts if corners and share > 0.0)
    if images:
        recorder.wants("uv", want)
    attributes = ["material", *(("uv",) if images else ()), *(("corner_colour",) if by_corner else ())]
    recorder.surface(surface, *attributes)
    return recorder.step(
        MATERIAL_COLOUR,
        surface,
        instance=name,
        colours=tuple(tuple(share * channel for channel in colour) for _, ((colour, *_), share) in parts),
        images=images,
        # Textures are told apart by index only, which is all there is while a scene stands still.
        version=outline.version if images else 0,
        **({"by_corner": by_corner} if by_corner else {}),
    )


def emission(recorder: Recorder, outline: Outline, surface: Node, visible: frozenset[int]) -> Node | None:
    """What the surface emits itself; None where no material of the instances `visible` does."""
    used = outline.instances.materials_of(visible)
    if not any(outline.materials[material].glows for material in used):
        return None
    colours = [(m.emission, m.emission_image, m.emission_corners) for m in outline.materials]
    return _colour(recorder, outline, surface, "emission", "emission", colours)


def irradiance(recorder: Recorder, surface: Node, light: Light) -> Node:
    """What the light sends to the surface."""
    linked = ("instance",) if light.receivers is not None else ()
    recorder.surface(surface, "position", "shading_normal", *linked)
    return recorder.step(
        IRRADIANCE,
        surface,
        instance=light.name,
        eye=recorder.shot.origin,
        emitter=light.emitter,
        receivers=light.receivers,
    )


def record(recorder: Recorder, outline: Outline) -> None:
    """Adds the unshadowed picture of every light that the graph already has a layer of."""
    for index in sorted({layer.of.index for layer in recorder.layers if layer.of.is_lamp}):
        light, points = outline.lights[index], steps.surface(recorder, outline)
        node = recorder.step(
            COMPOSITE,
            base_colour(recorder, outline, points),
            irradiance(recorder, points, light),
            instance=light.name,
            joins=((Join.LIGHT.value, brightness(light), 0),),
        )
        recorder.layer(LIT, node, Of.lamp(index))
