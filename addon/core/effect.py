"""An effect's whole declaration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

from .params import Params


class Metric(Enum):
    """How a layer's error is scored (see docs/accuracy.md)."""

    WEIGHTED_RMSE = "weighted rmse"
    RELATIVE_L2 = "relative l2"
    WRONG_SHARE = "share of wrong pixels"


class Blend(Enum):
    """How a layer joins the composite (effects/shared/composite.py). SCALE_LIGHT multiplies what its one
    light sends (a shadow); MULTIPLY multiplies all light that comes from surfaces (a transmittance); ADD adds
    light (scattering); OVER lies over the picture by its alpha, premultiplied. NONE: it does not."""

    NONE = "none"
    SCALE_LIGHT = "scale light"
    MULTIPLY = "multiply"
    ADD = "add"
    OVER = "over"


@dataclass(frozen=True)
class LayerKind:
    """The layers an effect makes: one a light (`per_light`) or one. `title` is the pass name's first part,
    `blend` how they join the composite."""

    title: str
    channels: str
    metric: Metric
    per_light: bool = False
    blend: Blend = Blend.NONE
    doc: str = ""


@dataclass(frozen=True)
class Effect:
    """`id` is the folder's name. `run(recorder, outline, params)` records steps; `needed(outline)` gives the
    reason why the scene does not need the effect, or None; `reference(rays, light, points, samples,
    seed)` is the slow, independent truth that probes are scored against (addon/measure). `sources` records,
    by name, what other effects may build on: each as `record(recorder, outline, params, light_index)`."""

    id: str
    title: str
    params: type[Params]
    layers: tuple[LayerKind, ...]
    needed: Callable
    run: Callable
    reference: Callable
    doc: str
    source: str
    sources: dict[str, Callable] = field(default_factory=dict, hash=False, compare=False)
