"""The GPU device itself: values to and fro, programs that fail, and starting or refusing to."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from strata.addon.core import shader as shaders
from strata.addon.core.errors import Cancelled, DeviceUnavailable, ShaderError
from strata.addon.core.shader import Shader, shader_text
from strata.addon.core.view import View
from strata.addon.devices import start
from strata.addon.devices.gpu import GpuDevice
from strata.addon.devices.gpu_image import stack_columns
from strata.addon.effects.shared.gpu_steps import UNSORT
from strata.addon.effects.shared.steps import LAYERED_DEPTH
from strata.scripts.build.compile_shaders import all_shaders
from strata.tests.support.gpu_objects import GpuObjects
from strata.tests.support.gpu_scenes import gpu_device, scene_of, share_beyond, triangle_mesh

VALUES = {
    "numbers": np.linspace(-3, 5, 35, dtype=np.float32).reshape(5, 7),
    "extremes": np.array([[np.inf, -np.inf, 0.0, -0.0, 1e-45, 3.4e38, -1e-30]], np.float32),
    "pairs": np.random.default_rng(1).normal(size=(4, 9, 2)).astype(np.float32),
    "vectors": np.random.default_rng(2).normal(size=(4, 9, 3)).astype(np.float32),
    "colours": np.random.default_rng(3).normal(size=(3, 2, 4)).astype(np.float32),
    "stack": np.random.default_rng(4).normal(size=(5, 6, 8)).astype(np.float32),
    "ids": np.array([[-1, 0, 1], [2**31 - 1, -(2**31), 2**24 + 1]], np.int32),
    "counts": np.array([[0, 2**32 - 1, 2**31]], np.uint32),
    "marks": np.array([[0, 1], [255, 7]], np.uint8),
}


@pytest.mark.parametrize("name", VALUES)
def test_values_go_to_the_gpu_and_back_bit_by_bit(name):
    device, array = gpu_device(), VALUES[name]
    back = device.to_host(device.from_host(array))
    assert back.dtype == array.dtype
    assert back.shape == array.shape
    # The sign of zero and subnormal numbers are the GPU's own business.
    ordinary = (np.abs(array.astype(np.float64)) >= 1e-37) | (array == 0)
    assert np.array_equal(back[ordinary], array[ordinary])


def test_nested_values_keep_their_shape_and_are_released():
    device = gpu_device()
    value = device.from_host({"a": VALUES["vectors"], "b": (VALUES["ids"], 3.5, "text")})
    back = device.to_host(value)
    assert np.array_equal(back["a"], VALUES["vectors"])
    assert np.array_equal(back["b"][0], VALUES["ids"])
    assert back["b"][1:] == (3.5, "text")
    device.release(value)
    assert value["a"].texture is None


def test_a_stack_wider_than_a_texture_is_tall_is_laid_out_in_columns():
    device = gpu_device()
    largest, device.largest_texture = device.largest_texture, 20
    try:
        stack = np.random.default_rng(5).normal(size=(5, 6, 7)).astype(np.float32)
        image = device.upload(stack)
        assert image.columns == 2
        assert image.size == (14, 18)
        assert np.array_equal(device.to_host(image), stack)
    finally:
        device.largest_texture = largest
    with pytest.raises(ValueError, match="do not fit"):
        stack_columns((9, 6, 7), 20)


def test_a_broken_program_raises_with_the_compilers_log(tmp_path, monkeypatch):
    (tmp_path / "broken.glsl").write_text("void main() { this_does_not_exist = 1; }\n")
    monkeypatch.setattr(shaders, "ADDON", tmp_path)
    with pytest.raises(ShaderError, match=r"broken\.glsl") as caught:
        gpu_device().compile(Shader("broken.glsl"))
    assert "this_does_not_exist" in caught.value.log


def test_includes_are_read_once_and_beside_the_file_first(tmp_path, monkeypatch):
    shared = tmp_path / "shared"
    shared.mkdir()
    (shared / "common.glsl").write_text("COMMON\n")
    (shared / "both.glsl").write_text('#include "common.glsl"\nSHARED BOTH\n')
    (tmp_path / "both.glsl").write_text('#include "common.glsl"\nOWN BOTH\n')
    (tmp_path / "main.glsl").write_text('#include "common.glsl"\n#include "both.glsl"\nMAIN\n')
    monkeypatch.setattr(shaders, "ADDON", tmp_path)
    monkeypatch.setattr(shaders, "SHARED", shared)
    text = shader_text("main.glsl")
    assert [word for word in text.split() if word in ("COMMON", "OWN", "SHARED", "MAIN")] == [
        *("COMMON", "COMMON", "OWN", "MAIN")
    ]
    # Twice in the text, once for the compiler: each copy stands behind its file's guard.
    assert text.count("#ifndef INCLUDED_SHARED_COMMON") == 2
    (tmp_path / "main.glsl").write_text('#include "missing.glsl"\n')
    with pytest.raises(OSError, match="missing"):
        shader_text("main.glsl")


def test_every_declared_program_compiles():
    device = gpu_device()
    programs = list(all_shaders())
    assert len(set(programs)) == len(programs)
    for program in programs:
        device.compile(program)


def test_programs_are_compiled_once():
    device = gpu_device()
    before = device.compile_seconds
    first = device.compile(UNSORT.defining("SOMETHING 1"))
    seconds = device.compile_seconds
    assert seconds > before
    assert device.compile(UNSORT.defining("SOMETHING 1")) is first
    assert GpuDevice().compile(UNSORT.defining("SOMETHING 1")) is first
    assert device.compile_seconds == seconds
    assert device.compile(UNSORT) is not first


def test_a_raised_flag_stops_the_next_dispatch():
    device = GpuDevice()
    image = device.new_image((4, 4))
    device.cancel_flag.set()
    with pytest.raises(Cancelled):
        device.dispatch(UNSORT, (4, 4), {"depths": image}, {"sorted": image}, {"size": (4, 4)})


def test_it_says_in_one_line_why_it_does_not_start(monkeypatch):
    monkeypatch.setenv("STRATA_DISABLE_GPU", "1")
    with pytest.raises(DeviceUnavailable, match="STRATA_DISABLE_GPU"):
        GpuDevice()


def test_importing_touches_no_gpu():
    program = "import sys, strata.addon.devices.gpu; sys.exit('gpu' in sys.modules or 'bpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_the_comparer_sees_a_perturbed_image():
    image = np.random.default_rng(6).random((20, 30)).astype(np.float32)
    perturbed = image.copy()
    perturbed[3, 4] += 0.01
    assert share_beyond(image, image, 0.0) == 0.0
    assert share_beyond(image, perturbed, 0.005) == pytest.approx(1 / 600)
    assert share_beyond(image, perturbed, 0.02) == 0.0
    perturbed[3, 4] = np.nan
    assert share_beyond(image, perturbed, 1.0) == pytest.approx(1 / 600)
    perturbed[3, 4] = np.inf
    assert share_beyond(perturbed, image, 1.0) == pytest.approx(1 / 600)


def test_a_missing_gpu_fails_where_one_is_expected():
    environment = os.environ | {"STRATA_DISABLE_GPU": "1", "STRATA_EXPECT_GPU": "1"}
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        __file__,
        "-k",
        "compiled_once",
    ]
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 1, ran.stdout
    assert "but no GPU" in ran.stdout


def test_leaving_with_gpu_objects_alive_is_no_crash():
    gpu_device()
    program = """
import bpy, numpy, sys
from strata.addon.devices import start
from strata.addon.devices.gpu import GpuDevice
from strata.addon.effects.shared.gpu_steps import UNSORT
sys.modules["keeps"] = device = GpuDevice()
device.kept_here = device.upload(numpy.zeros((4, 4), numpy.float32)), device.compile(UNSORT) and None
device.finish()
"""
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_switching_off_frees_every_gpu_object():
    gpu_device()
    triangles = np.random.default_rng(9).normal(size=(40, 3, 3))
    with GpuObjects() as objects:
        device = GpuDevice()
        device.set_scene(*scene_of([triangle_mesh(triangles)]))
        geometry = device.geometry()
        held = device.upload(VALUES["colours"]), device.compile(UNSORT.defining("HELD 1")) and None
        view = View((0, 0, 9), (1, 0, 0), (0, 1, 0), (0, 0, -1), (-1, 1, -1, 1), 0.1, 99.0)
        depths = LAYERED_DEPTH.gpu(device, geometry, view, frozenset({0}), 2, 16, 16)
        device.finish()
        assert objects.made > 10
        kinds = set(objects.held())
        assert {"GPUTexture", "GPUShader", "GPUVertBuf"} <= kinds
        start.unregister()
        assert objects.held() == []
        # All is made anew when it is asked for.
        device.set_scene(*scene_of([triangle_mesh(triangles)]))
        again = LAYERED_DEPTH.gpu(device, device.geometry(), view, frozenset({0}), 2, 16, 16)
        assert np.isfinite(device.to_host(again)).any()
        device.release([held, depths, again])


CROPPED = [((9, 12), np.int32), *(((9, 12, *more), np.float32) for more in ((), (2,), (3,), (4,)))]


@pytest.mark.parametrize(("shape", "dtype"), CROPPED)
def test_a_part_of_an_image(shape, dtype):
    device = gpu_device()
    image = np.random.default_rng(1).integers(-99, 99, shape).astype(dtype)
    found = device.to_host(device.cropped({"image": device.from_host(image)}, (1, 3), (7, 5)))["image"]
    assert found.dtype == dtype
    assert np.array_equal(found, image[1:8, 3:8])
