"""What a report has found: points of curves, the best of them, how fast errors fall; as JSON and as CSV."""

from __future__ import annotations

import csv
import io
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from .curve import Order, front, order_of
from .setting import Setting

WORST = "worst layer"
IN_USE = "in use"


@dataclass(frozen=True)
class Spread:
    """Of several runs: the median, the least and the most."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread | None:
        return cls(statistics.median(values), min(values), max(values)) if values else None

    def to_json(self) -> list[float]:
        return [self.low, self.median, self.high]


@dataclass(frozen=True)
class Error:
    """A layer's, with an interval; its upper end is the value's where none is known."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Point:
    """A setting and what all its runs found. `layers`: figures by layer's name, as the ledger has them."""

    setting: Setting
    cpu: Spread | None
    wall: Spread | None
    memory_mb: float | None
    layers: Mapping[str, Mapping[str, Any]]

    def error(self, layer: str) -> Error | None:
        """By the common truth where there is one, else what the bake says of itself. WORST: of those that
        multiply, the one with the largest."""
        if layer == WORST:
            known = [self.error(name) for name, each in self.layers.items() if "value" in each]
            return max(filter(None, known), key=lambda error: error.value, default=None)
        found = self.layers.get(layer, {})
        if "value" not in found:
            found = found.get("reported", {})
        if "value" not in found:
            return None
        low, high = found["ci95"]
        return Error(found["value"], low, found["value"] if high is None else high)


@dataclass(frozen=True)
class Result:
    """`layers`: the scene's, as plain values; `told`: what all runs have in common."""

    told: Mapping[str, Any]
    environment: Mapping[str, str]
    layers: Sequence[Mapping[str, Any]]
    points: Sequence[Point]
    warnings: Sequence[str]

    @classmethod
    def of(cls, told, environment, layers, settings: Iterable[Setting], runs, warnings) -> Result:
        """From a ledger's `runs`."""
        by_key: dict[str, list[dict[str, Any]]] = {}
        for run in runs:
            by_key.setdefault(run["key"], []).append(run)
        points = [_point(setting, by_key[setting.key]) for setting in settings if setting.key in by_key]
        return cls(told, environment, layers, points, warnings)

    @cached_property
    def shown(self) -> list[str]:
        """What has a plot of its own: the worst of several layers, and each."""
        names = [layer["name"] for layer in self.layers]
        measured = [name for name in names if self.curves(name)]
        multiplied = [
            name for name in measured if any("value" in p.layers.get(name, {}) for p in self.points)
        ]
        return [WORST] * (len(multiplied) > 1) + measured

    def curves(self, layer: str) -> dict[tuple[str, str], list[tuple[Point, Error]]]:
        """Points with an error and a time, by who made them and what is alike of them."""
        found: dict[tuple[str, str], list[tuple[Point, Error]]] = {}
        for point in self.points:
            error = point.error(layer)
            if error and point.cpu:
                found.setdefault((point.setting.who, point.setting.curve), []).append((point, error))
        return found

    def front(self, layer: str) -> set[str]:
        """Keys of the settings on Pareto's front, by seconds of all cores."""
        flat = [each for points in self.curves(layer).values() for each in points]
        places = front([point.cpu.median for point, _ in flat], [error.value for _, error in flat])
        return {flat[place][0].setting.key for place in places}

    def orders(self, layer: str) -> dict[tuple[str, str], Order | None]:
        return {
            name: order_of([p.setting.step for p, _ in points], [error.value for _, error in points])
            for name, points in self.curves(layer).items()
        }

    def to_json(self) -> dict[str, Any]:
        return {
            "asked": dict(self.told),
            "environment": dict(self.environment),
            "layers": [dict(layer) for layer in self.layers],
            "points": [_plain(point) for point in self.points],
            "fronts": {layer: sorted(self.front(layer)) for layer in self.shown},
            "orders": [
                {"layer": layer, "who": who, "curve": curve, **vars(order)}
                for layer in self.shown
                for (who, curve), order in self.orders(layer).items()
                if order
            ],
            "warnings": list(self.warnings),
        }

    def to_csv(self) -> str:
        """A row for each layer of each point."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(
            [
                "who",
                "curve",
                "counted",
                "step",
                "samples",
                "layer",
                "error",
                "low",
                "high",
                "bias",
                "p99",
                "reported",
                "method",
                "sampling",
                "model",
                "display",
                "unread",
                "cpu_s",
                "cpu_low",
                "cpu_high",
                "wall_s",
                "wall_low",
                "wall_high",
                "memory_mb",
                "best",
            ]
        )
        fronts = {layer: self.front(layer) for layer in self.shown}
        for point in self.points:
            setting = point.setting
            for name, found in point.layers.items():
                error, reported = point.error(name), found.get("reported", {})
                if error is None:
                    continue
                cells: list[Any] = [setting.who, setting.curve, setting.counted, f"{setting.step:g}"]
                cells += [setting.samples, name, error.value, error.low, error.high]
                cells += [found.get("bias"), found.get("p99"), reported.get("value")]
                cells += [reported.get(part) for part in ("method", "sampling", "model", "display", "unread")]
                for spread in (point.cpu, point.wall):
                    cells += [spread.median, spread.low, spread.high] if spread else [None] * 3
                cells += [point.memory_mb, int(setting.key in fronts.get(name, ()))]
                writer.writerow([f"{cell:.6g}" if isinstance(cell, float) else cell for cell in cells])
        return out.getvalue()


def _point(setting: Setting, runs: Sequence[Mapping[str, Any]]) -> Point:
    costs = [run["cost"] for run in runs if "cost" in run]
    memory = [cost["memory_mb"] for cost in costs if cost["memory_mb"] is not None]
    layers = next((run["layers"] for run in runs if "layers" in run), {})
    spreads = (Spread.of([cost[name] for cost in costs]) for name in ("cpu", "wall"))
    return Point(setting, *spreads, max(memory, default=None), layers)


def _plain(point: Point) -> dict[str, Any]:
    setting = point.setting
    return {
        "who": setting.who,
        "curve": setting.curve,
        "counted": setting.counted,
        "step": setting.step,
        "samples": setting.samples,
        "values": [list(each) for each in setting.values],
        "cpu_s": point.cpu.to_json() if point.cpu else None,
        "wall_s": point.wall.to_json() if point.wall else None,
        "memory_mb": point.memory_mb,
        "layers": point.layers,
    }
