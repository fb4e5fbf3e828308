"""What an earlier bake chose, read from its file or report, to be taken again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..core.errors import StrataError
from ..core.sampling import MOST_SAMPLES
from .exr_header import header_of


def settings_in(path: Path) -> tuple[dict[str, dict[str, int]], int | None]:
    """How many samples each layer got, by view layer (empty where the file is of one) and name; or where all
    got as many, that number. Raises StrataError where the file says nothing of them."""
    if path.suffix.lower() == ".json":
        try:
            report = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise StrataError(f"cannot read {path}: {error.strerror or error}") from None
        except ValueError:
            raise StrataError(f"{path} is no JSON") from None
    else:
        report = header_of(path).json("strata:report")
    rows = _rows(report, path)
    counts = {each["samples"] for each in rows if each.get("samples")}
    if not counts:
        raise StrataError(f"{path} does not say how many samples its layers have")
    chosen: dict[str, dict[str, int]] = {}
    for each in rows:
        if each.get("in_passes") and each.get("samples"):
            chosen.setdefault(each.get("view_layer", ""), {})[each["name"]] = each["samples"]
    return chosen, None if chosen else max(counts)


def _rows(report: Any, path: Path) -> list[dict[str, Any]]:
    """Of layers; whatever else the file may be is told in a line."""
    rows = report.get("layers") if isinstance(report, dict) else None
    is_report = isinstance(rows, list) and all(
        isinstance(each, dict) and isinstance(each.get("name"), str) for each in rows
    )
    if not is_report:
        raise StrataError(f"{path} is no report of Strata")
    for samples in (each.get("samples") or 1 for each in rows):
        if not (isinstance(samples, int) and 1 <= samples <= MOST_SAMPLES):
            raise StrataError(f"{path}: {samples} samples are not between 1 and {MOST_SAMPLES}")
    return rows
