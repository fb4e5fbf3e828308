"""Bakes a sample scene and makes a picture of it: out/demo.exr, out/demo.json, out/demo.png."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from strata.addon.bake import BakeJob, read_scene
from strata.addon.job import run_to_end
from strata.addon.layers.exr import write_layers
from strata.addon.measure.report_text import format_table
from strata.addon.planning import Options
from strata.addon.scene.open import choose, open_blend
from strata.ops.terminal import Progress
from strata.scripts.pictures.contact_sheet import save_contact_sheet

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", type=Path, default=ROOT / "sample_blends" / "courtyard.blend")
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "demo", help="without an ending")
    parser.add_argument("--size", default="960x540")
    parser.add_argument("--backend", default="auto")
    arguments = parser.parse_args()
    size = tuple(map(int, arguments.size.split("x")))
    output = arguments.output
    output.parent.mkdir(parents=True, exist_ok=True)

    open_blend(arguments.scene)
    chosen = choose()
    options = Options(backend=arguments.backend, lit=True)
    *read, seconds = read_scene(chosen.scene, chosen.view_layer, options, size=size)
    progress = Progress(sys.stderr, arguments.scene.stem)
    baked = run_to_end(BakeJob(*read, options, read_seconds=seconds), show=progress.show)
    progress.clear()
    write_layers(output.with_suffix(".exr"), baked.layers)
    report = json.dumps(baked.layers.report, indent=1, ensure_ascii=False)
    output.with_suffix(".json").write_text(report + "\n", encoding="utf-8")
    save_contact_sheet(output.with_suffix(".png"), baked.layers, baked.lit)
    print(format_table(baked.report))
    for ending in (".exr", ".json", ".png"):
        print(f"wrote {output.with_suffix(ending)}")


if __name__ == "__main__":
    main()
