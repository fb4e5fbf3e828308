"""What a report has found so far, a line a run, so that one that was stopped goes on."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from ..core.errors import StrataError
from ..layers.files import check_writable

NAME = "runs.jsonl"


class Ledger:
    """`asked` is what all runs have in common, as plain values. Raises StrataError where the folder holds
    runs of something else, or cannot be written."""

    def __init__(self, folder: Path, asked: dict[str, Any]):
        self.path = folder / NAME
        self.runs: list[dict[str, Any]] = []
        told = json.dumps(asked, sort_keys=True).encode()
        # What these runs share, and no others.
        self.kept = folder / "kept" / hashlib.sha256(told).hexdigest()[:12]
        check_writable(self.path)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lines = self.path.read_text(encoding="utf-8").splitlines() if self.path.exists() else []
        except OSError as error:
            raise StrataError(f"cannot write to {folder}: {error.strerror or error}") from None
        found = [_read(line) for line in lines]
        if found:
            differs = sorted(key for key in asked if found[0].get(key) != asked[key])
            if differs:
                raise StrataError(
                    f"{folder} holds another report ({', '.join(differs)} differ): choose another folder, or "
                    f"delete {self.path}"
                )
        self.kept.mkdir(parents=True, exist_ok=True)
        self.runs = [line for line in found[1:] if line]  # the last may be cut off
        self._write("w", [asked, *self.runs])

    def add(self, run: dict[str, Any]) -> None:
        self.runs.append(run)
        self._write("a", [run])

    def has(self, key: str, number: int) -> bool:
        """Whether it ran; one that failed may be tried again."""
        return any(run["key"] == key and run["round"] == number and "failed" not in run for run in self.runs)

    def _write(self, mode: str, lines: list[dict[str, Any]]) -> None:
        text = "".join(json.dumps(line, ensure_ascii=False, allow_nan=False) + "\n" for line in lines)
        try:
            with open(self.path, mode, encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise StrataError(f"cannot write {self.path}: {error.strerror or error}") from None


def _read(line: str) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
