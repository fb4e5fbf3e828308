"""What the panel shows and the operators write: nothing of it is saved with the file."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class PlanRow:
    """One line about a light (or, with no light, about an effect): a layer to come, or why there is none."""

    light: str
    text: str
    kept: bool


@dataclass
class State:
    """`plan_of` and `report_of` are the scenes' session ids, unique until Blender ends, so that no figure of
    one scene or file is ever shown beside another."""

    is_baking: bool = False
    share: float = 0.0
    doing: str = ""
    plan: tuple[PlanRow, ...] = ()
    plan_of: int | None = None
    report: dict[str, Any] = field(default_factory=dict)
    report_of: int | None = None

    def show_report(self, scene: int, report: dict[str, Any]) -> None:
        """The last bake or render of a scene, by its session id. From any thread."""
        self.report, self.report_of = report, scene


STATE = State()
