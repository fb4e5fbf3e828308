"""Which instance and material is shaded how: the effect's settings with their own over them, as tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...core.material import Material
from ...core.outline import Instance, Outline
from ...core.params import with_own
from ...core.ramp import Ramp
from .params import ToonObjectParams, ToonParams
from .ramp_table import table_of

EXCLUDED, BY_MATERIAL = -2, -1  # kernels/src/effects/toon/shade.rs
NOTHING_OWN = ToonObjectParams()


@dataclass(frozen=True, eq=False)
class Ramps:
    """`materials` (M,) int32: index of each material's ramp, or EXCLUDED; `instances` (I,) int32: the same or
    BY_MATERIAL, None where no instance has a ramp of its own; `pieces` (P, 17) float32 of all ramps
    (ramp_table.py), ramp r's from `starts[r]` to `starts[r + 1]`; `clamps` (R,) uint8."""

    materials: np.ndarray
    instances: np.ndarray | None
    pieces: np.ndarray
    starts: np.ndarray
    clamps: np.ndarray

    def as_params(self) -> dict:
        """What a step is recorded with."""
        return {name: value for name, value in vars(self).items() if value is not None}


def ramps_of(outline: Outline, params: ToonParams) -> Ramps:
    """The scene's ramp first, then those that materials and objects have of their own."""
    known: dict[Ramp, int] = {params.ramp: 0}

    def index(settings: ToonObjectParams, otherwise: int) -> int:
        if settings.excluded:
            return EXCLUDED
        return known.setdefault(settings.ramp, len(known)) if settings.use_ramp else otherwise

    materials = [index(settings_of(material), 0) for material in outline.materials]
    instances = np.full(len(outline.instances), BY_MATERIAL, np.int32)
    for number, instance in outline.instances.with_own_settings:
        instances[number] = index(settings_of(instance), BY_MATERIAL)
    tables = [table_of(ramp) for ramp in known]
    return Ramps(
        np.array(materials, np.int32),
        instances if (instances != BY_MATERIAL).any() else None,
        np.concatenate([table.packed() for table in tables]),
        np.cumsum([0, *(len(table.starts) for table in tables)]).astype(np.int32),
        np.array([table.clamps for table in tables], np.uint8),
    )


def settings_of(part: Instance | Material) -> ToonObjectParams:
    """What an instance or a material has of its own for this effect."""
    return with_own(NOTHING_OWN, part.own_settings, "toon")


def excluded_instances(outline: Outline) -> frozenset[int]:
    """Instances that are, or whose every material is, left to the picture below."""
    return _where_all_say(outline, lambda settings: settings.excluded)


def without_outline(outline: Outline) -> frozenset[int]:
    """Instances that have, or whose every material has, no outline."""
    return _where_all_say(outline, lambda settings: not settings.outline)


def _where_all_say(outline: Outline, says: Callable[[ToonObjectParams], bool]) -> frozenset[int]:
    found = {index for index, each in outline.instances.with_own_settings if says(settings_of(each))}
    materials = {index for index, material in enumerate(outline.materials) if says(settings_of(material))}
    if materials:
        every = enumerate(outline.instances)
        found.update(index for index, each in every if materials.issuperset(each.materials))
    return frozenset(found)
