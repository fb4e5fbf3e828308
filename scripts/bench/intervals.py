"""Section "Random scenes": whether the intervals that bakes report hold the error of all their pixels.

Scenes of all effects, with good settings and bad ones. The truth is what the reports rest on too, asked at
every pixel and with many more rays: this tests the choice of pixels and the interval, and nothing else.

What was found of each scene is kept in docs/data/intervals.jsonl (kept.py), one line a layer and number of
probes.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import bpy
import numpy as np
from strata.addon.bake import bake
from strata.addon.core.metrics import WRONG, mean_brightness
from strata.addon.core.slices import finished
from strata.addon.core.working_space import luminance_of
from strata.addon.measure import measure as measuring
from strata.addon.measure.deviation import LIT_VIEWS, Deviations, Scale, deviations, product_variances
from strata.addon.measure.footprint import Probed, seen
from strata.addon.measure.in_use import InUseScore
from strata.addon.measure.light import LightScore, halves_of
from strata.addon.measure.mask import Looked, MaskScore
from strata.addon.measure.strata import near_jumps
from strata.addon.planning import Options
from strata.scripts.bench.document import ROOT, table
from strata.scripts.bench.kept import kept_lines

SCENES = 200
SIZE = (48, 32)
PROBES = 512, 1024
KEPT = ROOT / "docs" / "data" / "intervals.jsonl"

SHADOW_VIEWS, LIGHT_VIEWS, MASK_VIEWS = (32, 128, 512), (2, 16, 64), (32, 512, 2048)
"""View rays of each of a pixel's two halves, for the error of all pixels: of every pixel, and of those that
those before leave in doubt."""
DOUBTFUL = {2: 1.0 / 8.0, 16: 1.0 / 32.0}
"""Share of a light's pixels that are looked at again, by the view rays before: the noisiest, and those that
are the most wrong, since few rays may all have missed what is bright in a pixel."""
NEAR = {32: 1.0 / 16.0, 512: 1.0 / 64.0}
"""A mask's pixel is in doubt where by so many view rays it is so near to what makes it wrong."""


@dataclass(frozen=True)
class Told:
    """A layer's error: as its report has it, and that of all its pixels, with its own standard deviation."""

    scene: int
    layer: str
    metric: str
    probes: int
    value: float
    low: float
    high: float
    true: float
    true_noise: float
    seconds: float

    @property
    def holds(self) -> bool:
        return self.low <= self.true <= self.high

    @property
    def may_hold(self) -> bool:
        return self.low - 2.0 * self.true_noise <= self.true <= self.high + 2.0 * self.true_noise


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
        probes=1,
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


Truth = tuple[float, float]
"""An error and its standard deviation, by the rays' noise."""


def true_error(probed: Probed) -> Truth:
    """Of all pixels, by the layer's own metric."""
    score = probed.layer.kind.score
    return {InUseScore: _in_use, LightScore: _light_error, MaskScore: _mask_error}[type(score)](probed, score)


def _root(squares: np.ndarray, variances: np.ndarray, count: float) -> Truth:
    error = math.sqrt(max(float(squares.sum()), 0.0) / count)
    return error, math.sqrt(float(variances.sum())) / count / max(2.0 * error, 1e-30)


def _in_use(probed: Probed, score: InUseScore) -> Truth:
    truth = partial(score.truth, probed.rays, probed.outline, probed.layer, probed.layers, probed.casters)
    count = probed.image.shape[0] * probed.image.shape[1]
    values = np.nan_to_num(probed.image.reshape(count, -1).astype(np.float64))
    scale = Scale(1.0, np.array(luminance_of(probed.outline.working_space)), probed.outline.exposure)
    first = finished(seen(probed, truth, np.arange(count), SHADOW_VIEWS[0], 2, 4321, 2))
    # Of as many view rays as the reports take for it, again and again.
    light = np.nan_to_num(first.multiplied).reshape(count, LIT_VIEWS, -1, 3).mean(axis=1)
    brightness = scale.of(light)
    if not (brightness > 0.0).any():
        return 0.0, 0.0
    scale = scale.with_means(
        float(np.mean([mean_brightness(each[each > 0.0]) for each in brightness.T])), 1.0
    )
    found: Deviations = deviations(values, first, scale)
    squares, variances = found.squares.copy(), found.square_variances.copy()
    # Where light changes, few rays may all have missed the little of a pixel that is bright and wrong.
    image = brightness.mean(axis=1).reshape(probed.image.shape[:2])
    doubtful = found.errors.any(axis=(1, 2)) | near_jumps(image).reshape(-1)
    for views in SHADOW_VIEWS[1:]:
        again = np.flatnonzero(doubtful)
        told = finished(seen(probed, truth, again, views, 2, 1234 * views, 2))
        more = deviations(values[again], told, scale)
        squares[again], variances[again] = more.squares, more.square_variances
        doubtful[again] = more.errors.any(axis=(1, 2))
    return _root(squares, variances, float(found.has_light.sum()))


def _looked(
    probed: Probed, score, views: tuple[int, ...], doubtful: Callable[[np.ndarray, int], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """The layer (P, channels) and the truth (2, P, channels); `doubtful(errors, views)`: of (2, P, channels)
    by so many view rays, the pixels that are looked at again."""
    along, count = score.along(probed), probed.image.shape[0] * probed.image.shape[1]
    values = np.nan_to_num(probed.image.reshape(count, -1).astype(np.float64))
    halves = finished(halves_of(probed, along, np.arange(count), views[0], 4321, 512))
    for before, each in pairwise(views):
        again = doubtful(values - halves, before)
        if len(again):
            halves[:, again] = finished(halves_of(probed, along, again, each, 1234 * each, 512))
    return values, halves


def _light_error(probed: Probed, score: LightScore) -> Truth:
    values = np.nan_to_num(probed.image.reshape(probed.image.shape[0] * probed.image.shape[1], -1))
    usual = mean_brightness(np.abs(values).mean(axis=1)) or 1.0

    def doubtful(errors: np.ndarray, views: int) -> np.ndarray:
        truth = np.abs(values - errors.mean(axis=0)).mean(axis=1, keepdims=True)
        shares = errors / (truth + usual)
        doubts = product_variances(*shares) + (shares[0] * shares[1]).sum(axis=1) ** 2
        return np.argsort(-doubts)[: int(DOUBTFUL[views] * errors.shape[1])]

    values, (first, last) = _looked(probed, score, LIGHT_VIEWS, doubtful)
    truth = np.abs(0.5 * (first + last)).mean(axis=1, keepdims=True)
    whole = truth + (mean_brightness(truth) or 1.0)
    first, last = (values - first) / whole, (values - last) / whole
    channels = values.shape[1]
    return _root((first * last).mean(axis=1), product_variances(first, last) / channels**2, len(values))


def _mask_error(probed: Probed, score: MaskScore) -> Truth:
    def near(errors: np.ndarray, views: int) -> np.ndarray:
        beyond = np.abs(errors.mean(axis=0)).max(axis=1) - WRONG
        return np.flatnonzero((beyond > -NEAR[views]) & (beyond < 2.0 * NEAR[views]))

    values, halves = _looked(probed, score, MASK_VIEWS, near)
    errors = values - halves
    wrong = np.abs(errors.mean(axis=0)).max(axis=1) > WRONG
    # Those that got the most rays, of which alone it is not known.
    closest = errors[:, near(errors, MASK_VIEWS[-2])].swapaxes(0, 1)
    doubts = Looked(closest, np.zeros(len(closest))).doubts
    return float(wrong.mean()), math.sqrt(doubts.sum()) / len(values)


def told(seed: int) -> Iterator[Told]:
    """Of each layer of a random scene."""
    options, found = build(seed), []
    own = measuring.Measurement.measure

    def watching(self, probed: Probed, *more):
        true = true_error(probed)
        for probes in PROBES:
            # Each number of probes finds out by itself what all need.
            probed.found.clear()
            error = finished(own(measuring.Measurement(probes, seed), probed))
            found.append((probed.layer.name, probes, error, *true))
        return own(self, probed, *more)

    measuring.Measurement.measure = watching
    try:
        bake(bpy.context.scene, bpy.context.view_layer, options, size=SIZE)
    finally:
        measuring.Measurement.measure = own
    for layer, probes, error, true, noise in found:
        ends = error.value, *error.ci95
        yield Told(seed, layer, error.metric, probes, *ends, true, noise, error.seconds)


def all_told(count: int, kept: Path = KEPT) -> list[Told]:
    """Of so many scenes."""
    lines = kept_lines(range(count), kept, lambda seed: map(asdict, told(seed)))
    return [Told(**line) for line in lines]


def section(count: int) -> str:
    """So many scenes, as a part of the document."""
    return document_of(all_told(count))


def document_of(told_of: list[Told]) -> str:
    """The same of what was found."""
    rows = []
    for metric, probes in sorted({(each.metric, each.probes) for each in told_of}):
        layers = [each for each in told_of if (each.metric, each.probes) == (metric, probes)]
        wrong = [each for each in layers if each.true > 0.0]
        above = [each.high / each.true for each in wrong]
        values = [each.value / each.true for each in wrong]
        held = [sum(getattr(each, name) for each in layers) for name in ("holds", "may_hold")]
        rows.append([metric, str(probes), str(len(layers))])
        rows[-1] += [f"{100.0 * each / len(layers):.0f}%" for each in held]
        rows[-1] += [f"{np.median(each):.2f}" if each else "" for each in (above, values)]
    width, height = SIZE
    header = ["metric", "probes", "layers", "held", "within the truth's noise", "upper end over truth"]
    return "\n\n".join(
        [
            "### Intervals on random scenes",
            f"{len({each.scene for each in told_of})} of {SCENES} scenes of up to eight things, three lamps "
            "and fog, some in toon, with good settings and bad ones (1 to 16 samples, maps of 128 texels), "
            f"{width}x{height}. The truth is the reports' own, asked at every pixel and with more rays: how "
            "often the interval holds the error of all pixels, or does if widened by two standard deviations "
            "of that error's own noise, and, in the median, its upper end and the value over that error.",
            table([*header, "value over truth"], rows),
        ]
    )
