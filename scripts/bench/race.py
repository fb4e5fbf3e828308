"""Section "Error against time": the effect against rays, Embree and Cycles on the benchmark scene."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from strata.addon.report.curve import Curve
from strata.addon.report.rivals.embree_packets import flattened

from . import cycles, embree
from .document import milliseconds, rmse, significant, table, times
from .machine import interleaved
from .methods import Effect, Rays, Surface, surface_of
from .scenes import Case, read
from .truth import Error, Truth, truth_by_rays

RAY_COUNTS = (4, 16, 64)
SETTINGS = {
    "bitmask, 128²": {"resolution": 128},
    "bitmask, 256², 64 samples": {"resolution": 256, "max_samples": 64},
    "bitmask, 256², 256 samples": {"resolution": 256, "max_samples": 256},
    "bitmask, 256²": {"resolution": 256},
    "bitmask, 256², every 2nd pixel": {"resolution": 256, "spacing": 2},
    "bitmask, 256², 128 samples, every 2nd pixel": {"resolution": 256, "max_samples": 128, "spacing": 2},
    "bitmask, 512²": {"resolution": 512},
    "bitmask, 1024²": {"resolution": 1024},
    "bitmask, 1024², every 2nd pixel": {"resolution": 1024, "spacing": 2},
    "bitmask, 2048²": {"resolution": 2048},
    "bitmask, 1024², k = 1": {"resolution": 1024, "layers": 1},
    "bitmask, 1024², k = 2": {"resolution": 1024, "layers": 2},
    "bitmask, 1024², k = 4": {"resolution": 1024, "layers": 4},
    "hybrid, 512²": {"method": "hybrid", "resolution": 512},
    "hybrid, 1024²": {"method": "hybrid", "resolution": 1024},
    "hybrid, 1024², every 2nd pixel": {"method": "hybrid", "resolution": 1024, "spacing": 2},
    "hybrid, 2048²": {"method": "hybrid", "resolution": 2048},
    "area sum, 1024², k = 1": {"method": "area", "resolution": 1024, "layers": 1},
    "area sum, 1024², k = 3": {"method": "area", "resolution": 1024, "layers": 3},
}


@dataclass(frozen=True)
class Scale:
    """How long to measure: `probes` pixels and twice `reference_rays` for the truth, `repeats` interleaved
    runs of each method, Cycles' sample counts, (width, height) or None for the scene's own."""

    probes: int = 20_000
    reference_rays: int = 1024
    repeats: int = 5
    cycles_samples: tuple[int, ...] = (16, 64)
    size: tuple[int, int] | None = None


QUICK = Scale(1000, 256, 1, (1, 2), (240, 135))


@dataclass
class Embree:
    """A rival that is called like the others."""

    case: Case
    surface: Surface
    samples: int
    trace: object  # embree.by_packets or embree.by_binding
    visibility: np.ndarray = field(init=False)

    def __post_init__(self):
        (layer,) = self.case.graph.layers
        self.emitter = self.case.outline.lights[layer.of.index].emitter
        self.triangles = flattened(self.case.arrays, self.case.outline, layer.casters, self.case.eye)

    def __call__(self) -> dict[str, float]:
        found = self.trace(self.triangles, self.surface, self.emitter, self.case.eye, self.samples)
        self.visibility = found.visibility
        return {"build": found.build, "rays": found.trace, "generate": found.generate, "total": found.seconds}


@dataclass(frozen=True)
class Result:
    """One method's median seconds by part, and its error."""

    seconds: dict[str, float]
    error: Error


@dataclass(frozen=True)
class Race:
    """Everything measured, by method name."""

    results: dict[str, Result]
    curves: dict[str, Curve]
    truth: Truth
    embree_agrees: float
    common: dict[str, float]
    case: Case


def run(scene, scale: Scale) -> Race:
    """Measures all of it."""
    case = read(scene, scale.size)
    surface, _ = surface_of(case)
    truth = truth_by_rays(case, surface, scale.probes, scale.reference_rays)
    runs = {f"own rays, {n}": Rays(case, surface, n) for n in RAY_COUNTS}
    runs |= {f"Embree, {n}": Embree(case, surface, n, embree.by_packets) for n in RAY_COUNTS}
    runs["Embree by embreex, 16"] = Embree(case, surface, 16, embree.by_binding)
    runs |= {name: Effect(case, values) for name, values in SETTINGS.items()}
    seconds = interleaved(runs, scale.repeats)
    results = {name: Result(seconds[name], truth.error(runs[name].visibility)) for name in runs}
    common = {name: seconds["bitmask, 1024²"][name] for name in ("geometry", "surface")}
    agrees = _agreement(case, surface, truth, scale)
    results |= _cycles(scene, case, truth, scale)
    curves = {
        rival: _curve(results, rival, counts)
        for rival, counts in (
            ("own rays", RAY_COUNTS),
            ("Embree", RAY_COUNTS),
            ("Cycles", scale.cycles_samples),
        )
    }
    return Race(results, curves, truth, agrees, common, case)


def _agreement(case: Case, surface: Surface, truth: Truth, scale: Scale) -> float:
    """Weighted RMS difference of Embree and the reference at a tenth of its pixels."""
    some = truth.pixels[::10]
    found = Embree(case, surface[some], scale.reference_rays, embree.by_packets)
    found()
    difference, weight = found.visibility - truth.visibility[::10], truth.weight[::10]
    return float(np.sqrt((weight * difference**2).sum() / weight.sum()))


def _cycles(scene, case: Case, truth: Truth, scale: Scale) -> dict[str, Result]:
    results = {}
    (lamp,) = cycles.lamps(scene)
    for samples in scale.cycles_samples:
        found = cycles.shadow(scene, lamp, samples, size=case.graph.shot.size)
        visibility = np.nan_to_num(found.visibility, nan=1.0)
        results[f"Cycles, {samples}"] = Result({"total": found.seconds}, truth.error(visibility))
    return results


def _curve(results: dict[str, Result], rival: str, counts) -> Curve:
    chosen = [results[f"{rival}, {n}"] for n in counts]
    return Curve(tuple(r.seconds["total"] for r in chosen), tuple(r.error.rmse for r in chosen))


def _ratio(race: Race, rival: str, result: Result) -> tuple[float, bool]:
    seconds, within = race.curves[rival].seconds_at(result.error.rmse)
    return seconds / result.seconds["total"], within


def _parts(seconds: dict[str, float]) -> str:
    words = {
        "layered_depth": "map",
        "prepare": "prepare",
        "backproject": "backproject",
        "ray_accelerator": "tree",
        "build": "tree",
        "rays": "rays",
    }
    return " + ".join(f"{words[name]} {milliseconds(s)}" for name, s in seconds.items() if name in words)


def tables(race: Race) -> str:
    """Markdown of the race and its goals."""
    rows = []
    for name, result in race.results.items():
        ratios = []
        for rival in ("own rays", "Embree", "Cycles"):
            ratio, within = _ratio(race, rival, result)
            same = name.startswith(rival)
            ratios.append("" if same else ("" if within else "~") + times(ratio))
        error = result.error
        figures = [rmse(error.rmse), f"{error.bias:+.4f}", f"{error.p99:.3f}", f"{error.largest:.2f}"]
        rows.append([name, *figures, milliseconds(result.seconds["total"]), _parts(result.seconds), *ratios])
    header = ["method", "RMSE", "bias", "p99", "max", "ms", "of which", "own rays ÷", "Embree ÷", "Cycles ÷"]
    truth, size, common = race.truth, race.case.graph.shot.size, race.common
    laying_out = race.results["Embree, 16"].seconds["generate"]
    notes = [
        f"{race.case.outline.triangles:,} triangles, {size[0]}x{size[1]}, one light. "
        f"Truth: {truth.rays} stratified rays at {len(truth.pixels):,} random lit pixels; "
        f"its own noise {rmse(truth.noise)} is taken off. Embree's rays differ from it by "
        f"{rmse(race.embree_agrees)} at a tenth of them, both's noise included.",
        "Common to all and not in the table: "
        f"meshes to the kernels {milliseconds(common['geometry'])} ms, "
        f"camera surface {milliseconds(common['surface'])} ms. Not in the table either: "
        f"laying out 16 rays a pixel for Embree with numpy, {milliseconds(laying_out)} ms.",
        "The last three columns are the rival's time at this method's error over this method's time "
        "(straight lines on logarithmic axes; ~: beyond the rival's measured points).",
    ]
    return "\n\n".join([notes[0], table(header, rows), *notes[1:], _goals(race)])


def _goals(race: Race) -> str:
    def best(method: str, rays: int, rival: str) -> tuple[str, float]:
        limit = race.results[f"own rays, {rays}"].error.rmse
        fit = {
            name: _ratio(race, rival, result)[0]
            for name, result in race.results.items()
            if name.startswith(method) and result.error.rmse <= limit
        }
        name = max(fit, key=fit.get, default="")
        return name, fit.get(name, 0.0)

    rows = []
    for method, rays, rival, goal, stretch in (
        ("bitmask", 16, "own rays", 3.0, None),
        ("bitmask", 16, "Embree", None, 4.0),
        ("bitmask", 16, "Cycles", 50.0, None),
        ("hybrid", 64, "own rays", 1.5, 3.0),
        ("hybrid", 64, "Embree", None, None),
    ):
        name, ratio = best(method, rays, rival)
        measured = f"{times(ratio)} ({name})" if name else "no setting reaches that error"
        wanted = [f"{significant(x)}x" if x else "" for x in (goal, stretch)]
        verdict = "" if goal is None else ("met" if ratio >= goal else "missed")
        verdict = "stretch met" if stretch and ratio >= stretch else verdict
        rows.append(
            [f"{method} at the error of {rays} rays or less, against {rival}", *wanted, measured, verdict]
        )
    return table(["", "goal", "stretch", "measured, rival's time at equal error ÷ ours", ""], rows)
