"""What Blender has baked, by what it hangs on: in memory, and in a folder of the user's cache."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from pathlib import Path

import numpy as np

MOST_MEMORY = 1 << 30
MOST_ON_DISK = 4 << 30
FOLDER_VARIABLE = "STRATA_CACHE"
"""Of the environment: a folder to keep it in instead; empty for none."""


def cache_folder() -> Path | None:
    """The user's own for caches; None where there is to be none."""
    if (given := os.environ.get(FOLDER_VARIABLE)) is not None:
        return Path(given) if given else None
    try:
        if sys.platform == "win32":
            base = os.environ.get("LOCALAPPDATA") or str(Path.home() / "AppData" / "Local")
        elif sys.platform == "darwin":
            base = str(Path.home() / "Library" / "Caches")
        else:
            base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    except RuntimeError:  # a user without a home
        return None
    return Path(base) / "strata" / "baked"


class Store:
    """Arrays (H, W, channels) f32 by keys that are names of files. Nothing that goes wrong with the folder
    stops anything: `problem` then says in one line what is the matter, empty otherwise."""

    def __init__(self, folder: Path | None, most_memory: int = MOST_MEMORY, most_on_disk: int = MOST_ON_DISK):
        self.folder = folder
        self.problem = ""
        self.version = 0  # counts up with what is put in
        self._most_memory, self._most_on_disk = most_memory, most_on_disk
        self._known: dict[str, np.ndarray] = {}  # what was asked for longest ago first

    def has(self, key: str) -> bool:
        """Whether it seems to be there, without a look at it."""
        return key in self._known or (self.folder is not None and self._path(key).exists())

    def get(self, key: str) -> np.ndarray | None:
        if key in self._known:
            self._known[key] = values = self._known.pop(key)
            return values
        values = self._read(key)
        if values is not None:
            self._remember(key, values)
        return values

    def put(self, key: str, values: np.ndarray) -> None:
        self.version += 1
        self._remember(key, values)
        if self.folder is None:
            return
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._make_room(values.nbytes)
            descriptor, beside = tempfile.mkstemp(prefix=".", suffix=".part", dir=self.folder)
            try:
                with os.fdopen(descriptor, "wb") as file:
                    np.save(file, values, allow_pickle=False)
                os.replace(beside, self._path(key))
                self.problem = ""
            except BaseException:
                with contextlib.suppress(OSError):
                    os.unlink(beside)
                raise
        except OSError as error:
            self.problem = (
                f"what Blender bakes is kept in memory only: '{self.folder}' cannot be written to "
                f"({error.strerror or error})"
            )

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.npy"

    def _read(self, key: str) -> np.ndarray | None:
        if self.folder is None:
            return None
        try:
            values = np.load(self._path(key), allow_pickle=False)
        except (OSError, ValueError, EOFError):  # none, or not whole
            return None
        with contextlib.suppress(OSError):
            os.utime(self._path(key))  # what is used last is thrown away last
        is_sound = values.ndim == 3 and values.dtype == np.float32 and np.isfinite(values).all()
        return values if is_sound and values.size else None

    def _remember(self, key: str, values: np.ndarray) -> None:
        self._known[key] = values
        held = sum(each.nbytes for each in self._known.values())
        while held > self._most_memory and len(self._known) > 1:
            held -= self._known.pop(next(iter(self._known))).nbytes

    def _make_room(self, nbytes: int) -> None:
        """Throws away what was used longest ago."""
        files = []
        for each in self.folder.glob("*.npy"):
            with contextlib.suppress(OSError):  # thrown away by another Blender meanwhile
                files.append((each.stat(), each))
        held = nbytes + sum(stat.st_size for stat, _ in files)
        for stat, each in sorted(files, key=lambda pair: pair[0].st_mtime):
            if held <= self._most_on_disk:
                break
            with contextlib.suppress(OSError):
                each.unlink()
                held -= stat.st_size


STORE = Store(cache_folder())
