"""docs/effects/<effect>.md, from what the effects declare; `make setup` writes them."""

from __future__ import annotations

import inspect
from importlib import import_module
from pathlib import Path

from strata.addon.core.effect import Effect
from strata.addon.core.graph import Step
from strata.addon.core.params import Colour, ParamSpec, plain
from strata.addon.core.ramp import Ramp
from strata.addon.core.roles import Subject
from strata.addon.effects.registry import EFFECTS
from strata.addon.measure.verdict import off_by

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "effects"


def page(effect: Effect) -> str:
    """The page of one effect, in Markdown."""
    return "\n".join(
        [
            f"# {effect.title} (`{effect.id}`)",
            "",
            f"{effect.doc}.",
            "",
            f"Source: {effect.source}.",
            *_notes(effect),
            "",
            "<!-- Written by `make setup` from the effect's declaration: change that. -->",
            "",
            "## Layers",
            "",
            *_table(["Layer", "Channels", "Made for", "Error", "Meaning"], map(_layer_row, effect.layers)),
            "",
            "## Parameters",
            "",
            f"In a shell `--set {effect.id}.<name>=<value>`, in Python `scene.strata.{effect.id}.<name>`.",
            "",
            *_table(["Name", "In the panel", "Default", "Range", "Unit", "Trades time for error", "Meaning"],
                    map(_parameter_row, effect.params.specs())),
            "",
            "## Steps",
            "",
            *_table(["Step", "CPU", "GPU"], map(_step_row, steps_of(effect))),
            "",
        ]
    )  # fmt: skip


def _notes(effect: Effect) -> list[str]:
    """The link to what the effect's author wrote by hand."""
    notes = f"addon/effects/{effect.id}/README.md"
    if not (FOLDER.parents[1] / notes).exists():
        return []
    return [f"What it approximates, where it fails and how that is tested: [{notes}](../../{notes})."]


def steps_of(effect: Effect) -> list[Step]:
    """The steps that the effect declares itself, by name."""
    module = import_module(f"strata.addon.effects.{effect.id}.steps")
    return sorted((v for _, v in inspect.getmembers(module) if isinstance(v, Step)), key=lambda s: s.name)


def _table(head: list[str], rows) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines]


def _layer_row(kind) -> list[str]:
    name = f"{kind.title} *light*" if kind.of is Subject.LAMP else kind.title
    light = kind.of.value if kind.of is Subject.LAMP else ""
    error = off_by(kind.score.metric, "a share", light) if kind.score else "not measured"
    return [name, kind.channels, kind.of.value, error, kind.doc]


def _parameter_row(spec: ParamSpec) -> list[str]:
    default = str(spec.default) if spec.kind in (Colour, Ramp) else plain(spec.default)
    accepted = ", ".join(spec.choices)
    if spec.hard:
        accepted = f"{spec.hard[0]:g} to {spec.hard[1]:g}"
        if spec.soft != spec.hard:
            accepted += f" (slider {spec.soft[0]:g} to {spec.soft[1]:g})"
    shown = f"{default:g}" if isinstance(default, float) else str(default).lower()
    if spec.unlimited:
        accepted += f"; {spec.hard[1]:g} is {spec.unlimited.lower()}"
    meaning = spec.doc
    if used_when := spec.used_when.words("`{}`".format):
        meaning += f". Counts where {used_when}"
    label = f"{spec.group.title}: {spec.label}" if spec.group.title else spec.label
    dearer = "yes" if spec.trades_time else ""
    return [f"`{spec.name}`", label, shown, accepted, spec.unit, dearer, meaning]


def _step_row(step: Step) -> list[str]:
    hole = f"no: {step.hole}" if step.hole else "no"
    return [f"`{step.name}`", *("yes" if twin else hole for twin in (step.cpu, step.gpu))]


def main() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    for path in FOLDER.glob("*.md"):
        path.unlink()
    for effect in EFFECTS:
        (FOLDER / f"{effect.id}.md").write_text(page(effect), encoding="utf-8")


if __name__ == "__main__":
    main()
