"""Every program there is, so that tests and CI can compile them all (scripts/build/compile_shaders.py)."""

from __future__ import annotations

from collections.abc import Iterator

from ..core.shader import Shader
from ..effects.registry import EFFECTS
from ..effects.shared import gpu_lit as lit
from ..effects.shared import gpu_steps as shared
from .gpu import BARRIER, SPLIT_TO_INTEGER
from .gpu_meshes import COPY_PAIRS, COPY_ROWS


def all_shaders() -> Iterator[Shader]:
    """Every program that Strata may compile, each once."""
    yield from (BARRIER, SPLIT_TO_INTEGER, COPY_ROWS, COPY_PAIRS)
    yield from shared.variants()
    yield from lit.variants()
    for effect in EFFECTS:
        yield from effect.shaders()
