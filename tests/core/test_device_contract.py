"""What steps and references call is declared in core/device.py, and both devices have what is declared."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from strata.addon.core import device as contract
from strata.addon.core.surface import ATTRIBUTES
from strata.addon.devices.cpu import CpuDevice, CpuRays
from strata.addon.devices.gpu import GpuDevice
from strata.addon.devices.gpu_geometry import GpuGeometry
from strata.addon.devices.gpu_image import GpuImage
from strata.tests.support.gpu_scenes import gpu_device
from strata.tests.support.places import ROOT

EFFECTS = sorted((ROOT / "addon/effects").rglob("*.py"))
CORE = [ROOT / "addon/core" / name for name in ("executor.py", "graph.py", "value_stores.py")]


def members(protocol: type) -> set[str]:
    """What a protocol declares, with what it builds on."""
    found: set[str] = set()
    for each in protocol.__mro__:
        if each.__module__ == contract.__name__:
            found |= {*vars(each).get("__annotations__", {}), *vars(each)}
    return {name for name in found if not name.startswith("_")}


def contract_of(path: Path, function: ast.FunctionDef, argument: ast.arg) -> type | None:
    """What an argument of a step's or a reference's function has to have; None for other arguments."""
    told = ast.unparse(argument.annotation) if argument.annotation is not None else ""
    if getattr(vars(contract).get(told), "__module__", "") == contract.__name__:
        return getattr(contract, told)
    is_gpu = path.name.startswith("gpu_")
    if argument.arg == "device":
        return contract.Device if path in CORE else contract.GpuSteps if is_gpu else contract.CpuSteps
    if argument.arg == "rays":
        return contract.RayCaster
    return contract.GpuGeometry if is_gpu and argument.arg in ("geometry", "hull") else None


def undeclared(path: Path, source: str) -> Iterator[str]:
    """What functions read of such arguments and the contract does not have."""
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef):
            continue
        for argument in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs):
            if (protocol := contract_of(path, function, argument)) is None:
                continue
            for node in ast.walk(function):
                is_read = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
                if is_read and node.value.id == argument.arg and node.attr not in members(protocol):
                    yield f"{path.name}: {function.name}: {argument.arg}.{node.attr}"


@pytest.mark.parametrize("path", [*CORE, *EFFECTS], ids=lambda path: path.relative_to(ROOT).as_posix())
def test_nothing_is_called_that_is_not_declared(path):
    assert list(undeclared(path, path.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("steps.py", "def twin(device, surface):\n    return device.dispatch()"),
        ("gpu_steps.py", "def twin(device, surface):\n    return device.kernels.composite()"),
        ("gpu_steps.py", "def twin(device, geometry):\n    return geometry._lists"),
        ("steps.py", "def both(device: Device):\n    def inner():\n        device.kernels\n    inner()"),
        ("reference.py", "def truth(rays, outline):\n    return rays.camera"),
    ],
)
def test_calls_that_are_not_declared_are_found(name, source):
    assert len(list(undeclared(ROOT / name, source))) == 1


def test_everything_that_is_declared_for_steps_is_called():
    """What nobody calls is deleted. Faces set a device's scene and say what it is."""
    sources = [path.read_text(encoding="utf-8") for path in (*CORE, *EFFECTS)]
    called = {
        node.attr for s in sources for node in ast.walk(ast.parse(s)) if isinstance(node, ast.Attribute)
    }
    tables = {each.corners for each in ATTRIBUTES.values()}  # asked for by name
    for protocol in (contract.CpuSteps, contract.GpuSteps, contract.GpuGeometry):
        assert members(protocol) - called - tables - {"set_scene", "description", "traces_rays"} == set()


def same_arguments(declared, real) -> bool:
    """Whether what is declared can be called of the real thing: the same names, in order."""
    declared, real = (list(inspect.signature(each).parameters.values()) for each in (declared, real))
    names = [each.name for each in declared]
    rest = real[len(names) :]
    return [each.name for each in real[: len(names)]] == names and all(
        each.default is not inspect.Parameter.empty for each in rest
    )


def check(real: type, instance, protocol: type) -> None:
    for name in members(protocol):
        assert hasattr(instance, name), f"{real.__name__}.{name}"
        declared = getattr(protocol, name, None)
        if inspect.isfunction(declared):
            assert same_arguments(declared, getattr(real, name, declared)), f"{real.__name__}.{name}"


def test_devices_have_what_is_declared(backend):
    if backend == "cpu":
        check(CpuDevice, CpuDevice(), contract.CpuSteps)
    else:
        device = gpu_device()
        check(GpuDevice, device, contract.GpuSteps)
        check(GpuImage, device.upload(np.zeros((2, 3), np.float32)), contract.GpuImage)
        for name in members(contract.GpuGeometry):
            declared = getattr(contract.GpuGeometry, name)
            assert hasattr(GpuGeometry, name), name
            if inspect.isfunction(declared):
                assert same_arguments(declared, getattr(GpuGeometry, name)), name


def test_rays_have_what_is_declared():
    check(CpuRays, CpuRays(None, np.zeros(3)), contract.RayCaster)
