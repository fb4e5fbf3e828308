"""A report from beginning to end: runs, then files of what they found, also where they were stopped."""

from __future__ import annotations

import json
import re
from pathlib import Path

from ..layers.files import replaced
from .environment import environment
from .page import drawing, page
from .picture import png
from .result import Result
from .sweep import Asked, Show, Sweep

PAGE, DATA, TABLE, PLOTS = "report.html", "report.json", "report.csv", "plots"


def report(asked: Asked, folder: Path, show: Show) -> Result:
    """Runs what has not run yet, and writes all files into `folder`. Whatever stops it, Ctrl-C too, what has
    been found by then is written, and what stopped it is raised."""
    sweep = Sweep(asked, folder, show)
    try:
        sweep.run()
    except BaseException:
        if sweep.ledger.runs and sweep.settings:
            write(result_of(sweep), folder)
        raise
    result = result_of(sweep)
    write(result, folder)
    return result


def result_of(sweep: Sweep) -> Result:
    """So far."""
    told = {**sweep.told, "size": list(sweep.judge.size)}
    machine = {**environment(), "backend": sweep.backend}
    return Result.of(told, machine, sweep.judge.layers, sweep.settings, sweep.ledger.runs, sweep.warnings)


def write(result: Result, folder: Path) -> None:
    """The page, JSON, CSV, and a plot of each layer as PNG and as SVG."""
    text = json.dumps(result.to_json(), indent=1, ensure_ascii=False, allow_nan=False)
    files = {DATA: text + "\n", TABLE: result.to_csv(), PAGE: page(result, folder)}
    for name, text in files.items():
        with replaced(folder / name) as stream:
            stream.write(text.encode())
    for layer in result.shown:
        plot, name = drawing(result, layer), re.sub(r"[^\w.-]+", "_", layer)
        for ending, data in ((".svg", plot.svg().encode()), (".png", png(plot.pixels()))):
            with replaced(folder / PLOTS / f"{name}{ending}") as stream:
                stream.write(data)
