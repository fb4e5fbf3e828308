"""`python -m strata`: the command line outside a Blender binary."""

from __future__ import annotations

import sys


def run() -> int:
    """One command; the exit code. What goes wrong while modules load is one line too."""
    try:
        from .ops.cli import main

        return main()
    except KeyboardInterrupt:  # while modules load, and a second one while the first is being obeyed
        return 130
    except BaseException as error:
        from .addon.core.errors import one_line

        print(f"strata: {one_line(error)}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(run())
