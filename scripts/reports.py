"""Writes docs/report: error against time of every sample scene, by `strata report`.

What was found so far is kept in out/report, so that a run that was stopped goes on: delete it to begin anew.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path

from strata.addon.layers.files import replaced
from strata.addon.report.report import DATA, PAGE, PLOTS, TABLE
from strata.addon.report.result import WORST
from strata.addon.report.setting import OURS
from strata.ops.cli import main as strata
from strata.scripts.bench.document import ROOT, significant, table, times
from strata.scripts.bench.rivals import TARGET, at_target, curves_of
from strata.scripts.bench.scenes import SAMPLES

KEPT, DOCUMENTS = ROOT / "out" / "report", ROOT / "docs" / "report"
SIZE = "240x135"
PLOT = "plot.svg"
SLOW = {"mist": ("--samples", "1,4,16")}
"""Of scenes whose bakes take long."""

HEAD = f"""# Reports of the sample scenes

Error against time of each scene in [sample_blends](../../sample_blends), written by `make report`
([how](../report.md)). All effects of a scene are baked, {SIZE}; errors in use are judged by one truth for
all. "Worst" is the layer that is furthest off of those that multiply; seconds are CPU seconds of all
cores for an error of {TARGET:g} of it, straight lines between points on logarithmic axes (<: the cheapest
point is nearer than that already, >: the dearest is not). p and floor: error² = (a · N^-p)² + floor² over
samples N. Rivals make the shadows alone, of all lamps; Embree takes all leaves for whole.
"""


def made(scene: Path) -> None:
    """One scene's report, and of it what belongs to the documents."""
    kept, documents = KEPT / scene.stem, DOCUMENTS / scene.stem
    given = ["report", str(scene), "-o", str(kept), "--backend", "cpu", "--size", SIZE, "--repeats", "1"]
    code = strata([*given, "--samples-only", "--rivals", "cycles,embree", *SLOW.get(scene.stem, ())])
    if code:
        sys.exit(code)
    plots = sorted((kept / PLOTS).glob("*.svg"), key=lambda path: path.stem != WORST.replace(" ", "_"))
    if not plots:  # nothing of the scene is measured
        shutil.rmtree(documents, ignore_errors=True)
        return
    documents.mkdir(parents=True, exist_ok=True)
    for name in (PAGE, DATA, TABLE):
        shutil.copyfile(kept / name, documents / name)
    shutil.copyfile(plots[0], documents / PLOT)


def index() -> str:
    """Of the reports that there are."""
    rows, machines = [], {}
    for path in sorted(DOCUMENTS.glob(f"*/{DATA}")):
        data = json.loads(path.read_text(encoding="utf-8"))
        machines[", ".join(data["environment"][key] for key in ("processor", "Blender", "backend"))] = None
        scene = path.parent.name
        link = f"[{scene}]({scene}/{PAGE})"
        rows += [[link if not number else "", *row] for number, row in enumerate(_rows(data))]
    there = {path.parent.name for path in DOCUMENTS.glob(f"*/{DATA}")}
    missing = [each.stem for each in sorted(SAMPLES.glob("*.blend")) if each.stem not in there]
    told = [f"Not here, as nothing of them was measured: {', '.join(missing)}."] if missing else []
    header = ["scene", "who", "errors of the worst", f"CPU s at {TARGET:g}", "over ours", "p", "floor"]
    plots = [
        f"![{scene.name}: error against time]({scene.name}/{PLOT})"
        for scene in sorted(DOCUMENTS.iterdir())
        if (scene / PLOT).is_file()
    ]
    return "\n\n".join([HEAD.rstrip(), table(header, rows), "; ".join(machines) + ".", *told, *plots]) + "\n"


def _rows(data: dict) -> list[list[str]]:
    orders = {(each["who"], each["curve"]): each for each in data["orders"] if each["layer"] == WORST}
    named = {layer["name"] for layer in data["layers"]}
    if len(named) == 1:
        orders = {(each["who"], each["curve"]): each for each in data["orders"]}
    rows, own = [], None
    for (who, curve), points in curves_of(data).items():
        errors, seconds, _ = zip(*points, strict=True)
        (took,), sign = at_target(errors, [seconds])
        own = took if who == OURS and own is None and not sign else own
        order = orders.get((who, curve))
        fitted = [f"{order['power']:.2f}", f"{order['floor']:.4f}"] if order else ["", ""]
        ratio = times(took / own) if own and who != OURS else ""
        name = "Strata" if who == OURS else f"{who}: {curve}"
        cost = f"{sign}{significant(took)}"
        spread = f"{max(errors):.3f} to {min(errors):.3f}"
        rows.append([name, spread, cost, f"{sign}{ratio}" if ratio else "", *fitted])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", help="names of sample scenes (default: all)")
    arguments = parser.parse_args()
    scenes = sorted(SAMPLES.glob("*.blend"))
    for scene in scenes:
        if not arguments.scenes or scene.stem in arguments.scenes:
            made(scene)
            with replaced(DOCUMENTS / "README.md") as stream:
                stream.write(index().encode())


if __name__ == "__main__":
    main()
