"""What a rival is told, and what it answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...audit.other_blender import Scene
from ...bake import BakeJob
from ..cost import Cost
from ..setting import Setting


@dataclass(frozen=True)
class Case:
    """What to make: shadows of `lamps`, Blender's names of light objects by layer's name; `in_colour`: layers
    of three channels. `scene` and `request` are for programs of another Blender (audit/other_blender.py),
    `luminance` (3,) of the working space; `folder` is for what is worth keeping between runs; `job(setting)`
    reads the scene for a bake of ours that measures nothing."""

    scene: Scene
    request: Mapping[str, Any]
    lamps: Mapping[str, str]
    in_colour: frozenset[str]
    luminance: np.ndarray
    folder: Path
    job: Callable[[Setting], BakeJob]

    @property
    def groups(self) -> dict[str, str]:
        """A short name for each lamp, that of its light group."""
        return {lamp: f"g{number}" for number, lamp in enumerate(dict.fromkeys(self.lamps.values()))}


@dataclass(frozen=True)
class Found:
    """`images`: by layer's name, each way to read the lamp's shadow from what was made, (height, width)
    float64 or with channels, row 0 at the bottom: the best counts. Empty where only the cost was wanted."""

    cost: Cost
    images: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)


BY_LIGHT = "Its shadow of a lamp is its light over the same without shadow, whose time is not counted."
"""Told by those who render."""


class Rival(Protocol):
    """`id` is its word on the command line, `told` how its shadows and times are come by, in a sentence."""

    id: str
    title: str
    told: str

    def why_not(self) -> str:
        """Why it does not run here; empty if it does."""

    def settings(self, case: Case) -> list[Setting]:
        """From fast to exact. Raises StrataError where it cannot make the case."""

    def run(self, case: Case, setting: Setting, wants_images: bool, look: Callable[[], None]) -> Found:
        """Makes it. `look` is called now and then, and may raise. Raises StrataError where it fails."""


def factor(shadowed: np.ndarray, bare: np.ndarray, luminance: np.ndarray, in_colour: bool) -> np.ndarray:
    """A lamp's shadow from its light (height, width, 3) with it and without: 1 where there is none, and never
    more, which only noise makes it."""
    if not in_colour:
        shadowed, bare = shadowed @ luminance, bare @ luminance
    share = np.divide(shadowed, bare, out=np.ones_like(bare, dtype=np.float64), where=bare > 0.0)
    return np.clip(share, 0.0, 1.0)
