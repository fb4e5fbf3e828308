"""Names: of the render engine, and of layers so that every EXR reader groups them right."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

ENGINE_ID = "STRATA"  # of the render engine, in Blender's lists and files

LONGEST = 63  # bytes of UTF-8; Blender cuts there
HASH_DIGITS = 6


def layer_name(title: str, light: str = "", taken: Iterable[str] = ()) -> str:
    """`title light` without dots (Blender groups channels by the last two) or a hyphen at the end (its reader
    drops that), at most 63 bytes of UTF-8; a hash of the light's name is added on truncation or where the
    name is taken."""
    full = f"{title} {light}".strip()
    safe = "".join("_" if c == "." or not c.isprintable() else c for c in full)
    safe = safe[:-1] + "_" if safe.endswith("-") else safe
    taken = set(taken)
    if len(safe.encode()) <= LONGEST and safe not in taken:
        return safe
    for salt in range(len(taken) + 1):
        digest = hashlib.blake2b(f"{light}\0{salt}".encode()).hexdigest()[:HASH_DIGITS]
        head = safe.encode()[: LONGEST - HASH_DIGITS - 1].decode(errors="ignore").rstrip()
        if (name := f"{head} {digest}") not in taken:
            return name
    raise AssertionError("more salts than names taken cannot all be taken")
