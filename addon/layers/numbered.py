"""Paths with the number of a frame in them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Placeholder:
    """A path that may carry the frame number, as `####` in its file name."""

    text: str

    @property
    def is_numbered(self) -> bool:
        return "#" in Path(self.text).name

    def path(self, frame: int) -> Path:
        """The last run of `#` becomes the frame number, padded with zeros to the run's length."""
        path = Path(self.text)
        runs = list(re.finditer("#+", path.name))
        if not runs:
            return path
        start, end = runs[-1].span()
        return path.with_name(f"{path.name[:start]}{frame:0{end - start}d}{path.name[end:]}")
