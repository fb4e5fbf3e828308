"""Section "An error of 2%": what it takes Strata and its rivals, by reports of scenes (docs/report.md).

Reports are kept in out/rivals, so that a run that was stopped goes on: delete them to begin anew.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

from strata.addon.report.curve import Curve
from strata.addon.report.report import DATA
from strata.addon.report.setting import OURS
from strata.ops.cli import main

from .document import ROOT, significant, table, times
from .scenes import SAMPLES

TARGET = 0.02
FOLDER = ROOT / "out" / "rivals"


@dataclass(frozen=True)
class Race:
    """`file`: a sample scene's name, or that of one in the folder that STRATA_SCENES names; `lights`: all
    without."""

    name: str
    file: str
    what: str
    lights: str = ""
    size: str = "480x270"

    @property
    def path(self) -> Path:
        own = SAMPLES / f"{self.file}.blend"
        return own if own.is_file() else Path(os.environ.get("STRATA_SCENES", "")) / f"{self.file}.blend"


RACES = (
    Race("one_lamp", "courtyard", "one lamp", "Sky panel"),
    Race("courtyard", "courtyard", "all four lamps"),
    Race("teapots", "armory_render_voxelao_teapots", "a sun on 280,000 triangles", size="240x135"),
)


def run(quick: bool) -> str:
    """Makes the reports that are not there yet."""
    small = ("--samples", "1,4", "--repeats", "1", "--size", "64x36") if quick else ()
    for race in RACES[:1] if quick else RACES:
        if race.path.is_file():
            words = [
                "report",
                str(race.path),
                "-o",
                str(_folder(race, quick)),
                "--effects",
                "soft_shadow",
                "-q",
            ]
            words += ["--backend", "cpu", "--samples-only", "--rivals", "cycles,embree"]
            words += small or ["--samples", "2,4,8,16,32", "--repeats", "1", "--size", race.size]
            main([*words, "--lights", race.lights] if race.lights else words)
    return document(quick)


def document(quick: bool) -> str:
    """Of the reports that there are."""
    rows, machine, missing = [], "", []
    for race in RACES:
        path = _folder(race, quick) / DATA
        if not path.is_file():
            missing.append(f"`{race.file}` ({race.what}) was not there.")
            continue
        data = json.loads(path.read_text(encoding="utf-8"))
        machine = ", ".join(data["environment"][key] for key in ("processor", "Blender"))
        machine += f", {data['environment']['cores']} cores"
        rows += _rows(race, data)
    text = (
        f"Soft shadows at an error in use of {TARGET:g} of the worst of a scene's lamps, "
        "everything counted: reading, maps, trees, samples; of Cycles one render with a light "
        "group for each lamp, light tree on, no bounces, with a Denoise node on each group or "
        "without; its shadow is read in the better of two ways, whose unshadowed render is not "
        "counted ([how](report.md)). All are judged by the same rays at every pixel. Straight "
        "lines between points on logarithmic axes; >: the dearest point does not reach it, <: the "
        "cheapest does. The last columns are times over those of Strata as it is. One run of each "
        "beside much other work on the same two cores: seconds that passed say less than those of "
        f"the CPU. {machine}."
    )
    header = ["scene", "who", "errors tried", "CPU s", "s", "CPU ÷ ours", "s ÷ ours"]
    return "\n\n".join([text, table(header, rows), *missing])


def _folder(race: Race, quick: bool) -> Path:
    return FOLDER / (f"quick_{race.name}" if quick else race.name)


def _rows(race: Race, data: dict) -> list[list[str]]:
    own, rows = None, []
    for (who, curve), points in curves_of(data).items():
        errors = tuple(error for error, _, _ in points)
        seconds, sign = at_target(errors, [tuple(point[n] for point in points) for n in (1, 2)])
        own = own or (seconds if who == OURS else None)
        ratios = (
            [sign + times(each / ours) for each, ours in zip(seconds, own, strict=True)] if own else ["", ""]
        )
        name = "Strata" + ("" if curve == "as the scene has it" else f", {curve.partition('.')[2]}")
        rows.append(
            [
                f"{race.file}, {race.what}",
                name if who == OURS else f"{who}: {curve}",
                f"{max(errors):.3f} to {min(errors):.3f}",
                *(sign + significant(each) for each in seconds),
                *(ratios if curve != "as the scene has it" else ["", ""]),
            ]
        )
    return rows


def curves_of(data: dict) -> dict[tuple[str, str], list[tuple[float, float, float]]]:
    """Of a report, by who and curve: the worst layer's error, CPU seconds, and seconds that passed."""
    curves: dict[tuple[str, str], list[tuple[float, float, float]]] = {}
    for point in data["points"]:
        errors = [each["value"] for each in point["layers"].values() if "value" in each]
        if errors and point["cpu_s"]:
            place = point["who"], point["curve"]
            curves.setdefault(place, []).append((max(errors), point["cpu_s"][1], point["wall_s"][1]))
    return {place: points for place, points in curves.items() if len(points) > 1}


def at_target(errors: tuple[float, ...], costs: list[tuple[float, ...]]) -> tuple[list[float], str]:
    """Seconds of each kind, and what is before them: > of the dearest point, where none reaches the target,
    < of the cheapest, where all do."""
    if min(errors) > TARGET:
        return [max(each) for each in costs], ">"
    if max(errors) <= TARGET:
        return [min(each) for each in costs], "<"
    return [Curve(each, errors).seconds_at(TARGET)[0] for each in costs], ""
