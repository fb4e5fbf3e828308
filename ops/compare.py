"""`strata compare`: the layers of two files beside each other, and an exit code for a farm."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TextIO

OVER_LIMIT = 1


def compare(arguments: argparse.Namespace, out: TextIO) -> int:
    """0, or OVER_LIMIT where a layer differs by more than --limit. Raises StrataError."""
    from ..addon.layers.files import replaced
    from ..addon.measure.table import columns
    from ..addon.measure.verdict import percent
    from ..addon.report.compare import compared, file_name
    from ..addon.report.picture import signed_png

    found = compared(Path(arguments.first), Path(arguments.second), arguments.layers or ())
    if arguments.output:
        for each in found:
            with replaced(Path(arguments.output) / file_name(each.name)) as stream:
                stream.write(signed_png(each.errors))
    over = [each for each in found if arguments.limit is not None and each.rms > arguments.limit]
    if arguments.json:
        print(json.dumps([each.to_json() for each in found], indent=1, ensure_ascii=False), file=out)
    elif not arguments.quiet:
        rows = [
            [
                each.name,
                "share of the brightness" if each.is_share else "as it is",
                *(percent(number) for number in (each.rms, each.p99, each.most)),
                f"{each.flip:.4f}",
                str(each.non_finite or ""),
                "over" if each in over else "",
            ]
            for each in found
        ]
        titles = ["layer", "differs", "RMS", "99%", "most", "FLIP", "not finite", "limit"]
        print("\n".join(columns(titles, rows)), file=out)
    return OVER_LIMIT if over else 0
