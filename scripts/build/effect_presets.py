"""The presets that Blender lists, from what the effects declare; `make setup` writes them."""

from __future__ import annotations

import shutil
from pathlib import Path

from strata.addon.core.effect import Effect
from strata.addon.effects.registry import EFFECTS

FOLDER = Path(__file__).resolve().parents[2] / "addon" / "ui" / "presets"


def presets() -> dict[str, str]:
    """What each file holds, by its path below FOLDER."""
    return {
        f"strata/{effect.id}/{name}.py": _text(effect, name) for effect in EFFECTS for name in effect.presets
    }


def _text(effect: Effect, name: str) -> str:
    """As Blender's own operator writes presets; every value, so that nothing of an earlier one stays."""
    values = effect.params.checked(effect.id, effect.presets[name]).as_dict()
    lines = ["import bpy", "", f"settings = bpy.context.scene.strata.{effect.id}", ""]
    for spec in effect.params.specs():
        if spec.is_of_file:
            continue
        value = values[spec.name]
        lines.append(f"settings.{spec.name} = {repr(value).replace(chr(39), chr(34))}")
    return "\n".join([*lines, ""])


def write(folder: Path = FOLDER) -> None:
    """All of them anew; nothing else stays in `folder`."""
    shutil.rmtree(folder, ignore_errors=True)
    for name, text in presets().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write()
