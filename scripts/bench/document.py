"""Markdown that a script rewrites: tables, and blocks between two marks in a document that people write."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table; numbers and what looks like them line up at the right."""
    rows = [[str(cell) for cell in row] for row in rows]
    numeric = [
        all(not cell or cell.lstrip("<>~-+.").startswith(tuple("0123456789")) for cell in column)
        for column in zip(*rows, strict=True)
    ] or [False] * len(header)
    rule = ["---:" if right else "---" for right in numeric]
    return "\n".join("| " + " | ".join(row) + " |" for row in [header, rule, *rows])


def significant(number: float, digits: int = 2) -> str:
    """`digits` significant digits, never as a power of ten."""
    if number == 0.0 or number != number:
        return "0" if number == 0.0 else "n/a"
    text = f"{number:.{digits}g}"
    return f"{float(text):,.0f}" if "e" in text or abs(number) >= 10**digits else text


def milliseconds(seconds: float) -> str:
    return significant(1e3 * seconds, 3)


def rmse(error: float | None) -> str:
    return "not known" if error is None else f"{error:.4f}"


def times(ratio: float) -> str:
    """A ratio, e.g. "3.4x"."""
    return f"{significant(ratio)}x"


def write_block(path: Path, name: str, text: str) -> None:
    """Replaces what is between `<!-- name -->` and `<!-- /name -->`. Raises ValueError if it is not there."""
    opening, closing = f"<!-- {name} -->", f"<!-- /{name} -->"
    document = path.read_text(encoding="utf-8")
    if document.count(opening) != 1 or document.count(closing) != 1:
        raise ValueError(f"{path}: no single block '{name}'")
    before, rest = document.split(opening)
    _, after = rest.split(closing)
    path.write_text(f"{before}{opening}\n\n{text.strip()}\n\n{closing}{after}", encoding="utf-8")
