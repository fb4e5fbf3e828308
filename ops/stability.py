"""`strata stability`: effects' extreme inputs, measured. What they are held against is with the tests."""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path
from typing import TextIO

from ..addon.core.errors import StrataError
from ..addon.effects.registry import EFFECTS
from ..addon.layers.files import replaced
from .terminal import Interrupts

CHECKOUT = "strata"
"""What the package is called there; inside Blender it has another name."""
BEYOND = 1


def stability(arguments: argparse.Namespace, out: TextIO, interrupts: Interrupts) -> int:
    """Writes the page, or prints the tables of the effects asked for; 1 where a cell is beyond its bound.
    Raises StrataError where there are no tests."""
    asked = tuple(EFFECTS.named(name).id for name in arguments.effects or ())
    root = __package__.rpartition(".")[0]
    if root != CHECKOUT or not (Path(__file__).parents[1] / "tests").is_dir():
        raise StrataError("extremes are with Strata's tests, which only a checkout of its source has")
    bench = import_module(f"{root}.scripts.bench.stability")
    text, beyond = bench.measured(asked, interrupts.check)
    if asked:
        print(text, file=out)
    else:
        with replaced(bench.DOCUMENT) as stream:
            stream.write(text.encode())
        print(f"wrote {bench.DOCUMENT}, {beyond} cells beyond their bounds", file=out)
    return BEYOND if beyond else 0
