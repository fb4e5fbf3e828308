"""Aligned text for a terminal: names may be of any script, lines have a limit."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

WIDTH = 110
LONGEST_CELL = 48


def clean(text: str) -> str:
    """Without line breaks, control characters and halves of characters, which no terminal can show."""
    return "".join(character if character.isprintable() else "?" for character in text)


def width_of(text: str) -> int:
    """Columns that a terminal takes for the text: two for a wide character, none for a combining one."""
    return sum(
        0 if unicodedata.combining(character) else 2 if unicodedata.east_asian_width(character) in "WF" else 1
        for character in text
    )


def cut(text: str, limit: int) -> str:
    """The text in at most `limit` columns."""
    text = clean(text)
    if width_of(text) <= limit:
        return text
    while width_of(text) > limit - 3:
        text = text[:-1]
    return text + "..."


def heading(text: str) -> str:
    return cut(text, WIDTH)


def columns(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A table; the first column and those of words are flush left, numbers flush right. Where it gets too
    wide, the widest column gives way."""
    cells = [list(titles), *([clean(cell) for cell in row] for row in rows)]
    widths = [min(max(width_of(row[i]) for row in cells), LONGEST_CELL) for i in range(len(titles))]
    gap = 2
    while sum(widths) + gap * (len(widths) - 1) > WIDTH:
        widths[widths.index(max(widths))] -= 1
    numeric = [
        all(_is_number(row[i]) for row in cells[1:] if row[i]) and bool(rows) for i in range(len(titles))
    ]
    lines = []
    for row in cells:
        padded = []
        for text, width, right in zip(row, widths, numeric, strict=True):
            text = cut(text, width)
            space = " " * (width - width_of(text))
            padded.append(space + text if right else text + space)
        lines.append((" " * gap).join(padded).rstrip())
    return lines


def _is_number(text: str) -> bool:
    text = text.removeprefix("below ").removesuffix("%")
    return text.replace(".", "", 1).replace("-", "", 1).isdigit()


def wrapped(text: str, lead: str) -> list[str]:
    """`lead` and `text` in lines of at most WIDTH, the later ones indented."""
    lines, line = [], cut(lead, WIDTH // 2)
    if lead.endswith(" ") and not line.endswith(" "):
        line += " "
    indent = " " * min(width_of(line), 9)
    empty = True
    for word in clean(text).split():
        word = cut(word, WIDTH - 12)
        if line.strip() and width_of(line) + (not empty) + width_of(word) > WIDTH:
            lines.append(line.rstrip())
            line, empty = indent, True
        line += word if empty else f" {word}"
        empty = False
    return [*lines, line.rstrip()]
