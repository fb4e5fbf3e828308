"""`strata effects`: what there is, with parameters and ranges."""

from __future__ import annotations

import argparse
import json
from typing import Any, TextIO

from ..addon.core.effect import Effect
from ..addon.core.params import plain
from ..addon.effects.registry import EFFECTS


def effects(arguments: argparse.Namespace, out: TextIO) -> None:
    """Prints what there is."""
    if arguments.json:
        print(json.dumps([describe(effect) for effect in EFFECTS], indent=1), file=out)
        return
    for effect in EFFECTS:
        default = "on" if effect.on_by_default else "off"
        print(f"{effect.id} ({default} by default): {effect.doc}", file=out)
        for spec in effect.params.specs():
            print(f"  {effect.id}.{spec.name} = {plain(spec.default)}  {_accepts(spec)}", file=out)
            used_when = spec.used_when.words()
            print(f"      {spec.doc}{f'. Counts where {used_when}' if used_when else ''}", file=out)


def describe(effect: Effect) -> dict[str, Any]:
    """An effect's declaration as plain values."""
    layers = [
        {
            "title": kind.title,
            "channels": kind.channels,
            "of": kind.of.value,
            "role": kind.role.value,
            "metric": kind.score.metric if kind.score else None,
            "reduce": kind.reduce.value,
            "doc": kind.doc,
        }
        for kind in effect.layers
    ]
    params = [
        {
            "name": spec.name,
            "type": "choice" if spec.choices else spec.kind.__name__,
            "default": plain(spec.default),
            "choices": list(spec.choices),
            "hard": spec.hard,
            "soft": spec.soft,
            "unit": spec.unit,
            "trades_time": spec.trades_time,
            "used_when": spec.used_when.words(),
            "doc": spec.doc,
        }
        for spec in effect.params.specs()
    ]
    declared = {"id": effect.id, "title": effect.title, "doc": effect.doc, "source": effect.source}
    declared["on_by_default"] = effect.on_by_default
    return {**declared, "layers": layers, "params": params}


def _accepts(spec) -> str:
    if spec.choices:
        return "one of " + ", ".join(spec.choices)
    words = [f"{spec.hard[0]:g} to {spec.hard[1]:g}"] if spec.hard else []
    return f"({' '.join([*words, spec.unit]).strip() or spec.kind.__name__})"
