"""Runs a module of this repository inside a Blender, whose Python need not know of it.

blender ... --python scripts/in_blender.py -- strata.tests.window.drive WORD ...
"""

from __future__ import annotations

import runpy
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    """The module finds its own words behind `--`, as if Blender had been given it."""
    spec = spec_from_file_location("strata", ROOT / "__init__.py", submodule_search_locations=[str(ROOT)])
    sys.modules["strata"] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules["strata"])
    runpy.run_module(sys.argv.pop(sys.argv.index("--") + 1), run_name="__main__")


if __name__ == "__main__":
    main()
