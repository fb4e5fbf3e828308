"""What the panels show and the operators write: nothing of it is saved with the file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..measure.report import LayerError, error_of

MOST_MARKS = 24  # of a layer in the plot of errors


@dataclass(frozen=True)
class PlanRow:
    """One line about a light (or, with no light, about an effect, by its id): a layer to come, or what there
    is none of, and why."""

    effect: str
    light: str
    what: str
    reason: str = ""

    @property
    def kept(self) -> bool:
        return not self.reason


@dataclass(frozen=True)
class Mark:
    """What a layer cost and how wrong it was, in one bake."""

    seconds: float
    error: float


@dataclass(frozen=True)
class Made:
    """What the last bake of a scene left behind."""

    view_layer: str
    file: Path | None
    has_images: bool


@dataclass
class State:
    """Scenes go by their session ids, unique until Blender ends, so that no figure of one scene or file is
    ever shown beside another."""

    is_baking: bool = False
    share: float = 0.0
    doing: str = ""
    is_cancelled: bool = False  # by the panel's button
    is_reporting: bool = False  # another Blender, error against time
    report_doing: str = ""
    is_report_cancelled: bool = False
    plans: dict[int, tuple[PlanRow, ...]] = field(default_factory=dict)
    warnings: dict[int, tuple[str, ...]] = field(default_factory=dict)
    outdated: set[int] = field(default_factory=set)  # scenes that have changed, and take long to read again
    memory: dict[int, Any] = field(default_factory=dict)
    baked: dict[int, tuple[str, ...]] = field(default_factory=dict)  # of materials, by Blender
    expected_s: dict[int, float] = field(default_factory=dict)  # of the next bake
    reports: dict[int, dict[str, Any]] = field(default_factory=dict)
    made: dict[int, Made] = field(default_factory=dict)
    marks: dict[int, dict[str, list[Mark]]] = field(default_factory=dict)
    reports_shown: int = 0  # counts up, so that a picture knows that it is old

    def show_plan(
        self,
        scene: int,
        graph,
        memory=None,
        warnings: Iterable[str] | None = None,
        baked: Iterable[str] = (),
        expected_s: float | None = None,
    ) -> None:
        """Of a `core.graph.Graph`, and what baking it takes, a `core.memory.MemoryEstimate`. `warnings` of
        reading the scene and `expected_s`, what a bake will take; None where they are as before. `baked` are
        lines about materials."""
        self.outdated.discard(scene)
        self.memory.pop(scene, None)
        self.baked[scene] = tuple(baked)
        if memory and graph.layers:
            self.memory[scene] = memory
        if expected_s is not None:
            self.expected_s[scene] = expected_s
        if warnings is not None:
            shortage = [memory.shortage] if memory and memory.shortage else []
            self.warnings[scene] = (*warnings, *shortage)
        kept = [PlanRow(layer.effect, layer.light, layer.name) for layer in graph.layers if layer.effect]
        left_out = [PlanRow(entry.effect, entry.light, entry.what, entry.reason) for entry in graph.left_out]
        self.plans[scene] = (*kept, *left_out)

    def show_no_plan(self, scene: int, why: str) -> None:
        """In one line."""
        self.outdated.discard(scene)
        self.plans[scene], self.warnings[scene] = (), (why,)
        self.memory.pop(scene, None)
        self.expected_s.pop(scene, None)

    def shown(self, scene: int) -> tuple:
        """All that is said of a scene before a bake: equal while nothing of it has to be drawn again."""
        told = (each.get(scene) for each in (self.plans, self.warnings, self.memory, self.expected_s))
        return (*told, scene in self.outdated)

    def idle_reason(self, scene: int, effect: str) -> str:
        """Why an effect that is switched on has no layer here; empty where it has one, or no plan tells."""
        rows = [row for row in self.plans.get(scene, ()) if row.effect == effect]
        if any(row.kept for row in rows):
            return ""
        reasons = list(dict.fromkeys(row.reason for row in rows if not row.light))
        return reasons[0] if reasons else "no light needs it" if rows else ""

    def show_report(self, scene: int, report: dict[str, Any], made: Made | None = None) -> None:
        """The last bake or render of a scene; `made` is a bake's. From any thread."""
        self.made.pop(scene, None)
        if made:
            self.made[scene] = made
        self.reports[scene] = report
        marks = self.marks.setdefault(scene, {})
        for layer in report["layers"]:
            if isinstance(error := error_of(layer.get("error")), LayerError):
                mark = Mark(layer["seconds"], error.value)
                marks[layer["name"]] = [*marks.get(layer["name"], ()), mark][-MOST_MARKS:]
        self.reports_shown += 1

    def clear(self) -> None:
        shown_all = (
            self.plans,
            self.warnings,
            self.outdated,
            self.memory,
            self.expected_s,
            self.reports,
            self.made,
            self.marks,
        )
        for shown in shown_all:
            shown.clear()


STATE = State()
