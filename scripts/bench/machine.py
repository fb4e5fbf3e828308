"""The machine: what it is, and the two limits that passes are held against."""

from __future__ import annotations

import os
import platform
import statistics
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import bpy
import numpy as np
from strata.addon.measure.bandwidth import copy_bandwidth

COPY_BYTES = 512 << 20  # beyond any cache but the largest servers'
MATRIX_SIDE = 2048


def description() -> str:
    """CPU, cores and versions, without a date."""
    model = platform.processor()
    caches = ""
    if (info := Path("/proc/cpuinfo")).exists():
        fields = dict(
            (part.strip() for part in line.split(":", 1))
            for line in info.read_text().splitlines()
            if ":" in line
        )
        model, flags = fields.get("model name", model), fields.get("flags", "").split()
        caches = f", model {fields.get('model')} stepping {fields.get('stepping')}"
        widths = {"avx512f": "AVX-512", "avx2": "AVX2"}
        model += ", " + next((name for flag, name in widths.items() if flag in flags), "SSE")
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "embreex"))
    return (
        f"{model}{caches}; {os.cpu_count()} cores; {platform.system()}; Python {platform.python_version()}, "
        f"Blender {bpy.app.version_string}, {packages}"
    )


@dataclass(frozen=True)
class Limits:
    """Of all cores together. `bandwidth` in bytes/s read and written by a copy; `operations` single-precision
    multiplications and additions per second in a matrix product."""

    bandwidth: float
    operations: float

    def seconds(self, count_bytes: float, count_operations: float) -> float:
        """The least time that so much work could take."""
        return max(count_bytes / self.bandwidth, count_operations / self.operations)


def _best(run, repeats: int) -> float:
    seconds = []
    for _ in range(repeats):
        started = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - started)
    return min(seconds)


def measure_limits(repeats: int = 5) -> Limits:
    """By numpy's copies, one thread a core, and by its BLAS."""
    bandwidth = copy_bandwidth(COPY_BYTES, repeats)
    matrix = np.full((MATRIX_SIDE, MATRIX_SIDE), 0.5, np.float32)
    product = np.empty_like(matrix)
    multiplying = _best(lambda: np.matmul(matrix, matrix, out=product), repeats)
    return Limits(bandwidth, 2.0 * MATRIX_SIDE**3 / multiplying)


def interleaved(runs: dict, repeats: int) -> dict:
    """Calls every run `repeats` times, one after the other, so that a busy machine hurts all alike; each
    returns a dict of seconds. Medians by run and part."""
    found: dict = {name: [] for name in runs}
    for _ in range(repeats):
        for name, run in runs.items():
            found[name].append(run())
    return {
        name: {part: statistics.median(item[part] for item in items) for part in items[0]}
        for name, items in found.items()
    }
