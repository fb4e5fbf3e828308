"""Whole bakes on both devices. One light sample more or less is 1/256, so they agree as statistics do: on the
mean, and in nearly all pixels; a bound on every pixel of the chain would be a lie."""

from __future__ import annotations

import os
import sys

import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.core.errors import StrataError
from strata.addon.devices import gpu_context, gpu_shader
from strata.addon.devices.gpu import GpuDevice
from strata.addon.planning import Options
from strata.addon.scene.open import choose, open_blend
from strata.tests.support.gpu_scenes import gpu_device
from strata.tests.support.places import SAMPLES

STEPS = ("surface", "layered_depth", "soft_shadow/prepare", "soft_shadow/backproject")


def baked(path, backend: str, method: str, **more):
    open_blend(path)
    chosen = choose()
    values = {"soft_shadow": {"method": method, "resolution": 256}}
    options = Options(backend=backend, samples=1, probes=0, values=values, **more)
    return bake(chosen.scene, chosen.view_layer, options, size=(128, 72)).layers


@pytest.mark.parametrize("method", ["bitmask", "hybrid"])
def test_a_bake_on_the_gpu_is_the_one_on_the_cpu(method):
    gpu_device()
    path = SAMPLES / "stacked.blend"
    sets = [baked(path, backend, method) for backend in ("cpu", "gpu")]
    assert not [warning for warning in sets[1].report["warnings"] if "failed on gpu" in warning]
    ran = {(step["name"], step["device"]) for step in sets[1].report["steps"]}
    for name in STEPS:
        assert (name, "gpu") in ran
        assert (name, "cpu") not in ran
    assert_alike(*sets)


def assert_alike(on_cpu, on_gpu):
    for cpu, gpu in zip(on_cpu.layers, on_gpu.layers, strict=True):
        assert cpu.name == gpu.name
        difference = gpu.pixels.astype(np.float64) - cpu.pixels
        # A pixel at a silhouette may see another surface (up to 1); they are few, and to both sides.
        assert (np.abs(difference) > 0.02).mean() < 0.01, cpu.name
        assert abs(difference.mean()) < 5e-4, cpu.name
        assert np.sqrt((difference**2).mean()) < 0.02, cpu.name


@pytest.mark.parametrize(("name", "effect"), [("comic", "toon"), ("mist", "volumetric_light")])
def test_pixels_with_places_of_their_own_are_those_of_the_cpu(name, effect):
    """In a bounded haze too, whose entries and exits are found on the CPU."""
    gpu_device()
    effects = {"effects": (effect,), "placement": "per_pixel"}
    sets = [baked(SAMPLES / f"{name}.blend", backend, "bitmask", **effects) for backend in ("cpu", "gpu")]
    failed = [warning for warning in sets[1].report["warnings"] if "failed on gpu" in warning]
    assert all(warning.startswith("step 'volumetric_light/spans'") for warning in failed)
    assert ("surface", "gpu") in {(step["name"], step["device"]) for step in sets[1].report["steps"]}
    assert_alike(*sets)


@pytest.mark.parametrize(
    ("broken", "step"),
    [
        ("effects/soft_shadow/backproject.glsl", "soft_shadow/backproject"),
        ("effects/soft_shadow/coarser.glsl", "soft_shadow/prepare"),
        ("effects/shared/layered_depth.glsl", "layered_depth"),
        ("effects/shared/surface.glsl", "surface"),
    ],
)
def test_a_step_whose_shader_does_not_compile_runs_on_the_cpu(monkeypatch, broken, step):
    """The others stay on the GPU, and the report has the compiler's log."""
    gpu_device()
    path = SAMPLES / "stacked.blend"
    on_cpu = baked(path, "cpu", "bitmask")
    good = gpu_shader.shader_text
    monkeypatch.setattr(GpuDevice, "_programs", {})
    monkeypatch.setattr(
        gpu_shader,
        "shader_text",
        lambda path: good(path) + "void bad() { no_such_word = 1; }\n" * (path == broken),
    )
    fallen = baked(path, "gpu", "bitmask")
    (warning,) = [text for text in fallen.report["warnings"] if "failed on gpu" in text]
    assert warning.startswith(f"step '{step}' failed on gpu and ran on cpu: ")
    assert broken in warning
    assert "no_such_word" in warning
    ran = {(one["name"], one["device"]) for one in fallen.report["steps"]}
    # What reads maps that are made on the CPU runs there too.
    fallen_steps = {step, "soft_shadow/backproject"} if step == "soft_shadow/prepare" else {step}
    for name in STEPS:
        assert ((name, "gpu") in ran) == (name not in fallen_steps)
        assert (name, "cpu") in ran or name not in fallen_steps
    assert fallen.report["backend"] == "gpu"
    assert_alike(on_cpu, fallen)


def test_a_gpu_that_does_not_start_leaves_the_bake_to_the_cpu(monkeypatch):
    class Gpu:
        """As Blender's module where no context can be had: it prints its log, and raises."""

        class platform:
            @staticmethod
            def renderer_get():
                raise SystemError("not started")

        @staticmethod
        def init():
            os.write(2, b"EGL: no display\nno context could be made\n")
            raise SystemError("failed")

    monkeypatch.setitem(sys.modules, "gpu", Gpu)
    monkeypatch.setattr(gpu_context, "_loads", lambda _library: True)
    path = SAMPLES / "stacked.blend"
    found = baked(path, "auto", "bitmask")
    assert found.report["backend"] == "cpu"
    assert found.report["backend_reason"] == "no GPU: no context could be made"
    assert len(found.layers) > 0
    with pytest.raises(StrataError, match=r"^no GPU: no context could be made$"):
        baked(path, "gpu", "bitmask")
