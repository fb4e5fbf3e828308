"""The whole chain on random scenes: surface, maps, shadows, probes, interval; against rays at every pixel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import strata_kernels
from strata.addon.core.executor import Executor
from strata.addon.core.graph import Graph, Node, PlannedLayer
from strata.addon.core.outline import Outline
from strata.addon.core.recorder import plan
from strata.addon.core.sampling import Sampling
from strata.addon.core.slices import finished
from strata.addon.core.surface import Chunk
from strata.addon.devices.cpu import CpuDevice, CpuRays
from strata.addon.effects.shared import steps
from strata.addon.effects.soft_shadow import EFFECT
from strata.addon.measure.measure import Measurement
from strata.addon.measure.report import LayerError
from strata.tests.measure.scenes import random_scene, shot_of
from strata.tests.support.executing import drain

SCENES = 50
PROBES = 64
TRUTH_RAYS = 256  # of each half, at every pixel; the halves' product is free of their noise


@dataclass
class Scored:
    """A scene's one layer, baked; `values` and the arrays of its shading points (rows, width[, 3])."""

    outline: Outline
    graph: Graph
    points: dict[str, np.ndarray]
    values: np.ndarray
    rays: CpuRays
    casters: np.ndarray

    @property
    def surface(self) -> Node:
        return self.graph.surface

    @property
    def layer(self) -> PlannedLayer:
        return self.graph.layers[0]

    def add(self, chunk, surface, layers) -> Iterator[None]:
        self.points, self.values = surface, layers[self.layer.name]
        yield

    def measured(self, values=None, probes=PROBES, seed=0) -> LayerError:
        values = self.values if values is None else values
        measurement = Measurement(self.graph, self.outline, probes, seed)
        width, height = self.graph.shot.size
        chunk = Chunk(width, height, 0, height, 0, (0.0, 0.0))
        finished(measurement.add(chunk, self.points, {self.layer.name: values}))
        return finished(measurement.measure(self.layer, self.rays, self.casters, values))

    def truth(self) -> tuple[np.ndarray, np.ndarray]:
        """Two independent estimates (2, pixels) and the weights (pixels,), by the kernel's light samples."""
        points = [
            np.ascontiguousarray(self.points[name].reshape(-1, 3))
            for name in ("position", "geometric_normal", "shading_normal")
        ]
        emitter, eye = self.outline.lights[0].emitter.packed(), np.array(self.graph.shot.origin)
        halves = [
            strata_kernels.ray_visibility(
                self.rays.accel, self.casters, emitter, eye, *points, TRUTH_RAYS, 1000 + half
            )
            for half in range(2)
        ]
        return np.array([half[0] for half in halves], np.float64), halves[0][1].astype(np.float64)


def bake(seed: int) -> Scored | None:
    """None where the plan leaves the light out."""
    outline, arrays = random_scene(seed)
    graph = plan(outline, shot_of(seed), {EFFECT: EFFECT.params(resolution=256)})
    if not graph.layers:
        return None
    device = CpuDevice()
    device.set_scene(outline, arrays)
    executor = Executor(device, device)
    layer = graph.layers[0]
    shot = Scored(outline, graph, {}, np.empty(0), None, device.instance_mask(layer.casters))
    drain(executor.run(graph, Sampling(*graph.shot.size), shot))
    accelerator = executor.value(steps.ray_accelerator(outline, graph.shot), device)
    shot.rays = CpuRays(accelerator, np.array(graph.shot.origin))
    return shot


@cache
def shots() -> list[tuple[Scored, np.ndarray, np.ndarray]]:
    baked = [shot for seed in range(SCENES + 10) if (shot := bake(seed))][:SCENES]
    assert len(baked) == SCENES
    return [(shot, *shot.truth()) for shot in baked]


def rmse(values, halves, weights) -> float:
    values = values.reshape(-1).astype(np.float64)
    squares = (weights * (values - halves[0]) * (values - halves[1])).sum()
    return float(np.sqrt(max(squares, 0.0) / weights.sum()))


def spoilt(values, halves, weights, rng) -> np.ndarray:
    """One to five of a thousand lit pixels turned from light to dark or from dark to light."""
    values = values.copy()
    lit = np.flatnonzero(weights > 0.0)
    bad = rng.choice(lit, max(round(rng.uniform(1e-3, 5e-3) * len(lit)), 1), replace=False)
    values.reshape(-1)[bad] = halves.mean(0)[bad] < 0.5
    return values


@pytest.mark.parametrize("rare_errors", [False, True], ids=["as baked", "rare large errors"])
def test_the_interval_holds_the_true_error(rare_errors):
    rng = np.random.default_rng(0)
    held, missed = 0, []
    for seed, (shot, halves, weights) in enumerate(shots()):
        values = spoilt(shot.values, halves, weights, rng) if rare_errors else shot.values
        truth, error = rmse(values, halves, weights), shot.measured(values, seed=seed)
        low, high = error.ci95
        if low <= truth <= high:
            held += 1
        else:
            missed.append((seed, truth, error.ci95))
    assert held >= 0.9 * SCENES, missed


def test_estimates_are_unbiased():
    """Squares of many layers, each seen with few probes, add up to the true sum."""
    found, true = [], []
    for shot, halves, weights in shots()[:20]:
        true.append(rmse(shot.values, halves, weights) ** 2)
        found.append([shot.measured(seed=seed).value ** 2 for seed in range(8)])
    sums = np.sum(found, axis=0)
    assert sums.mean() == pytest.approx(sum(true), abs=4 * sums.std(ddof=1) / np.sqrt(8))


def broken(change):
    """LAYERED_DEPTH with a bug: `change` is done to its depths (layers, height, width)."""

    sound = steps.LAYERED_DEPTH

    def twin(device, *inputs, **params):
        return np.ascontiguousarray(change(sound.cpu(device, *inputs, **params)))

    return replace(sound, name="layered_depth_broken", cpu=twin)


BUGS = {
    "map shifted by a fiftieth": lambda depths: np.roll(depths, 5, axis=2),
    "nearest layer lost": lambda depths: np.concatenate([depths[1:], np.full_like(depths[:1], np.inf)]),
}


@pytest.mark.parametrize("bug", BUGS.values(), ids=BUGS)
def test_a_broken_kernel_shows_in_one_report(bug, monkeypatch):
    healthy = bake(1).measured(probes=512)
    monkeypatch.setattr(steps, "LAYERED_DEPTH", broken(bug))
    report = bake(1).measured(probes=512)
    assert report.ci95[0] > 1.5 * healthy.ci95[1]
    assert report.max > 0.3


def test_the_choice_of_tiles_does_not_change_the_report(monkeypatch):
    shot = bake(2)
    monkeypatch.setattr("strata.addon.core.sampling.PIXELS_PER_TILE", 48 * 7)
    measurement = Measurement(shot.graph, shot.outline, PROBES, 0)
    device = CpuDevice()
    device.set_scene(*random_scene(2))
    drain(Executor(device, device).run(shot.graph, Sampling(*shot.graph.shot.size), measurement))
    tiled = finished(measurement.measure(shot.layer, shot.rays, shot.casters, shot.values))
    assert tiled.to_json() | {"seconds": 0} == shot.measured().to_json() | {"seconds": 0}
