"""`strata bake --trace`: a file for Perfetto of each frame, and its sums as a table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TextIO

from ..addon.core.observer import NOBODY, Observer
from ..addon.core.version import VERSION
from ..addon.layers.files import replaced
from ..addon.layers.numbered import Placeholder
from ..addon.measure.table import columns
from ..addon.measure.trace import Trace

SHOWN_SHARE = 0.005
"""Rows of the table that take less are one."""


class Tracing:
    """`observer` listens to what comes next, where there is a target to write to."""

    def __init__(self, target: Placeholder | None):
        self._target = target
        self.observer: Observer = Trace() if target else NOBODY

    def write(self, frame: int, out: TextIO | None) -> None:
        """What was traced up to now; a new trace begins. Raises StrataError where the disk does not play
        along."""
        if self._target is None:
            return
        trace, path = self.observer, self._target.path(frame)
        self.forget()
        lines = written(trace, path, frame=frame)
        if out:
            for line in ["", *lines, f"wrote {path}"]:
                print(line, file=out)
            out.flush()

    def forget(self) -> None:
        """What was traced up to now."""
        if self._target is not None:
            self.observer = Trace()


def written(trace: Trace, path: str | Path, **more: Any) -> list[str]:
    """Ends it and writes it; its table. Raises StrataError where the disk does not play along."""
    trace.end()
    told = trace.to_json(strata=VERSION, **more)
    with replaced(path) as stream:
        stream.write(json.dumps(told, ensure_ascii=False, allow_nan=False).encode())
    return [*table(told["otherData"]), *frames_table(told["otherData"])]


def table(told: dict[str, Any]) -> list[str]:
    """Lines: by step and by stage what it took, and what bounds it."""
    shown = [row for row in told["summary"] if row["share"] >= SHOWN_SHARE]
    rest = told["summary"][len(shown) :]
    rows = [
        (
            row["name"],
            row["where"],
            str(row["count"]),
            f"{row['seconds']:.3f}",
            f"{100.0 * row['share']:.1f}%",
            f"{row['cpu_s']:.3f}",
            f"{row['cores_busy']:.1f}",
            f"{1e-6 * (row['read_bytes'] + row['made_bytes']):.0f}" if "least_s" in row else "",
            f"{row['least_s']:.3f}" if "least_s" in row else "",
            row["bound"],
        )
        for row in shown
    ]
    if rest:
        seconds, share = (sum(row[name] for row in rest) for name in ("seconds", "share"))
        count = sum(row["count"] for row in rest)
        rows.append(
            (f"{len(rest)} others", "", str(count), f"{seconds:.3f}", f"{100.0 * share:.1f}%", *[""] * 5)
        )
    machine = f"{told['seconds']:.2f} s, {told['cores']} cores"
    if (others := told["others_cores"]) is not None:
        machine += f", of which others had {others:.1f}"
    machine += f", copying {1e-9 * told['copied_bytes_per_s']:.1f} GB/s"
    titles = [
        "step or stage",
        "where",
        "runs",
        "seconds",
        "share",
        "CPU s",
        "cores",
        "MB",
        "least s",
        "bound by",
    ]
    return [f"trace    {machine}", "", *columns(titles, rows)]


def frames_table(told: dict[str, Any]) -> list[str]:
    """Lines about a preview's frames; none of a bake."""
    if "frames" not in told:
        return []
    frames = told["frames"]
    longer = ", ".join(f"{count} took longer than {budget}" for budget, count in frames["longer"].items())
    lines = ["", f"frames   {frames['count']}, {frames['median_ms']:.1f} ms each (median); {longer}"]
    if frames["late"]:
        rows = [(row["what"], str(row["frames"]), f"{row['ms']:.1f}", row["bound"]) for row in frames["why"]]
        lines += ["", f"{frames['late']} missed their own budget; what took most of them", ""]
        lines += columns(["step", "frames", "ms each", "bound by"], rows)
    return lines
