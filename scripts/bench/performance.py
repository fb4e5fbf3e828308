"""Measures Strata against rays, Embree and Cycles and rewrites the figures in docs/performance.md.

python -m strata.scripts.bench.performance              everything (about ten minutes on two cores)
python -m strata.scripts.bench.performance race passes  these sections only
python -m strata.scripts.bench.performance rivals       only when named (an hour of two busy cores)
python -m strata.scripts.bench.performance sixty_lamps  only when named (a quarter of an hour of two cores)
python -m strata.scripts.bench.performance --quick      tiny settings, printed: whether it still runs
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from strata.scripts.bench import (
    files,
    goals,
    idle,
    lamps,
    machine,
    measuring,
    passes,
    placement,
    race,
    rivals,
    samples,
    scenes,
    toon,
    volumetric,
)
from strata.scripts.bench.document import ROOT, milliseconds, significant, write_block
from strata.scripts.bench.methods import Effect, Rays, surface_of
from strata.scripts.bench.sections import read_sections

DOCUMENT = ROOT / "docs" / "performance.md"


def run_race(folder: Path, quick: bool) -> str:
    """Error against time."""
    return race.tables(race.run(scenes.open_bench(folder), race.QUICK if quick else race.Scale()))


def run_passes(folder: Path, quick: bool) -> str:
    """Bytes and operations."""
    case = scenes.read(scenes.open_bench(folder), race.QUICK.size if quick else None)
    surface, _ = surface_of(case)
    rays = Rays(case, surface, 16)
    runs = {"effect": Effect(case, {}), "rays": rays}
    seconds = machine.interleaved(runs, 1 if quick else 5)
    weight = rays.weight
    traced = 16 * int((weight > 0.0).sum())
    taken = seconds["rays"]["rays"]
    remark = (
        "Rays are not counted, since what they read depends on the tree. For comparison: 16 from each "
        f"lit pixel are {traced / 1e6:.1f} million in {milliseconds(taken)} ms, "
        f"{significant(traced / taken / 1e6)} million a second."
    )
    counted = passes.works(case, surface, weight)
    return passes.tables(case, seconds["effect"], counted, machine.measure_limits(), remark)


def run_rivals(folder: Path, quick: bool) -> str:
    """What an error of 2% takes."""
    return rivals.run(quick)


def run_samples(folder: Path, quick: bool) -> str:
    """Errors and time of whole bakes by method."""
    return samples.run(quick)


def run_goals(folder: Path, quick: bool) -> str:
    """Layered depth, large meshes, GPU, memory."""
    repeats = 1 if quick else 3
    scene = scenes.open_bench(folder)
    found = [goals.layered_depth(scenes.read(scene), repeats), *goals.large_meshes(scene, repeats)]
    found.append(goals.gpu_and_cpu(scenes.open_sample("courtyard"), repeats))
    found.append(goals.memory(size=(480, 270) if quick else (3840, 2160)))
    return goals.tables(found)


def run_placement(folder: Path, quick: bool) -> str:
    """Surfaces of pixels that share their places and of such that do not."""
    return placement.times(quick)


def run_idle(folder: Path, quick: bool) -> str:
    """With and without useless objects."""
    return idle.tables(idle.run(size=(240, 135) if quick else None, repeats=1 if quick else 5))


def run_lamps(folder: Path, quick: bool) -> str:
    """Memory of many lamps, in groups and all at once."""
    return lamps.tables(lamps.QUICK if quick else lamps.STREETS)


def run_sixty_lamps(folder: Path, quick: bool) -> str:
    """Memory and time of a few lamps and of many."""
    return lamps.few_and_many(lamps.QUICK if quick else lamps.FEW_AND_MANY)


def run_measuring(folder: Path, quick: bool) -> str:
    """What measuring adds to bakes."""
    return measuring.tables(quick)


def run_toon(folder: Path, quick: bool) -> str:
    """Toon shading."""
    return toon.speed(scenes.open_sample("comic"), quick)


def run_volumetric(folder: Path, quick: bool) -> str:
    """The open integral, the walk against a march through the same maps, bakes against Cycles."""
    scene = scenes.open_sample("mist")
    lights = volumetric.prepared(scene, scene.view_layers[0])
    marched = volumetric.against_marching(lights[:1] if quick else lights)
    raced = volumetric.against_cycles(scene, *(((96, 54), (4, 16), 64) if quick else ()))
    return f"{volumetric.open_integral()}\n\n{marched}\n\n{raced}"


def run_files(folder: Path, quick: bool) -> str:
    """Seconds and sizes of EXR files."""
    return files.run(folder, *(((240, 135), 1) if quick else ((3840, 2160), 3)))


LONG = ("rivals", "sixty_lamps")

SECTIONS = {
    "race": run_race,
    "rivals": run_rivals,
    "samples": run_samples,
    "passes": run_passes,
    "goals": run_goals,
    "placement": run_placement,
    "idle": run_idle,
    "lamps": run_lamps,
    "sixty_lamps": run_sixty_lamps,
    "measuring": run_measuring,
    "volumetric": run_volumetric,
    "toon": run_toon,
    "files": run_files,
}


def main() -> None:
    """Reads the command line."""
    sections, quick = read_sections(__doc__, SECTIONS, LONG)
    with tempfile.TemporaryDirectory() as folder:
        for name in ("machine", *sections):
            text = SECTIONS[name](Path(folder), quick) if name in SECTIONS else machine.description()
            print(f"\n## {name}\n\n{text}", flush=True)
            if not quick:
                write_block(DOCUMENT, name, text)


if __name__ == "__main__":
    main()
