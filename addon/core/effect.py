"""An effect's whole declaration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from .params import Params


class Metric(Enum):
    """How a layer's error is scored (see docs/accuracy.md)."""

    WEIGHTED_RMSE = "weighted rmse"
    RELATIVE_L2 = "relative l2"
    WRONG_SHARE = "share of wrong pixels"


@dataclass(frozen=True)
class LayerKind:
    """The layers an effect makes: one a light (`per_light`) or one. `title` is the pass name's first part."""

    title: str
    channels: str
    metric: Metric
    per_light: bool = False
    doc: str = ""


@dataclass(frozen=True)
class Effect:
    """`id` is the folder's name. `run(recorder, outline, params)` records steps; `needed(outline)` gives the
    reason why the scene does not need the effect, or None; `reference(rays, light, points, samples,
    seed)` is the slow, independent truth that probes are scored against (addon/measure)."""

    id: str
    title: str
    params: type[Params]
    layers: tuple[LayerKind, ...]
    needed: Callable
    run: Callable
    reference: Callable
    doc: str
    source: str
