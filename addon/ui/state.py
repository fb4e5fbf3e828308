"""What the panels show and the operators write: nothing of it is saved with the file."""

from __future__ import annotations

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
    plans: dict[int, tuple[PlanRow, ...]] = field(default_factory=dict)
    memory: dict[int, Any] = field(default_factory=dict)
    reports: dict[int, dict[str, Any]] = field(default_factory=dict)
    made: dict[int, Made] = field(default_factory=dict)
    marks: dict[int, dict[str, list[Mark]]] = field(default_factory=dict)
    reports_shown: int = 0  # counts up, so that a picture knows that it is old

    def show_plan(self, scene: int, graph, memory=None) -> None:
        """Of a `core.graph.Graph`, and what baking it takes, a `core.memory.MemoryEstimate`."""
        self.memory.pop(scene, None)
        if memory and graph.layers:
            self.memory[scene] = memory
        kept = [PlanRow(layer.effect, layer.light, layer.name) for layer in graph.layers if layer.effect]
        left_out = [PlanRow(entry.effect, entry.light, entry.what, entry.reason) for entry in graph.left_out]
        self.plans[scene] = (*kept, *left_out)

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
        for shown in (self.plans, self.memory, self.reports, self.made, self.marks):
            shown.clear()


STATE = State()
