"""What panels ask the file system, which may be a share of a network that is slow, or gone: not at every
redraw, of which a bake makes twenty a second."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable

from .state import STATE

KEPT_SECONDS = 1.0
PAUSES = 10.0  # and at least so many times what the last answer took
MOST_KEPT = 64  # answers

_answers: dict[Hashable, tuple[float, object]] = {}  # by question, with the time until which they are kept


def kept[Answer](question: Hashable, ask: Callable[[], Answer]) -> Answer | None:
    """The answer to a question, up to a second old or so. While baking nothing is asked, and an old answer
    stands; None where there is none."""
    until, answer = _answers.get(question, (0.0, None))
    started = time.monotonic()
    if STATE.is_baking or started < until:
        return answer
    answer = ask()
    ended = time.monotonic()
    if len(_answers) >= MOST_KEPT:
        _answers.clear()
    _answers[question] = ended + max(KEPT_SECONDS, PAUSES * (ended - started)), answer
    return answer
