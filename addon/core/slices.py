"""Work that yields between slices of some hundredths of a second, so that a window can redraw in between."""

from __future__ import annotations

import time
from collections.abc import Generator


def finished[Result](work: Generator[None, None, Result]) -> Result:
    """Runs it to its end; what it returns."""
    while True:
        try:
            next(work)
        except StopIteration as end:
            return end.value


def timed[Result](work: Generator[None, None, Result]) -> Generator[None, None, tuple[Result, float]]:
    """The same, which returns the seconds too that it worked; what others do at its yields does not count."""
    seconds = 0.0
    while True:
        started = time.perf_counter()
        try:
            next(work)
        except StopIteration as end:
            return end.value, seconds + time.perf_counter() - started
        seconds += time.perf_counter() - started
        yield
