"""What a piece of work took."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from ..core.free_memory import give_back, held_bytes
from ..measure.report import peak_mb


@dataclass
class Cost:
    """Seconds that passed, seconds of all cores, and MiB of memory beside what the process had before, None
    where the system does not say."""

    wall: float = 0.0
    cpu: float = 0.0
    memory_mb: float | None = None

    def to_json(self) -> dict[str, Any]:
        return {key: None if item is None else float(f"{item:.5g}") for key, item in vars(self).items()}


@contextmanager
def counted() -> Iterator[Cost]:
    """Counts what this process does inside."""
    found = Cost()
    give_back()
    has_peak, held = _forget_peak(), held_bytes() / 2**20
    started = time.perf_counter(), time.process_time()
    yield found
    found.wall, found.cpu = time.perf_counter() - started[0], time.process_time() - started[1]
    if has_peak:
        found.memory_mb = max(peak_mb() - held, 0.0)


def _forget_peak() -> bool:
    """Whether the system counts the most memory anew from here on (Linux)."""
    with suppress(OSError), open("/proc/self/clear_refs", "w", encoding="ascii") as file:
        file.write("5")
        return True
    return False
