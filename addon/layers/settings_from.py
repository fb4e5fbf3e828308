"""What an earlier bake chose, read from its file or report, to be taken again."""

from __future__ import annotations

import json
from pathlib import Path

from ..core.errors import StrataError
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
    layers = report.get("layers") if isinstance(report, dict) else None
    counts = {each.get("samples") for each in layers or () if each.get("samples")}
    if not counts:
        raise StrataError(f"{path} does not say how many samples its layers have")
    chosen: dict[str, dict[str, int]] = {}
    for each in layers:
        if each.get("in_passes"):
            chosen.setdefault(each.get("view_layer", ""), {})[each["name"]] = int(each["samples"])
    return chosen, None if chosen else max(counts)
