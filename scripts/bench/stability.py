"""Writes docs/stability.md: every effect times every extreme input, measured on both devices.

python -m strata.scripts.bench.stability [effect ...]; fails where a cell is beyond its bound.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import bpy  # noqa: F401 (the gpu module comes with it)
from strata.addon.core.errors import DeviceUnavailable
from strata.addon.devices.cpu import CpuDevice
from strata.addon.devices.gpu import GpuDevice

ROOT = Path(__file__).resolve().parents[2]

DOCUMENT = ROOT / "docs" / "stability.md"
EFFECTS = ("soft_shadow", "volumetric_light", "toon")
"""Whose tests have extremes; each yields its rows."""

HEAD = """# Stability

Extreme inputs and how wrong the result is; a clear refusal counts as right, a NaN never does. Cells
beyond their bound are bold. Written by `python -m strata.scripts.bench.stability`.
"""


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
    for effect in EFFECTS:
        rows = list(import_module(f"strata.tests.effects.{effect}.extremes").rows(started))
        beyond += sum(not error <= row.bound for row in rows for error in row.errors.values())
        lines += [f"## {effect}", "", *table(rows), ""]
    lines.insert(1, f"CPU: {started[0].description}; GPU: {started[-1].description}.\n")
    DOCUMENT.write_text("\n".join(lines), encoding="utf-8")
    print(f"wrote {DOCUMENT}, {beyond} cells beyond their bounds")
    return 1 if beyond else 0


if __name__ == "__main__":
    sys.exit(main())
