"""Where things are: the repository and the scenes that tests open."""

from __future__ import annotations

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "sample_blends"


def scene_files() -> list[Path]:
    """The sample scenes, and every .blend of the folder that STRATA_SCENES names."""
    found = sorted(SAMPLES.glob("*.blend"))
    if folder := os.environ.get("STRATA_SCENES"):
        others = sorted(Path(folder).glob("*.blend"))
        assert others, f"STRATA_SCENES names a folder without .blend files: {folder}"
        found += others
    return found
