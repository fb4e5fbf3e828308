"""Section "Random scenes": whether the intervals that bakes report hold the error of all their pixels.

Scenes of all effects, with good settings and bad ones. The truth is what the reports rest on too, asked at
every pixel and with many more rays: this tests the choice of pixels and the interval, and nothing else.
"""

from __future__ import annotations

import math
import random
from collections.abc import Generator
from dataclasses import dataclass
from functools import partial

import bpy
import numpy as np
from strata.addon.bake import bake
from strata.addon.core.metrics import WRONG, mean_brightness
from strata.addon.core.slices import finished
from strata.addon.core.working_space import luminance_of
from strata.addon.measure import measure as measuring
from strata.addon.measure.deviation import Scale, deviations
from strata.addon.measure.footprint import Probed, seen
from strata.addon.measure.in_use import InUseScore
from strata.addon.measure.light import LightScore
from strata.addon.measure.mask import MaskScore
from strata.addon.measure.report import LayerError
from strata.addon.planning import Options
from strata.scripts.bench.document import table

SCENES = 200
SIZE = (48, 32)
PROBES = 512
SHADOW_VIEWS, LIGHT_VIEWS, MASK_VIEWS = 32, 8, 32
"""View rays of each of a pixel's two halves, for the error of all pixels: of masks as many as the reports
take, since a pixel counts as wrong by what so many rays say."""


@dataclass(frozen=True)
class Told:
    """A layer's error: as its report has it, and that of all its pixels."""

    scene: int
    layer: str
    metric: str
    value: float
    low: float
    high: float
    true: float

    @property
    def holds(self) -> bool:
        return self.low <= self.true <= self.high


def build(seed: int) -> Options:
    """A random scene in a new file, and how to bake it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, chance = bpy.context.scene, random.Random(seed)
    bpy.ops.mesh.primitive_plane_add(size=30.0)
    _paint(bpy.context.object, chance)
    makers = (
        bpy.ops.mesh.primitive_cube_add,
        bpy.ops.mesh.primitive_uv_sphere_add,
        bpy.ops.mesh.primitive_torus_add,
        bpy.ops.mesh.primitive_monkey_add,
        bpy.ops.mesh.primitive_grid_add,
    )
    for _ in range(chance.randint(1, 8)):
        place = chance.uniform(-3.0, 3.0), chance.uniform(-3.0, 4.0), chance.uniform(0.2, 2.5)
        turn = tuple(chance.uniform(0.0, math.tau) for _ in range(3))
        chance.choice(makers)(location=place, rotation=turn)
        size = chance.uniform(0.1, 1.2)
        bpy.context.object.scale = size, size * chance.uniform(0.02, 1.0), size
        _paint(bpy.context.object, chance)
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        _light(scene, chance)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, -9.0, 4.0), (1.15, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    if has_fog := chance.random() < 0.3:
        world = scene.world = bpy.data.worlds.new("World")
        volume = world.node_tree.nodes.new("ShaderNodeVolumeScatter")
        volume.inputs["Density"].default_value = 10.0 ** chance.uniform(-2.5, -0.5)
        output = world.node_tree.nodes.get("World Output")
        world.node_tree.links.new(volume.outputs[0], output.inputs["Volume"])
    shadow = {
        "method": chance.choice(("bitmask", "hybrid", "area")),
        "resolution": chance.choice((128, 256, 1024)),
        "max_samples": chance.choice((16, 256)),
        "layers": chance.choice((1, 3)),
        "rays": chance.choice((4, 32)),
    }
    fog = {"resolution": chance.choice((128, 256)), "light_samples": chance.choice((1, 4))}
    effects = ["soft_shadow"] + ["volumetric_light"] * has_fog + ["toon"] * (chance.random() < 0.3)
    return Options(
        effects=tuple(effects),
        backend="cpu",
        samples=chance.choice((1, 4, 8, 16)),
        probes=PROBES,
        values={"soft_shadow": shadow, "volumetric_light": fog},
        seed=seed,
    )


def _paint(thing: bpy.types.Object, chance: random.Random) -> None:
    material = bpy.data.materials.new("Paint")
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*(chance.uniform(0.02, 0.9) for _ in range(3)), 1.0)
    thing.data.materials.append(material)


def _light(scene: bpy.types.Scene, chance: random.Random) -> None:
    kind = chance.choice(("SUN", "AREA", "POINT", "SPOT"))
    data = bpy.data.lights.new("Lamp", kind)
    data.energy = 3.0 if kind == "SUN" else 10.0 ** chance.uniform(0.0, 3.0)
    data.color = tuple(chance.uniform(0.3, 1.0) for _ in range(3))
    if kind == "SUN":
        data.angle = math.radians(10.0 ** chance.uniform(-1.0, 1.3))
    elif kind == "AREA":
        data.size = 10.0 ** chance.uniform(-1.0, 0.5)
    else:
        data.shadow_soft_size = 10.0 ** chance.uniform(-2.0, 0.0)
    lamp = bpy.data.objects.new("Lamp", data)
    lamp.location = chance.uniform(-3.0, 3.0), chance.uniform(-4.0, 3.0), chance.uniform(2.5, 6.0)
    lamp.rotation_euler = chance.uniform(-0.7, 0.7), chance.uniform(-0.7, 0.7), 0.0
    scene.collection.objects.link(lamp)


def true_error(probed: Probed) -> float:
    """Of all pixels, by the layer's own metric."""
    score = probed.layer.kind.score
    return {InUseScore: _in_use, LightScore: _light_error, MaskScore: _mask_error}[type(score)](probed, score)


def _in_use(probed: Probed, score: InUseScore) -> float:
    truth = partial(score.truth, probed.rays, probed.outline, probed.layer, probed.layers, probed.casters)
    count = probed.image.shape[0] * probed.image.shape[1]
    looked = finished(seen(probed, truth, np.arange(count), SHADOW_VIEWS, 2, 4321, 2))
    scale = Scale(1.0, np.array(luminance_of(probed.outline.working_space)), probed.outline.exposure)
    brightness = scale.of(np.nan_to_num(looked.multiplied).mean(axis=1))
    lit = brightness > 0.0
    if not lit.any():
        return 0.0
    scale = scale.with_means(mean_brightness(brightness[lit]), 1.0)
    values = np.nan_to_num(probed.image.reshape(count, -1).astype(np.float64))
    found = deviations(values, looked, scale)
    return math.sqrt(max(float(found.squares.sum()), 0.0) / int(found.has_light.sum()))


def _halves(probed: Probed, along, views: int, step: int) -> Generator[np.ndarray]:
    count = probed.image.shape[0] * probed.image.shape[1]
    for half in range(2):
        parts = []
        for start in range(0, count, step):
            pixels = np.arange(start, min(start + step, count))
            seed = 1000 * half + start
            rays = probed.look(pixels, views, seed + 17)
            parts.append(along(rays, seed).mean(axis=0).reshape(len(pixels), views, -1).mean(axis=1))
        yield np.concatenate(parts)


def _light_error(probed: Probed, score: LightScore) -> float:
    first, last = _halves(probed, score.along(probed), LIGHT_VIEWS, 8)
    values = np.nan_to_num(probed.image.reshape(len(first), -1).astype(np.float64))
    truth = np.abs(0.5 * (first + last)).mean(axis=1, keepdims=True)
    whole = truth + (mean_brightness(truth) or 1.0)
    return math.sqrt(max(float(((values - first) * (values - last) / whole**2).mean()), 0.0))


def _mask_error(probed: Probed, score: MaskScore) -> float:
    first, last = _halves(probed, score.along(probed), MASK_VIEWS, 32)
    values = np.nan_to_num(probed.image.reshape(len(first), -1).astype(np.float64))
    return float((np.abs(values - 0.5 * (first + last)).max(axis=1) > WRONG).mean())


def told(seed: int) -> list[Told]:
    """Of each layer of a random scene."""
    options, scene, probed_of = build(seed), bpy.context.scene, {}
    own = measuring.Measurement.measure

    def watching(self, probed: Probed, *more):
        probed_of[probed.layer.name] = true_error(probed)
        return own(self, probed, *more)

    measuring.Measurement.measure = watching
    try:
        result = bake(scene, bpy.context.view_layer, options, size=SIZE)
    finally:
        measuring.Measurement.measure = own
    return [
        Told(seed, each.name, each.error.metric, each.error.value, *each.error.ci95, probed_of[each.name])
        for each in result.report.layers
        if isinstance(each.error, LayerError)
    ]


def section(count: int) -> str:
    """So many scenes, as a part of the document."""
    found: dict[str, list[Told]] = {}
    for seed in range(count):
        for each in told(seed):
            found.setdefault(each.metric, []).append(each)
    rows = []
    for metric, layers in found.items():
        above = [each.high / each.true for each in layers if each.true > 0.0]
        values = [each.value / each.true for each in layers if each.true > 0.0]
        held = sum(each.holds for each in layers)
        rows.append([metric, str(len(layers)), f"{100.0 * held / len(layers):.0f}%"])
        rows[-1] += [f"{np.median(each):.2f}" if each else "" for each in (above, values)]
    width, height = SIZE
    return "\n\n".join(
        [
            "### Intervals on random scenes",
            f"{count} scenes of up to eight things, three lamps and fog, some in toon, with good settings "
            f"and bad ones (1 to 16 samples, maps of 128 texels), {width}x{height}, {PROBES} probes. The "
            "truth is the reports' own, asked at every pixel and with more rays: how often the interval "
            "holds the error of all pixels, and, in the median, its upper end and the value over that error.",
            table(["metric", "layers", "held", "upper end over truth", "value over truth"], rows),
        ]
    )
