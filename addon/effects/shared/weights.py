"""What the samples of a layer that multiplies weigh: the light that it multiplies.

A pixel of such a layer is sum(V w) / sum(w) over its samples, so that the product of the finished layers is
the mean of the samples' products. With a plain mean of V it is not: where two surfaces share a pixel, the
darker one's V would count as much as the brighter one's.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from ...core.graph import Node, PlannedLayer, Rate, Step, Sum
from ...core.outline import Light, Outline
from ...core.recorder import Recorder
from ...core.roles import PRODUCT, Of
from ...core.weight import Weight
from ...core.working_space import luminance_of
from . import composite, gpu_lit, lit, steps

MOST = 1e30
FLOOR, FLOOR_OFF_SURFACES = 1e-30, 1e-36
"""What any sample weighs at least: where no light arrives a pixel is the plain mean over its samples on
surfaces, and over all of them where none is."""

WHITE = (1.0, 1.0, 1.0)


def _weight(device, colour, *factors, share, luminance, limits):
    most, *floors = np.float32(limits)
    floor = np.where(colour[..., 3] > 0.0, *floors)
    with np.errstate(over="ignore", invalid="ignore"):
        if luminance is not None and all(factor.ndim == 2 for factor in factors):
            weight = colour @ np.float32((*np.multiply(share, luminance), 0.0))
            for factor in factors:
                weight *= factor
        else:
            weight = colour[..., :3] * np.float32(share)
            for factor in factors:
                weight *= factor[..., None] if factor.ndim == 2 else factor[..., :3]
            weight = weight @ np.float32(luminance) if luminance is not None else weight
    # fmax takes the number where the other is none.
    weight = np.fmin(np.fmax(weight, np.float32(0.0)), most)
    weight += floor if weight.ndim == 2 else floor[..., None]
    return weight


def _terms(node: Node) -> tuple[tuple[Node, ...], ...]:
    picture, *more = node.inputs
    return picture.step.sum.terms(picture) if picture.step.sum and not more else ()


def _part(node: Node, numbers: Collection[int]) -> Node:
    (picture,) = node.inputs
    return Node(node.step, node.instance, (picture.step.sum.part(picture, numbers),), node.params)


# A colour (h, w, 4), which is there where its alpha is, times images (h, w[, 3 or 4]) and a constant colour:
# its luminance, or as it is where there are no coefficients. `limits`: the most that is, and what is added to
# it on surfaces and off them. It comes apart as a composite does.
WEIGHT = Step("weight", cpu=_weight, gpu=gpu_lit.weight, sum=Sum(_terms, _part))


def record(recorder: Recorder, outline: Outline, how: Weight) -> None:
    """Gives weights to all layers recorded so far whose samples weigh."""
    weighed = [layer for layer in recorder.layers if _is_weighed(layer)]
    if how is Weight.NONE or not weighed:
        return
    if not recorder.shot.has_eye:
        how = Weight.IRRADIANCE  # what a chart is used for has a colour of its own
    points = steps.surface(recorder, outline, "material")
    for index in sorted({layer.of.index for layer in weighed if layer.of.is_lamp}):
        light = outline.lights[index]
        colour = lit.diffuse_albedo if how is Weight.RADIANCE else lit.white
        factors = [colour(recorder, outline, points), lit.irradiance(recorder, points, light)]
        own = [layer for layer in recorder.layers if layer.of == Of.lamp(index)]
        for layer in (layer for role in PRODUCT for layer in own if layer.role is role):
            if layer in weighed:
                recorder.weigh(layer, _node(recorder, outline, layer, *factors, share=_hue(light)), how.value)
            if layer.joins and layer.node.rate != Rate.PICTURE:
                factors.append(layer.node)
    for layer in weighed:
        if not layer.of.is_lamp:
            colour = lit.base_colour if how is Weight.RADIANCE else lit.white
            picture = composite.behind(recorder, outline, layer, colour(recorder, outline, points))
            if picture is not None and picture.rate != Rate.PICTURE:
                weight = _node(recorder, outline, layer, picture, off_surfaces=FLOOR)
                recorder.weigh(layer, weight, how.value)


def _is_weighed(layer: PlannedLayer) -> bool:
    return layer.role in PRODUCT and layer.kind.is_weighed and layer.node.rate != Rate.PICTURE


def _node(
    recorder, outline, layer: PlannedLayer, *factors: Node, share=WHITE, off_surfaces=FLOOR_OFF_SURFACES
):
    """A colour weighs channel by channel."""
    return recorder.step(
        WEIGHT,
        *factors,
        instance=layer.light or layer.name,
        share=share,
        luminance=None if len(layer.channels) == 3 else luminance_of(outline.working_space),
        limits=(MOST, FLOOR, off_surfaces),
    )


def _hue(light: Light) -> tuple[float, float, float]:
    """The light's colour, its largest channel 1, so that its power does not matter."""
    sizes = np.abs(np.array(light.intensity, np.float64))
    largest = sizes.max()
    return tuple((sizes / largest).tolist()) if 0.0 < largest < np.inf else WHITE
