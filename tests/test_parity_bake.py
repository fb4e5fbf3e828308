"""Whole bakes on both devices. One light sample more or less is 1/256, so they agree as statistics do: on the
mean, and in nearly all pixels; a bound on every pixel of the chain would be a lie."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import SAMPLES
from gpu_scenes import gpu_device
from strata.addon.bake import Options, bake
from strata.addon.scene.open import choose, open_blend


def baked(path, backend: str, method: str):
    open_blend(path)
    chosen = choose()
    values = {"soft_shadow": {"method": method, "resolution": 256}}
    options = Options(backend=backend, samples=1, probes=0, values=values)
    return bake(chosen.scene, chosen.view_layer, options, size=(128, 72)).layers


@pytest.mark.parametrize("method", ["bitmask", "hybrid"])
def test_a_bake_on_the_gpu_is_the_one_on_the_cpu(method):
    gpu_device()
    path = SAMPLES / "stacked.blend"
    sets = [baked(path, backend, method) for backend in ("cpu", "gpu")]
    assert not [warning for warning in sets[1].report["warnings"] if "failed on gpu" in warning]
    ran = {(step["name"], step["device"]) for step in sets[1].report["steps"]}
    for name in ("surface", "layered_depth", "soft_shadow/prepare", "soft_shadow/backproject"):
        assert (name, "gpu") in ran
        assert (name, "cpu") not in ran
    for cpu, gpu in zip(sets[0].layers, sets[1].layers, strict=True):
        assert cpu.name == gpu.name
        difference = gpu.pixels.astype(np.float64) - cpu.pixels
        # A pixel at a silhouette may see another surface (up to 1); they are few, and to both sides.
        assert (np.abs(difference) > 0.02).mean() < 0.01, cpu.name
        assert abs(difference.mean()) < 5e-4, cpu.name
        assert np.sqrt((difference**2).mean()) < 0.02, cpu.name
