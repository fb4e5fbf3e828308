"""Names: of the render engine, and of layers so that every EXR reader groups them right."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Sequence

MOST_NAMED = 3  # of things that are told of together
MOST_FRAMES_NAMED = 10
ENGINE_ID = "STRATA"  # of the render engine, in Blender's lists and files

LONGEST = 63  # bytes of UTF-8; Blender cuts there
LONGEST_TITLE = 18  # bytes, of a kind of layer that each lamp has
LONGEST_LAMP = LONGEST - LONGEST_TITLE - 1
ERROR = "Error"
HASH_DIGITS = 8  # a street of thousands of lamps that begin alike has one clash in some hundreds of files


def layer_name(title: str, lamp: str = "") -> str:
    """A layer's name; `lamp` is a lamp's pass name, empty for a layer of no one lamp."""
    return f"{title} {lamp}".strip()


def pass_safe(text: str) -> str:
    """`text` without dots (Blender groups channels by the last two), without what is no printable character,
    and without a hyphen at the end (Blender's reader drops it)."""
    safe = "".join("_" if c == "." or not c.isprintable() else c for c in text).strip()
    return safe[:-1] + "_" if safe.endswith("-") else safe


def is_short(safe: str) -> bool:
    """Whether it can be a lamp's pass name without being cut."""
    return len(safe.encode()) <= LONGEST_LAMP


def hashed(safe: str, key: str, longest: int = LONGEST_LAMP) -> str:
    """As much of `safe` as fits into `longest` bytes, those of a lamp's pass name, and a hash of `key`."""
    digest = hashlib.blake2b(key.encode(errors="backslashreplace")).hexdigest()[:HASH_DIGITS]
    head = safe.encode()[: longest - HASH_DIGITS - 1].decode(errors="ignore").rstrip()
    return f"{head} {digest}".strip()


def lamp_pass_name(name: str, key: str) -> str:
    """Of a lamp that no other is mistaken for."""
    safe = pass_safe(name)
    return safe if is_short(safe) else hashed(safe, key)


def error_name(layer: str, layers: Collection[str]) -> str:
    """Of the error image of a layer, which is no name of `layers`: a lamp may be called `Key Error`."""
    name = f"{layer} {ERROR}"
    if len(name.encode()) <= LONGEST and name not in layers:
        return name
    return f"{hashed(layer, layer, LONGEST - len(ERROR) - 1)} {ERROR}"


def named_some(names: Sequence[str]) -> str:
    """`'a', 'b', 'c' and 4 more`, for a person."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(f"'{name}'" for name in names[:MOST_NAMED]) + more


def some_frames(frames: Sequence[int]) -> str:
    """`1, 2, 3, ...`, for a person."""
    more = ", ..." if len(frames) > MOST_FRAMES_NAMED else ""
    return ", ".join(map(str, frames[:MOST_FRAMES_NAMED])) + more
