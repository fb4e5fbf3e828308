"""What scripts that measure in sections take from the command line."""

from __future__ import annotations

import argparse
from collections.abc import Collection


def read_sections(description: str, known: Collection[str]) -> tuple[list[str], bool]:
    """The sections named on the command line, all if none is, and whether it says --quick."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sections", nargs="*", metavar="section", help=f"of {', '.join(known)}; all if none")
    parser.add_argument("--quick", action="store_true", help="tiny settings, nothing written")
    arguments = parser.parse_args()
    if unknown := set(arguments.sections) - set(known):
        parser.error(f"no such section: {', '.join(sorted(unknown))}")
    return arguments.sections or list(known), arguments.quick
