"""How many probes measuring may take where nobody said how many."""

from __future__ import annotations

from collections.abc import Callable, Generator

from ..core.slices import timed

DEFAULT_PROBES = 2048
SHARE = 0.15
"""Of a bake's seconds, with the measuring."""

SHORT_SECONDS = 2.0
"""Shorter bakes are allowed what one of so many seconds is."""

PILOTS = (8, 32, 128)
"""Probes of the runs that tell what more would take. What is made once (a tree, a sorted hull) falls to the
first, so that only the others tell."""


def allowed_seconds(baked_seconds: float) -> float:
    """For measuring all that was baked in so many seconds."""
    return SHARE / (1.0 - SHARE) * max(baked_seconds, (1.0 - SHARE) * SHORT_SECONDS)


def within[Result](
    work: Callable[[int], Generator[None, None, Result]], seconds: float, most: int = DEFAULT_PROBES
) -> Generator[None, None, tuple[Result, int]]:
    """What `work(probes)` returns, for the largest power of two of probes that fits into `seconds`, and that
    number: at least the second pilot's, at most `most`.

    The clock decides, not what was found, so that the estimates stay unbiased; powers of two, so that a bake
    that is made again seldom gets another number.
    """
    found, spent = None, 0.0
    for number, probes in enumerate(PILOTS):
        result, took = yield from timed(work(probes))
        found, spent = (result, probes), spent + took
        if number == 0:
            continue
        affordable = probes * (seconds - spent) / max(took, 1e-6)
        if number + 1 == len(PILOTS):
            while 2 * probes <= min(affordable, most):
                probes *= 2
            if probes > found[1]:
                found = (yield from work(probes)), probes
        elif affordable < PILOTS[number + 1]:
            break
    return found
