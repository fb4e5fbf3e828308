"""Volumetric light: the open integral at 1080p, the walk against a march through the same maps,
bakes against Cycles."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass, replace

import numpy as np
import strata_kernels
from strata.addon.bake import bake, read_scene
from strata.addon.core.executor import Executor
from strata.addon.core.surface import Chunk
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared.steps import SURFACE
from strata.addon.effects.volumetric_light.lattice import lattice_of
from strata.addon.planning import Options

from . import airlight, cycles
from .document import significant, table, times

ROUNDS = 7
SIZE = (240, 135)
TRUTH_STEPS = 32768
STEPS = (4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048)
ORDER = 5
"""Nodes a panel that bring the open integral 1e-4 of relative L2."""


def _median(work, rounds=ROUNDS) -> float:
    seconds = []
    for _ in range(rounds):
        started = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - started)
    return statistics.median(seconds)


def open_integral() -> str:
    """A point light and a sun without casters at 1920 x 1080."""
    width, height = 1920, 1080
    rays = np.array([0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 0, -0.5, -0.28, 1 / width, 0.56 / height, 0.1, 0.0])
    depth = np.random.default_rng(0).uniform(3.0, 20.0, (height, width)).astype(np.float32)
    rows = []
    for light, kind, axis in (("point", 1, (0, 0, -1)), ("sun", 0, (0, 0.6, -0.8))):
        source = np.array([kind, 1, 8, 0.5, *axis, 0.1, 0, -1, 0, np.inf, 0], np.float64)
        for medium, extinction in (("grey", (0.06, 0.06, 0.06)), ("coloured", (0.06, 0.07, 0.08))):
            packed = np.array([0.05] * 3 + [*extinction, 0.3])
            exact = strata_kernels.airlight(depth, rays, packed, source, [], order=16)
            image = strata_kernels.airlight(depth, rays, packed, source, [], order=ORDER)
            error = np.sqrt(np.mean((image - exact) ** 2)) / exact.mean()

            def work(packed=packed, source=source):
                strata_kernels.airlight(depth, rays, packed, source, [], order=ORDER)

            rows.append((light, medium, significant(1e3 * _median(work), 3), f"{error:.1e}"))
    return table(("light", "medium", "ms", "relative L2"), rows)


@dataclass(frozen=True)
class Prepared:
    """One light of a scene, with everything that its integral reads."""

    light: str
    arguments: tuple
    order: int


def prepared(scene, view_layer) -> list[Prepared]:
    """The scene's lights as one point of no size each, in a medium that is everywhere."""
    values = {"use_scene_medium": False, "scattering_per_m": "0.08,0.08,0.09", "light_samples": 1}
    options = Options(("volumetric_light",), "cpu", 1, 0, {"volumetric_light": values})
    outline, graph, arrays, _ = read_scene(scene, view_layer, options, size=SIZE)
    device = CpuDevice()
    device.set_scene(outline, arrays)
    executor = Executor(device, device)
    chunk = Chunk(*SIZE, 0, SIZE[1], 0, (0.0, 0.0))
    surface = SURFACE.cpu(
        device,
        executor.value(graph.surface.inputs[0], device),
        view=graph.shot.view,
        visible=graph.surface.params["visible"],
        chunk=chunk,
        attributes=frozenset({"depth"}),
    )
    found = []
    for node in graph.nodes():
        if node.step.name != "volumetric_light/airlight":
            continue
        maps = [executor.value(item, device) for item in node.inputs[1:]]
        lattice = lattice_of(graph.shot.view, chunk).packed()
        source = replace(node.params["source"], radius=0.0)
        packed = node.params["medium"].packed(), source.packed()
        found.append(
            Prepared(node.instance, (surface["depth"], lattice, *packed, maps), node.params["order"])
        )
    return found


def against_marching(lights: list[Prepared]) -> str:
    """How many jittered steps through the same maps are as good as the walk, and what they cost."""
    rows = []
    for light in lights:
        truth = strata_kernels.airlight(*light.arguments, march_steps=TRUTH_STEPS)

        def error(image, truth=truth):
            return np.sqrt(np.mean((image - truth) ** 2)) / truth.mean()

        walked = error(strata_kernels.airlight(*light.arguments, order=light.order))
        seconds = _median(lambda light=light: strata_kernels.airlight(*light.arguments, order=light.order), 5)
        for steps in STEPS:
            marched = error(strata_kernels.airlight(*light.arguments, march_steps=steps))
            if marched <= max(walked, 1e-3) or steps == STEPS[-1]:
                break

        def march(light=light, steps=steps):
            strata_kernels.airlight(*light.arguments, march_steps=steps)

        slow = _median(march, 3)
        least = "" if marched <= max(walked, 1e-3) else "more than "
        rows.append(
            (
                light.light,
                f"{walked:.1e}",
                significant(1e3 * seconds, 3),
                f"{least}{steps}",
                f"{marched:.1e}",
                significant(1e3 * slow, 3),
                times(slow / seconds),
            )
        )
    head = ("light", "walk: L2", "walk: ms", "march: steps", "march: L2", "march: ms", "march ÷ walk")
    return table(head, rows)


def against_cycles(scene, size=SIZE, samples=(16, 128, 1024), probes=airlight.PROBES, names=None) -> str:
    """Each light at default settings and pixel centres, the error of its method by rays: what it takes
    Cycles, whose error is its noise, to be as right, from its longest render on as 1 / sqrt(time). How noise
    really falls from the fewest samples to the most is told too."""
    options = Options(("volumetric_light",), "cpu", samples=1, probes=probes)
    baked = bake(scene, scene.view_layers[0], options, size=size)
    layers = {layer.light: layer for layer in baked.layers.layers if layer.light}
    alone = {entry.light: entry.seconds_alone for entry in baked.report.layers}
    rows = []
    for lamp in cycles.lamps(scene):
        if lamp.name not in layers or (names and lamp.name not in names):
            continue
        layer, own = layers[lamp.name], alone[lamp.name]
        whole = airlight.brightness(layer.pixels.astype(np.float64))
        found = [_noise_of_cycles(scene, lamp, count, size, whole) for count in samples]
        noises, seconds = zip(*found, strict=True)
        error = layer.error["method"]
        power = np.log(noises[-1] / noises[0]) / np.log(samples[-1] / samples[0])
        ratio = times(seconds[-1] * (noises[-1] / error) ** 2 / own) if error > 0.0 else "more"
        marks = [f"{e:.3f} in {significant(s, 3)} s" for e, s in found]
        rows.append((lamp.name, f"{error:.4f}", significant(own, 3), *marks, f"{power:.2f}", ratio))
    head = ("light", "error of the method", "s", *(f"Cycles, {count} samples" for count in samples))
    return table((*head, "power", "Cycles ÷ ours"), rows)


def _noise_of_cycles(scene, lamp, samples: int, size, whole: np.ndarray) -> tuple[float, float]:
    """Of a render, from two, as a share of `whole`, and the seconds of one."""
    first, second = (cycles.airlight(scene, lamp, samples, seed=seed, size=size) for seed in (1, 2))
    difference = (first.image - second.image) / whole
    return float(np.sqrt(np.mean(difference**2) / 2.0)), 0.5 * (first.seconds + second.seconds)
