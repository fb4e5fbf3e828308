"""How fast steps are on this machine, kept in the user's cache, so that the next Blender knows it before its
first bake. It changes what is expected, never what is made; where there is no folder, or it is read-only,
nothing is kept."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from typing import Any

from .core import progress
from .core.errors import StrataError
from .layers.files import replaced
from .scene.exact.store import cache_folder

LEAST_SECONDS = 1.0
"""Shorter bakes tell little: most of their time is not in pixels and triangles."""
NAME = "seconds.json"
AUTO = "auto"


_chosen: list[str] = []
"""What `auto` chose last in this process."""


def recall_speeds(backend: str) -> str:
    """What is kept of a device; of `auto`, of what it chose last, here or in an earlier process. Returns
    which that is."""
    kept, device = _kept(), backend
    if backend == AUTO:
        device = _chosen[-1] if _chosen else str(kept.get(AUTO, "cpu"))
    progress.recall(device, _checked(kept.get(device)))
    return device


def keep_speeds(backend: str, device: str, seconds: float) -> None:
    """After a bake of so many seconds on `device`, which `backend` asked for or left open."""
    if backend == AUTO:
        _chosen[:] = [device]
    folder = cache_folder()
    if folder is None or seconds < LEAST_SECONDS:
        return
    learnt = {_key(*kind): float(f"{each:.4g}") for kind, each in progress.learnt(device).items()}
    kept = {**_kept(), device: learnt}
    if backend == AUTO:
        kept[AUTO] = device
    with suppress(StrataError), replaced(folder / NAME) as stream:
        stream.write(json.dumps(kept, indent=1).encode())


def _kept() -> dict[str, Any]:
    folder = cache_folder()
    try:
        kept = json.loads((folder / NAME).read_text(encoding="utf-8")) if folder else {}
    except (OSError, ValueError):
        return {}
    return kept if isinstance(kept, dict) else {}


def _checked(table: Any) -> dict[tuple[str, bool], float]:
    """Whatever the file may hold."""
    found = {}
    for key, seconds in table.items() if isinstance(table, dict) else ():
        name, _, rate = key.rpartition(" ")
        if isinstance(seconds, float | int) and math.isfinite(seconds) and seconds >= 0.0:
            found[name, rate == "pixel"] = float(seconds)
    return found


def _key(name: str, is_at_surface: bool) -> str:
    return f"{name} {'pixel' if is_at_surface else 'run'}"
