"""What the executor asks of a device, and what a reference asks of rays."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from .view_rays import ViewRays


class Device(Protocol):
    """Runs steps. Values (arrays, textures, handles) belong to the device that made them.

    `kernels` is the native module on the CPU device; `cancel_flag` has `set()` and `is_set()`.
    Constructing one raises DeviceUnavailable where it cannot work.
    """

    name: str  # "cpu" or "gpu"
    description: str
    cancel_flag: Any
    compile_seconds: float
    cancelled: tuple[type[Exception], ...]  # what a twin raises when the flag is set

    def to_host(self, value: Any) -> Any:
        """The same value made of numpy arrays (dicts, tuples and lists keep their shape)."""

    def from_host(self, value: Any) -> Any:
        """The inverse of `to_host`."""

    def size_of(self, value: Any) -> int:
        """Bytes that the value's arrays take; 0 for handles that do not tell."""

    def finish(self) -> None:
        """Waits until all work is done, so that a clock read next is honest."""

    def release(self, value: Any) -> None:
        """Frees what the value holds on the device."""


class RayCaster(Protocol):
    """Rays against the true geometry; positions are relative to `origin`, (3,) float64. `kernels` is the
    native module and `accel` what its functions trace, both for what is asked at very many points."""

    origin: np.ndarray
    kernels: Any
    accel: Any
    cancel_flag: Any

    def occluded(
        self, casters: np.ndarray, origins: np.ndarray, directions: np.ndarray, t_max: np.ndarray
    ) -> np.ndarray:
        """(N,) bool: whether anything of `casters` (instances,) bool lies within t_max along each ray."""

    def nearest(
        self, casters: np.ndarray, origins: np.ndarray, directions: np.ndarray, t_max: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The nearest hit: its parameter (N,) float32, infinite for none, and the instance and the triangle
        of its mesh (N,) int32, -1 for none. Arguments as for `occluded`."""

    def look(self, pixels: np.ndarray, jitter: np.ndarray) -> ViewRays:
        """What the camera sees through `pixels` (N, 2), `jitter` (N, 2) pixels beside their centres: view
        rays with the graph's surface attributes, found by rays."""

    def value(self, node: Any) -> Any:
        """What a node of the graph (core/graph.py) holds, on the CPU; made again where it was freed."""

    def texture(self, image: int) -> np.ndarray | None:
        """Texels (h, w, 4) of `outline.images[image]`, None where they could not be read."""
