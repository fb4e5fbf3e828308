"""How fast this machine moves bytes."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np


def copy_bandwidth(count_bytes: int, repeats: int) -> float:
    """Bytes/s read and written by numpy's copies of so many bytes, one thread a core, the best of `repeats`.
    Caches help where they hold twice as many."""
    threads = os.process_cpu_count() or 1
    source = np.ones(count_bytes // 8)
    target = np.zeros_like(source)
    parts = list(zip(np.array_split(target, threads), np.array_split(source, threads), strict=True))
    best = float("inf")
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(repeats):
            started = time.perf_counter()
            list(pool.map(lambda pair: np.copyto(*pair), parts))
            best = min(best, time.perf_counter() - started)
    return 2.0 * source.nbytes / best
