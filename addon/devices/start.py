"""Which device runs a bake, and why."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache

from ..core.device import Device
from ..core.errors import DeviceUnavailable, StrataError
from .cpu import CpuDevice

BACKENDS = ("auto", "cpu", "gpu")


@dataclass(frozen=True)
class Devices:
    """`fallback` is the CPU; `reason` says in words why `primary` was taken."""

    primary: Device
    fallback: CpuDevice
    reason: str


def start_devices(backend: str = "auto") -> Devices:
    """`auto` takes the GPU where one starts. Raises StrataError where `gpu` was asked for and none does, or
    where there is no such backend. Only on the main thread: a GPU context is made there."""
    if backend not in BACKENDS:
        raise StrataError(f"backend '{backend}' is not one of {', '.join(BACKENDS)}")
    cpu = CpuDevice()
    if backend == "cpu":
        return Devices(cpu, cpu, "asked for")
    try:
        from .gpu import GpuDevice

        gpu = GpuDevice(cpu.cancel_flag)
    except DeviceUnavailable as reason:
        if backend == "gpu":
            raise StrataError(f"no GPU: {reason}") from None
        return Devices(cpu, cpu, f"no GPU: {reason}")
    if backend == "auto" and gpu.is_software:
        return Devices(cpu, cpu, f"the GPU is emulated in software ({gpu.description})")
    return Devices(gpu, cpu, gpu.description if backend == "auto" else "asked for")


@cache
def traces_rays(backend: str) -> bool:
    """Whether bakes run where rays are traced (Device). Where the backend does not start, they say so."""
    try:
        return backend == "cpu" or start_devices(backend).primary.traces_rays
    except StrataError:
        return True


def register() -> None:
    """Nothing: devices start when they are asked for."""


def unregister() -> None:
    """Frees what GPU devices hold."""
    if used := sys.modules.get(f"{__package__}.gpu"):
        used.free_all()
