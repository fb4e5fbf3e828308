"""All rivals."""

from __future__ import annotations

from collections.abc import Sequence

from ...core.errors import StrataError
from .cycles import CYCLES
from .eevee import EEVEE
from .embree import EMBREE
from .rival import Rival

RIVALS: tuple[Rival, ...] = (CYCLES, EEVEE, EMBREE)


def named(words: Sequence[str]) -> list[Rival]:
    """Raises StrataError for one that there is not."""
    known = {rival.id: rival for rival in RIVALS}
    for word in words:
        if word not in known:
            raise StrataError(f"no rival '{word}'; there is {', '.join(known)}")
    return [known[word] for word in words]
