"""What a report was made on."""

from __future__ import annotations

import os
import platform
from pathlib import Path

import bpy
import numpy as np

from ..core.version import VERSION

WIDTHS = {"avx512f": "AVX-512", "avx2": "AVX2"}


def environment() -> dict[str, str]:
    """In words, without a date."""
    return {
        "processor": processor(),
        "cores": str(os.cpu_count()),
        "system": platform.system(),
        "Python": platform.python_version(),
        "Blender": bpy.app.version_string,
        "NumPy": np.__version__,
        "Strata": VERSION,
    }


def processor() -> str:
    """Its model, and the widest instructions that the kernels know."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    fields = dict((part.strip() for part in line.split(":", 1)) for line in lines if ":" in line)
    flags = fields.get("flags", "").split()
    width = next((name for flag, name in WIDTHS.items() if flag in flags), "")
    words = [fields.get("model name", platform.machine()), width]
    if "model" in fields:
        words.append(f"model {fields['model']} stepping {fields.get('stepping')}")
    return ", ".join(filter(None, words))
