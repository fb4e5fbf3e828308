"""What `strata stability` writes into docs/stability.md: every effect times every extreme input, measured on
both devices."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

import bpy  # noqa: F401 (the gpu module comes with it)
from strata.addon.core.errors import DeviceUnavailable
from strata.addon.devices.cpu import CpuDevice
from strata.addon.devices.gpu import GpuDevice
from strata.addon.effects.registry import EFFECTS
from strata.scripts.bench.document import ROOT
from strata.tests.effects.extremes import rows_of

DOCUMENT = ROOT / "docs" / "stability.md"

HEAD = """# Stability

Extreme inputs and how wrong the result is; a clear refusal counts as right, a NaN never does. Cells
beyond their bound are bold. Written by `strata stability` in a checkout of the source.
"""


TITLES = {"shared": "What samples weigh"}


def devices() -> list:
    """Those that start here."""
    found = [CpuDevice()]
    try:
        found.append(GpuDevice())
    except DeviceUnavailable as reason:
        print(f"no GPU: {reason}", file=sys.stderr)
    return found


def table(rows) -> list[str]:
    """Lines of Markdown."""
    lines = ["| Extreme | Bound | CPU | GPU | Against |", "| --- | --- | --- | --- | --- |"]
    for row in rows:
        cells = (row.extreme, f"{row.bound:g}", row.cell("cpu"), row.cell("gpu"), row.truth)
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def measured(names: Sequence[str] = (), between: Callable[[], None] = lambda: None) -> tuple[str, int]:
    """The page, or only the tables of these effects; and how many cells are beyond their bounds. Calls
    `between` between two tables, which may raise."""
    lines, beyond = [], 0
    started = devices()
    for name in names or (*(effect.id for effect in EFFECTS), "shared"):
        between()
        rows = rows_of(name, started)
        beyond += sum(not error <= row.bound for row in rows for error in row.errors.values())
        lines += [f"## {TITLES.get(name, name)}", "", *table(rows), ""]
    if not names:
        described = "; ".join(f"{device.name.upper()}: {device.description}" for device in started)
        lines[:0] = [HEAD, f"{described}.\n"]
    return "\n".join(lines), beyond
