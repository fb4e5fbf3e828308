"""The truth and the layers against Cycles: an independent renderer with its own geometry, lights and rays.

Cycles' shadow is a lit over an unshadowed render of one light with the same samples
(scripts/bench/cycles.py), taken twice with different seeds, so that its noise is known and taken off.
"""

from dataclasses import dataclass

import numpy as np
import pytest
import strata_kernels
from strata.addon.bake import bake
from strata.addon.core.surface import SurfacePoints
from strata.addon.devices.cpu import CpuRays
from strata.addon.effects.shared.visibility_truth import evaluate
from strata.addon.planning import Options
from strata.scripts.bench import airlight, cycles, scenes
from strata.scripts.bench.methods import surface_of
from strata.tests.support.figures import weighted_bias, weighted_rmse

SIZE = (160, 90)
SAMPLES = 32

SAME_POINT = 0.05
"""Relative difference of unshadowed irradiance by which a pixel shows another surface point in Cycles, whose
samples spread over a hundredth of a pixel: at silhouettes and at the rims of clipped leaves."""

LAYER_RMSE = 0.03
"""What a layer may be off at default settings: the project's goal for soft shadows, as large as the noise of
20 Cycles samples. Cycles' own noise here is below 0.01 and taken off."""


@dataclass
class Judge:
    """One light as Cycles sees it; `noise` is half the difference of two renders."""

    visibility: np.ndarray
    noise: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, scene, lamp_name: str) -> "Judge":
        lamp = scene.objects[lamp_name]
        first, second = (cycles.shadow(scene, lamp, SAMPLES, seed=seed, size=SIZE) for seed in (1, 2))
        return cls(
            np.nan_to_num(0.5 * (first.visibility + second.visibility)).ravel(),
            np.nan_to_num(0.5 * (first.visibility - second.visibility)).ravel(),
            0.5 * (first.weight + second.weight).ravel(),
        )

    def same_points(self, irradiance: np.ndarray) -> np.ndarray:
        """Where Cycles' unshadowed light is Strata's, up to a factor that all pixels share."""
        lit = (self.weight > 0.0) & (irradiance > 0.0)
        ratio = np.where(lit, irradiance, np.nan) / np.where(lit, self.weight, np.nan)
        return np.abs(ratio / np.nanmedian(ratio) - 1.0) < SAME_POINT

    def rmse(self, values: np.ndarray, where: np.ndarray, *noises: np.ndarray) -> float:
        """Weighted RMSE of values against Cycles, without what Cycles' noise and `noises` explain."""
        weight = self.weight[where]
        square = weighted_rmse((values - self.visibility)[where], weight) ** 2
        square -= sum(weighted_rmse(noise[where], weight) ** 2 for noise in (self.noise, *noises))
        return max(square, 0.0) ** 0.5

    def bias(self, values: np.ndarray, where: np.ndarray) -> float:
        return weighted_bias((values - self.visibility)[where], self.weight[where])


@pytest.fixture(scope="module")
def courtyard():
    scene = scenes.open_sample("courtyard")
    return scene, scenes.read(scene, SIZE)


@pytest.mark.parametrize(
    ("name", "share", "rmse"),
    [
        # What remains is one flipped pixel in a few hundred, at thin rails, leaves, roof tiles and two
        # faces in one plane; the sun's and the sky panel's light reaches most of them.
        ("Sun", 0.97, 0.02),
        ("Sky panel", 0.96, 0.03),
        ("Wall lantern light", 0.85, 0.015),  # where a spot's blend begins, irradiance is steep
        ("Lantern light", 0.97, 0.015),
    ],
)
def test_the_reference_is_what_cycles_renders(courtyard, name, share, rmse):
    scene, case = courtyard
    surface, _ = surface_of(case)
    layer = next(layer for layer in case.graph.layers if layer.light == name)
    emitter = case.outline.lights[layer.of.index].emitter
    casters = case.device.instance_mask(layer.casters)
    rays = CpuRays(strata_kernels.Accel(case.device.geometry(), case.eye, casters), case.eye)
    points = SurfacePoints(*surface.points, case.eye, surface.lifts)
    halves, irradiance = evaluate(rays, emitter, None, points, samples=16, seed=5)
    truth, noise = halves.mean(axis=1), 0.5 * (halves[:, 0] - halves[:, 1])
    judge = Judge.of(scene, name)
    same = judge.same_points(irradiance)
    assert same.sum() > share * ((judge.weight > 0.0) & (irradiance > 0.0)).sum()
    assert judge.rmse(truth, same, noise) < rmse
    # No systematic part: a tenth of the error that a layer may have.
    assert abs(judge.bias(truth, same)) < 0.1 * LAYER_RMSE


@pytest.mark.parametrize("values", [{"method": "bitmask"}, {"method": "rays", "sample_rays": 256}])
@pytest.mark.parametrize("name", ["stacked", "animated"])
def test_a_layer_is_what_cycles_renders(name, values):
    scene = scenes.open_sample(name)
    options = Options(backend="cpu", samples=1, probes=0, values={"soft_shadow": values})
    (layer,) = bake(scene, scene.view_layers[0], options, size=SIZE).layers.layers
    judge = Judge.of(scene, layer.light)
    where = judge.weight > 0.0
    assert judge.rmse(layer.pixels.ravel(), where) < LAYER_RMSE
    assert abs(judge.bias(layer.pixels.ravel(), where)) < 0.25 * LAYER_RMSE


@pytest.mark.parametrize("name", ["Sun", "Lantern", "Lamp"])
def test_volumetric_light_is_what_cycles_renders(name):
    """Light that the haze of mist scatters once; beside a lamp Cycles is noisier than a pixel is bright."""
    (found,) = airlight.compare_all(scenes.open_sample("mist"), SAMPLES, (96, 54), (name,))
    # Its mean knows the brightness to some 1% all the same.
    assert abs(found.bias) < 0.03
    assert found.error < LAYER_RMSE + found.cycles_noise
