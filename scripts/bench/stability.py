"""Writes docs/stability.md: every effect times every extreme input, measured on both devices.

python -m strata.scripts.bench.stability; fails where a cell is beyond its bound.
"""

from __future__ import annotations

import sys

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
beyond their bound are bold. Written by `python -m strata.scripts.bench.stability`.
"""


TITLES = {"shared": "What samples weigh"}


def devices() -> list:
    """Those that start here."""
    found = [CpuDevice()]
    try:
        found.append(GpuDevice())
    except DeviceUnavailable as reason:
        print(f"no GPU: {reason}")
    return found


def table(rows) -> list[str]:
    """Lines of Markdown."""
    lines = ["| Extreme | Bound | CPU | GPU | Against |", "| --- | --- | --- | --- | --- |"]
    for row in rows:
        cells = (row.extreme, f"{row.bound:g}", row.cell("cpu"), row.cell("gpu"), row.truth)
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def main() -> int:
    """Measures, writes, and returns how many cells are beyond their bounds."""
    lines, beyond = [HEAD], 0
    started = devices()
    for name in (*(effect.id for effect in EFFECTS), "shared"):
        rows = rows_of(name, started)
        beyond += sum(not error <= row.bound for row in rows for error in row.errors.values())
        lines += [f"## {TITLES.get(name, name)}", "", *table(rows), ""]
    described = "; ".join(f"{device.name.upper()}: {device.description}" for device in started)
    lines.insert(1, f"{described}.\n")
    DOCUMENT.write_text("\n".join(lines), encoding="utf-8")
    print(f"wrote {DOCUMENT}, {beyond} cells beyond their bounds")
    return 1 if beyond else 0


if __name__ == "__main__":
    sys.exit(main())
