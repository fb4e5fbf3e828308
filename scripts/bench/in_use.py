"""Layers as they are used: multiplied onto Cycles' unshadowed image of their lamp, and the picture that the
compositor's nodes make of light groups, both held against Cycles' own shadows."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import strata_kernels
from strata.addon.audit.score import audit_of
from strata.addon.bake import bake
from strata.addon.core.layers import Layer
from strata.addon.core.metrics import mean_brightness
from strata.addon.core.weight import Weight
from strata.addon.planning import Options
from strata.addon.scene.materials import is_medium

from . import cycles, references
from .document import rmse, table
from .scenes import open_sample, read

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
PROBES = 2048
HYBRID = {"values": {"soft_shadow": {"method": "hybrid"}}}
BAKES = {
    ("bitmask", 8): {"values": {"soft_shadow": {"method": "bitmask"}}},
    ("hybrid", 8): HYBRID,
    ("default (rays)", 8): {},
}
"""What `Options` takes beside samples, by a name and the samples a pixel."""
OF_COURTYARD = {
    **BAKES,
    **{("hybrid", samples): HYBRID for samples in (4, 16, 32)},
    ("hybrid, plain means", 8): {**HYBRID, "weight": Weight.NONE.value},
}
OTHERS = {
    "armory_logic_toy_car": "a spot over a track of 49,000 triangles",
    "armory_light_area": "an area lamp",
    "armory_render_voxelao_teapots": "a sun on 280,000 triangles",
}
"""Scenes of others, in the folder that STRATA_SCENES names."""
PICTURES = (
    ("courtyard", "courtyard", False),
    ("mist without its haze", "mist", True),
    ("mist", "mist", False),
)
"""Name, sample scene, and whether media are taken out."""


@dataclass(frozen=True)
class InUse:
    """A share of the brightness there: `error` of luminance, Cycles' noise taken off, `noise` that of its two
    renders' mean, `colour` the error of each channel by itself, `inside` that of luminance away from
    silhouettes."""

    error: float
    noise: float
    colour: float
    inside: float


def of_layer(layer: np.ndarray, bare: np.ndarray, shadowed: np.ndarray, edge: np.ndarray) -> InUse:
    """A layer (height, width) or (height, width, 3) that multiplies `bare`, where that is anything; both
    images (2, height, width, 3), each half with noise of its own. `edge`: where silhouettes are."""
    factor = layer.reshape(*layer.shape[:2], -1)
    return _in_use(factor * bare - shadowed, bare.mean(axis=0), edge)


def of_picture(made: np.ndarray, truth: np.ndarray, edge: np.ndarray) -> InUse:
    """Two pictures, (2, height, width, 3) each, where the truth is anything."""
    return _in_use(made - truth, truth.mean(axis=0), edge)


def _in_use(difference: np.ndarray, image: np.ndarray, edge: np.ndarray) -> InUse:
    grey, brightness = difference @ LUMINANCE, image @ LUMINANCE
    error, noise = _root(grey, brightness, brightness > 0.0)
    inside, _ = _root(grey, brightness, (brightness > 0.0) & ~edge)
    lit = [each for each in range(3) if image[..., each].any()]
    channels = [_root(difference[..., each], image[..., each], brightness > 0.0)[0] for each in lit]
    return InUse(error, noise, float(np.sqrt(np.mean(np.square(channels or [0.0])))), inside)


def _root(difference: np.ndarray, image: np.ndarray, where: np.ndarray) -> tuple[float, float]:
    """RMS of a difference (2, height, width) over image + mean image, and the noise of the halves' mean."""
    if not where.any():
        return 0.0, 0.0
    found = audit_of(difference[:, where] / (image[where] + mean_brightness(image[where])), 0, 0.0)
    return found.value, found.noise


def silhouettes(scene, size: tuple[int, int]) -> np.ndarray:
    """(height, width) bool: pixels with a neighbour that shows another object."""
    case = read(scene, size)
    everything = np.ones(len(case.outline.instances), np.uint8)
    found = strata_kernels.raster_surface(
        case.device.geometry(), everything, case.graph.shot.view.packed(), *size, attributes=["object_id"]
    )["object_id"]
    edge = np.zeros(found.shape, bool)
    for axis in (0, 1):
        differs = np.diff(found, axis=axis) != 0
        before, after = [slice(None)] * 2, [slice(None)] * 2
        before[axis], after[axis] = slice(None, -1), slice(1, None)
        edge[tuple(before)] |= differs
        edge[tuple(after)] |= differs
    return edge


def baked_layers(scene, size: tuple[int, int], bakes: dict) -> dict[tuple[str, int], dict[str, Layer]]:
    """Shadows by bake and lamp, with the pixel filter that Cycles has."""
    found = {}
    with cycles.kept((scene.render, "engine", "CYCLES")):
        for (name, samples), more in bakes.items():
            options = Options(("soft_shadow",), "cpu", samples=samples, probes=PROBES, **more)
            layers = bake(scene, scene.view_layers[0], options, size=size).layers.layers
            found[name, samples] = {layer.light: layer for layer in layers}
    return found


def media(scene) -> list[bpy.types.Object]:
    """What shows no surface, only a medium."""
    return [
        item
        for item in scene.objects
        if any(slot.material and is_medium(slot.material) for slot in item.material_slots)
    ]


def lamps_alone(quick: bool) -> str:
    """Each lamp's layer times its own image."""
    rows, missing = [], []
    for name, samples, size, bakes in _scenes(quick, missing):
        scene = bpy.context.scene
        hidden, edge = media(scene), silhouettes(scene, size)
        baked = baked_layers(scene, size, bakes)
        for lamp in _with_layers(scene, baked):
            bare, shadowed = (
                references.diffuse(scene, lamp, samples, size, shadow=shadow, hidden=hidden)
                for shadow in (False, True)
            )
            for (method, count), layers in baked.items():
                layer = layers[lamp.name]
                found = of_layer(layer.pixels.astype(np.float64), bare, shadowed, edge)
                error = layer.error
                interval = f"{rmse(error['ci95'][0])} to {rmse(error['ci95'][1])}"
                reported = [rmse(error["value"]), interval, error["metric"]]
                rows.append([name, lamp.name, method, count, *_figures(found), *reported])
    text = (
        "A layer times Cycles' unshadowed image of its lamp (diffuse light times colour, no bounces, no "
        "media) against Cycles' shadowed one: RMS over the pixels that the lamp lights of the difference "
        "over (unshadowed image + its mean), of luminance, the render's pixel filter on both sides, Cycles' "
        "noise taken off. Over RGB: each channel by itself. No silhouettes: away from pixels whose "
        "neighbours show another object. Reported is what the bake says of itself. Courtyard at 480x270 "
        "and 2 x 64 samples of Cycles, the others at 240x135 and 2 x 128, where edges are a larger share of "
        "the pixels. Where two faces lie in one plane, Cycles shadows the one by the other and Strata "
        "does not: all walls of `armory_light_area` are there twice, the sill of a window of `mist` lies in "
        "its wall, houses of `comic` in each other. With 32 samples that is most of what is left of the "
        "errors of those suns."
    )
    header = ["scene", "light", "method", "samples", *_HEADER, "reported", "95% interval", "metric"]
    return "\n\n".join(["### Lamps in use", text, table(header, rows), *missing])


_HEADER = ["in use", "Cycles' noise", "over RGB", "no silhouettes"]


def _figures(found: InUse) -> list[str]:
    return [rmse(each) for each in (found.error, found.noise, found.colour, found.inside)]


def _with_layers(scene, baked: dict[tuple[str, int], dict[str, Layer]]) -> list[bpy.types.Object]:
    """Lamps that every bake has a layer of."""
    return [lamp for lamp in cycles.lamps(scene) if all(lamp.name in layers for layers in baked.values())]


def _scenes(quick: bool, missing: list[str]) -> Iterator[tuple[str, int, tuple[int, int], dict]]:
    """Opens one after the other: its name, Cycles' samples in each half, size, bakes. A sentence goes to
    `missing` for those that are not there."""
    if quick:
        open_sample("courtyard")
        yield "courtyard", 4, (96, 54), BAKES
        return
    open_sample("courtyard")
    yield "courtyard", 64, (480, 270), OF_COURTYARD
    for name in ("mist", "comic"):
        open_sample(name)
        yield name, 128, (240, 135), BAKES
    folder = Path(os.environ.get("STRATA_SCENES", ""))
    for name in OTHERS:
        path = folder / f"{name}.blend"
        if not path.is_file():
            missing.append(f"`{name}` was not there: STRATA_SCENES names the folder that has it.")
            continue
        bpy.ops.wm.open_mainfile(filepath=str(path))
        yield name, 128, (240, 135), BAKES


def pictures(quick: bool) -> str:
    """What the compositor's nodes make, with gloss and bounces."""
    samples, size = (2, (96, 54)) if quick else (64, (240, 135))
    rows = []
    for name, blend, is_clear in PICTURES:
        scene = open_sample(blend)
        hidden = media(scene) if is_clear else []
        edge, baked = silhouettes(scene, size), baked_layers(scene, size, BAKES)
        lamps = _with_layers(scene, baked)
        for bounces in (0, 4):
            truth, bare = (
                references.picture(scene, lamps, samples, size, shadow=shadow, bounces=bounces, hidden=hidden)
                for shadow in (True, False)
            )
            unshadowed = of_picture(bare["image"], truth["image"], edge)
            rows.append([name, bounces, "none", *_figures(unshadowed)])
            for (method, _), layers in baked.items():
                made = bare["image"].astype(np.float64)
                for lamp in lamps:
                    made = made + bare[lamp.name] * (layers[lamp.name].pixels[..., None] - 1.0)
                rows.append([name, bounces, method, *_figures(of_picture(made, truth["image"], edge))])
    text = (
        "What the nodes of *Build Compositor Nodes* make, image + the sum over lamps of (light group x "
        "(shadow - 1)), against Cycles with its own shadows, gloss, emission, world and media: RMS of the "
        f"difference over (truth + its mean), 8 samples a pixel, {size[0]}x{size[1]}, 2 x {samples} samples "
        "of Cycles; without any shadow for comparison. The brightness is the truth's: where walls "
        "keep a strong lamp out, as mist's its sun, little of its unshadowed light is much. With bounces a "
        "light group holds light that has bounced, of a lamp that no wall stopped, and the shadow of its "
        "direct light lies on that. In haze it holds what the haze scatters, unshadowed, and light that did "
        "not grow dimmer on its way, since Cycles asks nothing between a lamp without shadow and what it "
        "lights: a picture like that is of no use, and the button "
        "warns of it."
    )
    return "\n\n".join(["### Whole pictures", text, table(["scene", "bounces", "shadows", *_HEADER], rows)])
