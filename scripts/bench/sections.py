"""What scripts that measure in sections take from the command line."""

from __future__ import annotations

import argparse
from collections.abc import Collection


def read_sections(
    description: str, known: Collection[str], long: Collection[str] = ()
) -> tuple[list[str], bool]:
    """The sections named on the command line, if none is all but the `long` ones, and whether it says
    --quick."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "sections",
        nargs="*",
        metavar="section",
        help=f"of {', '.join(known)}; if none all" + (f" but {', '.join(long)}" if long else ""),
    )
    parser.add_argument("--quick", action="store_true", help="tiny settings, nothing written")
    arguments = parser.parse_args()
    if unknown := set(arguments.sections) - set(known):
        parser.error(f"no such section: {', '.join(sorted(unknown))}")
    return arguments.sections or [name for name in known if name not in long], arguments.quick
