"""Figures of many scenes, kept in a file as lines of JSON, so that a run that was stopped goes on, on any
machine: delete the file, or a scene's lines, to begin anew."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any


def kept_lines[Scene](
    scenes: Sequence[Scene], kept: Path, found_of: Callable[[Scene], Iterable[dict[str, Any]]]
) -> list[dict[str, Any]]:
    """What `found_of(scene)` says of each, one line a figure, each with its "scene": of those that `kept` has
    it is not asked again. One that fails is told and left out."""
    lines = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    done = {line["scene"] for line in lines}
    kept.parent.mkdir(parents=True, exist_ok=True)
    for scene in scenes:
        if scene in done:
            continue
        try:
            new = [_rounded(line) for line in found_of(scene)]
        except Exception as error:
            print(f"scene {scene} failed: {error!r}", file=sys.stderr)
            continue
        with kept.open("a") as file:  # a line that has nothing but the scene: there is nothing to find
            file.write("".join(json.dumps(each) + "\n" for each in new or [{"scene": scene}]))
        lines += new
    return [line for line in lines if len(line) > 1 and line["scene"] in scenes]


def _rounded(line: dict[str, Any]) -> dict[str, Any]:
    """To as many digits as anybody reads."""
    return {name: float(f"{it:.5g}") if isinstance(it, float) else it for name, it in line.items()}
