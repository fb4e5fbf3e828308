"""Extremes of what samples weigh: a finished shadow on the light that it is of, against the mean of the
samples' own products."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from strata.addon.bake import BakeJob
from strata.addon.core.arrays import Arrays, MeshArrays, Opacities
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.material import Material
from strata.addon.core.outline import Bounds, Instance, Light, Mesh, Outline
from strata.addon.core.shot import Camera, Raster, Shot
from strata.addon.planning import Options, plan_scene
from strata.tests.effects.extremes import Row
from strata.tests.support.settings import maps

BOUND = 2e-6
"""Of the brightest pixel: some float32 roundings of products and their sums."""

SIZE, SAMPLES = (48, 32), 4
CAMERA = Camera("Camera", (0.0, 0.0, 8.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
DOWN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)


def lamp(at=(1.0, 0.5, 4.0), power=1.0, half=0.3, name="Lamp", axes=DOWN) -> Light:
    right, up, forward = axes
    emitter = Emitter(EmitterKind.RECTANGLE, at, right, up, forward, half, half)
    return Light(name, name, "AREA", emitter, (power, 0.8 * power, 0.5 * power))


def scene(*lights: Light, albedo=0.8, bar_albedo=0.05, metallic=0.0) -> tuple[Outline, Arrays]:
    """A ground under thin bars of another colour: most pixels show both, and the bars' shadows."""
    quads = [[(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)]]
    quads += [
        [(x, -3, 0.7), (x + 0.07, -3, 0.7), (x + 0.3, 3, 0.7), (x + 0.23, 3, 0.7)] for x in range(-3, 3)
    ]
    meshes, instances, headers = [], [], []
    for index, quad in enumerate(quads):
        points = np.array(quad, np.float32)
        meshes.append(MeshArrays(points, np.arange(4, dtype=np.int32), np.array([0, 4], np.int32)))
        bounds = Bounds(tuple(points.min(0).tolist()), tuple(points.max(0).tolist()))
        rows = tuple(map(tuple, np.eye(4).tolist()))
        instances.append(Instance(str(index), index, rows, bounds, index, (int(index > 0),)))
        headers.append(Mesh(str(index), str(index), 4, 2))
    materials = (
        Material("Ground", base_color=(albedo,) * 3, metallic=metallic),
        Material("Bar", base_color=(bar_albedo,) * 3, metallic=metallic),
    )
    outline = Outline("Scene", "Layer", 1, lights, tuple(instances), tuple(headers), materials)
    return outline, Arrays(tuple(meshes), np.array([np.eye(4)] * len(quads)), (Opacities(), Opacities()))


def baked(device, read, size=SIZE, samples=SAMPLES):
    """Layers by name, each light's unshadowed picture, and the picture of all."""
    outline, arrays = read
    shot = Shot("Camera", Raster(CAMERA, size), seed=1)
    options = Options(
        ("soft_shadow",),
        device.name,
        samples,
        0,
        maps(resolution=256),
        lit=True,
        composite=True,
    )
    graph = plan_scene(outline, shot, options)
    result = BakeJob(outline, graph, arrays, options).result()
    layers = {layer.name: layer.pixels.astype(np.float64) for layer in result.layers.layers}
    return layers, result.lit, result.composite.astype(np.float64)


def product_error(device, read, **how) -> float:
    """Of one lamp: shadow times light less the shadowed picture, over the brightest pixel; NaN if any is."""
    layers, lit, composite = baked(device, read, **how)
    (shadow,) = layers.values()
    (light,) = lit.values()
    apart = shadow[..., None] * light[..., :3] - composite[..., :3]
    return float(np.abs(apart).max() / max(composite[..., :3].max(), np.finfo(np.float32).tiny))


def company_error(device, factor: float) -> float:
    """How a lamp's shadow changes beside another of `factor` times its power."""
    alone, _, _ = baked(device, scene(lamp()))
    both, _, _ = baked(device, scene(lamp(), lamp((-1.0, 0.0, 4.0), factor, name="Other")))
    name = next(iter(alone))
    return float(np.abs(both[name] - alone[name]).max())


def range_error(device, read) -> float:
    """How far a shadow is beyond 0 and 1, where nothing is multiplied and the mean of the samples stands."""
    layers, _, _ = baked(device, read)
    return max((float(np.abs(image - image.clip(0.0, 1.0)).max()) for image in layers.values()), default=0.0)


SIDEWAYS = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
PRODUCTS = {
    **{f"a lamp of power {power:g}": scene(lamp(power=power)) for power in (1e-12, 1e-6, 1.0, 1e6, 1e12)},
    **{f"a ground of albedo {albedo:g}": scene(lamp(), albedo=albedo) for albedo in (1e-12, 1e-6, 1.0)},
    "bars 1e12 times as dark as the ground": scene(lamp(), bar_albedo=8e-13),
    "light that grazes the ground, 1 mm above it": scene(lamp((-6.0, 0.0, 0.35), half=0.349, axes=SIDEWAYS)),
    "a lamp 1e4 m away": scene(lamp((3e3, 0.0, 1e4), power=1e8, half=300.0)),
}
SHAPES = {
    "one sample a pixel": {"samples": 1},
    "64 samples a pixel": {"samples": 64, "size": (24, 16)},
    "an image of 1 x 1": {"size": (1, 1)},
    "an image of 16384 x 1": {"size": (16384, 1)},
    "an image of 1 x 4096": {"size": (1, 4096)},
}
UNLIT = {
    "metals only": scene(lamp(), metallic=1.0),
    "black surfaces": scene(lamp(), albedo=0.0, bar_albedo=0.0),
    "a lamp behind the ground": scene(
        lamp((0.5, 0.0, -2.0), axes=(DOWN[0], (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)))
    ),
}


def rows(devices) -> Iterator[Row]:
    """Products, other lamps, and pixels in which nothing weighs."""

    def row(name: str, truth: str, error, bound: float = BOUND) -> Row:
        return Row(name, truth, {device.name: error(device) for device in devices}, bound)

    for name, read in PRODUCTS.items():
        yield row(name, "mean of products", lambda device, read=read: product_error(device, read))
    for name, how in SHAPES.items():
        yield row(
            name, "mean of products", lambda device, how=how: product_error(device, scene(lamp()), **how)
        )
    for factor in (1e-12, 1e12):
        yield row(
            f"beside a lamp of {factor:g} times the power",
            "the lamp alone",
            lambda device, factor=factor: company_error(device, factor),
            0.0,
        )
    for name, read in UNLIT.items():
        yield row(name, "0 to 1", lambda device, read=read: range_error(device, read), 0.0)
